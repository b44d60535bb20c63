"""What a simulation keeps: the outputs, the crossings and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..dynamics.equations import EquationsOfMotion, Evaluation, constraint_forces
from ..maps.classical import SingularityWarning
from ..maps.explicit import Crossing
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..native.workspace import Outputs
from ..warning import warn
from .stats import Stats
from .trajectory import Trajectory


class Record:
    """Outputs at the given times, filled one by one.

    Parameters
    ----------
    mechanism : Mechanism
    times : ndarray (N + 1,)
        s.
    items : sequence of {"a", "energy", "multipliers"}
        What to keep besides q and v.
    equations : EquationsOfMotion
        Tell whether the state ends with the work done, and whether motions are prescribed.

    Attributes
    ----------
    mechanism : Mechanism
    count : int
        Outputs kept so far.
    last_state : ndarray
        The state at the last one.
    work : ndarray or None
    """

    def __init__(
        self, mechanism: Mechanism, times: Array, items: Sequence[str], equations: EquationsOfMotion
    ) -> None:
        n = len(times)
        self.mechanism, self._times = mechanism, times
        self._q, self._v = np.empty((n, mechanism.nq)), np.empty((n, mechanism.nv))
        self._a = np.empty((n, mechanism.nv)) if "a" in items else None
        self._energy = np.empty(n) if "energy" in items else None
        self._multipliers = np.empty((n, mechanism.nc)) if "multipliers" in items else None
        self.work = np.empty(n) if equations.works else None
        self._drive = np.empty((n, mechanism.nv)) if equations.driven else None
        self._crossings: list[Crossing] = []
        self._warned = False
        self.count = 0
        self.last_state: Array = np.zeros(0)

    def add(self, i: int, now: Evaluation, x: Array) -> None:
        """Keep the evaluation at time i and state x."""
        self._q[i], self._v[i] = now.point.q, now.v
        if self._a is not None:
            self._a[i] = now.a
        if self._energy is not None:
            self._energy[i] = self.mechanism.energy(now.point.q, now.v)
        if self._multipliers is not None:
            self._multipliers[i] = constraint_forces(self.mechanism, now.point.q, now.v, now.a, now.tau)
        if self.work is not None:
            self.work[i] = x[-1]
        if self._drive is not None:
            self._drive[i] = now.drive
        self.count, self.last_state = i + 1, x

    @property
    def wanted(self) -> tuple[str, ...]:
        """Which of `Outputs` besides q and v a batch is to bring."""
        kept = {"a": self._a, "energy": self._energy, "work": self.work}
        names = [name for name, values in kept.items() if values is not None]
        return (*names, "a", "tau") if self._multipliers is not None else tuple(names)

    def extend(self, i: int, outputs: Outputs, x: Array) -> None:
        """Keep the outputs of a batch after time i; x is the state at the last one."""
        n = len(outputs.q)
        kept = slice(i + 1, i + 1 + n)
        pairs = [
            (self._q, outputs.q),
            (self._v, outputs.v),
            (self._a, outputs.a),
            (self._energy, outputs.energy),
            (self.work, outputs.work),
        ]
        for mine, given in pairs:
            if mine is not None and given is not None:
                mine[kept] = given
        if self._multipliers is not None:
            assert outputs.a is not None
            assert outputs.tau is not None
            for j in range(n):
                state = outputs.q[j], outputs.v[j], outputs.a[j], outputs.tau[j]
                self._multipliers[i + 1 + j] = constraint_forces(self.mechanism, *state)
        self.count, self.last_state = i + n + 1, x

    def cross(self, crossings: Sequence[Crossing]) -> None:
        """Log what was passed, y in the run's first coordinates; the first gap bridged is warned of."""
        own = self.mechanism.iq_numbers
        self._crossings += [replace(crossing, y=crossing.q[own]) for crossing in crossings]
        for crossing in crossings:
            if crossing.kind == "near miss" and not self._warned:
                self._warned = True
                warn(
                    f"at t = {crossing.time:.6g} s two modes pass with a gap of {crossing.certificate:.1g} "
                    "lengths, below geometric_tolerance: bridged as a crossing",
                    SingularityWarning,
                )

    @property
    def crossings(self) -> list[Crossing]:
        """Those logged so far."""
        return list(self._crossings)

    def grow(self, times: Array) -> None:
        """Make room for more output times, the first of which are the present ones."""
        more = len(times) - len(self._times)

        for name in ("_q", "_v", "_a", "_energy", "_multipliers", "work", "_drive"):
            values: Array | None = getattr(self, name)
            if values is not None:
                setattr(self, name, np.concatenate([values, np.empty((more, *values.shape[1:]))]))
        self._times = times

    def rewind(self, i: int) -> None:
        """Forget what came at time i and later."""
        self.count = i
        self.forget_crossings(i)

    def forget_crossings(self, i: int) -> None:
        """Forget those after time i."""
        self._crossings = [c for c in self._crossings if c.time <= self._times[i]]

    def trajectory(self, stats: Stats) -> Trajectory:
        """What is kept so far."""
        n = self.count

        def cut(values: Array | None) -> Array | None:
            return None if values is None else values[:n]

        return Trajectory(
            self.mechanism,
            self._times[:n],
            self._q[:n],
            self._v[:n],
            cut(self._a),
            cut(self._energy),
            cut(self._multipliers),
            cut(self.work),
            self._crossings,
            stats,
            cut(self._drive),
        )
