"""Steps of one phase that go on from each other, in a run of their own."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...errors import ClosureError, PartitionError, SimulationError
from ...kernel.simulation.steps import NativeSteps
from ...mechanism.tree.tree import Array, Tree
from ..runs.coordinates import Coordinates
from ..runs.fixed_steps import FixedRun
from ..runs.initial_state import initialise
from ..runs.schedule import Schedule
from ..runs.stepped import SteppedRun
from ..trajectories.interpolant import Interpolant

if TYPE_CHECKING:
    from ...dynamics.problem import Problem
    from ..runs.course import Course
    from ..trajectories.trajectory import Trajectory
    from .machine import Machines

Fault = SimulationError | ClosureError

SAME = 1e-11
"""Share of a velocity by which its independent components may say it otherwise."""


@dataclass
class Steps:
    """Ends of steps: t (N,), q, v, a, what acts besides gravity and what is held, and its work so far.

    `regular` tells that the kernel is there, and no zone of a singular place was met; `drive` is what drives
    take of what acts, see `Evaluation`, (N, 0) without any.
    """

    tree: Tree
    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    work: Array
    regular: bool = False
    drive: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        if not self.drive.size:
            self.drive = np.zeros((len(self.t), 0))

    def motion_at(self, t: float) -> tuple[Array, Array, Array]:
        """q, v and a between them, interpolated."""
        q, v, a = Interpolant(self.tree, self.t, self.q, self.v, self.a)(np.array([t]))
        return q[0], v[0], a[0]

    def first(self, n: int) -> Steps:
        """The first n of them."""
        parts = {name: getattr(self, name)[:n] for name in ("t", "q", "v", "a", "tau", "work", "drive")}
        return replace(self, **parts)


def _shifted(motion: Problem, v: Array) -> float:
    """Share of v by which its independent components say it otherwise."""
    found = motion.start.point.G @ motion.start.ydot
    units = motion.mechanism.units
    size = float(np.abs(v / units).max(initial=0.0))
    return float(np.abs((found - v) / units).max(initial=0.0)) / size if size > 0.0 else 0.0


def _steadier(
    motion: Problem,
    plan: Course,
    start: tuple[Array, Array, ArrayLike | None],
    native: NativeSteps | None,
) -> Problem:
    """The start in coordinates that say its velocity better, if any: near a turn they lose digits."""
    mechanism = motion.mechanism
    # by K's kernel: G itself, by which a run changes its coordinates, has no digits left there
    names = Coordinates(mechanism, mechanism.independent, motion.counters).at_rest(start[0])
    if names is None or plan.on_toggle == "error":
        return motion
    acting = motion.torque, plan.choice, plan.on_toggle, plan.drives, float(plan.schedule.times[0])
    with contextlib.suppress(SimulationError, PartitionError):  # the first ones lose digits, but serve
        other = initialise(native, mechanism.with_independent(names), start, *acting)
        if _shifted(other, start[1]) < 0.1 * _shifted(motion, start[1]):
            return other
    return motion


class Leg:
    """A run of a phase, from its state on.

    Parameters
    ----------
    machines : Machines
    plan : Course
        With the mechanism of the phase.
    torque : HeldTorque, callable, array_like or None
        With what slipping joints and springs add.
    times : ndarray (N + 1,)
        Where it begins, and the ends of its steps.
    start : (q, v, mode)

    Raises
    ------
    SingularStartError
        Where modes meet and no mode is given.
    """

    def __init__(
        self, machines: Machines, plan: Course, torque: Torque | ArrayLike | None, times: Array,
        start: tuple[Array, Array, ArrayLike | None],
    ) -> None:  # fmt: skip
        span = float(times[-1] - times[0])
        what = "a", "tau"  # r̈ of rows, and what the forces of those that are held have to balance
        self._plan = plan = replace(plan, schedule=Schedule.every(times), duration=span, record=what)
        self._begun, self.times, self._machines = time.perf_counter(), times, machines
        self._held = torque.value if isinstance(torque, HeldTorque) else None
        found = plan.begun(start, torque, machines.kernel, machines.required)
        self._motion, native, self._stability = found
        if _shifted(self._motion, start[1]) > SAME:
            self._motion = _steadier(self._motion, plan, start, native)
        if self._stability is not None:
            self._stability.before(self._motion, native)
        self._native = native
        run = plan.made(self._motion, native)
        assert isinstance(run, FixedRun)  # no solver goes with phases
        self._run = run
        before = machines.before
        if before is not None and before[0] is plan.mechanism:  # other closures are conditioned otherwise
            self._run.goes_on(before[1])

    @property
    def at(self) -> int:
        """The step's end that was reached; −1 before the start."""
        return self._run.record.count - 1

    @property
    def state(self) -> tuple[Array, Array]:
        """q and v there."""
        return self._run.record.state()

    @property
    def ended(self) -> bool:
        """Whether an event ended it."""
        return self._run.ended

    @property
    def paused(self) -> bool:
        """Whether the last step is to be looked at."""
        return self._run.paused

    def advance(self, n: int) -> Fault | None:
        """n steps more, and what stopped them; with n = 0 the start."""
        try:
            self._plan.gone(self._run, self._begun, False, lambda: self._further(n))
        except (SimulationError, ClosureError) as error:
            return error  # not raised: an event in the steps before it may keep the motion from there
        finally:
            self._machines.before = self._plan.mechanism, self._run.before
            if self._stability is not None and n:  # the start alone is no step to judge by
                self._stability.after(self._motion)
                self._stability = None
        return None

    def _further(self, n: int) -> None:
        run = self._run
        if not isinstance(run, SteppedRun):
            run.further(n)
            return
        if run.record.at < 0:
            run.begin()
        if n and self._held is not None:
            run.take(self._held, n)

    def turn(self, torque: Array) -> bool:
        """Hold another torque from here on; whether it can."""
        self._held = None if self._held is None else torque
        return self._held is not None

    def since(self, i: int) -> Steps:
        """The ends of steps from number i on, which lies lower where the run went back."""
        regular = self._native is not None and self._run.zone_evaluations == 0
        t, q, v, a, tau, work, drive = self._run.record.steps(i)
        return Steps(self._plan.mechanism.tree, t, q, v, a, tau, work, regular, drive)

    def gone_back(self) -> bool:
        """Whether outputs told before were taken anew since this was asked last."""
        lowest, self._run.lowest = self._run.lowest, len(self.times)
        return lowest < len(self.times)

    def release(self) -> None:
        """Give the kernel's memory back; no more steps are taken."""
        if self._native is not None:
            self._native.release()

    def trajectory(self) -> Trajectory:
        """Its crossings and costs too."""
        return self._run.trajectory(self._begun)
