"""The course of a run through phases of smooth motion: steps, event, decision, next phase."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import CuspError, SimulationError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .at_rest import Still, rested
from .decision import State, decided, settled
from .happening import Happening
from .impact import REST
from .phase_run import Fault, Leg, Steps
from .progress import FIRST
from .round_cusp import RoundCusps
from .rows import Kind
from .transitions import BREAK, LATCH, SWITCH, Turn
from .watch import Found

MOST = 4096
"""Steps of one leg."""

FINER = (4, 16, 64)
"""Parts of a step that fails: a stop may be what keeps the mechanism from the place where it does."""

AT_ONCE = 200
"""Phases that begin at one time: more of them would never end."""

AHEAD = (1e-3, 1e-2, 0.1, 1.0)
"""Shares of a step after a break at which it is looked what slips."""


class Phases(RoundCusps):
    """A motion through phases; parameters are those of `Progress`."""

    # ----------------------------------------------------------------- from phase to phase

    def advance(self, end: float) -> None:
        """From phase to phase up to a time of the grid, s."""
        while not self.ended and (self._fresh or self._t < end - self._grid.slack):
            if self._fresh:
                self._begin()
            elif self._machine is None:
                self._rest(end)
            else:
                self._walk(self._machine, end)
            if self._report is not None:
                span = self._grid.end - self._grid.t0
                self._report(min(float((self._t - self._grid.t0) / span), 1.0))

    def hold(self, torque: Array) -> None:
        """Another torque (nv,) from now on, where torques are held over steps."""
        held, phase = self._machines.held, self._phase
        assert held is not None
        if np.array_equal(torque, held.value, equal_nan=True):
            return
        self._machines.hold(self._t, torque)
        if self._fresh:
            return
        if self._leg is not None and not self._leg.turn(held.beside(torque, self._machines.constant(phase))):
            self._drop()
        # what slips or has left goes on: a torque has no impulse, so that only what is held may give
        if not phase.held:
            return
        self._collect()
        other = phase.successor()
        other.held = decided(self._machines.bounds, self._machines.acting(other), other, self._state)
        self._fresh = sorted(other.held) != sorted(phase.held) or other.slip != phase.slip

    def _tell(self, kind: str, rows: Any, loss: float = 0.0) -> None:
        happening = Happening(float(self._t), kind, self._rows.names(rows), float(loss))
        self.joined.happenings.append(happening)

    def _begin(self) -> None:
        """The phase that begins now, and its first output."""
        machines, rows, before = self._machines, self._rows.rows, self._v
        self._require_progress()
        self._drop()
        self._armed = frozenset(i for i in self._latches if rows[i].start <= self._t)
        given = self._phase, self._state, self._ahead, self._tell
        told = len(self.joined.happenings)
        self._phase, self._v = settled(machines.bounds, machines.acting, *given)
        if self._rows.drive is not None:  # its impulses hold it to its motion, whatever is struck
            kinetic, lost = self._rows.mechanism.tree.kinetic, self.joined.happenings[told:]
            change = kinetic(self._q, self._v) - kinetic(self._q, before)
            self.joined.take_work(change + sum(happening.loss for happening in lost))
        self.passed.turns.append(Turn(self._t, self._why, self._q, before, self._v, replace(self._phase)))
        self._why, self._ahead, self._fresh, self._size = SWITCH, None, False, FIRST
        machine = self._machine = machines.of(self._phase, self._q)
        if machine is None:
            after = np.array([self._t, self._t + self._grid.step])
            self.joined.add(rested(machines, self._phase, self._state, after).block.first(1), self._phase)
            return
        self._stretch = self._looked_at(machine)
        try:
            steps = self._new_leg(machine).since(0)
        except CuspError as fault:
            self._round(fault)
            return
        self._keep(steps, self._stretch.forces(steps, 0)[None])

    def _require_progress(self) -> None:
        """Refuse to begin phase after phase at one time."""
        since, times = self._begun
        self._begun = self._t, times + 1 if since == self._t else 1
        if self._begun[1] > AT_ONCE:
            names = {name for x in self.joined.happenings[-AT_ONCE:] for name in x.joints}
            joints = names or {row.part.joint for row in self._rows.rows}
            raise SimulationError(
                f"at t = {self._t:.6g} s the phases of {', '.join(sorted(joints))} follow each other without "
                "end: neither of them lasts; take another step, or change a stop or a friction a little"
            )

    def _times(self, until: float) -> Array:
        """The present time and the ends of the next steps: on the grid again as soon as may be."""
        slack = self._grid.slack
        until = next((x for x in self._switches if self._t < x <= until + slack), until)
        ahead = self._grid.after(self._t, MOST)
        few = len(ahead) < MOST or ahead[-1] >= until
        ahead = ahead[ahead < until - slack]
        return np.array([self._t, *ahead, *([until] if few and until < np.inf else [])])

    def _new_leg(self, machine: Mechanism) -> Leg:
        """A new leg from the present state."""
        times, q, v = self._times(self._grid.end), self._q, self._v
        if len(times) == 1 or times[1] <= times[0]:  # at the end of all
            times = np.array([self._t, self._t + self._grid.step])
        events = self._events if self._events else None
        leg = self._machines.leg(
            machine, self._phase, times, q, v, self._seen.toward, events, self._stretch.guard
        )
        if (fault := leg.advance(0)) is not None:
            raise fault
        self._leg, self._sums, self._read = leg, self.joined.sums, 0
        return leg

    # ----------------------------------------------------------------- steps

    def _walk(self, machine: Mechanism, end: float) -> None:
        """Steps up to the next event, or to the end."""
        leg = self._leg or self._new_leg(machine)
        i, slack = leg.at, self._grid.slack
        n = int(np.searchsorted(leg.times, end + slack, side="right")) - 1 - i
        # motions are asked for all steps to come before the first of them is taken
        few = self._stretch.limited or self._rows.drive is not None
        fault = leg.advance(min(max(n, 1), self._size) if few else max(n, 1))
        back = leg.gone_back()
        if not (back or fault or leg.paused or leg.ended or self._stretch.looks):
            self._t, self._size = float(leg.times[leg.at]), min(2 * self._size, MOST)
            if leg.at == len(leg.times) - 1:
                self._drop()
                self._fresh = self._t in self._switches
            return
        if back:  # beside a zone without a bridge steps are taken again with error control
            self._read = 0
            self.joined.back_to(self._sums)
        steps = leg.since(self._read)
        last = len(steps.t) - 1
        # the guard lets no event pass: of steps that it did not stop only the forces are looked at
        found, held = self._stretch.first(steps, self._seen, 0 if back else last - int(leg.paused))
        if found is None and isinstance(fault, CuspError):
            self._keep(steps, held)
            self._read = leg.at
            self._drop()
            self._round(fault)
            return
        if fault is not None and found is None and leg.at <= i:  # else the steps before it are kept first
            self._collect()
            steps, found, held = self._finer(machine, leg, fault)
        k, end = len(steps.t) - 1 if found is None else found.step, float(steps.t[-1])
        switched = end in self._switches or (leg.ended and not self._over)
        if found is None and switched:  # the state before; what follows has one of its own
            steps = replace(steps, t=np.append(steps.t[:-1], np.nextafter(end, -np.inf)))
        self._keep(steps.first(k + 1), held[: k + 1])
        if found is not None:
            self._met(machine, found, float(steps.t[k + 1] - steps.t[k]), held[k])
            return
        self._t, self._fresh, self._read = end, switched, leg.at
        if leg.ended:
            self._stop_at_event()
        elif fault is not None or leg.at == len(leg.times) - 1:
            self._drop()
        self._size = min(2 * self._size, MOST)

    def _finer(self, machine: Mechanism, leg: Leg, fault: Fault) -> tuple[Steps, Found | None, Array]:
        """A step that failed, in parts as far as an event in it; without one its fault is raised."""
        for parts in FINER:
            times = np.linspace(leg.times[leg.at], leg.times[leg.at + 1], parts + 1)
            finer = self._machines.leg(machine, self._phase, times, self._q, self._v, self._seen.toward)
            finer.advance(parts)
            steps = finer.since(0)
            finer.release()
            found, held = self._stretch.first(steps, self._seen)
            if found is not None:
                return steps, found, held
        raise fault

    def _met(self, machine: Mechanism, found: Found, h: float, held: Array) -> None:
        """Go to an event in the step h that begins now."""
        start = self._state
        self._count()  # and not `_drop`: what the leg took beyond it is none of the motion
        self._events.forget(self._t)  # what the leg met of the user's in going beyond it
        self._events.ended_by = None
        part = self._stretch.located(start, h, found)
        if part is not None and self._events:  # which may end it before
            end = float(part.t[-1])
            part = self._machines.part(machine, self._phase, start, end, self._events)
        if part is not None:
            end = float(part.t[-1])
            block = self._stretch.block(part, np.array([held, self._stretch.forces(part, -1)]))
            # two outputs at one time, before the impulse and after it, are a last bit apart
            before = end if self._over else float(np.nextafter(end, -np.inf))
            block.t = np.array([start.t, before])
            inner = [(0, row) for row in self._within(start, end, held)]
            self.joined.add(block.with_rows(inner), self._phase, first=1)
            self._arrive(part)
        if self._events.ended:
            self._stop_at_event()
        else:
            self._fresh = True
            self._decide(found)

    @property
    def _over(self) -> bool:
        """Whether an event of the user's ended the motion."""
        return self._events.ended_by is not None and self._events.ended_by < self._asked

    def _stop_at_event(self) -> None:
        """An event ends the motion, or closes a lock."""
        self._drop()
        if self._over:
            self.ended = self.joined.to_the_end = True
            return
        self._events.ended_by, self._fresh, self._why = None, True, LATCH
        closed = {self._latches[k - self._asked] for k in self._events.together if k >= self._asked}
        self._phase = replace(self._phase, latched=self._phase.latched | closed)

    def _decide(self, found: Found) -> None:
        """What the event is, for the decision that follows."""
        phase, rows, self._why = self._phase, self._rows, found.row
        if found.row < 0:
            self._ahead = self._looked_ahead()
        elif found.row in phase.slip:
            self._tell("at rest", [i for i in phase.slip if abs(rows.E[i] @ self._v) <= REST])
        elif rows.rows[found.row].kind is Kind.SPRING:
            phase = self._phase = replace(phase, touching=phase.touching ^ {found.row})
            self._tell("touch" if found.row in phase.touching else "leave", [found.row])

    def _looked_ahead(self) -> Iterator[State]:
        """States a moment later, while what was held still is."""
        state = self._state
        for share in AHEAD:
            part = self._stretch.part(state, state.t + share * self._grid.step)
            yield State.of(part, -1, state.seen)

    def _rest(self, end: float) -> None:
        """Nothing moves, up to a time or until something breaks loose."""
        times = self._times(end)
        times = np.union1d(times, self.joined.chosen.between(times[0], times[-1]))
        found = rested(self._machines, self._phase, self._state, times)
        zero = Still(self._q, self._v).ended(self._events, found.block.t) if self._events else None
        if zero is not None:
            times = np.append(times[times < zero], zero)
            # what breaks after it does not count
            found = rested(self._machines, self._phase, self._state, times)
        switched = found.until in self._switches
        if switched and not found.broke:
            found.block.t[-1] = np.nextafter(found.until, -np.inf)
        self.joined.add(found.block, self._phase)
        if found.fault is not None:
            raise found.fault
        self._t, self._v, self._seen = found.until, np.zeros_like(self._v), found.seen
        self._fresh = found.broke or switched
        if zero is not None:
            self._fresh = False
            self._stop_at_event()
        elif found.broke:
            self._why = BREAK
            # torques alone change: a moment later they are too much for what is held where it is
            later = [found.until + share * self._grid.step for share in AHEAD]
            self._ahead = iter([State(t, self._q, self._v, found.seen) for t in later])
