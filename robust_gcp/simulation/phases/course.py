"""The course of a run through phases of smooth motion: stretch, event, decision, next stretch."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import OptionError, SimulationError
from ...maps.start_check import checked_state, require_freedom
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import parts_given
from ...mechanism.tree import Array
from ..coarse import Coarse
from .decision import Phase, State, settled
from .frame import Seen
from .happening import Happening
from .impact import REST
from .joined import Block, Joined
from .machine import Machines
from .rest import rested
from .rows import Kind, Rows
from .stretch import Stretch, Walked
from .turn import BREAK, START, SWITCH, Passed, Turn
from .watch import Found

if TYPE_CHECKING:
    from ..course import Course, Progress
    from ..trajectory import Trajectory

FIRST, MOST = 8, 512
"""Steps of the stretch after an event, then doubled: those behind the next event are taken for nothing."""

SAME = 1e-9
"""Share of a step by which a time of the grid is left out beside an event."""

AHEAD = (1e-3, 1e-2, 0.1, 1.0)
"""Shares of a step after a break at which it is looked what slips."""


class Phases:
    """A run through phases.

    Parameters
    ----------
    machines : Machines
    start : (q0, v0)
    report : callable (fraction), optional
    """

    def __init__(
        self, machines: Machines, start: tuple[Array, Array], report: Callable[[float], Any] | None = None
    ) -> None:
        course = machines.course
        self._machines, self._rows, self._report = machines, machines.rows, report
        self._grid, self._step = course.schedule.times, course.step
        self._t, self._end = float(self._grid[0]), float(self._grid[-1])
        self._q, self._v = start
        self._rows.require_within(self._q)
        gaps = self._rows.gaps(self._q)
        self._phase = Phase(touching=frozenset(i for i in self._rows.of(Kind.SPRING) if gaps[i] < 0.0))
        self._seen = Seen(self._v, np.zeros_like(self._v), machines.toward(self._v))
        self._ahead: Iterator[State] | None = None
        self.passed, self._why = Passed(machines), START
        self.joined = Joined(self._rows, course.record)
        self.joined.stats.step = self._step
        locks = [self._rows.rows[i] for i in self._rows.of(Kind.LOCK)]
        switches = {x for row in locks for x in (row.start, row.end)}
        self._switches = sorted({x for x in switches if self._t < x < self._end} | {self._end})

    def go(self) -> None:
        """From phase to phase to the end."""
        fresh, size = True, FIRST
        while self._t < self._end or fresh:
            if fresh:
                self._settle()
                if self._t >= self._end:
                    self._keep_last()
                    return
            until = next(x for x in self._switches if x > self._t)
            machine, switched = self._machines.of(self._phase, self._q), False
            if machine is None:
                event = self._rest(self._times(until, len(self._grid)))
            else:
                event = self._stretch(machine, self._times(until, size))
            if not event and until - self._t <= SAME * self._step:
                self._t, switched = until, until < self._end
            fresh = event or switched
            size = FIRST if fresh else min(2 * size, MOST)
            if self._report is not None:
                done = (self._t - self._grid[0]) / (self._end - self._grid[0])
                self._report(min(float(done), 1.0))

    @property
    def _state(self) -> State:
        return State(self._t, self._q, self._v, self._seen)

    def _settle(self) -> None:
        """The phase that begins now."""
        acting, tell, before = self._machines.acting, self._tell, self._v
        self._phase, self._v = settled(self._rows, acting, self._phase, self._state, self._ahead, tell)
        turn = Turn(self._t, self._why, self._q, before, self._v, replace(self._phase))
        self.passed.turns.append(turn)
        self._ahead, self._why = None, SWITCH

    def _tell(self, kind: str, rows: Any, loss: float = 0.0) -> None:
        happening = Happening(float(self._t), kind, self._rows.names(rows), float(loss))
        self.joined.happenings.append(happening)

    def _times(self, until: float, size: int) -> Array:
        """The present time and the ends of the next steps: on the grid again as soon as may be."""
        slack = SAME * self._step
        first = int(np.searchsorted(self._grid, self._t + slack, side="right"))
        ahead = self._grid[first : first + size]
        ahead = ahead[ahead < until - slack]
        return np.array([self._t, *ahead, *([until] if len(ahead) < size else [])])

    def _stretch(self, machine: Mechanism, times: Array) -> bool:
        """Steps up to the next event, or to the end of the stretch; whether there was one."""
        walked = Stretch(self._machines, machine, self._phase).taken(self._state, times)
        run, last = walked.run, walked.count - 1
        self._keep(walked)
        self._t, self._q, self._v = float(run.t[last]), run.q[last], run.v[last]
        if walked.found is None:
            return False
        if walked.part is not None:
            self._keep_part(walked, walked.part)
        self._meet(machine, walked.found)
        return True

    def _keep(self, walked: Walked) -> None:
        """Outputs of a stretch before its event."""
        run, n = walked.run, walked.count
        assert run.a is not None
        self.joined.add(Block.of(run, n, walked.held[:n]), self._phase)
        self.joined.count(run, float(run.t[n - 1]))
        self._seen = Seen.of(run.v[n - 1], run.a[n - 1], self._seen)

    def _keep_part(self, walked: Walked, part: Trajectory) -> None:
        """The state just before the event, which is where the partial step ends."""
        assert part.a is not None and walked.part_held is not None
        self._t, self._q, self._v = float(part.t[-1]), part.q[-1], part.v[-1]
        self._seen = Seen.of(part.v[-1], part.a[-1], self._seen)
        block = Block.of(part, 2, walked.part_held)
        block.t = np.array([part.t[0], np.nextafter(self._t, -np.inf)])
        self.joined.add(block, self._phase, slice(1, None))
        self.joined.count(part, self._t)

    def _meet(self, machine: Mechanism, found: Found) -> None:
        """What the event is, for the decision that follows."""
        phase, rows, self._why = self._phase, self._rows, found.row
        if found.row < 0:
            self._ahead = self._looked_ahead(machine)
        elif rows.rows[found.row].kind is Kind.FRICTION:
            self._tell("at rest", [i for i in phase.slip if abs(rows.E[i] @ self._v) <= REST])
        elif rows.rows[found.row].kind is Kind.SPRING:
            phase.touching = phase.touching ^ {found.row}
            self._tell("touch" if found.row in phase.touching else "leave", [found.row])

    def _looked_ahead(self, machine: Mechanism) -> Iterator[State]:
        """States a moment later, while what was held still is."""
        phase, t, q, v, seen = self._phase, self._t, self._q, self._v, self._seen
        for share in AHEAD:
            times = np.array([t, t + share * self._step])
            run = self._machines.march(machine, phase, times, q, v, seen.toward)
            assert run.a is not None
            yield State(float(run.t[-1]), run.q[-1], run.v[-1], Seen.of(run.v[-1], run.a[-1], seen))

    def _rest(self, times: Array) -> bool:
        """Nothing moves; whether it broke loose."""
        found = rested(self._machines, self._phase, self._state, times)
        self.joined.add(found.block, self._phase)
        if found.fault is not None:
            raise found.fault
        self._t, self._v, self._seen = found.until, np.zeros_like(self._v), found.seen
        if found.broke:
            self._why = BREAK
            later = [found.until + share * self._step for share in AHEAD]
            self._ahead = iter([State(t, self._q, self._v, found.seen) for t in later])
        return found.broke

    def _keep_last(self) -> None:
        """An event at the very end of the run: the state after it is the last output."""
        machine, after = self._machines.of(self._phase, self._q), self._end + self._step
        if machine is None:
            block = rested(self._machines, self._phase, self._state, np.array([self._end, after])).block
            self.joined.add(block, self._phase, slice(0, 1))
        else:
            self._keep(Stretch(self._machines, machine, self._phase).first_output(self._state, after))


def run_phases(
    course: Course, parts: Any, start: tuple[Any, Any, Any], torque: Any, kernel: Any, required: bool,
    report: Progress,
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
    begun, mechanism = time.perf_counter(), course.mechanism
    rows = Rows(mechanism, parts_given(parts))
    q0, v0, mode = start
    require_freedom(mechanism)
    state = checked_state(mechanism, mechanism.home if q0 is None else q0, v0)
    machines = Machines(rows, course, torque, kernel, required, mode)
    phases = Phases(machines, state, report if callable(report) else None)

    def joined() -> Trajectory:
        run = phases.joined.trajectory()
        run.stats.wall_seconds, run.acted = time.perf_counter() - begun, course.acted
        run.passed = phases.passed
        return run

    try:
        phases.go()
    except SimulationError as error:
        error.trajectory = joined()
        raise
    run = joined()
    Coarse(mechanism, course.step).judge(run)
    return run


def require_plain(refused: dict[str, bool]) -> None:
    """An OptionError that names the first argument which does not go with `joints=`."""
    for name, given in refused.items():
        if given:
            raise OptionError(
                f"joints=: stops, friction and locks do not go with {name} yet; leave one of them out"
            )
