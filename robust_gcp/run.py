"""One simulation in progress: the loop, the record and the events."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from .bridge import BridgeOptions
from .bridge_map import BridgeMap
from .dynamics import EquationsOfMotion, Evaluation, Torque, constraint_forces, does_work
from .errors import BranchError, NonFiniteError, ToggleError
from .explicit import Crossing, ExplicitMap, Passage
from .gcp import SingularityWarning
from .kernel import Counters, Point
from .march import POOR
from .mechanism import Mechanism
from .obstacle import UncertifiedZoneError
from .start import Start, begin
from .steppers import NoProgressError, adaptive, rk4_step
from .trajectory import Stats, Trajectory
from .tree import Array

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
    ) -> None:
        self._original = mechanism
        self._torque, self._times, self._counters = torque, times, counters
        self._progress = progress
        self._recorded = 0
        n = len(times)
        self._q, self._v = np.empty((n, mechanism.nq)), np.empty((n, mechanism.nv))
        self._a = np.empty((n, mechanism.nv)) if "a" in record else None
        self._energy = np.empty(n) if "energy" in record else None
        self._multipliers = np.empty((n, mechanism.nc)) if "multipliers" in record else None
        self._works = does_work(mechanism, torque)
        self._work = np.empty(n) if self._works else None
        self._crossings: list[Crossing] = []
        self._repartitions: list[tuple[float, tuple[str, ...]]] = []
        self._calls = 0
        self._last: Evaluation | None = None
        self._x = np.concatenate([start.point.y, start.ydot, np.zeros(int(self._works))])
        self._warned = False
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
        well-conditioned one with error control, or changes coordinates there.
        """
        last = len(self._times) - 1
        i, careful, met_at, changed_at = 0, False, -1, -1
        safe = Checkpoint(0, self._x, self._explicit.anchor)
        while True:
            t = float(self._times[i])
            try:
                now = self._careful(t) if careful else self._equations.evaluate(t, self._x)
                self._accept(i, now)
                good = now.point.conditioning >= POOR
                careful = careful and not (good and i > met_at)
                if (good and not careful) or i == 0:
                    safe = Checkpoint(i, self._x, now.point)
                if i == last:
                    return
                h = float(self._times[i + 1]) - t
                x = self._refined(t, h) if careful else self._rk4(t, h, now)
            except UncertifiedZoneError as zone:
                met_at, i = i, self._back_to(safe)
                if zone.obstacle.kind == "toggle" and on_toggle == "repartition" and i > changed_at:
                    self._repartition(i, options)
                    changed_at, safe = i, Checkpoint(i, self._x, self._explicit.anchor)
                else:
                    careful = True
                continue
            except (BranchError, ToggleError):
                # the true curve is lost in these coordinates; others may hold it
                if not careful or on_toggle != "repartition" or safe.i <= changed_at:
                    raise
                i, careful = self._back_to(safe), False
                self._repartition(i, options)
                changed_at, safe = i, Checkpoint(i, self._x, self._explicit.anchor)
                continue
            self._x = x
            i += 1

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
        t = float(self._times[safe.i])
        self._x, self._explicit.anchor, self._last = safe.x, safe.point, None
        self._recorded = safe.i
        self._crossings = [c for c in self._crossings if c.time <= t]
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
                for x in adaptive(stepper, self._equations, self._x, times[i:], rtol, atol):
                    i += 1
                    if not np.all(np.isfinite(x)):
                        raise NonFiniteError(f"{stepper} left the finite numbers at t = {times[i]:.6g} s")
                    self._x = x
                    self._accept(i, self._equations.evaluate(float(times[i]), x))
            except ToggleError:
                i = self._recorded - 1
                if on_toggle == "error" or i == changed_at or self._last is None:
                    raise
                self._explicit.anchor = self._last.point
                self._x = self._accepted
                self._repartition(i, options)
                changed_at = i

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

    def _repartition(self, i: int, options: BridgeOptions) -> None:
        """Change to the best conditioned independent joints at the present state."""
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

    # --------------------------------------------------------------------- record

    def _accept(self, i: int, now: Evaluation) -> None:
        """Record the evaluation at time i, and what was passed since the last one."""
        t = float(self._times[i])
        if self._last is not None:
            for passage in self._explicit.passed(self._last.point, now.point):
                self._cross(passage, float(self._times[i - 1]), t, self._last, now)
        self._last = now
        self._q[i], self._v[i] = now.point.q, now.v
        if self._a is not None:
            self._a[i] = now.a
        if self._energy is not None:
            self._energy[i] = self._mechanism.energy(now.point.q, now.v)
        if self._multipliers is not None:
            self._multipliers[i] = constraint_forces(self._original, now.point.q, now.v, now.a, now.tau)
        if self._work is not None:
            self._work[i] = self._x[-1]
        self._recorded, self._accepted = i + 1, self._x
        if self._progress is not None:
            self._progress(i / (len(self._times) - 1))

    def _cross(self, passage: Passage, t0: float, t1: float, before: Evaluation, after: Evaluation) -> None:
        """Log a crossing at the time where the Hermite interpolant of y meets the surface."""
        a, b = before.point, after.point
        towards = b.y - a.y
        spline = CubicHermiteSpline([t0, t1], np.array([a.y, b.y]), np.array([a.ydot, b.ydot]))

        def ahead(t: float) -> float:
            return float((spline(t) - passage.y) @ towards)

        ends = ahead(t0), ahead(t1)
        when = t1 if ends[1] == 0.0 or ends[0] * ends[1] > 0.0 else float(brentq(ahead, t0, t1))
        self._crossings.append(
            Crossing(when, passage.y, passage.q, passage.kind, passage.certificate, passage.transversality)
        )
        if passage.kind == "near miss" and not self._warned:
            self._warned = True
            warnings.warn(
                f"at t = {when:.6g} s two modes pass with a gap of {passage.certificate:.1g} lengths, "
                "below geometric_tolerance: bridged as a crossing",
                SingularityWarning,
                stacklevel=5,
            )

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        n, c = self._recorded, self._counters

        def cut(values: Array | None) -> Array | None:
            return None if values is None else values[:n]

        stats = Stats(
            rhs=self._calls + self._equations.calls,
            newton_iterations=c.newton_iterations,
            zone_evaluations=c.zone_evaluations,
            marching_steps=c.marching_steps,
            bridges_built=c.bridges_built,
            refined_steps=c.refined_steps,
            svds=c.svds,
            repartitions=self._repartitions,
            wall_seconds=time.perf_counter() - begun,
        )
        return Trajectory(
            self._original,
            self._times[:n],
            self._q[:n],
            self._v[:n],
            cut(self._a),
            cut(self._energy),
            cut(self._multipliers),
            cut(self._work),
            self._crossings,
            stats,
        )
