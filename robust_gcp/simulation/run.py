"""One simulation in progress: the loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike

from ..dynamics.equations import Evaluation, Torque
from ..dynamics.linearise import ReducedJacobian
from ..dynamics.problem import Problem, set_out
from ..errors import BranchError, NonFiniteError, ToggleError
from ..maps.choice import MapChoice
from ..maps.classical import ClassicalMap
from ..maps.cluster.cluster_map import ClusterMap
from ..maps.cluster.obstacles import ObstacleError
from ..maps.explicit import Stretch
from ..maps.grouped import GroupMap
from ..maps.point import Counters, Point
from ..mechanism.tree import Array
from ..native.steps import NativeSteps
from ..native.structures import Reason
from ..native.workspace import Batch
from .charts import (
    coordinate_choices,
    in_new_chart,
    map_of_rest,
    motion_at,
    numbers,
    placed,
    placed_between,
    point_of_rest,
    q_of_rest,
    stretch_between,
)
from .crossings import located
from .record import Record
from .recovery import Checkpoint, Recovery
from .stats import Stats
from .steppers import FixedStep, NoProgressError, SolverStep, solver_steps
from .trajectory import Trajectory

REFINED_RTOL, REFINED_ATOL = 1e-10, 1e-12
"""Tolerances of the error-controlled steps through a zone without a bridge."""

REFINED_EFFORT = 5_000
"""Right-hand sides that one such step may take."""


WATCHED = 20
"""Outputs of a batch at which all rows of φ are looked at."""


class Run:
    """One simulation in progress.

    Parameters
    ----------
    motion : Problem
        What the run begins with; a change of coordinates replaces it.
    choice : MapChoice
        Its explicit map, for the next ones.
    torque : callable, array_like or None
    times : ndarray (N + 1,)
        Output times, s.
    record : sequence of {"a", "energy", "multipliers"}
    counters : Counters
    on_toggle : {"error", "repartition"}
    progress : callable (fraction) or None
    native : NativeSteps or None
        Takes the regular steps of `fixed_steps`.
    """

    def __init__(
        self,
        motion: Problem,
        choice: MapChoice,
        torque: Torque | ArrayLike | None,
        times: Array,
        record: Sequence[str],
        counters: Counters,
        on_toggle: str,
        progress: Callable[[float], None] | None,
        native: NativeSteps | None = None,
    ) -> None:
        self._motion, self._x, self._choice = motion, motion.x, choice
        self._torque, self._times, self._counters = torque, times, counters
        self._on_toggle, self._progress, self._native = on_toggle, progress, native
        self._record = Record(motion.mechanism, times, record, motion.equations)
        self._repartitions: list[tuple[float, tuple[str, ...]]] = []
        self._calls = 0
        self._last: Evaluation | None = None
        self._behind: Array = motion.x
        self._recovery = Recovery(on_toggle, Checkpoint(0, self._x, motion.explicit.anchor))

    # --------------------------------------------------------------------- fixed steps

    def fixed_steps(self, take: FixedStep) -> None:
        """One step of a method from output to output, except where `Recovery` says otherwise."""
        self.advance(take, 0, len(self._times) - 1)

    def advance(self, take: FixedStep, i: int, last: int, known: Evaluation | None = None) -> None:
        """The steps from output i to output `last`; `known` is the evaluation at i where it was accepted."""
        recovery = self._recovery
        while True:
            try:
                now = self._evaluated(i, recovery) if known is None else known
                if known is None:
                    if self._last is not None:
                        self._cross(i, self._last.point, self._last.ydd, now)
                    now, self._x = in_new_chart(self._motion.explicit, now, self._x)
                    self._accept(i, now)
                    recovery.accept(i, self._x, now.point)
                known = None
                if recovery.changing and self._others_serve_better(now.point):
                    recovery.changed(self._repartition(i))
                    continue
                if self._native is not None and not recovery.careful:
                    i, now = self._natively(self._native, i, last, now)
                if i == last:
                    return
                self._x = self._refined(i) if recovery.careful else self._stepped(take, i, now)
                i += 1
            except (ObstacleError, BranchError, ToggleError) as stop:
                change = recovery.meet(i, stop)
                i = self._back_to(recovery.safe)
                if change:
                    recovery.changed(self._repartition(i))

    def _evaluated(self, i: int, recovery: Recovery) -> Evaluation:
        """The equations at the present state; carefully: on the true curve of an uncertified zone."""
        t = float(self._times[i])
        if not recovery.careful:
            return self._motion.equations.evaluate(t, self._x)
        with self._cluster_map().following_true_curve():
            return self._motion.equations.evaluate(t, self._x)

    def _natively(self, native: NativeSteps, i: int, last: int, now: Evaluation) -> tuple[int, Evaluation]:
        """As many steps after output i, up to output `last`, as the kernel can take."""
        recovery = self._recovery
        explicit, wanted = self._motion.explicit, self._record.wanted
        assert isinstance(explicit, ClusterMap | ClassicalMap | GroupMap)  # the kernel knows no other map
        while i < last:
            batch = native.take(explicit, now, self._x, self._times[i : last + 1], wanted)
            if batch is None:
                break
            self._count(batch)
            if batch.safe is not None:
                recovery.safe = Checkpoint(i + batch.safe[0], *batch.safe[1:])
            if batch.steps:
                explicit.resume(batch.now.point, batch.on_bridge)
                self._record.extend(i, batch.outputs, batch.x)
                for j in range(batch.steps - 1, -1, -max(1, batch.steps // WATCHED)):
                    self._watch(batch.outputs.q[j], i + 1 + j)
                i, now, self._x, self._last = i + batch.steps, batch.now, batch.x, batch.now
                if self._progress is not None:
                    for j in range(i - batch.steps + 1, i + 1):
                        self._report(j)
            if batch.failure is not None:
                raise batch.failure
            if batch.reason is Reason.PASSED and batch.before is not None:
                self._cross(i, *batch.before, now)
            elif batch.reason is not Reason.DONE:
                break
        return i, now

    def _count(self, batch: Batch) -> None:
        """Add what a batch took."""
        counters = self._counters
        counters.native_steps += batch.steps
        for name, count in batch.counts.items():
            if name == "rhs":
                self._motion.equations.calls += count
            else:
                setattr(counters, name, getattr(counters, name) + count)

    def _stepped(self, take: FixedStep, i: int, now: Evaluation) -> Array:
        f, t, end = self._motion.equations, float(self._times[i]), float(self._times[i + 1])
        x = take(f, t, self._x, end - t, f.derivative(now))
        if not all(map(isfinite, x.tolist())):
            raise NonFiniteError(
                f"the state left the finite numbers between t = {t:.6g} and {end:.6g} s; use a "
                "smaller step, or an implicit stepper (Radau, BDF) if the mechanism is stiff"
            )
        return x

    def _refined(self, i: int) -> Array:
        """One step through an uncertified zone by an error-controlled method."""
        bridged, x, times = self._cluster_map(), self._x, self._times[i : i + 2]
        tolerances = REFINED_RTOL, REFINED_ATOL, REFINED_EFFORT
        with bridged.following_true_curve():
            try:
                for step in solver_steps("DOP853", self._motion.equations, x, times, *tolerances):
                    x = step.x
            except NoProgressError as error:
                raise bridged.refusal() from error
        self._counters.refined_steps += 1
        return x

    def _back_to(self, safe: Checkpoint) -> int:
        """Forget what came after the checkpoint."""
        self._x, self._motion.explicit.anchor, self._last = safe.x, safe.point, None
        self._record.rewind(safe.i)
        return safe.i

    # --------------------------------------------------------------------- adaptive steps

    def adaptive_steps(self, stepper: str, rtol: float, atol: float) -> None:
        """One of scipy's solvers, started anew after a change of coordinates; output at the times."""
        times, begun = self._times, float(self._times[0])
        self._accept(0, self._motion.equations.evaluate(float(times[0]), self._x))
        i, changed_at = 0, -1
        while i + 1 < len(times):
            try:
                jacobian = ReducedJacobian(self._motion.equations)
                self._behind = self._x
                ahead = np.concatenate([[begun], times[i + 1 :]])
                for step in solver_steps(
                    stepper, self._followed, self._x, ahead, rtol, atol, jacobian=jacobian
                ):
                    self._look_behind(step)
                    for x in step.outputs:
                        i += 1
                        if not np.all(np.isfinite(x)):
                            raise NonFiniteError(f"{stepper} left the finite numbers at t = {times[i]:.6g} s")
                        self._x = x
                        self._start_near(x)
                        self._accept(i, self._motion.equations.evaluate(float(times[i]), x))
                    explicit = self._motion.explicit
                    if np.all(np.isfinite(step.x)) and explicit.outgrown(explicit.anchor):
                        self._start_near(step.x)
                        begun, here = step.t1, self._motion.equations.evaluate(step.t1, step.x)
                        _, self._x = in_new_chart(self._motion.explicit, here, step.x)
                        break
            except ToggleError:
                i = self._record.count - 1
                if self._on_toggle == "error" or i == changed_at or self._last is None:
                    raise
                self._motion.explicit.anchor = self._last.point
                self._x = self._record.last_state
                self._record.forget_crossings(i)
                self._repartition(i)
                changed_at, begun = i, float(times[i])

    def _followed(self, t: float, x: Array) -> Array:
        """ẋ for a solver, whose trial steps may be refused after they went far ahead."""
        self._start_near(x)
        return self._motion.equations(t, x)

    def _start_near(self, x: Array) -> None:
        """Follow the mode from the last output, if that is nearer to x than the last evaluation."""
        if self._last is None:
            return
        explicit, y = self._motion.explicit, x[: self._motion.mechanism.m]
        rest, last = map_of_rest(explicit), point_of_rest(self._last.point)
        y = numbers(explicit, y)
        if last.origin is rest.anchor.origin and _apart(y, last.y) < _apart(y, rest.anchor.y):
            rest.anchor = last

    def _look_behind(self, step: SolverStep) -> None:
        """Log what an accepted step of a solver passed, whatever the outputs are."""
        behind, self._behind = self._behind, step.x
        explicit, m = self._motion.explicit, self._motion.mechanism.m
        if not explicit.met or not np.all(np.isfinite(step.x)):
            return
        self._start_near(behind)
        before, after = (explicit.at(x[:m], x[m : 2 * m]) for x in (behind, step.x))
        stretch = Stretch(step.t0, step.t1, lambda t: numbers(explicit, step.between(t)[:m]))
        crossings = located(explicit.passed(before, after, stretch), stretch)
        self._record.cross(placed(explicit, crossings, lambda t: step.between(t)[:m]))

    # --------------------------------------------------------------------- changes of coordinates

    def _cluster_map(self) -> ClusterMap:
        explicit = map_of_rest(self._motion.explicit)
        assert isinstance(explicit, ClusterMap)  # no other map knows uncertified zones
        return explicit

    def _others_serve_better(self, point: Point) -> bool:
        """Whether other joints see more of the motion than the independent ones do."""
        mechanism = self._motion.mechanism
        choices = coordinate_choices(mechanism, point.q)
        return bool(choices) and set(choices[0]) != set(mechanism.independent)

    def _repartition(self, i: int) -> Checkpoint:
        """Change to the best conditioned independent joints at the present state, which is returned."""
        old, x, t = self._motion, self._x, float(self._times[i])
        here, m = old.explicit.anchor, old.mechanism.m
        present = set(old.mechanism.independent)
        choices = coordinate_choices(old.mechanism, here.q)
        names = next((names for names in choices if set(names) != present), None)
        if names is None:
            raise self._cluster_map().refusal()
        mechanism = old.mechanism.with_independent(names)
        v = here.G @ x[m : 2 * m]
        self._motion = set_out(
            mechanism, here.q, v, torque=self._torque, choice=self._choice, counters=self._counters
        )
        self._x = np.concatenate([self._motion.x[: 2 * m], x[2 * m :]])
        self._calls += old.equations.calls
        self._last = None
        self._repartitions = [(when, what) for when, what in self._repartitions if when < t]
        self._repartitions.append((t, names))
        return Checkpoint(i, self._x, self._motion.start.point)

    # --------------------------------------------------------------------- record

    def _accept(self, i: int, now: Evaluation) -> None:
        """Record the evaluation at time i."""
        self._watch(now.point.q, i)
        self._record.add(i, now, self._x)
        self._last = now
        self._report(i)

    def _watch(self, q: Array, i: int) -> None:
        """Refuse to go on where rows of φ are left open."""
        explicit, rest = self._motion.explicit, map_of_rest(self._motion.explicit)
        if isinstance(rest, ClusterMap):
            rest.require_closed(q_of_rest(explicit, q), f"at t = {self._times[i]:.6g} s")

    def _cross(self, i: int, before: Point, ydd: Array, now: Evaluation) -> None:
        """Log what was passed in the fixed step that ends at time i."""
        if not self._motion.explicit.met:
            return
        t0, t1 = float(self._times[i - 1]), float(self._times[i])
        explicit, mechanism = self._motion.explicit, self._motion.mechanism
        ends = (before, ydd), (now.point, now.ydd)
        stretch = stretch_between(explicit, mechanism, (t0, t1), *ends)
        crossings = located(explicit.passed(before, now.point, stretch), stretch)
        states = (motion_at(*end) for end in ends)
        self._record.cross(placed_between(mechanism, crossings, (t0, t1), *states))

    def _report(self, i: int) -> None:
        if self._progress is not None:
            self._progress(i / (len(self._times) - 1))

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        stats = Stats(
            **asdict(self._counters),
            rhs=self._calls + self._motion.equations.calls,
            repartitions=self._repartitions,
            wall_seconds=time.perf_counter() - begun,
        )
        return self._record.trajectory(stats)


def _apart(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max(initial=0.0))
