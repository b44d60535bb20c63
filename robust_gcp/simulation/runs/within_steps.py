"""The motion within a step, to the order of the stepper: for outputs and events between its ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...dynamics.equations import Evaluation
from ...kernel.simulation.batch import Outputs
from ...maps.explicit import ExplicitMap
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..trajectories.interpolant import Interpolant
from .crossings import coordinates
from .steppers import SolverStep


class End(NamedTuple):
    """The motion at an end of a step; of the work done, (1,), or none, and its rate."""

    q: Array
    v: Array
    a: Array
    work: Array
    power: float

    @classmethod
    def of(cls, now: Evaluation, x: Array) -> End:
        """By the evaluation there, and the state."""
        return cls(now.point.q, now.v, now.a, x[2 * len(now.ydd) :], now.power)

    @classmethod
    def of_row(cls, mechanism: Mechanism, rows: Outputs, k: int) -> End:
        """By a row that has a and, where something does work, τ; see `Evaluation` for its power."""
        assert rows.a is not None
        q, v = rows.q[k], rows.v[k]
        if rows.work is None or rows.tau is None:
            return cls(q, v, rows.a[k], np.zeros(0), 0.0)
        # τ of a row holds the springs and dampers of the mechanism too, whose power is told apart
        tau, power = (
            (mechanism.tree.zero, 0.0) if mechanism.applied is None else mechanism.applied.torque_at(q, v)
        )
        return cls(q, v, rows.a[k], rows.work[k : k + 1], float((rows.tau[k] - tau) @ v) + power)


class FixedStep:
    """A step of RK4 or a tableau: the polynomials through q, v and a at its ends.

    Parameters
    ----------
    mechanism : Mechanism
    explicit : ExplicitMap
        In the chart of the step's end.
    times : (float, float)
    before, after : End
    """

    def __init__(
        self,
        mechanism: Mechanism,
        explicit: ExplicitMap,
        times: tuple[float, float],
        before: End,
        after: End,
    ) -> None:
        self._mechanism, self._explicit, self._ends = mechanism, explicit, (before, after)
        self.t0, self.t1 = times
        q, v, a = (np.array(pair) for pair in zip(before[:3], after[:3], strict=True))
        self._motion = Interpolant(mechanism.tree, np.array(times), q, v, a)

    def state(self, t: float) -> tuple[Array, Array]:
        """q and v; the loops are closed to the order of the stepper."""
        q, v, _ = self._motion(np.array([t]))
        return q[0], v[0]

    def x(self, t: float) -> Array:
        """The state at a time of the step: y and u, and the work done by the cubic through its power."""
        (w0, p0), (w1, p1) = (end[3:] for end in self._ends)
        h = self.t1 - self.t0
        s = (t - self.t0) / h
        # its rate is all that is known besides: O(h⁴), where q by its accelerations has O(h⁶)
        work = w0 + s * (
            h * p0 + s * (3.0 * (w1 - w0) - h * (2.0 * p0 + p1) + s * (h * (p0 + p1) - 2.0 * (w1 - w0)))
        )
        return np.concatenate([*coordinates(self._explicit, self._mechanism, *self.state(t)), work])


class DenseStep:
    """A step of a solver of scipy's, by its dense output; to be asked before the next one.

    Parameters
    ----------
    explicit : ExplicitMap
        Gives q and v, on the mode that it follows.
    m : int
    step : SolverStep
    near : callable (x)
        Told of each state before the map is asked for it.
    """

    def __init__(
        self, explicit: ExplicitMap, m: int, step: SolverStep, near: Callable[[Array], None] = lambda x: None
    ) -> None:
        self._explicit, self._m, self._step, self._near = explicit, m, step, near
        self.t0, self.t1 = step.t0, step.t1

    def state(self, t: float) -> tuple[Array, Array]:
        """q and v, loops closed."""
        x = self.x(t)
        point = self._explicit.point_at(x[: self._m], x[self._m : 2 * self._m])
        return point.q, point.G.dot(point.ydot)

    def x(self, t: float) -> Array:
        """The state at a time of the step."""
        x = self._step.between(t)
        self._near(x)
        return x
