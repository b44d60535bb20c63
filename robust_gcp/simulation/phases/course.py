"""The course of a run through phases of smooth motion: stretch, event, decision, next stretch."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from ...errors import ClosureError, OptionError, SimulationError
from ...maps.start_check import require_compatible, require_finite_energy, require_freedom
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import NEARLY_CLOSED
from ...mechanism.tree import Array
from ..coarse import Coarse
from .decision import Phase, State, settled
from .frame import Seen
from .impact import REST
from .joined import Block, Joined
from .machine import Machines
from .parts import Happening, parts_given
from .rows import Kind, Rows
from .watch import Found, Holding, Signals, first_break

if TYPE_CHECKING:
    from ..course import Course, Progress
    from ..trajectory import Trajectory

FIRST, MOST = 8, 512
"""Steps of the stretch after an event, then doubled: those behind the next event are taken for nothing."""

SAME = 1e-9
"""Share of a step by which a time of the grid is left out beside an event."""

AHEAD = (1e-3, 1e-2, 0.1, 1.0)
"""Shares of a step after a break at which it is looked what slips."""

FINER = (1, 4, 16, 64)
"""Parts of a step that fails: a stop may be what keeps the mechanism from the place where it does."""

CORRECTIONS = 5


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
        springs = frozenset(i for i in self._rows.of(Kind.SPRING) if gaps[i] < 0.0)
        self._phase = Phase(touching=springs)
        self._seen = Seen.of(self._v, np.zeros_like(self._v))
        self._ahead: Iterator[State] | None = None
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
            machine = self._machines.of(self._phase, self._q)
            if machine is None:
                self._rest(until)
                fresh, size = True, FIRST
            elif self._stretch(machine, until, size):
                fresh, size = True, FIRST
            else:
                fresh, size = self._t >= until and self._t < self._end, min(2 * size, MOST)
            if self._report is not None:
                done = (self._t - self._grid[0]) / (self._end - self._grid[0])
                self._report(min(float(done), 1.0))

    # ----------------------------------------------------------------- between phases

    def _settle(self) -> None:
        t, tell = self._t, self._tell
        state = State(t, self._q, self._v, self._seen)
        self._phase, self._v = settled(
            self._rows, self._machines.acting, self._phase, state, self._ahead, tell
        )
        self._ahead = None

    def _tell(self, kind: str, rows: Any, loss: float = 0.0) -> None:
        self.joined.happenings.append(Happening(float(self._t), kind, self._rows.names(rows), float(loss)))

    def _keep_last(self) -> None:
        """An event at the very end of the run: its state is the last."""
        acting = self._machines.acting(self._phase)(self._t, self._q, self._v)
        row = (x[None] for x in (self._q, self._v, self._seen.a, acting))
        held = np.zeros((1, len(self._rows.rows)))
        self.joined.add(Block(np.array([self._end]), *row, np.zeros(1), held), self._phase)

    # ----------------------------------------------------------------- a stretch of steps

    def _times(self, until: float, size: int) -> Array:
        """The present time and the ends of the next steps: on the grid again as soon as may be."""
        slack = SAME * self._step
        first = int(np.searchsorted(self._grid, self._t + slack, side="right"))
        ahead = self._grid[first : first + size]
        ahead = ahead[ahead < until - slack]
        if len(ahead) < size:
            ahead = np.append(ahead, until)
        return np.array([self._t, *ahead])

    def _stretch(self, machine: Mechanism, until: float, size: int) -> bool:
        """Steps up to the next event, or to the end of the stretch; whether there was one."""
        phase, times = self._phase, self._times(until, size)
        signals, holding = Signals(self._rows, phase), Holding(self._rows, phase)
        run, fault = self._marched(machine, times)
        if len(run.t) < 2:
            for parts in FINER[1:]:
                run, fault = self._marched(machine, np.linspace(times[0], times[1], parts + 1))
                if self._first(run, signals, holding)[0] is not None:
                    break
        found, held = self._first(run, signals, holding)
        if found is None and fault is not None and len(run.t) < 2:
            raise fault
        if found is None:
            self._advance(run, len(run.t), held)
            self._t, self._q, self._v = float(run.t[-1]), run.q[-1], run.v[-1]
            if fault is None and self._t > until - SAME * self._step:
                self._t = until
            return False
        self._advance(run, found.step + 1, held)
        self._locate(machine, run, found, signals, holding)
        return True

    def _marched(
        self, machine: Mechanism, times: Array
    ) -> tuple[Trajectory, SimulationError | ClosureError | None]:
        """The steps, and what stopped them before their end."""
        try:
            return self._machines.march(
                machine, self._phase, times, self._q, self._v, self._seen.toward
            ), None
        except (SimulationError, ClosureError) as error:
            if error.trajectory is None or not len(error.trajectory.t):
                raise
            return error.trajectory, error

    def _first(self, run: Trajectory, signals: Signals, holding: Holding) -> tuple[Found | None, Array]:
        """The first event of a stretch, and the forces of what is held as far as that."""
        assert run.a is not None
        found = signals.first(run.t, run.q, run.v, run.a)
        count = len(run.t) if found is None else found.step + 2
        held, margins = np.zeros((len(run.t), len(self._rows.rows))), np.full(len(run.t), np.inf)
        if holding:
            for k in range(count):
                held[k], margins[k] = holding.forces(run.q[k], run.v[k], run.a[k], self._tau(run, k))
                if k and holding.limited and margins[k] < 0.0:
                    break
        step = first_break(margins[1:]) if holding.limited else None
        if step is None or (found is not None and found.step < step):
            return found, held
        share = self._break(run, step, holding)
        return (found if found is not None and found[:2] < (step, share) else Found(step, share, -1)), held

    @staticmethod
    def _tau(run: Trajectory, k: int) -> Array:
        return np.zeros(run.v.shape[1]) if run.tau is None else np.asarray(run.tau[k])

    def _break(self, run: Trajectory, step: int, holding: Holding) -> float:
        """The share of the step at which the margin of what is held is 0, on the interpolated motion."""
        h, acting = run.t[step + 1] - run.t[step], self._machines.acting(self._phase)

        def margin(x: float) -> float:
            s = run.at(min(run.t[step] + x * h, run.t[step + 1]))
            return holding.margin(s.q, s.v, s.a, acting(float(s.t), s.q, s.v))

        if margin(0.0) <= 0.0:
            return 0.0
        return 1.0 if margin(1.0) >= 0.0 else float(brentq(margin, 0.0, 1.0, xtol=1e-13))

    def _advance(self, run: Trajectory, count: int, held: Array) -> None:
        """Keep the first outputs of a stretch."""
        assert run.a is not None
        self.joined.add(Block.of(run, count, held[:count]), self._phase)
        self._moved(run, count - 1)
        self.joined.cross(run, float(run.t[count - 1]))

    def _moved(self, run: Trajectory, k: int) -> None:
        assert run.a is not None
        self._seen = Seen.of(run.v[k], run.a[k], self._seen)

    def _locate(
        self, machine: Mechanism, run: Trajectory, found: Found, signals: Signals, holding: Holding
    ) -> None:
        """Go to the event, by a partial step corrected until the event's own function vanishes."""
        k, x = found.step, found.share
        h, begin = float(run.t[k + 1] - run.t[k]), float(run.t[k])
        self._q, self._v, self._t = run.q[k], run.v[k], begin
        part: Trajectory | None = None
        for _ in range(CORRECTIONS):
            if x * h < max(1e-15, 4.0 * np.spacing(abs(begin))):
                part = None
                break
            part = self._machines.march(
                machine, self._phase, np.array([begin, begin + x * h]), run.q[k], run.v[k], self._seen.toward
            )
            value, slope = self._value(part, found, signals, holding, h)
            if abs(value) <= max(1e-14, -1e-15 * slope) or slope >= 0.0 or abs(value) > -1e-3 * slope:
                break
            x = min(x - value / slope, 1.0)
        if part is not None:
            self._keep_part(part, holding)
        self._meet(machine, found)

    def _value(
        self, part: Trajectory, found: Found, signals: Signals, holding: Holding, h: float
    ) -> tuple[float, float]:
        """The event's function at the end of a partial step, and its slope by a share of the step of h."""
        assert part.a is not None
        q, v, a = part.q[-1], part.v[-1], part.a[-1]
        if found.row >= 0:
            value, rate = signals.at(found.row, q, v, a)
            return value, rate * h
        value = holding.margin(q, v, a, self._tau(part, -1))
        acting, dt = self._machines.acting(self._phase), min(1e-3 * h, 0.5 * float(part.t[-1] - part.t[0]))
        before = part.at(part.t[-1] - dt)
        earlier = holding.margin(before.q, before.v, before.a, acting(float(before.t), before.q, before.v))
        return value, (value - earlier) / dt * h

    def _keep_part(self, part: Trajectory, holding: Holding) -> None:
        """The state just before the event, which is where the partial step ends."""
        assert part.a is not None
        t, q, v, a, n = float(part.t[-1]), part.q[-1], part.v[-1], part.a[-1], len(self._rows.rows)
        held = np.zeros((len(part.t), n))
        if holding:
            held[-1] = holding.forces(q, v, a, self._tau(part, -1))[0]
        block = Block.of(part, len(part.t), held)
        block.t = np.array([*part.t[:-1], np.nextafter(t, -np.inf)])
        self.joined.add(block, self._phase, slice(len(part.t) - 1, None))
        self.joined.cross(part, t)
        self._t, self._q, self._v = t, q, v
        self._moved(part, -1)

    def _meet(self, machine: Mechanism, found: Found) -> None:
        """What the event is, for the decision that follows."""
        phase, rows = self._phase, self._rows
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
            run = self._machines.march(
                machine, phase, np.array([t, t + share * self._step]), q, v, seen.toward
            )
            assert run.a is not None
            yield State(float(run.t[-1]), run.q[-1], run.v[-1], Seen.of(run.v[-1], run.a[-1], seen))

    # ----------------------------------------------------------------- where nothing moves

    def _rest(self, until: float) -> None:
        """Nothing moves, until torques that change with time are too much for what is held, or a lock opens."""
        phase, q, seen, acting = self._phase, self._q, self._seen, self._machines.acting(self._phase)
        holding, zero = Holding(self._rows, phase), np.zeros_like(self._v)
        still = Seen(zero, zero, seen.toward)

        def margin(t: float) -> float:
            return holding.margin(q, zero, zero, acting(t, q, zero), still)

        times, size = self._times(until, len(self._grid)), len(self._rows.rows)
        varies, known = self._machines.varies, holding.forces(q, zero, zero, acting(self._t, q, zero), still)
        taus, held = [acting(self._t, q, zero)], [known[0]]
        broken: float | None = None
        for before, t in zip(times[:-1], times[1:], strict=True):
            if varies:
                taus.append(acting(float(t), q, zero))
                known = holding.forces(q, zero, zero, taus[-1], still)
                if holding.limited and known[1] < 0.0:
                    broken = (
                        float(before)
                        if margin(before) <= 0.0
                        else float(brentq(margin, before, t, xtol=1e-14))
                    )
                    taus[-1] = acting(broken, q, zero)
                    known = holding.forces(q, zero, zero, taus[-1], still)
            else:
                taus.append(taus[0])
            held.append(known[0])
            if broken is not None:
                break
        n = len(taus)
        t = times[:n].copy()
        if broken is not None:
            t[-1] = np.nextafter(broken, -np.inf)
        rows = np.tile(q, (n, 1)), np.zeros((n, len(zero))), np.zeros((n, len(zero))), np.array(taus)
        block = Block(t, *rows, np.zeros(n), np.array(held).reshape(n, size))
        self.joined.add(block, phase, slice(0, n if n < 2 or t[-1] > t[-2] else n - 1))
        self._seen, self._v, self._t = still, zero, until if broken is None else broken
        if broken is not None:
            later = [broken + share * self._step for share in AHEAD]
            self._ahead = iter([State(x, q, zero, still) for x in later])


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
    OptionError, StateError, SimulationError
    """
    begun, mechanism = time.perf_counter(), course.mechanism
    rows = Rows(mechanism, parts_given(parts))
    q0, v0, mode = start
    q = mechanism.home if q0 is None else mechanism.configuration(q0, "q0")
    v = np.zeros(mechanism.nv) if v0 is None else mechanism.velocity(v0, "v0")
    q, v = _checked(mechanism, q, v)
    machines = Machines(rows, course, torque, kernel, required, mode)
    phases = Phases(machines, (q, v), report if callable(report) else None)

    def joined() -> Trajectory:
        run = phases.joined.trajectory()
        run.stats.wall_seconds = time.perf_counter() - begun
        run.acted = course.acted
        return run

    try:
        phases.go()
    except SimulationError as error:
        error.trajectory = joined()
        raise
    run = joined()
    if course.solver is None and course.choice.method == "bridge":
        Coarse(mechanism, course.step).judge(run)
    return run


def _checked(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """A start with its loops closed, or an error that tells what is wrong with it."""
    require_freedom(mechanism)
    mechanism.require_closed(q, NEARLY_CLOSED, "q0")
    mechanism.require_proper(q)
    require_finite_energy(mechanism, v)
    require_compatible(mechanism, q, v)
    return mechanism.polish(q, mechanism.iv_dependent), v


def require_plain(refused: dict[str, bool]) -> None:
    """An OptionError that names the first argument which does not go with `joints=`."""
    for name, given in refused.items():
        if given:
            raise OptionError(
                f"joints=: stops, friction and locks do not go with {name} yet; leave one of them out"
            )
