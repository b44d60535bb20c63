"""The closed form of the planar four-bar: γ, G, g; its parallelogram mode is a `pendulum`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_between
from ..errors import OptionError
from ..mechanism.tree.model import OVERFLOWING
from .pendulum import Triple
from .pendulum import parallelogram_pendulum as parallelogram_pendulum
from .pendulum import pendulum as pendulum

PI = math.pi
LENGTH_ROUNDING = 8 * float(np.finfo(float).eps)
"""Times the perimeter: lengths this near to a change-point linkage are taken to be one, as rounded
lengths would veer where modes cross. On lengths, not squares: √(8 ulp) would hide a true gap."""

SAME_ASSEMBLY = 1e-6  # rad: within this a configuration belongs to an assembly


class _Shape(NamedTuple):
    """Constants of a linkage, rounded so that a change point is exact."""

    d: float  # l0 − l1
    kappa: float  # l2² − l3²
    c1: float  # S1² = c1 + 4 l0 l1 sin²(y/2); 0: S1 is signed
    c2: float  # S2² = c2 + 4 l0 l1 cos²(y/2); 0: S2 is signed
    b1: float  # S1² = b1 − 4 l0 l1 cos²(y/2): keeps the digits where c1 would cancel
    b2: float  # S2² = b2 − 4 l0 l1 sin²(y/2)
    still: int  # two links keep their direction: 1 parallelogram, −1 folded, 0 neither
    beta: tuple[float, float]  # offset and slope of a line within π of which β stays
    psi: tuple[float, float]  # the same for ψ


def _shape(l0: float, l1: float, l2: float, l3: float, s: int) -> _Shape:
    rounding = LENGTH_ROUNDING * (l0 + l1 + l2 + l3)
    d, e, c, f = l0 - l1, l2 - l3, l0 + l1, l2 + l3
    if max(abs(d), abs(e)) <= rounding:
        d = e = 0.0
    elif abs(abs(d) - abs(e)) <= rounding:
        e = math.copysign(d, e)
    if abs(c - f) <= rounding:
        f = c
    c1, c2 = (abs(d) - abs(e)) * (abs(d) + abs(e)), (f - c) * (f + c)
    b1, b2 = (c - abs(e)) * (c + abs(e)), (f - abs(d)) * (f + abs(d))
    still = s if c1 == c2 == 0.0 and d == s * e else 0
    flat, half = (0.0, 0.0), (PI, 0.0)
    if c1 == c2 == 0.0:  # β or ψ winds once per turn of y
        beta, psi = ((s * PI, -s), half) if e < 0.0 else (flat, (0.0, s))
    else:
        beta = half if c1 == 0.0 and e < 0.0 else flat
        psi = half if c2 == 0.0 else beta
    return _Shape(d, e * f, c1, c2, b1, b2, still, beta, psi)


def _angle(cosine: float, sine: float, reference: float) -> float:
    """Argument of cosine + i sine within π of `reference`, rad."""
    c, s = math.cos(reference), math.sin(reference)
    return reference + math.atan2(sine * c - cosine * s, cosine * c + sine * s)


@dataclass(frozen=True)
class FourBar:
    """One operation mode of the planar four-bar, analytic in y through its change points.

    φ = [l1 cos q1 + l2 cos q12 − l0 − l3 cos q3; l1 sin q1 + l2 sin q12 − l3 sin q3], with
    q12 = q1 + q2 and y = q1. D = l0 − l1 e^{iy} runs from the tip of link 1 to the ground pivot of
    link 3; r = |D|, κ = l2² − l3², s = `assembly`; q12 = arg D + β and q3 = arg D + ψ, where

        e^{iβ} = (r² + κ + i s S1 S2) / (2 r l2),   e^{iψ} = (κ − r² + i s S1 S2) / (2 r l3),
        S1² = r² − (l2 − l3)² = (l0 − l1)² − (l2 − l3)² + 4 l0 l1 sin²(y/2),
        S2² = (l2 + l3)² − r² = (l2 + l3)² − (l0 + l1)² + 4 l0 l1 cos²(y/2).

    At change-point lengths, |l0 − l1| = |l2 − l3| or l0 + l1 = l2 + l3 to `LENGTH_ROUNDING`, the
    constant of S1² or S2² vanishes and the root keeps its sign, S1 = 2 √(l0 l1) sin(y/2) or
    S2 = 2 √(l0 l1) cos(y/2): the positive root would jump to the other mode. For l0 = l1 with
    l2 = l3, r is signed in the same way, r = S1.

    Modes, s = +1 | s = −1:
    rhombus: parallelogram mode a, q = (y, −y, y) | mode c, q2 and q3 stay at π (mod 2π);
    parallelogram l0 = l2 ≠ l1 = l3: q = (y, −y, y) | the antiparallelogram;
    deltoid l0 = l3 ≠ l1 = l2: its curved mode | q2 and q3 stay at π (mod 2π);
    all others: coupler to the left | to the right of D at small y > 0, or at the first in reach.
    With just one of the two equalities, a mode that turns fully closes after two turns: y + 2π is
    the other assembly at y. Modes on which y rests (the rhombus' mode b) have no γ(y).
    Source: docs/method.md; circle intersection in half-angles, differentiated: no K_d is inverted, no
    digit lost at a crossing. Where r is as small as |l0 − l1|, G is off by up to ε l1 / |l0 − l1|.

    Parameters
    ----------
    l0, l1, l2, l3 : float
        Ground, input link, coupler, output link, m. OptionError unless positive and able to move.
    assembly : int
        +1 or −1, else OptionError.
    """

    l0: float
    l1: float
    l2: float
    l3: float
    assembly: int = 1
    _shape: _Shape = field(init=False, repr=False, compare=False)
    _turns: tuple[float, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        lengths = (self.l0, self.l1, self.l2, self.l3)
        for name, length in zip(("l0", "l1", "l2", "l3"), lengths, strict=True):
            check_between(name, length, 0.0, OVERFLOWING)
        room = sum(lengths) * (1.0 - LENGTH_ROUNDING) - 2.0 * max(lengths)
        if not (min(lengths) > 0.0 and 0.0 < room < math.inf):
            raise OptionError(f"lengths {lengths} m: need all > 0, the longest below the others' sum")
        if self.assembly not in (1, -1):
            raise OptionError(f"assembly must be +1 or -1, got {self.assembly!r}")
        object.__setattr__(self, "_shape", _shape(*lengths, self.assembly))
        object.__setattr__(self, "_turns", (0.0, 0.0))
        low, high = self.reach
        angles = self._pose(0.0 if low == 0.0 else PI if high == PI else 0.5 * (low + high))[:2]
        turns = tuple(-2.0 * PI * math.ceil((a - PI) / (2.0 * PI) - 1e-9) for a in angles)  # π itself stays
        object.__setattr__(self, "_turns", turns)

    @property
    def reach(self) -> tuple[float, float]:
        """(low, high), rad: y is in reach where low ≤ |y| ≤ high, y taken mod 2π in (−π, π]."""
        f = self._shape
        low = 0.0 if f.c1 >= 0.0 else 2.0 * math.atan2(math.sqrt(-f.c1), math.sqrt(max(f.b1, 0.0)))
        return low, PI if f.c2 >= 0.0 else 2.0 * math.atan2(math.sqrt(max(f.b2, 0.0)), math.sqrt(-f.c2))

    def evaluate(self, y: float, near: ArrayLike | None = None) -> Triple:
        """γ(y), G = γ'(y) and γ''(y), so that v = G ẏ and g = γ'' ẏ².

        Parameters
        ----------
        y : float
            q1 on the unwrapped real line, rad. OptionError if out of reach, or a dead point, where
            γ' does not exist.
        near : (3,) array_like, optional
            q2, q3 get the multiples of 2π nearest to near[1:], rad. Without it they are continuous
            over every interval in reach, in (−π, π] at y = 0, else at π, else amid `reach`.

        Returns
        -------
        q, G, g1 : ndarray (3,)
            rad, -, 1/rad.
        """
        q2, q3, sh, ch, rr, s1, s2 = self._pose(y)
        q, f, s = np.array([y, q2, q3]), self._shape, self.assembly
        if near is not None:
            q[1:] += 2.0 * PI * np.round((np.asarray(near, dtype=float)[1:] - q[1:]) / (2.0 * PI))
        if f.still:
            rate = -1.0 if f.still > 0 else 0.0
            return q, np.array([1.0, rate, -rate]), np.zeros(3)
        if (s1 == 0.0 and f.c1 != 0.0) or (s2 == 0.0 and f.c2 != 0.0):
            raise OptionError(f"y = {y!r} is a dead point: y turns back; use another coordinate")
        p = self.l0 * self.l1
        root, u = math.sqrt(p), 2.0 * p * sh * ch  # u = l0 l1 sin y = (r²)'/2
        # f1 = 2 √p sin(y/2) / S1 and f2 = 2 √p cos(y/2) / S2 are 1 where the root is signed.
        f1, df1 = (2.0 * root * sh / s1, root * ch * f.c1 / s1**3) if f.c1 else (1.0, 0.0)
        f2, df2 = (2.0 * root * ch / s2, -root * sh * f.c2 / s2**3) if f.c2 else (1.0, 0.0)
        h, dh = 0.5 * s * f1 * f2, 0.5 * s * (df1 * f2 + f1 * df2)
        if f.d == f.c1 == 0.0:  # l0 = l1, l2 = l3
            turn, dturn, ratio, dratio = 0.5, 0.0, 0.0, 0.0
        else:
            turn = self.l1 * (2.0 * self.l0 * sh * sh - f.d) / rr  # (arg D)'
            dturn = u * f.d * (self.l0 + self.l1) / rr**2
            ratio, dratio = f.kappa / rr, -2.0 * f.kappa * u / rr**2
        g12, dg12 = turn - (1.0 - ratio) * h, dturn - (1.0 - ratio) * dh + dratio * h
        g3, dg3 = turn + (1.0 + ratio) * h, dturn + (1.0 + ratio) * dh + dratio * h
        return q, np.array([1.0, g12 - 1.0, g3]), np.array([0.0, dg12, dg3])

    @classmethod
    def assembly_of(cls, l0: float, l1: float, l2: float, l3: float, q: ArrayLike) -> FourBar:
        """Find the mode that passes through a closed configuration q (3,), rad, to SAME_ASSEMBLY.

        Raises OptionError if no assembly does, or both do (a change point).
        """
        y, *others = np.asarray(q, dtype=float).tolist()
        bars = (cls(l0, l1, l2, l3, 1), cls(l0, l1, l2, l3, -1))
        apart = np.array([bar._pose(y)[:2] for bar in bars]) - others
        hit = np.max(np.abs(np.exp(1j * apart) - 1.0), axis=1) <= SAME_ASSEMBLY
        if hit[0] == hit[1]:
            which = "both pass: give assembly=+1 or -1" if hit[0] else "neither passes"
            raise OptionError(f"assemblies of {l0, l1, l2, l3} through q = {y, *others}: {which}")
        return bars[0] if hit[0] else bars[1]

    def _pose(self, y: float) -> tuple[float, float, float, float, float, float, float]:
        """q2, q3 (rad), sin(y/2), cos(y/2), r² (m²), S1, S2 (m)."""
        f, s, p = self._shape, self.assembly, 4.0 * self.l0 * self.l1
        sh, ch = (math.sin(0.5 * y), math.cos(0.5 * y)) if math.isfinite(y) else (math.nan, math.nan)
        s1, s2 = math.sqrt(p) * sh, math.sqrt(p) * ch
        rr = f.d * f.d + s1 * s1
        # of two forms that are equal the one that cancels less
        square1 = f.b1 - s2 * s2 if -f.c1 > f.b1 else f.c1 + s1 * s1
        square2 = f.b2 - s1 * s1 if -f.c2 > f.b2 else f.c2 + s2 * s2
        if not (square1 >= 0.0 and square2 >= 0.0):
            reach = "{:.15g} <= |y| <= {:.15g} rad, y modulo 2 pi in (-pi, pi]".format(*self.reach)
            raise OptionError(f"y = {y!r} is out of reach of {self}, which needs {reach}")
        s1 = math.sqrt(square1) if f.c1 else s1  # signed at change points: |s1| would jump to the other mode
        s2 = math.sqrt(square2) if f.c2 else s2
        beta, psi = f.beta[0] + f.beta[1] * y, f.psi[0] + f.psi[1] * y
        if f.still:
            q2, q3 = (-y, y) if f.still > 0 else (PI, PI)
        elif f.d == f.c1 == 0.0:  # everything divided by the signed r
            q12 = 0.5 * (y - PI) + _angle(s1, s * s2, 0.0)
            q2, q3 = q12 - y, 0.5 * (y - PI) + _angle(-s1, s * s2, 0.0)
        else:
            axis = math.atan2(-2.0 * self.l1 * sh * ch, f.d + 2.0 * self.l1 * sh * sh)
            if f.d < 0.0:  # D = −e^{iy} (l1 − l0 e^{−iy}) winds with y
                axis = y + PI + math.atan2(2.0 * self.l0 * sh * ch, 2.0 * self.l0 * sh * sh - f.d)
            q2 = axis + _angle(rr + f.kappa, s * s1 * s2, beta) - y
            q3 = axis + _angle(f.kappa - rr, s * s1 * s2, psi)
        return q2 + self._turns[0], q3 + self._turns[1], sh, ch, rr, s1, s2
