"""A knot of a discretised motion: where it was evaluated last on its mode, and the step of RK4 from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..dynamics.problem import initial_value_problem
from ..kernel.derivatives.derivations import derivation
from ..maps.explicit import Point
from ..maps.grouped import GroupMap, joined
from ..mechanism.coordinates.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..simulation.derivatives.accelerations import learned
from ..simulation.derivatives.one_step import Stepped, step
from .mode_points import Followed


@dataclass
class Taken:
    """A step that was taken, from x under τ over h, and from which point of the mode."""

    x: Array
    tau: Array
    h: float
    point: Point
    after: Stepped


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
        self, mechanism: Mechanism, q0: ArrayLike | None, mode: ArrayLike | None, places: NDArray[np.int64]
    ) -> None:
        self._mechanism, self._places, self._groups = mechanism, places, groups_of(mechanism)
        self._explicit = initial_value_problem(mechanism, q0, None, mode).explicit
        self._followed = Followed(mechanism, self._explicit)
        self._taken: Taken | None = None

    def step(self, x: Array, tau: Array, h: float) -> Array:
        """x after a step of h s under torques τ (nv,), derivatives with it where the kernel takes it.

        Raises
        ------
        SimulationError
            Where the mode has no such state, or no such step.
        """
        after = self._from(x, tau, h).after
        return np.concatenate([after.q[self._places], after.v[self._mechanism.iv_independent]])

    def jacobians(self, x: Array, tau: Array, h: float) -> tuple[Array, Array]:
        """A (2m, 2m) and B (2m, nv) of the same step, see `step_jacobians`.

        Raises
        ------
        SimulationError
            As `step`; where derivatives cannot be certified.
        """
        taken = self._from(x, tau, h)
        if taken.after.A is None:
            taken.after = self._stepped(taken.point, tau, h, True)
        assert taken.after.A is not None and taken.after.B is not None  # they were asked for
        return taken.after.A, taken.after.B

    def _from(self, x: Array, tau: Array, h: float) -> Taken:
        """The step, which is taken once."""
        last = self._taken
        if last is not None and h == last.h and np.array_equal(x, last.x) and np.array_equal(tau, last.tau):
            return last
        self._taken = None
        point = self._followed.point_at(*self._state(x))
        after = self._by_kernel(point, tau, h) or self._stepped(point, tau, h, False)
        self._taken = Taken(x.copy(), tau.copy(), h, point, after)
        return self._taken

    def _by_kernel(self, point: Point, tau: Array, h: float) -> Stepped | None:
        """The step with its derivatives, on regular ground or on a mode that the kernel is told of."""
        kernel, q, v = derivation(self._mechanism, point.q), point.q, point.G @ point.ydot
        if kernel is None:
            return None
        for told in (False, True):  # a series is made where it takes no step without: 0.1 s
            if told and not learned(kernel, self._mechanism, q, v, h):
                return None
            good, ends, rates, A, B = kernel.step_each(q[None], v[None], tau[None], h, True)
            if good[0]:
                return Stepped(ends, rates, A, B).first()
        return None

    def _stepped(self, point: Point, tau: Array, h: float, jacobians: bool) -> Stepped:
        """The step as others take it, its derivatives only when they are asked for."""
        return step(self._mechanism, point.q, point.G @ point.ydot, tau, h, jacobians, point.G)

    def _state(self, x: Array) -> tuple[Array, Array]:
        """y and u at x, joints on groups where they are there."""
        explicit, m = self._explicit, self._mechanism.m
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
        return y, u
