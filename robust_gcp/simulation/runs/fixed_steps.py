"""A run of fixed steps, in Python and in the compiled kernel."""

from __future__ import annotations

from math import isfinite
from typing import Any

from ...dynamics.equations import Evaluation
from ...dynamics.problem import Problem
from ...errors import BranchError, NonFiniteError, ToggleError
from ...kernel.simulation.batch import Batch, Outputs, count_in
from ...kernel.simulation.guard import Guard, Watch
from ...kernel.simulation.steps import NativeSteps
from ...kernel.structures import Reason
from ...maps.cluster.obstacles import UNBRIDGED, ObstacleError
from ...maps.explicit import Point
from ...mechanism.tree.tree import Array
from .crossings import in_new_chart
from .error_control import RefinedRun
from .record import Record
from .recovery import Checkpoint
from .stats import until
from .steppers import FixedStep as Take
from .steppers import rk4_step
from .within_steps import End, FixedStep

WATCHED = 20
"""Outputs of a batch at which all rows of φ are looked at."""


class FixedRun(RefinedRun):
    """A run of fixed steps.

    Parameters
    ----------
    take : callable
        One step of the method.
    native : NativeSteps or None
        Takes the regular steps.
    more, options
        As for `Run`.
    """

    def __init__(self, take: Take, native: NativeSteps | None, *more: Any, **options: Any) -> None:
        super().__init__(*more, **options)
        self._take, self._native = take, native
        self.stepper = "rk4" if take is rk4_step else "tableau"
        self._first = self._motion.first  # told already at the start
        self.guard: Guard | None = None  # after a step in which it is met the run pauses
        self.paused = False
        self.lowest = len(self.times)  # was gone back to, for whoever looks

    def go(self) -> None:
        """From output to output, except where `Recovery` says otherwise."""
        self.advance(0, len(self.times) - 1)

    def further(self, n: int) -> None:
        """n steps more, from the start or from where it came to."""
        i, self.paused = self._record.at, False
        self.advance(max(i, 0), max(i, 0) + n, None if i < 0 else self._last)

    @property
    def record(self) -> Record:
        """What is recorded so far."""
        return self._record

    @property
    def zone_evaluations(self) -> int:
        """Right-hand sides so far that were not on regular ground."""
        return self._counters.zone_evaluations

    @property
    def ended(self) -> bool:
        """Whether an event ended it."""
        return self._ended

    def standing(self, now: Evaluation) -> tuple[Problem, Array, Watch | None] | None:
        """Motion, state, and the watch on its coordinates, where the kernel could go on alone from now."""
        if self._native is None or self.asks or self._ended:
            return None
        if self._recovery.error_controlled or self._events or self._suspicious(now.point):
            return None
        return self._motion, self._x, self._watch_coordinates()

    @property
    def asks(self) -> bool:
        """Whether functions of the user's say what acts."""
        forces, native = self._motion.mechanism.applied, self._native
        return (native is not None and native.asks) or (forces is not None and forces.own is not None)

    def advance(self, i: int, last: int, known: Evaluation | None = None) -> None:
        """The steps from time i to time `last`; `known` is the evaluation at i where it was accepted."""
        recovery, inside = self._recovery, False  # whether the last step was looked into already
        while True:
            try:
                now = self._evaluated(i) if known is None else known
                if known is None:
                    if self._last is not None:
                        self._cross(i, float(self.times[i]), now)
                        if not inside and self._looked_for(i):
                            self._look_within(i, End.of(self._last, self._behind), now)
                        if self._ended:
                            return
                        # only now: what the step passed, and what lies within it, is in the chart it began in
                        now, self._x = in_new_chart(self._motion.explicit, now, self._x)
                    elif self._events:
                        self._events.begin(float(self.times[i]), now.point.q, now.v)
                    before = self._last
                    self._accept(i, now)
                    recovery.accept(i, self._x, now.point)  # may be gone back to
                    if self.guard is not None:
                        self._look_out(self.guard, i, before, now)
                known = None
                if i == last or self.paused:
                    return
                # before the step: in coordinates that turn back within it there would be no end of it
                if self._changed(i, now.point):
                    continue
                by_kernel = not recovery.error_controlled or self._goes_natively(i)
                if by_kernel:
                    self._leave()
                if self._native is not None and by_kernel:
                    i, going = self._natively(self._native, i, last, now)
                    if self._unbridged:  # the same search in Python takes seconds, and finds none either
                        raise ObstacleError(UNBRIDGED)
                    if i == last or self._ended or self.paused:
                        return
                    if going is None:
                        continue
                    now = going
                self._behind, self._renewed_at, inside = self._x, None, recovery.error_controlled
                self._x = (self._refined if inside else self._stepped)(i, now)
                if self._ended:
                    return
                i += 1
            except (ObstacleError, BranchError, ToggleError) as stop:
                # the step may have begun too near already: go back to the last safe one
                change = recovery.meet(i, stop)
                i = self._back_to(recovery.safe)
                if change:
                    names = self._others(self._motion.explicit.anchor)
                    recovery.changed(self._repartition(i, float(self.times[i]), names))

    def _changed(self, i: int, point: Point) -> bool:
        """Whether the step from time i is to begin in better coordinates, which are taken."""
        names = self._others(point) if self._recovery.changing else self._better(point)
        if names is None:
            return False
        self._recovery.changed(self._repartition(i, float(self.times[i]), names))
        return True

    def _look_out(self, guard: Guard, i: int, before: Evaluation | End | None, now: Evaluation) -> None:
        """Pause where the step to time i is to be looked at."""
        if before is not None:
            h = float(self.times[i] - self.times[i - 1])
            self.paused = guard.met(h, before.v, before.a, now.point.q, now.v, now.a)

    def _evaluated(self, i: int) -> Evaluation:
        """The equations at the present state."""
        known, self._first = self._first, None
        if known is not None:
            self._counters.rhs += 1  # the kernel made it when it closed the start
            return known
        if self._following is not None and self._following.kept is not None:
            return self._following.kept  # at the end of a step with error control
        with self._accuracy():
            return self._motion.equations.evaluate(float(self.times[i]), self._x)

    def _natively(
        self, native: NativeSteps, i: int, last: int, now: Evaluation
    ) -> tuple[int, Evaluation | None]:
        """As many steps after output i, up to output `last`, as the kernel can take.

        Returns the output that was reached, and the evaluation there; none where other coordinates were
        taken.
        """
        self._unbridged = False  # whether the kernel says so of the step that comes next
        while i < last and (not self._recovery.error_controlled or self._goes_natively(i)):
            batch = self._batch(native, i, last, now)
            if batch is None:
                break
            begun, self._behind = now, self._x
            if batch.steps:
                self._record.extend(i, batch.outputs, batch.x)
                now = batch.now
            self._take_over(i, batch)
            if self._redundant:
                self._watch_rows(i, batch.outputs.q)
            i += batch.steps
            if batch.failure is not None:
                raise batch.failure
            self.paused = batch.reason is Reason.MET
            if self._events.pending or (batch.steps == 1 and not self._schedule.plain):
                before = End.of(begun, self._behind)
                if batch.steps > 1:
                    before = End.of_row(self._motion.mechanism, batch.outputs, batch.steps - 2)
                self._look_into(i, before, batch.outputs)
            if self._ended:
                break
            if i < last and not self.paused and self._suspicious(now.point) and self._changed(i, now.point):
                return i, None
            if batch.reason is Reason.OBSTACLE:  # what has outputs within, Python goes on with
                self._unbridged = not self._looked_for(i + 1)
            # all else is Python's to do; where coordinates or bounds were looked at in vain, it goes on
            if batch.reason not in (Reason.DONE, Reason.CHART, Reason.MET) or self.paused:
                break
        return i, now

    def _take_over(self, i: int, batch: Batch) -> None:
        """Go on from where steps of the kernel's after time i ended; their outputs are recorded."""
        count_in(self._counters, batch.counts)
        self._recovery.best = batch.best
        if self._recovery.error_controlled and batch.steps:
            self._count_refined(i, batch.steps)
            self._lose(*batch.rounding)
        if batch.safe is not None:
            self._recovery.through(Checkpoint(i + batch.safe[0], *batch.safe[1:]))
        if batch.steps:
            self._motion.resume(batch.now.point, batch.trackers)
            self._x, self._last = batch.x, batch.now
            if self._progress is not None:
                for j in range(i + 1, i + 1 + batch.steps):
                    self._progress(j / (len(self.times) - 1))
        if batch.crossings:
            self._record.cross(batch.crossings)

    def _watch_rows(self, i: int, q: Array) -> None:
        """Refuse to go on where rows of φ are left open at some of the outputs after time i."""
        # backwards: the last one is always among them, as the run goes on from there
        for j in range(len(q) - 1, -1, -max(1, len(q) // WATCHED)):
            self._watch(q[j], i + 1 + j)

    def _watch_coordinates(self) -> Watch | None:
        """What tells the kernel that other coordinates may serve better."""
        return None if self._coordinates is None else self._coordinates.watch

    def _batch(self, native: NativeSteps, i: int, last: int, now: Evaluation) -> Batch | None:
        """Steps from i on, up to one that has an event within.

        One that has outputs within is taken alone where the kernel does not take these.
        """
        times, wanted = self.times[i : last + 1], self._record.wanted
        watch, best = self._watch_coordinates(), self._recovery.best
        control = self._control(i) if self._recovery.error_controlled else None
        within = None if self._schedule.plain else self._schedule.between(i, last)
        more = watch, best, control, within, self._events.met if self._events else None
        return native.take(self._motion, now, self._x, times, wanted, *more)

    def _look_into(self, i: int, before: End, rows: Outputs) -> None:
        """Look into a step of the kernel's, which ended at time i, where it stopped."""
        now = self._last
        assert now is not None  # the step was taken over
        if self._events.pending:
            self.paused = False  # MET was said of an event: of bounds the guard tells
            if self.guard is not None:
                self._look_out(self.guard, i, before, now)
        self._look_within(i, before, now, told=rows.within is not None)

    def _look_within(self, i: int, before: End, now: Evaluation, told: bool = False) -> None:
        """Keep outputs and events within the step that ends at time i; `told`: outputs are kept already."""
        rows = [] if told else self._schedule.within(i)
        if not self._events and not rows:
            return
        times = float(self.times[i - 1]), float(self.times[i])
        step = FixedStep(self._motion.mechanism, self._motion.explicit, times, before, End.of(now, self._x))
        zeros = self._events.zeros(now.point.q, now.v, step) if self._events else []
        self._keep_within(rows, step, zeros, now)

    def _stepped(self, i: int, now: Evaluation) -> Array:
        f, t, end = self._motion.equations, float(self.times[i]), float(self.times[i + 1])
        x = self._take(f, t, self._x, end - t, f.derivative(now))
        if not all(map(isfinite, x.tolist())):  # of so few numbers a fifth of what `np.isfinite` takes
            raise NonFiniteError(
                f"the state left the finite numbers between t = {t:.6g} and {end:.6g} s; use a "
                "smaller step, or an implicit stepper (Radau, BDF) if the mechanism is stiff"
            )
        return x

    def _back_to(self, safe: Checkpoint) -> int:
        """Forget what came after the checkpoint."""
        self._leave()
        # without a last evaluation what was passed before the checkpoint is not logged once more
        self._x, self._motion.explicit.anchor, self._last = safe.x, safe.point, None
        self._record.rewind(safe.i)
        self.lowest = min(self.lowest, safe.i)
        back = float(self.times[safe.i])
        self._events.forget(back)
        self._stretches = until(self._stretches, back)
        return safe.i
