"""What a `Simulation` was made with, and the runs that begin so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.loads import Wrench
from ..dynamics.prescribed.driven import prescribed
from ..dynamics.prescribed.motion import Motion
from ..dynamics.prescribed.zero_order_hold import HeldTorque
from ..kernel.library import Library
from ..maps.choice import MapChoice
from ..mechanism.mechanism import Mechanism
from ..mechanism.parts import Part
from ..mechanism.tree.tree import Array
from .events import Event
from .runs.coordinates import in_coordinates
from .runs.course import Course
from .runs.initial_state import Given
from .runs.schedule import Keep, Schedule
from .runs.stepped import SteppedRun
from .saved_state import StartState
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
        if self.parts:
            from .phases.run_phases import require_plain  # a simulation without them need not load them

            require_plain({"method=": self.choice.method != "bridge"})

    def run(
        self, start: Given, ctrl: Array | None, saved: StartState | None = None
    ) -> tuple[Mechanism, SteppedRun | PhasedRun]:
        """The mechanism, and a run from (q0, v0, mode) that has not begun; without one all is as it was.

        Parameters
        ----------
        saved : StartState, optional
            Whose time, activations and independent joints it begins with; t0, the actuators' and the user's
            when left out.
        """
        held, none = self.held, np.zeros(self.mechanism.nv)
        t0 = self.t0 if saved is None else saved.t
        active = None if saved is None or saved.driven is None else saved.driven[1]
        # without a value before it the first one begins with the actuators' own activations
        before, held.value = held.value, none[:0]
        held.value = held.row(none, ctrl, (t0, t0 + self.step), active)
        try:
            if self.parts:
                return self._phased(start, t0)
            return self._stepped(start, t0, () if saved is None else saved.independent)
        except Exception:
            held.value = before
            raise

    def _stepped(self, start: Given, t0: float, independent: Sequence[str]) -> tuple[Mechanism, SteppedRun]:
        course = at_first = self._course(start, t0, ROOM)
        mechanism = course.mechanism
        if independent and course.on_toggle == "repartition":
            at_first = replace(course, mechanism=in_coordinates(mechanism, independent))
        motion, native, stability = at_first.begun(start, self.held, self.kernel, self.required)
        if stability is not None:
            stability.before(motion, native)
        run = course.made(motion, native)
        assert isinstance(run, SteppedRun)  # as torques are held
        return mechanism, run

    def _phased(self, start: Given, t0: float) -> tuple[Mechanism, PhasedRun]:
        from .phases.phased_simulation import PhasedRun  # a simulation without them need not load them

        told = self.held, start, t0, self.keep, self.kernel, self.required
        course = self._course(start, t0, 2)
        return course.mechanism, PhasedRun(course, self.parts, *told)

    def _course(self, start: Given, t0: float, outputs: int) -> Course:
        """What a run is to do, with room for so many outputs."""
        mechanism, drives = prescribed(self.mechanism, self.drive, start[0], np.array([t0, t0 + self.step]))
        toggle = checked_toggle(None, self.choice.method, drives is not None)
        schedule = Schedule.numbered(t0, self.step, 0, outputs)
        return Course(
            mechanism, schedule, self.step, self.step, self.choice, drives, "rk4", None,
            Acted(None, tuple(self.wrenches)), self.record, self.events, toggle, keep=self.keep,
        )  # fmt: skip
