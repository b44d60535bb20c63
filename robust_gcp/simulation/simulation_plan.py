"""What a `Simulation` was made with, and the runs that begin so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.loads import Wrench
from ..dynamics.prescribed.driven import prescribed
from ..dynamics.prescribed.motion import Motion
from ..dynamics.prescribed.zero_order_hold import HeldTorque
from ..errors import OptionError
from ..kernel.library import Library
from ..kernel.simulation.steps import NativeSteps
from ..maps.choice import MapChoice
from ..maps.explicit import Counters
from ..mechanism.mechanism import Mechanism
from ..mechanism.parts import Part
from ..mechanism.tree.tree import Array
from .events import Event
from .runs.coordinates import in_coordinates
from .runs.course import Course
from .runs.initial_state import Given, initialise
from .runs.schedule import Keep, Schedule
from .runs.stability import StabilityCheck
from .runs.stepped import SteppedRun
from .runs.steppers import rk4_step
from .simulate import checked_toggle
from .trajectories.acted import Acted

if TYPE_CHECKING:
    from .phases.phased_simulation import PhasedRun

ROOM = 1024
"""Outputs that there is room for at first; when they are full, those that are not kept go, or it doubles."""


@dataclass
class StepwisePlan:
    """What is the same in all runs of a simulation, checked.

    Attributes
    ----------
    mechanism : Mechanism
        As the user named it.
    step, t0 : float
        s.
    held : HeldTorque
    choice, record, events, wrenches, drive, keep
        See `Simulation`.
    parts : sequence of Stop, JointFriction, Lock
    kernel, required
        See `NativeSteps`.
    """

    mechanism: Mechanism
    step: float
    t0: float
    held: HeldTorque
    choice: MapChoice
    record: Sequence[str]
    events: Sequence[Event]
    wrenches: Sequence[Wrench]
    drive: Mapping[str, Motion] | None
    keep: Keep
    parts: Sequence[Part]
    kernel: Library | None
    required: bool

    def __post_init__(self) -> None:
        for name, given in (("drive=", self.drive is not None), ("method=", self.choice.method != "bridge")):
            if self.parts and given:
                raise OptionError(
                    f"joints=: stops, friction and locks do not go with {name} yet; leave one of them out"
                )

    def clock(self, first: int, count: int) -> Array:
        """Times of the outputs numbered from `first` on."""
        return self.t0 + self.step * np.arange(first, first + count)

    def run(
        self, start: Given, ctrl: Array | None, independent: Sequence[str] = ()
    ) -> tuple[Mechanism, SteppedRun | PhasedRun]:
        """The mechanism, and a run from (q0, v0, mode) that has not begun; without one all is as it was.

        Parameters
        ----------
        independent : sequence of str
            The joints that are so at first, where they are not those that the user named.
        """
        held, none = self.held, np.zeros(self.mechanism.nv)
        before, held.value = held.value, none[:0]
        held.value = held.row(none, ctrl, (self.t0, self.t0 + self.step))
        try:
            return self._phased(start) if self.parts else self._stepped(start, independent)
        except Exception:
            held.value = before
            raise

    def _stepped(self, start: Given, independent: Sequence[str]) -> tuple[Mechanism, SteppedRun]:
        choice, held, counters, t0 = self.choice, self.held, Counters(), self.t0
        mechanism, drives = prescribed(self.mechanism, self.drive, start[0], np.array([t0, t0 + self.step]))
        native = None if self.kernel is None else NativeSteps(self.kernel, held.native, self.required, drives)
        toggle = checked_toggle(None, choice.method, drives is not None)
        at_first = mechanism
        if independent and toggle == "repartition":
            at_first = in_coordinates(mechanism, independent)
        problem = initialise(native, at_first, start, held, choice, counters, toggle, drives, t0)
        if drives is None:
            StabilityCheck(mechanism, None, self.step, choice.options).before(problem, native)
        run = SteppedRun(
            held, rk4_step, native, problem, choice, held, Schedule.every(self.clock(0, ROOM)), self.record,
            counters, toggle, events=self.events, named=mechanism, keep=self.keep,
        )  # fmt: skip
        run.acted = Acted.driven(drives, wrenches=tuple(self.wrenches))
        return mechanism, run

    def _phased(self, start: Given) -> tuple[Mechanism, PhasedRun]:
        from .phases.phased_simulation import PhasedRun  # a simulation without them need not load them

        mechanism, toggle = self.mechanism, checked_toggle(None, self.choice.method, False)
        course = Course(
            mechanism, Schedule.every(self.clock(0, 2)), self.step, self.step, self.choice, None, "rk4", None,
            Acted(wrenches=tuple(self.wrenches)), self.record, self.events, toggle,
        )  # fmt: skip
        told = self.held, start, self.t0, self.keep, self.kernel, self.required
        return mechanism, PhasedRun(course, self.parts, *told)
