"""What a simulation keeps: the outputs, the crossings and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..dynamics.equations import Evaluation, constraint_forces
from ..maps.classical import SingularityWarning
from ..maps.explicit import Crossing, Passage
from ..maps.point import Point
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..warning import warn
from .stats import Stats
from .trajectory import Trajectory


@dataclass(frozen=True)
class Outputs:
    """Rows for several outputs at once, C-contiguous; None where not wanted."""

    q: Array
    v: Array
    a: Array | None = None
    tau: Array | None = None
    energy: Array | None = None
    work: Array | None = None


class Record:
    """Outputs at the given times, filled one by one.

    Parameters
    ----------
    mechanism : Mechanism
    times : ndarray (N + 1,)
        s.
    items : sequence of {"a", "energy", "multipliers"}
        What to keep besides q and v.
    works : bool
        Whether the state ends with the work done.

    Attributes
    ----------
    count : int
        Outputs kept so far.
    last_state : ndarray
        The state at the last one.
    work : ndarray or None
    """

    def __init__(self, mechanism: Mechanism, times: Array, items: Sequence[str], works: bool) -> None:
        n = len(times)
        self._mechanism, self._times = mechanism, times
        self._q, self._v = np.empty((n, mechanism.nq)), np.empty((n, mechanism.nv))
        self._a = np.empty((n, mechanism.nv)) if "a" in items else None
        self._energy = np.empty(n) if "energy" in items else None
        self._multipliers = np.empty((n, mechanism.nc)) if "multipliers" in items else None
        self.work = np.empty(n) if works else None
        self._crossings: list[Crossing] = []
        self._warned = False
        self.count = 0
        self.last_state: Array = np.zeros(0)

    def add(
        self, i: int, now: Evaluation, x: Array, passages: Sequence[Passage], before: Evaluation | None
    ) -> None:
        """Keep the evaluation at time i and state x; `passages` lie between `before` and it."""
        for passage in passages:
            assert before is not None
            self._cross(passage, i, before.point, now.point)
        self._q[i], self._v[i] = now.point.q, now.v
        if self._a is not None:
            self._a[i] = now.a
        if self._energy is not None:
            self._energy[i] = self._mechanism.energy(now.point.q, now.v)
        if self._multipliers is not None:
            self._multipliers[i] = constraint_forces(self._mechanism, now.point.q, now.v, now.a, now.tau)
        if self.work is not None:
            self.work[i] = x[-1]
        self.count, self.last_state = i + 1, x

    def room(self, i: int, n: int) -> Outputs:
        """Where the n outputs after time i go."""

        def rows(values: Array | None) -> Array | None:
            return None if values is None else values[i + 1 : i + 1 + n]

        a, tau, nv = rows(self._a), None, self._mechanism.nv
        if self._multipliers is not None:
            a, tau = np.empty((n, nv)) if a is None else a, np.zeros((n, nv))
        kept = slice(i + 1, i + 1 + n)
        return Outputs(self._q[kept], self._v[kept], a, tau, rows(self._energy), rows(self.work))

    def keep(self, i: int, n: int, outputs: Outputs, x: Array) -> None:
        """Keep n outputs after time i, written to what `room` gave; x is the state at the last one."""
        if self._multipliers is not None:
            a, tau = outputs.a, outputs.tau
            assert a is not None
            assert tau is not None
            for j in range(n):
                forces = constraint_forces(self._mechanism, outputs.q[j], outputs.v[j], a[j], tau[j])
                self._multipliers[i + 1 + j] = forces
        self.count = i + n + 1
        self.last_state = x

    def cross(self, passages: Sequence[Passage], i: int, before: Point, after: Point) -> None:
        """Log what was passed between the points at times i − 1 and i."""
        for passage in passages:
            self._cross(passage, i, before, after)

    def rewind(self, i: int) -> None:
        """Forget what came at time i and later."""
        self.count = i
        self._crossings = [c for c in self._crossings if c.time <= self._times[i]]

    def _cross(self, passage: Passage, i: int, a: Point, b: Point) -> None:
        """Log a crossing at the time where the Hermite interpolant of y meets the surface."""
        t0, t1 = float(self._times[i - 1]), float(self._times[i])
        h, towards = t1 - t0, b.y - a.y
        # how far y is ahead of the surface along the step, at both ends: values and rates
        f0, f1 = float((a.y - passage.y) @ towards), float((b.y - passage.y) @ towards)
        r0, r1 = h * float(a.ydot @ towards), h * float(b.ydot @ towards)

        def ahead(u: float) -> float:
            """Cubic Hermite interpolant at t0 + u h."""
            return f0 + u * (r0 + u * (3.0 * (f1 - f0) - 2.0 * r0 - r1 + u * (2.0 * (f0 - f1) + r0 + r1)))

        met = f1 != 0.0 and f0 * f1 <= 0.0
        when = t0 + h * float(scipy.optimize.brentq(ahead, 0.0, 1.0)) if met else t1
        self._crossings.append(
            Crossing(when, passage.y, passage.q, passage.kind, passage.certificate, passage.transversality)
        )
        if passage.kind == "near miss" and not self._warned:
            self._warned = True
            warn(
                f"at t = {when:.6g} s two modes pass with a gap of {passage.certificate:.1g} lengths, "
                "below geometric_tolerance: bridged as a crossing",
                SingularityWarning,
            )

    def trajectory(self, stats: Stats) -> Trajectory:
        """What is kept so far."""
        n = self.count

        def cut(values: Array | None) -> Array | None:
            return None if values is None else values[:n]

        return Trajectory(
            self._mechanism,
            self._times[:n],
            self._q[:n],
            self._v[:n],
            cut(self._a),
            cut(self._energy),
            cut(self._multipliers),
            cut(self.work),
            self._crossings,
            stats,
        )
