"""One simulation in progress: the loop, the record and the events."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike

from ..dynamics.equations import EquationsOfMotion, Evaluation, Torque, does_work
from ..dynamics.linearise import ReducedJacobian
from ..errors import BranchError, NonFiniteError, ToggleError
from ..maps.bridge.bridge import BridgeOptions
from ..maps.bridge.bridge_map import BridgeMap
from ..maps.bridge.obstacle import UncertifiedZoneError
from ..maps.explicit import ExplicitMap
from ..maps.march import POOR
from ..maps.point import Counters, Point
from ..maps.start import Start, begin
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..native.steps import NativeSteps
from ..native.structures import Reason
from .record import Record
from .stats import Stats
from .steppers import NoProgressError, adaptive, rk4_step
from .trajectory import Trajectory

REFINED_RTOL, REFINED_ATOL = 1e-10, 1e-12
"""Tolerances of the error-controlled steps through a zone without a bridge."""


REFINED_EFFORT = 5_000
"""Right-hand sides that one such step may take."""


@dataclass(frozen=True)
class Checkpoint:
    """A well-conditioned state to return to: step, state and point."""

    i: int
    x: Array
    point: Point


class Run:
    """One simulation in progress.

    Parameters
    ----------
    mechanism : Mechanism
    start : Start
    explicit : ExplicitMap
        The map that the run begins with; a repartition replaces it.
    torque : callable, array_like or None
    times : ndarray (N + 1,)
        Output times, s.
    record : sequence of {"a", "energy", "multipliers"}
    counters : Counters
    progress : callable (fraction) or None
    native : NativeSteps or None
        Takes the regular steps of `fixed_steps`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        start: Start,
        explicit: ExplicitMap,
        torque: Torque | ArrayLike | None,
        times: Array,
        record: Sequence[str],
        counters: Counters,
        progress: Callable[[float], None] | None,
        native: NativeSteps | None = None,
    ) -> None:
        self._torque, self._times, self._counters = torque, times, counters
        self._progress, self._native = progress, native
        self._record = Record(mechanism, times, record, does_work(mechanism, torque))
        self._works = self._record.work is not None
        self._repartitions: list[tuple[float, tuple[str, ...]]] = []
        self._calls = 0
        self._last: Evaluation | None = None
        self._x = np.concatenate([start.point.y, start.ydot, np.zeros(int(self._works))])
        self._mechanism, self._explicit = mechanism, explicit
        self._equations = EquationsOfMotion(mechanism, explicit, torque)

    def _use(self, mechanism: Mechanism, start: Start, explicit: ExplicitMap) -> None:
        """Go on with these coordinates and this map."""
        work = self._x[len(self._x) - int(self._works) :]
        self._calls += self._equations.calls
        self._mechanism, self._explicit = mechanism, explicit
        self._equations = EquationsOfMotion(mechanism, explicit, self._torque)
        self._x = np.concatenate([start.point.y, start.ydot, work])

    # --------------------------------------------------------------------- loops

    def fixed_steps(self, on_toggle: str, options: BridgeOptions) -> None:
        """RK4, except through a zone without a bridge.

        There γ bends sharply and a fixed step loses its accuracy before the zone is met. So the run
        goes back to the last well-conditioned state and takes the steps from there to the next
        well-conditioned one with error control, or changes coordinates as soon as others serve better.
        """
        last = len(self._times) - 1
        i, careful, changing, met_at, changed_at = 0, False, False, -1, -1
        safe = Checkpoint(0, self._x, self._explicit.anchor)
        while True:
            t = float(self._times[i])
            try:
                now = self._careful(t) if careful else self._equations.evaluate(t, self._x)
                self._accept(i, now)
                good = now.point.conditioning >= POOR
                careful = careful and not (good and i > met_at)
                changing = changing and careful
                if changing and self._others_serve_better(now.point):
                    self._last, careful, changing = None, False, False
                    changed_at, safe = i, self._repartition(i, options)
                    continue
                if (good and not careful) or i == 0:
                    safe = Checkpoint(i, self._x, now.point)
                if self._native is not None and not careful:
                    i, now, safe = self._natively(self._native, i, now, safe)
                    t = float(self._times[i])
                if i == last:
                    return
                h = float(self._times[i + 1]) - t
                x = self._refined(t, h) if careful else self._rk4(t, h, now)
            except UncertifiedZoneError as zone:
                met_at, i, careful = i, self._back_to(safe), True
                changing = zone.obstacle.kind == "toggle" and on_toggle == "repartition"
                continue
            except (BranchError, ToggleError) as stop:
                # the true curve is lost in these coordinates; others may hold it
                known = changing or not isinstance(stop, ToggleError)  # else told only now what it is
                if not careful or on_toggle != "repartition" or (known and safe.i <= changed_at):
                    raise
                i, careful, changing = self._back_to(safe), not known, not known
                if known:
                    changed_at, safe = i, self._repartition(i, options)
                continue
            self._x = x
            i += 1

    def _natively(
        self, native: NativeSteps, i: int, now: Evaluation, safe: Checkpoint
    ) -> tuple[int, Evaluation, Checkpoint]:
        """As many steps after time i as the kernel can take."""
        while i + 1 < len(self._times):
            batch = native.take(self._mechanism, self._explicit, now, self._x, self._times, self._record, i)
            if batch is None:
                break
            self._equations.calls += batch.counts["rhs"]
            if batch.safe is not None:
                safe = Checkpoint(i + batch.safe[0], *batch.safe[1:])
            for j in range(i + 1, i + batch.steps + 1 if self._progress is not None else 0):
                self._report(j)
            if batch.steps:
                i, now, self._x, self._last = i + batch.steps, batch.now, batch.x, batch.now
            if batch.reason is Reason.PASSED and batch.before is not None:
                passages = self._explicit.passed(batch.before, now.point)
                self._record.cross(passages, i, batch.before, now.point)
            elif batch.reason is not Reason.DONE:
                break
        return i, now, safe

    def _rk4(self, t: float, h: float, now: Evaluation) -> Array:
        f = self._equations
        x = rk4_step(f, t, self._x, h, f.derivative(now))
        if not all(map(isfinite, x.tolist())):
            raise NonFiniteError(
                f"the state left the finite numbers between t = {t:.6g} and {t + h:.6g} s; use a "
                "smaller step, or an implicit stepper (Radau, BDF) if the mechanism is stiff"
            )
        return x

    def _back_to(self, safe: Checkpoint) -> int:
        """Forget what came after the checkpoint."""
        self._x, self._explicit.anchor, self._last = safe.x, safe.point, None
        self._record.rewind(safe.i)
        return safe.i

    def adaptive_steps(
        self, stepper: str, rtol: float, atol: float, on_toggle: str, options: BridgeOptions
    ) -> None:
        """One of scipy's solvers, started anew after a change of coordinates; output at the times."""
        times = self._times
        self._accept(0, self._equations.evaluate(float(times[0]), self._x))
        i, changed_at = 0, -1
        while i + 1 < len(times):
            try:
                f = self._equations
                jacobian = ReducedJacobian(f)
                states = adaptive(stepper, self._followed, self._x, times[i:], rtol, atol, jacobian=jacobian)
                for x in states:
                    i += 1
                    if not np.all(np.isfinite(x)):
                        raise NonFiniteError(f"{stepper} left the finite numbers at t = {times[i]:.6g} s")
                    self._x = x
                    self._start_near(x)
                    self._accept(i, self._equations.evaluate(float(times[i]), x))
            except ToggleError:
                i = self._record.count - 1
                if on_toggle == "error" or i == changed_at or self._last is None:
                    raise
                self._explicit.anchor = self._last.point
                self._x = self._record.last_state
                self._repartition(i, options)
                changed_at = i

    def _followed(self, t: float, x: Array) -> Array:
        """ẋ for a solver, whose trial steps may be refused after they went far ahead."""
        self._start_near(x)
        return self._equations(t, x)

    def _start_near(self, x: Array) -> None:
        """Follow the mode from the last output, if that is nearer to x than the last evaluation."""
        anchor, y = self._explicit.anchor, x[: self._mechanism.m]
        if self._last is not None and _apart(y, self._last.point.y) < _apart(y, anchor.y):
            self._explicit.anchor = self._last.point

    def _careful(self, t: float) -> Evaluation:
        """The evaluation at the present state on the true curve of an uncertified zone."""
        with self._bridge_map().following_true_curve():
            return self._equations.evaluate(t, self._x)

    def _refined(self, t: float, h: float) -> Array:
        """One step through an uncertified zone by an error-controlled method."""
        bridged = self._bridge_map()
        with bridged.following_true_curve():
            states = adaptive(
                "DOP853",
                self._equations,
                self._x,
                np.array([t, t + h]),
                REFINED_RTOL,
                REFINED_ATOL,
                REFINED_EFFORT,
            )
            try:
                (x,) = states
            except NoProgressError as error:
                raise bridged.refusal() from error
        self._counters.refined_steps += 1
        return x

    def _bridge_map(self) -> BridgeMap:
        assert isinstance(self._explicit, BridgeMap)  # no other map knows uncertified zones
        return self._explicit

    def _others_serve_better(self, point: Point) -> bool:
        """Whether other joints see more of the motion than the independent ones do."""
        choices = self._mechanism.coordinate_choices(point.q)
        return bool(choices) and set(choices[0][1]) != set(self._mechanism.independent)

    def _repartition(self, i: int, options: BridgeOptions) -> Checkpoint:
        """Change to the best conditioned independent joints at the present state, which is returned."""
        here, t = self._explicit.anchor, float(self._times[i])
        v = here.G @ self._x[self._mechanism.m : 2 * self._mechanism.m]
        names = next(
            (
                names
                for _, names in self._mechanism.coordinate_choices(here.q)
                if set(names) != set(self._mechanism.independent)
            ),
            None,
        )
        if names is None:
            raise self._bridge_map().refusal()
        mechanism = self._mechanism.with_independent(names)
        start = begin(mechanism, here.q, v, None, options, self._counters)
        error_controlled = self._bridge_map().error_controlled
        self._use(mechanism, start, BridgeMap(start.path, start.point, options, error_controlled))
        self._repartitions = [(when, what) for when, what in self._repartitions if when < t]
        self._repartitions.append((t, names))
        return Checkpoint(i, self._x, start.point)

    # --------------------------------------------------------------------- record

    def _accept(self, i: int, now: Evaluation) -> None:
        """Record the evaluation at time i, and what was passed since the last one."""
        passages = [] if self._last is None else self._explicit.passed(self._last.point, now.point)
        self._record.add(i, now, self._x, passages, self._last)
        self._last = now
        self._report(i)

    def _report(self, i: int) -> None:
        if self._progress is not None:
            self._progress(i / (len(self._times) - 1))

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        stats = Stats(
            **asdict(self._counters),
            rhs=self._calls + self._equations.calls,
            repartitions=self._repartitions,
            wall_seconds=time.perf_counter() - begun,
        )
        return self._record.trajectory(stats)


def _apart(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max(initial=0.0))
