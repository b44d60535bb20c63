"""A run that is taken a few steps at a time, and can be put back to where it was."""

from __future__ import annotations

import copy
from bisect import bisect_right
from typing import Any

import numpy as np

from ..dynamics.equations import Evaluation
from ..dynamics.held import HeldTorque
from ..maps.explicit import Crossing
from ..mechanism.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..native.steps import NativeSteps
from .fixed import FixedRun
from .schedule import Schedule

FIXED = ("_choice", "_torque", "_held", "_take", "_native", "_progress", "_counters", "_on_toggle", "_named")
"""What of a run no step changes, or what counts on."""


class SteppedRun(FixedRun):
    """A run that goes on when asked to, under a torque that is held.

    Where it has to go back over steps that were taken, the torques held then act again.

    Parameters
    ----------
    held : HeldTorque
        The torque of the run.
    more
        As for `FixedRun`.
    """

    def __init__(self, held: HeldTorque, *more: Any, **options: Any) -> None:
        super().__init__(*more, **options)
        self._held = held
        self._changes, self._torques = [0], [held.value]

    @property
    def last(self) -> Evaluation:
        """The evaluation accepted last."""
        assert self._last is not None  # output 0 is accepted before anyone asks
        return self._last

    @property
    def at(self) -> int:
        """The number of the last output."""
        return self._record.at

    @property
    def crossings(self) -> list[Crossing]:
        """Those passed so far."""
        return self._record.crossings

    def hold(self, torque: Array) -> None:
        """Hold a torque from the last output on, and look at the state there again if it is another."""
        if np.array_equal(torque, self._held.value):
            return
        i = self.at
        self._changes.append(i)
        self._torques.append(torque)
        self._held.value = torque
        t = float(self.times[i])
        known = None if self._native is None else self._native.look(t, self.last)
        if known is None:
            self._last = self._motion.equations.at_point(t, self.last.point)
        else:
            self._last = known
            self._motion.equations.calls += 1
            self._counters.force_evaluations += 1
        self._record.add(i, self._last, self._x)

    def _torque_from(self, i: int) -> Array:
        """What is held from time i on."""
        return self._torques[bisect_right(self._changes, i) - 1]

    def _evaluated(self, i: int) -> Evaluation:
        self._held.value = self._torque_from(i)
        return super()._evaluated(i)

    def _look_within(self, i: int, before: Evaluation, now: Evaluation) -> None:
        """As ever, under the torque of the step before time i, not of the one after it."""
        after, self._held.value = self._held.value, self._torque_from(i - 1)
        if self._looked_for(i) and not np.array_equal(after, self._held.value):
            now = self._motion.equations.at_point(float(self.times[i]), now.point)
        super()._look_within(i, before, now)
        self._held.value = after

    def _natively(self, native: NativeSteps, i: int, last: int, now: Evaluation) -> tuple[int, Evaluation]:
        if self._changes[-1] > i:  # over steps taken once more, one by one
            return i, now
        return super()._natively(native, i, last, now)

    def grow(self, times: Array) -> None:
        """Go on to more output times, the first of which are the present ones."""
        self._schedule = Schedule.every(times)
        self._record.grow(self._schedule)

    def parts(self) -> dict[str, Any]:
        """What steps change, by name."""
        return {name: value for name, value in vars(self).items() if name not in FIXED}

    def copied(self, parts: dict[str, Any] | None = None) -> dict[str, Any]:
        """A copy of all that steps change, or of such a copy; what they do not change is shared."""
        parts = self.parts() if parts is None else parts
        shared: list[Any] = [self._counters, parts["_schedule"]]
        for mechanism in {id(m): m for m in (self._record.mechanism, parts["_motion"].mechanism)}.values():
            shared += _unchanging(mechanism)
        return copy.deepcopy(parts, {id(part): part for part in shared})

    def put_back(self, parts: dict[str, Any]) -> None:
        """Go back to where these parts were copied."""
        for name, value in self.copied(parts).items():
            setattr(self, name, value)
        self._held.value = self._torques[-1]


class HeldRun(SteppedRun):
    """A run that asks a function for the torque at the start of each step, and holds it over the step."""

    def go(self) -> None:
        """Step by step; steps that are taken once more have the torque that they had."""
        ask, motion = self._held.asked, self._motion
        assert ask is not None  # `HeldTorque.of` gave it
        start, times = motion.start, self.times.tolist()
        self._held.value = ask(times[0], start.point.q, start.point.G.dot(start.ydot))
        self._torques = [self._held.value]
        self.advance(0, 0)
        for i in range(len(times) - 1):
            if i > 0:
                self.hold(ask(times[i], self.last.point.q, self.last.v))
            self.advance(i, i + 1, self.last)
            if self._ended:
                return


def _unchanging(mechanism: Mechanism) -> list[Any]:
    """A mechanism and what its maps hold of it."""
    loops = [cluster.loops for cluster in mechanism.clusters]
    trees = [each.tree for each in (mechanism, *loops)]
    applied = [] if mechanism.applied is None else [mechanism.applied]
    groups = groups_of(mechanism)
    apart = [] if groups is None else [groups, *_unchanging(groups.rest)]
    return [mechanism, mechanism.clusters, *mechanism.clusters, *loops, *trees, *applied, *apart]
