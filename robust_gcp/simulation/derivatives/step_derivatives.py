"""A step of a motion with its derivatives, in coordinates that serve, told in the mechanism's own.

Where `simulate` takes a step of RK4 this takes the same one; where it would take it with error control, or
in other coordinates, the motion over the step is followed by parts of it, each halved until whole and
halves agree in their end and in their derivatives.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...checks import require_finite
from ...dynamics.change_of_coordinates import Slope
from ...dynamics.discrete import NOTHING, differentiated_step
from ...dynamics.modes.mode_rates import SPARED, UNSTEADY, ZONE
from ...dynamics.problem import Problem, initial_value_problem
from ...errors import SimulationError
from ...kernel.derivatives.derivations import derivation, left_to_python
from ...kernel.derivatives.step_derivatives import SAME
from ...maps.choice import MapChoice
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..runs.crossings import in_new_chart
from .serving_coordinates import serving, state_of
from .step_of_motion import Acting, Moved

AGREE = 1e-8
"""Difference of whole and halves, relative, at which the halves are kept: theirs is a fifteenth of it."""

MOST_DOUBLINGS = 11
"""Of the kernel's parts of a step, from six on."""

SMALLEST = 2.0**-12
"""Share of the step below which no part is tried."""

WHAT = "derivatives of steps"
"""What this is to who is warned of its price."""


def differentiated(
    mechanism: Mechanism,
    state: tuple[ArrayLike, ArrayLike | None],
    mode: ArrayLike | None,
    acting: Acting,
    t: float,
    h: float,
    by_parts: bool = False,
    end: tuple[Array, Array] | None = None,
) -> Moved:
    """The step from a state, and its derivatives in the mechanism's coordinates.

    Parameters
    ----------
    state : (q, v)
    by_parts : bool
        Whether the motion is followed by parts of the step from the first, as where `simulate` controlled
        its error.
    end : (q, v), optional
        Where it leads to, which is what the result says then if it was found to lead there.

    Raises
    ------
    SimulationError
        Where the mechanism's coordinates do not parametrise the motion at the start, or no part of the step
        has certified derivatives.
    """
    motion = initial_value_problem(mechanism, *state, mode, acting.torque)
    at, other = state_of(motion, *state), serving(mechanism, motion.start.point)
    if not by_parts:
        try:
            if other is not None:
                moved = step_by_kernel(other, at, mode, acting, h, end)
                if moved is not None:
                    return moved.told_in(mechanism)
                motion = initial_value_problem(other, *at, mode, acting.torque)
            moved = Follower(motion, acting, t).whole(h).told_in(mechanism)
            left_to_python(mechanism, WHAT, _why(acting))
            return moved
        except SimulationError:  # as `simulate`, which then goes on with error control
            pass
    own = mechanism if other is None else other
    moved = parts_by_kernel(own, at, mode, acting, h, end)
    if moved is None or not by_parts:
        left_to_python(mechanism, WHAT, _why(acting))
    if moved is not None:
        return moved.told_in(mechanism)
    motion = initial_value_problem(own, *at, mode, acting.torque, MapChoice(error_controlled=True))
    return Follower(motion, acting, t, sparing=True).by_parts(h).told_in(mechanism)


def step_by_kernel(
    mechanism: Mechanism,
    state: tuple[Array, Array],
    mode: ArrayLike | None,
    acting: Acting,
    h: float,
    end: tuple[Array, Array] | None,
    count: int = 1,
    same: float | None = None,
    zone: float = ZONE,
    steady: float = 0.0,
) -> Moved | None:
    """The step in equal parts by the kernel in a mechanism's own coordinates; None where it takes them not.

    `same`, `zone` and `steady` are those of `Derivation.take`.
    """
    more = acting.by_more is not None or acting.held is not None
    given = mode is not None or callable(acting.torque) or more
    kernel = None if given else derivation(mechanism, state[0])
    if kernel is None:
        return None
    q, v = (np.full((count + 1, len(part)), np.nan) for part in state)
    q[0], v[0] = state
    if end is not None:
        q[-1], v[-1] = end
    tau = None if acting.torque is None else np.tile(np.asarray(acting.torque, dtype=float), (count, 1))
    if same is None:
        same = np.inf if end is None else SAME  # with no end told there is nothing to compare
    taken = kernel.take(np.linspace(0.0, h, count + 1), q, v, tau, same, zone, steady=steady)
    if not taken.good.all():
        return None
    A, B, *_ = kernel.pull(0, count, np.eye(2 * kernel.m))
    first, last = (Slope(taken.G[i], taken.dv_dy[i]) for i in (0, -1))
    none, ends = np.zeros((len(A), 0)), end or (taken.q[-1], taken.v[-1])
    return Moved(A, B.sum(axis=0), none, mechanism, mechanism, first, last, *ends)  # τ is held over all parts


