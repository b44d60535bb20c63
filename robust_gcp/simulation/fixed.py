"""A run of fixed steps, in Python and in the compiled kernel."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from math import isfinite
from typing import Any

import numpy as np

from ..dynamics.equations import Evaluation
from ..dynamics.problem import set_out
from ..errors import BranchError, NonFiniteError, SimulationError, ToggleError
from ..maps.classical import ClassicalMap, SingularityWarning
from ..maps.cluster.cluster_map import ClusterMap
from ..maps.cluster.obstacles import ObstacleError
from ..maps.grouped import GroupMap
from ..maps.point import Point
from ..mechanism.tree import Array
from ..native.batch import Batch
from ..native.steps import NativeSteps
from ..native.structures import Reason
from ..warning import warn
from .charts import in_new_chart, motion_at, placed_between, stretch_between
from .crossings import located
from .recovery import Checkpoint, Recovery
from .run import Run
from .stats import extended, until
from .steppers import FixedStep as Take
from .steppers import NoProgressError, SolverStep, rk4_step, solver_steps
from .within import FixedStep, SolverSteps

REFINED_RTOL, REFINED_ATOL = 1e-10, 1e-12
"""Tolerances of the error-controlled steps through a zone without a bridge."""

REFINED_EFFORT = 5_000
"""Right-hand sides that one such step may take."""

TOLD = 3e-9
"""Relative uncertainty of G by rounding that a warning tells."""

WATCHED = 20
"""Outputs of a batch at which all rows of φ are looked at."""

FEW = 16
"""Steps of a batch after one with an event, so that little is taken twice; then doubled."""


class FixedRun(Run):
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
        self._behind: Array = self._x
        self._refinement: SolverSteps | None = None
        self._stride = len(self.times)
        self._told = False
        self._recovery = Recovery(self._on_toggle, Checkpoint(0, self._x, self._motion.explicit.anchor))

    def go(self) -> None:
        """From output to output, except where `Recovery` says otherwise."""
        self.advance(0, len(self.times) - 1)

    def advance(self, i: int, last: int, known: Evaluation | None = None) -> None:
        """The steps from time i to time `last`; `known` is the evaluation at i where it was accepted."""
        recovery = self._recovery
        while True:
            try:
                now = self._evaluated(i) if known is None else known
                if known is None:
                    if self._last is not None:
                        self._cross(i, self._last.point, self._last.ydd, now)
                        self._look_within(i, self._last, now)
                        if self._ended:
                            return
                    elif self._events:
                        self._events.begin(float(self.times[i]), now.point.q, now.v)
                    now, self._x = in_new_chart(self._motion.explicit, now, self._x)
                    self._accept(i, now)
                    recovery.accept(i, self._x, now.point)
                known = None
                if i == last:
                    return
                if self._changed(i, now.point):
                    continue
                if self._native is not None and not recovery.careful:
                    begun, (i, now) = i, self._natively(self._native, i, last, now)
                    if i == last or self._ended:
                        return
                    if i > begun and self._changed(i, now.point):
                        continue
                self._behind, self._refinement = self._x, None
                self._x = (self._refined if recovery.careful else self._stepped)(i, now)
                i += 1
            except (ObstacleError, BranchError, ToggleError) as stop:
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

    def _evaluated(self, i: int) -> Evaluation:
        """The equations at the present state."""
        with self._accuracy():
            return self._motion.equations.evaluate(float(self.times[i]), self._x)

    def _natively(self, native: NativeSteps, i: int, last: int, now: Evaluation) -> tuple[int, Evaluation]:
        """As many steps after output i, up to output `last`, as the kernel can take."""
        recovery = self._recovery
        while i < last:
            batch = self._batch(native, i, last, now)
            if batch is None:
                break
            before, self._behind, self._refinement = now, self._x, None
            self._count(batch)
            if batch.safe is not None:
                recovery.safe = Checkpoint(i + batch.safe[0], *batch.safe[1:])
            if batch.steps:
                self._kernel_map().resume(batch.now.point, batch.trackers)
                self._record.extend(i, batch.outputs, batch.x)
                for j in range(batch.steps - 1, -1, -max(1, batch.steps // WATCHED)):
                    self._watch(batch.outputs.q[j], i + 1 + j)
                i, now, self._x, self._last = i + batch.steps, batch.now, batch.x, batch.now
                if self._progress is not None:
                    for j in range(i - batch.steps + 1, i + 1):
                        self._report(j)
            self._record.cross(batch.crossings)
            if batch.failure is not None:
                raise batch.failure
            if batch.steps == 1:
                self._look_within(i, before, now)
            suspicious = self._coordinates is not None and self._coordinates.suspicious(now.point)
            if self._ended or suspicious or batch.reason is not Reason.DONE:
                break
        return i, now

    def _batch(self, native: NativeSteps, i: int, last: int, now: Evaluation) -> Batch | None:
        """Steps from i on, up to one that has an output or an event within; that one is taken alone.

        A torque function of the user's is not called for a step once more: beside events each is taken alone.
        """

        def take(end: int) -> Batch | None:
            times, coordinates = self.times[i : end + 1], self._coordinates
            chart = None if coordinates is None else (coordinates.sizes, coordinates.limit)
            return native.take(self._kernel_map(), now, self._x, times, self._record.wanted, chart)

        until = min(last, max(self._schedule.free_until(i), i + 1))
        if not self._events:
            return take(until)
        stride, self._stride = self._stride, max(2 * self._stride, FEW)
        batch = take(i + 1 if callable(self._torque) else min(until, i + stride))
        if batch is None or batch.steps < 2:
            return batch
        ends = self.times[i + 1 : i + 1 + batch.steps]
        j = self._events.first_met(ends, batch.outputs.q, batch.outputs.v)
        if j is None:
            return batch
        self._stride = 1
        return take(i + max(j, 1))

    def _looked_for(self, i: int) -> bool:
        """Whether outputs or events may lie within the step that ends at time i."""
        return bool(self._events) or bool(self._schedule.within(i))

    def _look_within(self, i: int, before: Evaluation, now: Evaluation) -> None:
        """Keep outputs and events within the step that ends at time i, which the map is put back to."""
        if not self._looked_for(i):
            return
        times = float(self.times[i - 1]), float(self.times[i])
        explicit, mechanism = self._motion.explicit, self._motion.mechanism
        step: FixedStep | SolverSteps | None = self._refinement
        if step is None:
            step = FixedStep(mechanism, explicit, times, before, now, self._behind, self._x)
        with self._accuracy():
            zeros = self._events.zeros(now.point.q, now.v, step) if self._events else []
            self._keep_within(i, step, zeros)
            if not self._ended:
                explicit.at(now.point.y, now.point.ydot)

    def _accuracy(self) -> AbstractContextManager[None]:
        """What evaluations are made in: carefully, on the true curve of an uncertified zone."""
        return self._cluster_map().following_true_curve() if self._recovery.careful else nullcontext()

    def _kernel_map(self) -> ClusterMap | ClassicalMap | GroupMap:
        explicit = self._motion.explicit
        assert isinstance(explicit, ClusterMap | ClassicalMap | GroupMap)  # the kernel knows no other map
        return explicit

    def _count(self, batch: Batch) -> None:
        """Add what a batch took."""
        self._motion.equations.calls += batch.rhs
        batch.add_to(self._counters)

    def _stepped(self, i: int, now: Evaluation) -> Array:
        f, t, end = self._motion.equations, float(self.times[i]), float(self.times[i + 1])
        x = self._take(f, t, self._x, end - t, f.derivative(now))
        if not all(map(isfinite, x.tolist())):
            raise NonFiniteError(
                f"the state left the finite numbers between t = {t:.6g} and {end:.6g} s; use a "
                "smaller step, or an implicit stepper (Radau, BDF) if the mechanism is stiff"
            )
        return x

    def _refined(self, i: int, begun: Evaluation) -> Array:
        """One step through an uncertified zone by an error-controlled method."""
        bridged, x, t, end = self._cluster_map(), self._x, float(self.times[i]), float(self.times[i + 1])
        ends, dense = [t], []
        looks = self._looked_for(i + 1)
        while t < end:
            with bridged.following_true_curve():
                try:
                    for step in self._refinements(x, np.array([t, end])):
                        x, t = step.x, step.t1
                        if looks:
                            ends.append(t)
                            dense.append(step.dense())
                        elif t < end and self._renewed_within(i, begun, t, x):
                            break
                except NoProgressError as error:
                    raise bridged.refusal() from error
            if t < end:
                bridged, x = self._cluster_map(), self._x
        if looks:
            self._refinement = SolverSteps(self._motion.explicit, self._motion.mechanism.m, ends, dense)
        self._counters.refined_steps += 1
        self._stretches = extended(self._stretches, float(self.times[i]), end)
        return x

    def _refinements(self, x: Array, times: Array) -> Iterator[SolverStep]:
        """Steps with error control; a trial that is refused leaves the map where the step began."""
        equations, explicit = self._motion.equations, self._motion.explicit
        good = explicit.anchor

        def f(t: float, state: Array) -> Array:
            try:
                return equations(t, state)
            except SimulationError:
                explicit.anchor = good
                raise

        tolerances = REFINED_RTOL, REFINED_ATOL, REFINED_EFFORT
        for step in solver_steps("DOP853", f, x, times, *tolerances, rounding=self._rounding):
            good = explicit.anchor
            yield step

    def _renewed_within(self, i: int, begun: Evaluation, t: float, x: Array) -> bool:
        """Whether a step from time i, begun there, goes on at t in better coordinates, which are taken."""
        if self._coordinates is None or not self._coordinates.suspicious(self._motion.explicit.anchor):
            return False
        names = self._better(self._motion.equations.evaluate(t, x).point)
        if names is None:
            return False
        m, mechanism = self._motion.mechanism.m, self._in_coordinates(names)
        try:
            start = set_out(mechanism, begun.point.q, begun.v, choice=self._choice)
            self._x = x
            self._repartition(i, t, names)
        except SimulationError:
            return False
        state = np.concatenate([start.x[: 2 * m], self._behind[2 * m :]])
        self._recovery.safe = Checkpoint(i, state, start.start.point)
        return True

    def _rounding(self) -> float:
        """What rounding leaves uncertain of G here; told once where that shows in the motion."""
        lost, distance = self._cluster_map().rounding()
        if lost > TOLD and not self._told:
            self._told = True
            warn(
                f"the motion passes a singular place without a bridge at a distance of {distance:.1g} or "
                f"less: rounding leaves it right to {lost:.0e} there, whatever the step",
                SingularityWarning,
            )
        return lost

    def _back_to(self, safe: Checkpoint) -> int:
        """Forget what came after the checkpoint."""
        self._x, self._motion.explicit.anchor, self._last = safe.x, safe.point, None
        self._record.rewind(safe.i)
        back = float(self.times[safe.i])
        self._events.forget(back)
        self._stretches = until(self._stretches, back)
        return safe.i

    def _cross(self, i: int, before: Point, ydd: Array, now: Evaluation) -> None:
        """Log what was passed in the fixed step that ends at time i."""
        if not self._motion.explicit.met:
            return
        t0, t1 = float(self.times[i - 1]), float(self.times[i])
        explicit, mechanism = self._motion.explicit, self._motion.mechanism
        ends = (before, ydd), (now.point, now.ydd)
        stretch = stretch_between(explicit, mechanism, (t0, t1), *ends)
        crossings = located(explicit.passed(before, now.point, stretch), stretch)
        states = (motion_at(*end) for end in ends)
        self._record.cross(placed_between(mechanism, crossings, (t0, t1), *states))
