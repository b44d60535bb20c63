"""Where a motion through phases is, and what is recorded of it."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...dynamics.problem import initial_value_problem
from ...maps.explicit import Crossing
from ...maps.start_check import checked_state, require_freedom
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import Part
from ...mechanism.tree.tree import Array
from ...user_functions import returned
from ..events import Event, Events, checked_events
from ..runs.crossings import together
from ..trajectories.trajectory import Trajectory
from .admissible import Seen
from .decision import Phase, State
from .first_event import Stretch
from .grid import Chosen
from .happening import Happening
from .machine import Machines
from .phase_run import Leg, Steps
from .record import Block, Joined
from .rows import Kind, Rows
from .transitions import START, Passed

if TYPE_CHECKING:
    from ..runs.course import Course

FIRST = 8
"""Steps that are looked at together after an event, then doubled: some are taken for nothing."""

KNOWN = 8
"""Phases whose looks are kept."""

SAVED = ("_t", "_q", "_v", "_seen", "_fresh", "_begun", "_size", "_sums", "_armed", "ended")
"""What steps change, besides the phase and the record."""


class Progress:
    """Where a motion through phases is.

    Parameters
    ----------
    course : Course
        Of its steps; its schedule says at most which outputs are asked for.
    parts : sequence of Stop, JointFriction, Lock
    start : (q0, v0, mode)
    torque : HeldTorque, callable, array_like or None
    kernel, required
        As `Course.run` takes them.
    chosen : Chosen
        Outputs that are kept.
    report : callable (fraction), optional

    Attributes
    ----------
    joined : Joined
        What is recorded.
    ended : bool
        Whether one of the user's events ended the motion.

    Raises
    ------
    OptionError, ModelError, StateError
    """

    def __init__(
        self, course: Course, parts: Sequence[Part], start: tuple[Any, Any, Any], torque: Any, kernel: Any,
        required: bool, chosen: Chosen, report: Callable[[float], Any] | None = None,
    ) -> None:  # fmt: skip
        mechanism, grid, (q0, v0, mode) = course.mechanism, chosen.grid, start
        self._rows, self._grid, self._report = Rows(mechanism, parts, course.drives), grid, report
        require_freedom(mechanism)
        self._t = grid.number(0)
        self._q, self._v = self._start(course, q0, v0, mode)
        machines = self._machines = Machines(self._rows, course, torque, kernel, required, mode)
        self._rows.require_within(self._q)
        self._phase = Phase(touching=frozenset(self._rows.touched(self._q, self._v)))
        self._seen = Seen(self._v, np.zeros_like(self._v), machines.toward(self._v))
        self._ahead: Iterator[State] | None = None
        self._fresh, self._size, self.ended = True, FIRST, False
        self._begun = (-np.inf, 0)  # when a phase began last, and how many did then
        self._machine: Mechanism | None = None
        self._known: dict[Hashable, Stretch] = {}
        self._leg: Leg | None = None
        self._latches = [i for i in self._rows.of(Kind.LOCK) if self._rows.rows[i].when is not None]
        self._armed = frozenset[int]()  # those that may close
        asked = course.events.asked if isinstance(course.events, Events) else list(course.events)
        self._asked = len(asked)  # of all events; those of latches follow
        self._events = Events([*asked, *map(self._latch, self._latches)], self._t, grid.step)
        self.passed, self._why = Passed(machines), START
        self.joined = Joined(self._rows, course.record, chosen, machines.controls)
        self.joined.stats.step = grid.step
        self._sums, self._read = self.joined.sums, 0  # at the leg's start; its last output that was kept
        locks = [self._rows.rows[i] for i in self._rows.of(Kind.LOCK)]
        switches = {x for row in locks for x in (row.start, row.end)}
        self._switches = sorted(x for x in switches if self._t < x < grid.end - grid.slack)

    def _start(self, course: Course, q0: Any, v0: Any, mode: Any) -> tuple[Array, Array]:
        """q and v, checked; where drives begin, with what is free at rest if no v0 says otherwise."""
        mechanism = course.mechanism
        if course.drives is None:
            return checked_state(mechanism, mechanism.home if q0 is None else q0, v0)
        choice, drive = course.choice, course.drives
        start = initial_value_problem(mechanism, q0, v0, mode, choice=choice, drive=drive).start
        return start.point.q, start.point.G @ start.ydot

    @property
    def state(self) -> tuple[Array, Array]:
        """q and v where it is."""
        leg = self._leg
        return (self._q, self._v) if leg is None or leg.at <= self._read else leg.state

    @property
    def _state(self) -> State:
        return State(self._t, self._q, self._v, self._seen)

    def _collect(self) -> None:
        """Keep the leg's outputs that were not looked at, as nothing can have happened."""
        leg = self._leg
        if leg is not None and leg.at > self._read:
            steps = leg.since(self._read)
            if steps.t[-1] in self._switches:
                steps.t = np.append(steps.t[:-1], np.nextafter(steps.t[-1], -np.inf))
            t, self._read = self._t, leg.at
            self._keep(steps, np.zeros((len(steps.t), len(self._rows.rows))))
            self._t = t  # not the last bit before a switch
            self._machines.forget()

    def _drop(self) -> None:
        """The leg is over; its outputs, crossings and costs up to now are kept."""
        self._collect()
        self._count()

    def _count(self) -> None:
        """The leg is over; its crossings and costs up to now are kept."""
        if self._leg is not None:
            self.joined.count(self._leg.trajectory(), self._t)
            self._leg.release()
        self._leg = None

    def _keep(self, steps: Steps, held: Array) -> None:
        """Outputs of steps without an event, and of those asked for within."""
        block, inner = self._stretch.block(steps, held), list[tuple[int, Block]]()
        for k in range(len(steps.t) - 1 if self.joined.chosen.times is not None else 0):
            state = State(float(steps.t[k]), steps.q[k], steps.v[k], self._seen)
            inner += [(k, part) for part in self._within(state, float(steps.t[k + 1]), held[k])]
        self.joined.add(block.with_rows(inner), self._phase)
        self._arrive(steps)

    def _arrive(self, steps: Steps) -> None:
        """Go to the last of these ends of steps."""
        self._t, self._q, self._v = float(steps.t[-1]), steps.q[-1].copy(), steps.v[-1].copy()
        self._seen = Seen.of(self._v, steps.a[-1].copy(), self._seen)

    def _within(self, state: State, end: float, held: Array) -> Iterator[Block]:
        """Outputs asked for between a state and a time, each by a partial step."""
        for t in self.joined.chosen.between(state.t, end).tolist():
            part = self._stretch.part(state, t)
            yield self._stretch.block(part, np.array([held, self._stretch.forces(part, -1)]))

    @property
    def last(self) -> dict[str, Array]:
        """The last row of the record, kept or not."""
        self._collect()
        return self.joined.last

    @property
    def dissipated(self) -> float:
        """Energy lost so far, J."""
        self._collect()
        return self.joined.dissipated

    @property
    def crossings(self) -> list[Crossing]:
        """Singular places passed so far."""
        return together(self._counted().crossings)

    @property
    def happenings(self) -> list[Happening]:
        """What happened so far."""
        return self.joined.happenings

    @property
    def events(self) -> Events:
        """The user's."""
        return self._events.only(self._asked)

    def _latch(self, row: int) -> Event:
        """The event that closes a lock, as long as it is open."""
        (asked,) = checked_events([self._rows.rows[row].when])
        label = f"Lock {self._rows.rows[row].part.joint!r}"

        def function(t: float, q: Array, v: Array) -> float:
            if row not in self._armed or row in self._phase.latched:
                return 1.0
            return float(returned(asked(t, q, v), (), f"{label}: when(t, q, v)", t=t))

        return Event(function, True, asked.direction)

    @property
    def toward(self) -> Array:
        """Velocity when it last moved, (nv,)."""
        self._collect()
        return self._seen.toward

    def remembered(self) -> tuple[Any, ...]:
        """What a motion through the same rows goes on from, besides the state."""
        self._collect()
        return self._rows.signature, copy.deepcopy(self._phase), self._seen

    def recall(self, remembered: tuple[Any, ...] | None) -> None:
        """Go on from that; a motion through other rows begins without it."""
        signature, phase, seen = (None, None, None) if remembered is None else remembered
        if signature == self._rows.signature:
            self._phase, self._seen = copy.deepcopy(phase), seen

    def trajectory(self, begun: float) -> Trajectory:
        """What is recorded so far, and what it cost since `begun` on the computer's clock."""
        self._collect()
        run = self._counted().trajectory(self.events)
        run.stats.wall_seconds, run.acted = time.perf_counter() - begun, self._machines.course.acted
        return run

    def _counted(self) -> Joined:
        """A copy of the record, with the crossings and the cost of the leg that is not over."""
        joined = self.joined.copied()
        if self._leg is not None:
            joined.count(self._leg.trajectory(), self._t)
        return joined

    def copied(self) -> dict[str, Any]:
        """All that steps change; what comes next begins with a new leg, as it does after `put_back`."""
        self._drop()
        parts = {name: getattr(self, name) for name in SAVED}
        held = self._machines.held
        torque = None if held is None else held.value
        return parts | {
            "_phase": copy.deepcopy(self._phase), "joined": self.joined.copied(),
            "events": self._events.copied(), "torque": torque, "before": self._machines.before,
        }  # fmt: skip

    def put_back(self, parts: dict[str, Any]) -> None:
        """Go back to where these were copied."""
        self._leg = self._ahead = None
        for name in SAVED:
            setattr(self, name, parts[name])
        self._phase, self.joined = copy.deepcopy(parts["_phase"]), parts["joined"].copied()
        self._events, self._machines.before = parts["events"].copied(), parts["before"]
        if self._machines.held is not None:
            self._machines.held.value = parts["torque"]
            self._machines.forget()  # the leg that they drove is gone
        self._machine = None if self._fresh else self._machines.of(self._phase, self._q)
        if self._machine is not None:
            self._stretch = self._looked_at(self._machine)

    def _looked_at(self, machine: Mechanism) -> Stretch:
        """What looks at the steps of the phase; the last ones are kept, as phases come again."""
        key, known = self._phase.key, self._known
        if key not in known:
            if len(known) >= KNOWN:
                del known[next(iter(known))]
            known[key] = Stretch(self._machines, machine, self._phase)
        return known[key]
