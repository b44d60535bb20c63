"""A run that is taken a few steps at a time, and can be put back to where it was."""

from __future__ import annotations

import copy
from typing import Any

from ..dynamics.equations import Evaluation, TorqueFunction
from ..maps.explicit import Crossing
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .run import Run

FIXED = ("_choice", "_torque", "_native", "_progress", "_counters", "_on_toggle")
"""What of a run no step changes, or what counts on."""


class HeldTorque(TorqueFunction):
    """A torque that stays what it was set to.

    Attributes
    ----------
    value : ndarray (nv,)
    """

    def __init__(self, value: Array) -> None:
        super().__init__(lambda t, q, v: self.value, len(value))
        self.value = value

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """The torque held, whatever the state."""
        return self.value

    def __deepcopy__(self, memo: object) -> HeldTorque:
        """Itself: what is held is set anew with each step."""
        return self


class SteppedRun(Run):
    """A run that goes on when asked to."""

    @property
    def last(self) -> Evaluation:
        """The evaluation accepted last."""
        assert self._last is not None  # output 0 is accepted before anyone asks
        return self._last

    @property
    def at(self) -> int:
        """The number of the last output."""
        return self._record.count - 1

    @property
    def times(self) -> Array:
        """Output times that there is room for, s."""
        return self._times

    @property
    def crossings(self) -> list[Crossing]:
        """Those passed so far."""
        return self._record.crossings

    def under_new_forces(self) -> None:
        """Look at the present state again, under forces that have jumped."""
        i = self.at
        self._last = self._motion.equations.at_point(float(self._times[i]), self.last.point)
        self._record.add(i, self._last, self._x)

    def grow(self, times: Array) -> None:
        """Go on to more output times, the first of which are the present ones."""
        self._times = times
        self._record.grow(times)

    def copied(self, parts: dict[str, Any] | None = None) -> dict[str, Any]:
        """A copy of all that steps change, or of such a copy; what they do not change is shared."""
        if parts is None:
            parts = {name: value for name, value in vars(self).items() if name not in FIXED}
        shared: list[Any] = [self._counters]
        for mechanism in {id(m): m for m in (self._record.mechanism, parts["_motion"].mechanism)}.values():
            shared += _unchanging(mechanism)
        return copy.deepcopy(parts, {id(part): part for part in shared})

    def put_back(self, parts: dict[str, Any]) -> None:
        """Go back to where these parts were copied."""
        for name, value in self.copied(parts).items():
            setattr(self, name, value)


def _unchanging(mechanism: Mechanism) -> list[Any]:
    """A mechanism and what its maps hold of it."""
    loops = [cluster.loops for cluster in mechanism.clusters]
    trees = [each.tree for each in (mechanism, *loops)]
    applied = [] if mechanism.applied is None else [mechanism.applied]
    return [mechanism, mechanism.clusters, *mechanism.clusters, *loops, *trees, *applied]