def parts_by_kernel(
    mechanism: Mechanism,
    state: tuple[Array, Array],
    mode: ArrayLike | None,
    acting: Acting,
    h: float,
    end: tuple[Array, Array] | None,
) -> Moved | None:
    """Ever more parts of a step as `step_by_kernel` has it, until they agree; None where they do not.

    What each and twice as many lead to, without the error that they differ by (Richardson).
    """
    before: Moved | None = None
    best: Array | None = None
    for count in (6 << k for k in range(MOST_DOUBLINGS)):
        now = step_by_kernel(
            mechanism, state, mode, acting, h, end, count, same=SAME, zone=SPARED, steady=UNSTEADY
        )
        if now is None:  # shorter ones may be taken
            continue
        if before is not None:
            found = _extrapolated(before, now)
            if best is not None and np.abs(found.A - best).max() < AGREE * np.abs(best).max():
                return found
            best = found.A
        before = now
    return None


def _extrapolated(whole: Moved, halves: Moved) -> Moved:
    """What parts of half the length lead to without their error of fourth order."""
    tree = halves.begun.tree

    def beyond(one: Array, other: Array) -> Array:
        return np.asarray(other + (other - one) / 15.0)  # 2⁴ − 1: halves err by a sixteenth

    q = tree.integrate(halves.q, tree.difference(whole.q, halves.q) / 15.0)
    A, B = beyond(whole.A, halves.A), beyond(whole.B, halves.B)
    return replace(halves, A=A, B=B, q=q, v=beyond(whole.v, halves.v))


def _why(acting: Acting) -> str | None:
    """Why the kernel does not take such steps, wherever they are."""
    if acting.held is not None:
        return "joints are held there, by stops, friction, locks or as geometry that may change"
    return "a torque follows the state there; hold it over steps" if callable(acting.torque) else None


class Follower:
    """Follows a motion step by step, with derivatives.

    Parameters
    ----------
    motion : Problem
    acting : Acting
    t : float
        When it begins, s.
    sparing : bool
        See `ModeRates`.
    """

    def __init__(self, motion: Problem, acting: Acting, t: float, sparing: bool = False) -> None:
        self._motion, self._acting, self._t, self._sparing = motion, acting, t, sparing
        self._slopes = acting.slopes_of(motion, sparing)
        self._x = motion.x[: 2 * motion.mechanism.m]

    def whole(self, h: float) -> Moved:
        """One step of RK4, whose end is where it goes on."""
        motion, slopes, drive = self._motion, self._slopes, self._acting.drive
        step = differentiated_step(slopes, self._t, self._x, h)
        x = np.concatenate([step.end.y, step.end.ydot])
        # at the end of a step joints on groups begin new charts, as they do in runs
        now, x = in_new_chart(motion.explicit, motion.equations.at_point(self._t + h, step.end), x)
        last = Slope.of(slopes.derivatives_at(self._t + h, now))
        self._t, self._x, self._now = self._t + h, x, now
        own = motion.mechanism
        A, B, P, D = step.jacobians(self._acting.by_more, NOTHING if drive is None else drive.driven)
        require_finite(A, "A")
        return Moved(A, B, P, own, own, Slope.of(step.stages[0].slopes), last, now.point.q, now.v, D)

    def by_parts(self, h: float) -> Moved:
        """Parts of a step, each halved until whole and halves agree."""
        end, part, found = self._t + h, h, None
        while end - self._t > 1e-12 * h:  # parts add up to h but for rounding
            part = min(part, end - self._t)
            more = self._halves(part, part <= SMALLEST * h)
            if more is None:
                part *= 0.5
                continue
            found = more if found is None else found.then(more)
            part *= 2.0 if self._apart < AGREE / 32.0 else 1.0  # theirs grows as h⁵
            self._renew()
        assert found is not None
        return found

    def _halves(self, h: float, last: bool) -> Moved | None:
        """Two halves, where the whole agrees with them; None, and nothing taken, where it does not.

        Raises
        ------
        SimulationError
            Of a part that is not to be made shorter.
        """
        explicit = self._motion.explicit
        begun, anchor = (self._t, self._x), explicit.anchor
        try:
            whole = self.whole(h)
            (self._t, self._x), explicit.anchor = begun, anchor  # else halves begin where the whole went
            halves = self.whole(0.5 * h).then(self.whole(0.5 * h))
            self._apart = _apart(self._motion.mechanism, whole, halves)
            if last or self._apart < AGREE:
                return halves
        except SimulationError:
            if last:
                raise
        (self._t, self._x), explicit.anchor = begun, anchor
        return None

    def _renew(self) -> None:
        """Go on in other coordinates, where those present do not serve."""
        other = serving(self._motion.mechanism, self._now.point)
        if other is None:
            return
        choice = MapChoice(error_controlled=True)
        try:
            motion = initial_value_problem(
                other, self._now.point.q, self._now.v, None, self._acting.torque, choice
            )
        except SimulationError:  # beside a singular place: these do until that is behind
            return
        self.__init__(motion, self._acting, self._t, self._sparing)  # type: ignore[misc]


def _apart(mechanism: Mechanism, one: Moved, other: Moved) -> float:
    """Relative difference of two ways to take the same step."""
    unit = mechanism.units
    apart = np.abs(mechanism.tree.difference(one.q, other.q) / unit).max()
    fast = np.abs((one.v - other.v) / unit).max() / (1.0 + np.abs(one.v / unit).max())
    slopes = np.abs(one.A - other.A).max() / np.abs(other.A).max()
    return float(max(apart, fast, slopes))
