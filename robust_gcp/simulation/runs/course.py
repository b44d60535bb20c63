"""The course of a run: it begins, goes, and is taken again where a step that nobody named does not serve."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.prescribed.drive import Drive, warned_of_kink
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...dynamics.problem import Problem
from ...dynamics.tableau import Tableau
from ...errors import ClosureError, CuspError, NonFiniteError, SimulationError
from ...kernel.library import Library
from ...kernel.simulation.guard import Guard
from ...kernel.simulation.steps import NativeSteps
from ...maps.choice import MapChoice
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import Part
from ...printing import progress_bar
from ..events import Event, Events
from ..trajectories.acted import Acted
from ..trajectories.trajectory import Trajectory
from .fixed_steps import FixedRun
from .initial_state import Given, initialise
from .recovery import add_remedy
from .run import Run
from .schedule import ALL, Keep, Schedule, planned
from .solver_run import AdaptiveRun
from .stability import MOST_PARTS, StabilityCheck
from .stepped import SteppedRun
from .steppers import rk4_step
from .too_long_steps import Coarse
from .unnamed_steps import STIFF, taken_again, words_of

Again = Callable[..., Trajectory]
Progress = Callable[[float], None] | bool | None

OVERFLOWN = "the state left the finite numbers; use a smaller step, and check v0 and torque"
"""Where Python's own numbers overflow."""


