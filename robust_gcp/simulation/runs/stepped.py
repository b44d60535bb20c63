"""A run that is taken a few steps at a time, and can be put back to where it was."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np

from ...dynamics.equations import Evaluation
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...kernel.simulation.batch import one_by_one
from ...kernel.simulation.prepared import Prepared
from ...kernel.simulation.steps import NativeSteps, most_steps
from ...kernel.structures import Reason
from ...maps.explicit import Crossing
from ...mechanism.tree.tree import Array
from ..current_state import Here
from ..events import Events
from ..saved_state import unchanging
from ..trajectories.trajectory import Trajectory
from .fixed_steps import FixedRun
from .held_torques import HeldTorques
from .schedule import Schedule
from .within_steps import End

FIXED = ("_take", "_native", "_progress", "_counters", "_on_toggle", "_named", "_lean", "acted")
"""What of a run no step changes, or what counts on."""


class SteppedRun(FixedRun):
    """A run under a torque that is held over each step, as by a digital controller; it goes on when asked to.

    It has no stops, friction or locks: see `phases.phased_simulation`. Where it has to go back over steps
    that were taken, the torques held then act again.

    Parameters
    ----------
    more, options
        As for `FixedRun`; the torque of the motion is a `HeldTorque`.
    """

    happenings: tuple[Any, ...] = ()
    dissipated = 0.0

    def __init__(self, *more: Any, **options: Any) -> None:
        super().__init__(*more, **options)
        held = self._motion.torque
        assert isinstance(held, HeldTorque)  # no other is held
        self._torques = HeldTorques(held)
        self._lean: Prepared | None = None
        self._begun = 0  # where the steps began that the kernel has not told of
        self._watching: Array | None = None  # q of all outputs, where rows of φ are to be looked at
        self._t0 = float(self.times[0])
        self._gone = 0  # outputs since the start that this run numbers no more
        self._most = most_steps(self._motion.mechanism)

    def begin(self) -> None:
        """Accept the start."""
        self._go_on(0, 0, None)

    def go(self) -> None:
        """All steps, each under what `HeldTorque.asked` says at its start."""
        ask, start, times = self._torques.now.asked, self._motion.start, self.times.tolist()
        assert ask is not None  # `HeldTorque.of` gave it
        first = ask(times[0], start.point.q, start.point.G.dot(start.ydot))  # once: it may have a memory
        self._torques.restart(first)
        self._first = None  # was evaluated under no torque
        self.begin()
        self.take(first, 1)
        for t in times[1:-1]:
            if self._ended:
                break
            self.take(ask(t, *self.state), 1)
        self.settle()

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        self.settle()
        found = super().trajectory(begun)
        if found.acted is not None and not self._record.keeps.all:
            found.acted = replace(found.acted, lost=True)  # the torques of steps that were let go
        elif found.acted is not None:
            found.acted = replace(found.acted, held=self._held_from(found.t[:-1])[:, : found.v.shape[1]])
        found.u = self._torques.now.driven(self._held_from(found.t), found.t)
        return found

    def take(self, torque: Array, n: int) -> None:
        """n steps under a torque (nv,) that is held, from the last output on.

        Where the kernel went the way here it goes on by itself, into the record's own rows, and all that
        follows from a step waits until someone asks (`settle`).
        """
        i, bits, lean = self._record.at, torque.tobytes(), self._lean
        self.paused = False
        turned = bits != self._torques.bits  # a look anew at the same torque costs a right-hand side
        if lean is not None and n <= self._most:
            plain = lean(i, n, torque if turned else None)
            completed = n if plain else lean.completed
            if turned and completed >= 0:  # −1: it could not be looked at, and Python takes it up
                self._torques.hold(i, torque, bits)
                turned = False
            if completed > 0:
                self._record.reach(i + completed)
            if plain:
                if self._watching is not None:
                    self._watch_rows(i, self._watching[i + 1 : i + 1 + n])
                return
            self.settle()
            if self.paused or self._ended:
                self._lean = self._prepared()
                return
        if turned:
            self._hold(i, torque, bits)
        self._go_on(self.at, i + n, self.last)

    def _go_on(self, i: int, last: int, known: Evaluation | None) -> None:
        """The steps from time i to time `last` with all that may happen, and then the kernel by itself."""
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite ends in an error of ours
            self.advance(i, last, known)
        self._lean = self._prepared()

    def settle(self) -> None:
        """Take over what the kernel's own steps left behind."""
        lean, self._lean = self._lean, None
        if lean is None or not lean.used or self._native is None:
            return
        i, at = self._begun, self._record.at
        batch = self._native.settled(i, at)
        self._take_over(i, batch)
        self._last = batch.now
        self._record.last_state = self._x
        self.paused = batch.reason is Reason.MET
        if batch.failure is not None:
            raise batch.failure
        rows = self._record.rows
        if self._events.pending and rows is not None:
            self._look_into(at, End.of_row(self._motion.mechanism, rows, at - 1), rows)

    def _prepared(self) -> Prepared | None:
        """Steps of the kernel's alone from the last output on; None where more is to be looked at."""
        rows, last = self._record.rows, self._last
        if self._native is None or self._native.asks or rows is None or last is None:
            return None
        if self._recovery.error_controlled or self._progress or self._suspicious(last.point):
            return None
        self._begun = self._record.at
        self._watching = rows.q if self._redundant else None
        watch, best = self._watch_coordinates(), self._recovery.best
        looked = one_by_one(self._events.met, rows, self._begun + 1) if self._events else None
        return self._native.prepared(self._motion, last, self.times, rows, watch, best, looked)

    @property
    def zone_evaluations(self) -> int:
        """Right-hand sides so far that were not on regular ground."""
        self.settle()
        return super().zone_evaluations

    @property
    def last(self) -> Evaluation:
        """The evaluation accepted last."""
        self.settle()
        assert self._last is not None  # output 0 is accepted before anyone asks
        return self._last

    @property
    def here(self) -> Here:
        """The same by name."""
        now = self.last
        work = {"work": float(self._x[-1])} if self._motion.works else {}
        return Here(now.point.q, now.v, now.a, now.tau, now.drive, work)

    @property
    def toward(self) -> Array:
        """The tangent of the mode, (nv, m)."""
        return self.last.point.G.copy()

    def remembered(self) -> None:
        """What another run goes on from besides the state: nothing."""

    def recall(self, phase: Any) -> None:
        """Nothing is to be recalled."""

    @property
    def at(self) -> int:
        """The number of the last output."""
        return self._record.at

    @property
    def state(self) -> tuple[Array, Array]:
        """q and v where the run is."""
        if self._lean is None and not self._ended:
            return self.last.point.q, self.last.v
        return self._record.state()

    @property
    def time(self) -> float:
        """Where the run is, s."""
        return self._record.time if self._ended else float(self.times[self.at])

    @property
    def events(self) -> Events:
        """What is looked for, and what was found of it."""
        return self._events

    @property
    def crossings(self) -> list[Crossing]:
        """Those passed so far."""
        return self._record.crossings

    def _hold(self, i: int, torque: Array, bits: bytes) -> None:
        """Hold a torque from output i, the last one, on, and look at the state there again."""
        last = self.last
        self._torques.hold(i, torque, bits)
        t = float(self.times[i])
        known = None if self._native is None else self._native.look(self._motion, last, self._x, t)
        if known is None:
            self._last = self._motion.equations.at_point(t, last.point)
        else:
            self._last = known
            self._counters.rhs += 1
            self._counters.force_evaluations += 1
        self._record.add(i, self._last, self._x)

    def _held_from(self, t: Array) -> Array:
        """What was held from each of these times on, (len(t), nv)."""
        return self._torques.along(np.searchsorted(self.times, t, side="right") - 1)

    def _evaluated(self, i: int) -> Evaluation:
        torque = self._torques.on(i)
        if torque is not self._torques.now.value:
            self._leave()  # what is known at the end of a step was found under the torque before
        self._torques.now.value = torque
        return super()._evaluated(i)

    def _look_within(self, i: int, before: End, now: Evaluation, told: bool = False) -> None:
        """As ever, under the torque of the step before time i, not of the one after it."""
        held = self._torques.now
        after, held.value = held.value, self._torques.on(i - 1)
        if self._looked_for(i) and not np.array_equal(after, held.value, equal_nan=True):
            now = self._motion.equations.at_point(float(self.times[i]), now.point)
        super()._look_within(i, before, now, told)
        held.value = after

    def _natively(
        self, native: NativeSteps, i: int, last: int, now: Evaluation
    ) -> tuple[int, Evaluation | None]:
        if self._torques.changes_after(i):  # gone back over: one by one, each under its own torque
            return i, now
        return super()._natively(native, i, last, now)

    def room_for(self, n: int, step: float) -> None:
        """Make room for n more outputs, by letting go of those that are not kept or by growing.

        Parameters
        ----------
        step : float
            Between outputs, s.
        """
        if self.at + n < len(self.times):
            return
        self.settle()
        if not self._record.keeps.all:
            self._slide(self._recovery.safe.i, step)
        if self.at + n >= (room := len(self.times)):
            count = max(2 * room, self.at + n + 1)  # doubled: all copies together are as long as the run
            self._schedule = Schedule.numbered(self._t0, step, self._gone, count)
            self._record.grow(self._schedule)

    def _slide(self, n: int, step: float) -> None:
        """Number outputs from the n-th on, before which the run never goes back."""
        self._gone += n
        self._schedule = Schedule.numbered(self._t0, step, self._gone, len(self.times))
        self._record.forget(n, self._schedule)
        self._recovery.shift(n)
        self._torques.forget(n)

    def copied(self, parts: dict[str, Any] | None = None) -> dict[str, Any]:
        """A copy of all that steps change, or of such a copy; what they do not change is shared."""
        if parts is None:
            self.settle()
            self._leave()
            parts = {name: value for name, value in vars(self).items() if name not in FIXED}
        # counts go on over what is taken back, and a user's function stays the one that was given
        shared: list[Any] = [self._counters, parts["_schedule"], *self._events.asked]
        for mechanism in {id(m): m for m in (self._record.mechanism, parts["_motion"].mechanism)}.values():
            shared += unchanging(mechanism)
        return copy.deepcopy(parts, {id(part): part for part in shared})

    def put_back(self, parts: dict[str, Any]) -> None:
        """Go back to where these parts were copied."""
        self._lean = None
        self._leave()
        for name, value in self.copied(parts).items():  # copied once more: one may come back again
            setattr(self, name, value)
        self._torques.resume()
