"""ẋ of a motion for a solver that takes trials back, by the kernel where it can."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...dynamics.equations import Evaluation
from ...dynamics.problem import Problem
from ...errors import SimulationError
from ...kernel.simulation.batch import count_in
from ...kernel.simulation.rates import Rates
from ...kernel.simulation.steps import NativeSteps
from ...maps.choice import KernelMap
from ...maps.cluster.cluster_map import ClusterMap
from ...maps.explicit import Crossing
from ...mechanism.tree.tree import Array
from .coordinates import Coordinates
from .crossings import numbers, point_of_rest
from .steppers import RefusedTrialError, SolverStep


class Following:
    """Follows a motion's mode to the states that a solver asks for, which may be refused far ahead.

    The kernel goes by itself from where Python was until it meets what it does not know; Python evaluates
    that, and hands over again.

    Parameters
    ----------
    motion : Problem
    native : NativeSteps or None
    coordinates : Coordinates or None
        What looks after the independent joints.
    returns : bool
        Whether the map in Python goes back to what was kept wherever that is nearer, not on a refusal alone.

    Attributes
    ----------
    kept : Evaluation or None
        Gone back to where it is nearer than what was evaluated last.
    """

    def __init__(
        self,
        motion: Problem,
        native: NativeSteps | None,
        coordinates: Coordinates | None,
        returns: bool = True,
    ) -> None:
        self._returns = returns
        self._motion, self._native, self._coordinates = motion, native, coordinates
        self._rates: Rates | None = None
        self.kept: Evaluation | None = None

    def __call__(self, t: float, x: Array) -> Array:
        """ẋ, (n,)."""
        rate = self._by_kernel(t, x)
        return self._by_python(t, x) if rate is None else rate

    def trial(self, t: float, x: Array) -> Array:
        """The same for a solver that may try a shorter step.

        Raises
        ------
        RefusedTrialError
            Where the kernel says that the mode ends before x: Python need not say so too, which takes long.
        """
        rate = self._by_kernel(t, x)
        if rate is None and self._rates is not None and self._rates.refused:
            refused = RefusedTrialError(f"the motion could not be followed to a trial at t = {t:.6g} s")
            refused.look, refused.why = partial(self, t, x), partial(self._why, t, x)
            raise refused
        return self._by_python(t, x) if rate is None else rate

    def keep(self, t: float, x: Array) -> Evaluation:
        """The evaluation at an output, which is gone back to where that is nearer than what comes after."""
        if self._by_kernel(t, x) is not None and self._rates is not None:
            self.kept = self._rates.keep()
        else:
            self._fall_back()
            self.kept = self._in_python(t, x)
        return self.kept

    def begin(self, now: Evaluation, x: Array) -> None:
        """Go on from an output that Python evaluated."""
        self.kept = now
        self._hand_over(now, x)

    @property
    def plain(self) -> bool:
        """Whether nothing was met on the way that the map in Python would have to tell of."""
        return self._rates is not None and self._rates.plain

    def passed(self, step: SolverStep, behind: Array) -> list[Crossing] | None:
        """Singular places that a step from the state `behind` passed; None where Python has to look."""
        if self._rates is None:
            return None
        ends = np.array([behind, step.x])[:, : 2 * self._motion.mechanism.m]
        found = self._rates.passed((step.t0, step.t1), ends, step.between)
        if found:
            self.looked()  # else the next step would tell them again
        return found

    @property
    def on_bridge(self) -> bool:
        """Whether the kernel's last state is on a bridge, where the map in Python was not told of it."""
        return self._rates is not None and self._rates.on_bridge

    def rounding(self) -> tuple[float, float, float]:
        """What rounding costs of G where there is no bridge, see `apex.rounding`."""
        if self._rates is not None:
            return self._rates.rounding()
        rest = self._motion.explicit.rest
        return rest.rounding() if isinstance(rest, ClusterMap) else (0.0, 0.0, np.inf)

    def share(self) -> None:
        """Put the map in Python where the kernel is, which stays there."""
        if self._rates is None:
            return
        now, trackers, in_zone, met = self._rates.told()
        explicit = self._motion.explicit
        assert isinstance(explicit, KernelMap)  # the kernel knows no other map
        explicit.resume(now.point, trackers, in_zone, met)

    def looked(self) -> None:
        """What was met on the way was told of, and the limit of the coordinates may be another."""
        if self._rates is not None:
            self._rates.looked(None if self._coordinates is None else self._coordinates.watch.limit)

    def drop(self) -> None:
        """The kernel is not to go on; what it took is counted."""
        if self._rates is None:
            return
        count_in(self._motion.counters, self._rates.taken)
        self._rates = None

    def near(self, x: Array) -> None:
        """Follow the mode, in Python, from what was kept if that is nearer to x than the last evaluation."""
        if self.kept is None:
            return
        explicit, y = self._motion.explicit, x[: self._motion.mechanism.m]
        rest, last = explicit.rest, point_of_rest(self.kept.point)
        y = numbers(explicit, y)
        # in another chart y are other numbers, and cannot be compared
        if last.origin is rest.anchor.origin and _apart(y, last.y) < _apart(y, rest.anchor.y):
            rest.anchor = last

    def _by_kernel(self, t: float, x: Array) -> Array | None:
        if self._rates is None:
            return None
        try:
            return self._rates(t, x)
        except BaseException:  # of a torque function
            self._fall_back()
            raise

    def _why(self, t: float, x: Array) -> SimulationError:
        self(t, x)  # raises what Python finds there
        self._fall_back()  # else the map is told where that is
        rest = self._motion.explicit.rest
        assert isinstance(rest, ClusterMap)  # no other is followed where K_d is poor
        return rest.refusal()

    def _by_python(self, t: float, x: Array) -> Array:
        self._fall_back()
        return self._motion.equations.derivative(self._in_python(t, x))

    def _in_python(self, t: float, x: Array) -> Evaluation:
        if self._returns:
            self.near(x)
        try:
            now = self._motion.equations.evaluate(t, x)
        except SimulationError:  # at a trial: the map goes back to where the step began
            if self.kept is not None:
                self._motion.explicit.rest.anchor = point_of_rest(self.kept.point)
            raise
        if self.kept is None:  # where the solver begins
            self.kept = now
        self._hand_over(now, x)
        return now

    def _fall_back(self) -> None:
        self.share()  # first: dropped, the kernel cannot say any more where it is
        self.drop()

    def _hand_over(self, now: Evaluation, x: Array) -> None:
        """Let the kernel go on from an evaluation of Python's, on regular ground."""
        if self._native is None or not np.isfinite(now.ydd).all():
            return
        rest = self._motion.explicit.rest
        if isinstance(rest, ClusterMap) and rest.met:  # what was met is looked at first
            return
        watch = None if self._coordinates is None else self._coordinates.watch
        self._rates = self._native.rates(self._motion, now, x, watch)


def _apart(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max(initial=0.0))