@dataclass
class Course:
    """What a run is to do, checked.

    Attributes
    ----------
    mechanism : Mechanism
        In coordinates that include the driven joints.
    schedule : Schedule
    duration, step : float
        s.
    choice : MapChoice
    drives : Drive or None
    tableau : Tableau or str
        Of fixed steps; "rk4" for the classical ones.
    solver : (str, float, float) or None
        One of SciPy's and its tolerances, in place of fixed steps.
    acted : Acted
    record, events, on_toggle
        As `Run` takes them.
    checked : bool
        Whether it is warned of steps that are too long.
    guard : Guard or None
        What is to stay within bounds; the run pauses after a step in which it may not have.
    restitution : float or None
        Of the motion's speed at a cusp; None where it ends there.
    keep : Keep
        Which outputs stay where there is no more room for them.
    """

    mechanism: Mechanism
    schedule: Schedule
    duration: float
    step: float
    choice: MapChoice
    drives: Drive | None
    tableau: Tableau | str
    solver: tuple[str, float, float] | None
    acted: Acted
    record: Sequence[str]
    events: Sequence[Event] | Events
    on_toggle: str
    checked: bool = True
    guard: Guard | None = None
    restitution: float | None = None
    keep: Keep = ALL

    def __post_init__(self) -> None:
        if self.drives is not None:
            self.acted = replace(self.acted, drive=self.drives.names, motions=self.drives.motions)

    def run(
        self,
        start: Given,
        torque: Torque | ArrayLike | None,
        kernel: Library | None,
        required: bool,
        again: Again | None,
        progress: Progress,
    ) -> Trajectory:
        """The motion from a start.

        Parameters
        ----------
        start : (q0, v0, mode)
        torque : HeldTorque, callable, array_like or None
        kernel, required
            See `NativeSteps`.
        again : callable, optional
            The run by another stepper or in other steps, where this one's step was not named.
        progress
            As in `simulate`.
        """
        begun = time.perf_counter()
        motion, native, stability = self.begun(start, torque, kernel, required)
        # By its Jacobian at the start: where RK4 would need more than `MOST_PARTS` parts, stiffly.
        if stability is not None and again is None:
            stability.before(motion, native)
        elif stability is not None and again is not None:
            parts = stability.parts(motion, native)
            if parts > MOST_PARTS:
                return again(stepper=STIFF)
            if parts > 1:
                t0, outputs = float(self.schedule.times[0]), self.schedule.outputs
                self.schedule, self.step = planned(t0, self.duration, self.step / parts, outputs, True)
        with _reporting(progress, self.schedule, self.mechanism.name) as report:
            run = self.made(motion, native, report)
            try:
                fault = self.gone(run, begun, again is not None, run.go)
            finally:
                if native is not None:
                    native.release()
                if stability is not None:  # after a run that failed too: this may be why
                    stability.after(motion)
        finished = None if fault is not None else run.trajectory(begun)
        return self._judged(finished, fault, again)

    def begun(
        self, start: Given, torque: Torque | ArrayLike | None, kernel: Library | None, required: bool
    ) -> tuple[Problem, NativeSteps | None, StabilityCheck | None]:
        """The motion at its start, what takes its steps natively, and what tells whether these are stable."""
        held, stability = isinstance(torque, HeldTorque), None
        # the region is that of the classical tableau; SciPy's solvers choose their steps
        if self.checked and self.tableau == "rk4" and self.solver is None and self.drives is None:
            function = None if held else torque
            stability = StabilityCheck(self.mechanism, function, self.step, self.choice.options)
            torque = torque if held else stability.torque
        own = self.tableau if isinstance(self.tableau, Tableau) else None
        acts = torque.native if isinstance(torque, HeldTorque) else torque
        native = None if kernel is None else NativeSteps(kernel, acts, required, self.drives, own, self.guard)
        t0 = float(self.schedule.times[0])
        given = self.mechanism, start, torque, self.choice, self.on_toggle, self.drives, t0
        return initialise(native, *given), native, stability

    def through_phases(
        self, joints: Sequence[Part], start: Given, torque: Torque | ArrayLike | None, kernel: Library | None,
        required: bool, refused: dict[str, bool], progress: Progress,
    ) -> Trajectory:  # fmt: skip
        """The motion with stops, friction and locks; see `phases.run_phases`.

        Parameters
        ----------
        refused : dict of str to bool
            Arguments of `simulate` that do not go with them, and whether they were given.
        """
        from ..phases.run_phases import require_plain, run_phases  # a run without them need not load them

        require_plain(refused)
        with _reporting(progress, self.schedule, self.mechanism.name) as report:
            return run_phases(self, joints, start, torque, kernel, required, report)

    def made(
        self, motion: Problem, native: NativeSteps | None, report: Callable[[float], None] | None = None
    ) -> Run:
        """The run that goes on from there."""
        more = report, self.events, self.mechanism, self.keep
        parts = (motion, self.schedule, self.record, self.on_toggle, *more)
        run: Run
        if self.solver is not None:
            run = AdaptiveRun(*self.solver, native, *parts)
        else:
            kind = SteppedRun if isinstance(motion.torque, HeldTorque) else FixedRun
            run = kind(self.tableau.step if isinstance(self.tableau, Tableau) else rk4_step, native, *parts)
            run.guard = self.guard
        run.acted = self.acted
        return run

    def gone(self, run: Run, begun: float, mended: bool, go: Callable[[], None]) -> str | None:
        """Take steps; the words of a stop that may be mended, others are raised with the motion."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # what is not finite ends in an error of ours
                go()
        except (SimulationError, ClosureError) as error:
            fault = words_of(error) if mended else None
            if fault is not None:
                return fault
            if isinstance(error, CuspError):
                run.arrive(error)
            error.trajectory = run.trajectory(begun)
            may_change = self.on_toggle == "error" and self.choice.method == "bridge"
            add_remedy(error, self.drives, may_change)
            raise
        except OverflowError as overflow:
            stop = NonFiniteError(OVERFLOWN)
            stop.trajectory = run.trajectory(begun)
            raise stop from overflow
        return None

    def _judged(self, finished: Trajectory | None, fault: str | None, again: Again | None) -> Trajectory:
        """The run, warned of where its steps were coarse; taken again where nobody named these."""
        coarse = Coarse(self.mechanism, self.step)  # what a linearisation at the start cannot tell
        if finished is not None and again is not None:
            fault = coarse.fault(finished)
            if fault is None:
                return finished
        if fault is not None and again is not None:
            return taken_again(again, self.schedule, self.step, fault)
        assert finished is not None  # what cannot be mended was raised
        # a kink leaves its own error of energy, which a shorter step would not mend
        if self.drives is not None and warned_of_kink(self.drives, finished.t):
            return finished
        # the other methods are there as published, their errors with them
        if self.checked and self.solver is None and self.choice.method == "bridge":
            coarse.judge(finished)
        return finished


def _reporting(
    progress: Progress, schedule: Schedule, name: str
) -> AbstractContextManager[Callable[[float], None] | None]:
    """What is told of the work done, while it lasts."""
    if isinstance(progress, bool):
        span = float(schedule.times[-1] - schedule.times[0])
        return progress_bar(span, f"simulating {name}") if progress else nullcontext()
    return nullcontext(progress)
