"""A knot of a discretised motion: where it was evaluated last on its mode, and the step of RK4 from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..dynamics.derivatives import PointDerivatives
from ..dynamics.discrete import differentiated_step
from ..dynamics.problem import Problem, initial_value_problem
from ..kernel.derivatives.derivations import derivation, left_to_python
from ..maps.explicit import Point
from ..maps.grouped import GroupMap, joined
from ..mechanism.coordinates.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..simulation.derivatives.accelerations import learned
from ..simulation.runs.steppers import rk4_step
from .mode_points import Followed


@dataclass
class Taken:
    """A step that was taken, from x under τ over h: its end, and its derivatives where they are known."""

    x: Array
    tau: Array
    h: float
    end: Array
    A: Array | None = None
    B: Array | None = None


class Knot:
    """An explicit map has several values at one y: a knot's own stays on its mode.

    Parameters
    ----------
    mechanism : Mechanism
    q0, mode : array_like, optional
        Where the map begins, and on which mode: as in `simulate`.
    places : ndarray of int
        Where the numbers of a state x = (numbers, u) are in q.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        q0: ArrayLike | None,
        mode: ArrayLike | None,
        places: NDArray[np.int64],
    ) -> None:
        self._mechanism, self._places, self._groups = mechanism, places, groups_of(mechanism)
        self._tau: Array = np.zeros(mechanism.nv)
        self._motion: Problem = initial_value_problem(mechanism, q0, None, mode, lambda t, q, v: self._tau)
        self._slopes = PointDerivatives(self._motion)
        self._followed = Followed(mechanism, self._motion.explicit)
        self._taken: Taken | None = None

    def step(self, x: Array, tau: Array, h: float) -> Array:
        """x after a step of h s under torques τ (nv,), derivatives with it where the kernel takes it.

        Raises
        ------
        SimulationError
            Where the mode has no such state, or no such step.
        """
        return self._from(x, tau, h).end

    def jacobians(self, x: Array, tau: Array, h: float) -> tuple[Array, Array]:
        """A (2m, 2m) and B (2m, nv) of the same step, see `step_jacobians`.

        Raises
        ------
        SimulationError
            As `step`; where derivatives cannot be certified.
        """
        taken = self._from(x, tau, h)
        if taken.A is None or taken.B is None:
            start = self._state(x)[: 2 * self._mechanism.m]
            self._followed.explicit()
            taken.A, taken.B = differentiated_step(self._slopes, 0.0, start, h).jacobians()
        return taken.A, taken.B

    def _from(self, x: Array, tau: Array, h: float) -> Taken:
        """The step, which is taken once."""
        last = self._taken
        if last is not None and h == last.h and np.array_equal(x, last.x) and np.array_equal(tau, last.tau):
            return last
        self._taken, self._tau = None, tau
        start, m = self._state(x), self._mechanism.m
        point = self._followed.point_at(start[:m], start[m : 2 * m])
        taken = Taken(x.copy(), tau.copy(), h, x)
        if not self._by_kernel(point, taken):
            self._by_reference(start, taken)
        self._taken = taken
        return taken

    def _by_kernel(self, point: Point, taken: Taken) -> bool:
        """Whether the kernel took the step, on regular ground or on a mode that it knows or is told of."""
        mechanism, h = self._mechanism, taken.h
        kernel, q, v = derivation(mechanism, point.q), point.q, point.G @ point.ydot
        if kernel is None:
            return False
        for told in (False, True):
            if told and not learned(kernel, mechanism, q, v, h):
                return False
            good, ends, rates, A, B = kernel.step_each(q[None], v[None], taken.tau[None], h, True)
            if good[0]:
                assert A is not None and B is not None  # they were asked for
                taken.end = np.concatenate([ends[0, self._places], rates[0, mechanism.iv_independent]])
                taken.A, taken.B = A[0], B[0]
                return True
        return False

    def _by_reference(self, start: Array, taken: Taken) -> None:
        """The step in Python, its derivatives only when they are asked for."""
        left_to_python(self._mechanism, "steps of knots")
        equations, explicit, m = self._motion.equations, self._followed.explicit(), self._mechanism.m

        def f(t: float, x: Array) -> Array:
            return equations.derivative(equations.evaluate(t, x))

        after = rk4_step(f, 0.0, start, taken.h, f(0.0, start))
        numbers = after[:m]
        if self._groups is not None:
            assert isinstance(explicit, GroupMap)
            q = np.zeros(self._mechanism.nq)
            q[self._mechanism.iq_numbers] = after[self._groups.rest_inputs]
            q[self._groups.iq] = self._groups.place(explicit.origin, after[self._groups.inputs])
            numbers = q[self._places]
        taken.end = np.concatenate([numbers, after[m : 2 * m]])

    def _state(self, x: Array) -> Array:
        """The motion's state at x, joints on groups where they are there."""
        explicit, m = self._motion.explicit, self._mechanism.m
        numbers, u = x[:-m], x[-m:]
        y = numbers.copy()
        if self._groups is not None:
            assert isinstance(explicit, GroupMap)
            inputs = self._groups.rest_inputs
            q = np.zeros(self._mechanism.nq)
            q[self._places] = numbers
            y, here = np.zeros((2, m))
            y[inputs], here[inputs] = q[self._mechanism.iq_numbers], explicit.rest.anchor.y
            explicit.anchor = joined(self._groups, explicit.rest.anchor, q[self._groups.iq], here, u)
        return np.concatenate([y, u, self._motion.x[2 * m :]])
