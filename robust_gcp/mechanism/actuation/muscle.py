"""Force of a muscle by its length and velocity, in the form of MuJoCo's muscles."""

from __future__ import annotations

from dataclasses import dataclass

from ...checks import check_finite, checked_vector
from ...errors import ModelError

TINY = 1e-15  # MuJoCo's own guard of divisions

Range = tuple[float, float]


@dataclass(frozen=True)
class Muscle:
    """Force of a muscle by its length and velocity: −force (FL(L) FV(V) u + FP(L)), L = 1 at its best.

    Parameters
    ----------
    lengths : (float, float)
        ℓ, m, at which L is the first and the last of `range`.
    range : (float, float)
    force : float
        Peak active force at rest, N.
    lmin, lmax : float
        L at which it pulls no more.
    vmax : float
        Velocity at which it does, in best lengths a second.
    fpmax, fvmax : float
        Passive force at lmax, and active force as it is stretched fast, shares of `force`.
    """

    lengths: Range
    force: float
    range: Range = (0.75, 1.05)
    lmin: float = 0.5
    lmax: float = 1.6
    vmax: float = 1.5
    fpmax: float = 1.3
    fvmax: float = 1.2

    def __post_init__(self) -> None:
        for name in ("lengths", "range"):
            low, high = checked_vector(getattr(self, name), 2, f"Muscle: {name}", "2").tolist()
            if not low < high:
                raise ModelError(f"Muscle: {name} = ({low}, {high}) must be ascending")
            object.__setattr__(self, name, (low, high))
        for name in ("force", "lmin", "lmax", "vmax", "fpmax", "fvmax"):
            check_finite(f"Muscle: {name}", getattr(self, name))
            object.__setattr__(self, name, float(getattr(self, name)))

    def gain_and_bias(self, length: float, rate: float) -> tuple[float, float]:
        """Force at u = 1 without, and at u = 0 with what is passive, N."""
        best = (self.lengths[1] - self.lengths[0]) / max(TINY, self.range[1] - self.range[0])
        L = self.range[0] + (length - self.lengths[0]) / max(TINY, best)
        V = rate / max(TINY, best * self.vmax)
        return -self.force * self._active(L) * self._fast(V), -self.force * self._passive(L)

    def _active(self, L: float) -> float:
        """FL: four parabolas, 1 at L = 1."""
        if not self.lmin <= L <= self.lmax:
            return 0.0
        a, b = 0.5 * (self.lmin + 1.0), 0.5 * (1.0 + self.lmax)
        if a >= L:
            return 0.5 * ((L - self.lmin) / max(TINY, a - self.lmin)) ** 2
        if b >= L:
            side = 1.0 - a if L <= 1.0 else b - 1.0
            return 1.0 - 0.5 * ((L - 1.0) / max(TINY, side)) ** 2
        return 0.5 * ((self.lmax - L) / max(TINY, self.lmax - b)) ** 2

    def _fast(self, V: float) -> float:
        """FV: two parabolas, 1 at V = 0."""
        most = self.fvmax - 1.0
        if V <= -1.0:  # it shortens as fast as it can and pulls nothing
            return 0.0
        if V <= 0.0:
            return (V + 1.0) ** 2
        return self.fvmax if most < V else self.fvmax - (most - V) ** 2 / max(TINY, most)

    def _passive(self, L: float) -> float:
        """FP: a parabola, then a line."""
        b = 0.5 * (1.0 + self.lmax)
        if L <= 1.0:
            return 0.0
        x = (min(L, b) - 1.0) / max(TINY, b - 1.0)
        return self.fpmax * (0.5 * x * x + max(L - b, 0.0) / max(TINY, b - 1.0))
