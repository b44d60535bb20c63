"""A run of `simulate` through phases, from its start to its end."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...dynamics.prescribed.drive import warned_of_kink
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...errors import OptionError, SimulationError
from ...mechanism.parts import Part
from ..runs.schedule import ALL
from ..runs.too_long_steps import Coarse
from .course import Phases
from .grid import Chosen, Grid

if TYPE_CHECKING:
    from ..runs.course import Course, Progress
    from ..trajectories.trajectory import Trajectory


def run_phases(
    course: Course, parts: Sequence[Part], start: tuple[Any, Any, Any], torque: Any, kernel: Any,
    required: bool, report: Progress,
) -> Trajectory:  # fmt: skip
    """A run of `simulate` with `joints=`.

    Parameters
    ----------
    course : Course
    parts : sequence of Stop, JointFriction, Lock
    start : (q0, v0, mode)
    torque, kernel, required
        As `Course.run` takes them.
    report : callable (fraction) or None

    Raises
    ------
    OptionError, ModelError, StateError, SimulationError
    """
    begun, schedule = time.perf_counter(), course.schedule
    grid = Grid(float(schedule.times[0]), course.step, schedule.times)
    chosen = Chosen(grid, None if schedule.plain else schedule.outputs, ALL)
    told = report if callable(report) else None
    phases = Phases(course, parts, start, torque, kernel, required, chosen, told)
    try:
        _go(phases, grid, torque)
        run = phases.trajectory(begun)
    except SimulationError as error:
        error.trajectory = phases.trajectory(begun)
        error.trajectory.passed = phases.passed
        raise
    finally:
        phases.passed.machines.release()
    run.passed = phases.passed
    # a kink leaves an error of energy of its own, which no shorter step mends
    if course.drives is not None and warned_of_kink(course.drives, run.t):
        return run
    Coarse(course.mechanism, course.step).judge(run)
    return run


def _go(phases: Phases, grid: Grid, torque: Any) -> None:
    """To the end; torques that are held are asked for at each step's beginning."""
    if not isinstance(torque, HeldTorque):
        phases.advance(grid.end)
        return
    assert torque.asked is not None and grid.times is not None
    for k in range(len(grid.times) - 1):
        if phases.ended:
            return
        phases.hold(torque.asked(grid.number(k), *phases.state))
        phases.advance(grid.number(k + 1))


def require_plain(refused: dict[str, bool]) -> None:
    """An OptionError that names the first argument which does not go with `joints=`."""
    for name, given in refused.items():
        if given:
            raise OptionError(
                f"joints=: stops, friction and locks do not go with {name} yet; leave one of them out"
            )
