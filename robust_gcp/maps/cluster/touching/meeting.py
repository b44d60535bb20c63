"""What two modes do where K loses one rank more: the zeros of g on the mid curve decide.

A zero of multiplicity 2k is a meeting with contact of order k, k = 1 a crossing; of odd multiplicity, three
or more, a cusp; none, with real modes beside: they pass each other; g = 0 throughout: the mode lies in the
singular set.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from ....mechanism.tree.tree import Array
from ..interpolation import nodes
from ..jet import LostError
from ..options import BridgeOptions
from ..space import ClusterSpace
from .mid_curve import MidCurve, Surface, mid_curve

if TYPE_CHECKING:
    from ..curve import Curve

INSIDE = 3e-15
"""max |g|, in lengths, on a mode that lies in the singular set."""

SLOW, WIDER = 3e-5, (0.6, 0.9)
"""Where modes part by less than this, in g, a longer piece of the mid curve tells more."""

NEARBY = 0.8, 0.5
"""Zeros of g beyond these, along and off the real axis in units of R, belong to other places."""

MANY, ROUNDING = 8, 1e-15
"""Zeros in one place from which on what is left of g is looked at near it alone, and may be what rounding of
g's last coefficients, which are cut, makes of it: 24⁷/7! times as much along all of the mid curve."""

AROUND = 1.25
"""Half widths within which that is looked at."""

KNOWN, SAME = 0.8, 1e-9
"""Share of the mid curve within which a point is told by it, and how near to the surface a point is on it."""


def half_width(order: int) -> float:
    """10^(−4/(k + 2)), beyond which Newton's own errors ε/δᵏ, kε/δᵏ⁺¹, k²ε/δᵏ⁺² of q, G and g are small."""
    return max(float(10.0 ** (-4.0 / (order + 2))), 0.1)


MeetingKind = Literal["meets", "cusp", "isolated", "inside", "passes", "turns"]


@dataclass(frozen=True)
class Meeting:
    """What the modes do near a place.

    Attributes
    ----------
    kind : {"meets", "cusp", "isolated", "inside", "passes", "turns"}
        Two modes meet; a cusp; a point of its own; the mode lies in the singular set; two modes pass each
        other; one mode turns back in u, where K has full rank.
    places : tuple of (float, int)
        u and multiplicity of the zeros of g.
    gap : float
        How far the linkage is from having exactly these zeros, in lengths: max |g mod Π(u − u_i)^p_i|, near
        those of `MANY` where Newton needs the bridge (`half_width`).
    curve : MidCurve
    bridges : dict of float to Curve
        Those that were built through it, by the side of the mode.
    """

    kind: MeetingKind
    places: tuple[tuple[float, int], ...]
    gap: float
    curve: MidCurve
    bridges: dict[float, Curve] = field(default_factory=dict, compare=False, repr=False)

    @property
    def orders(self) -> tuple[tuple[float, int], ...]:
        """u and order of contact of the places where K loses rank."""
        return tuple((u, p // 2) for u, p in self.places if p > 1)

    @property
    def star(self) -> Array:
        """x of the first place."""
        return self.curve.values_at(next(u for u, p in self.places if p > 1))[0]

    @property
    def order(self) -> int:
        """The highest order of contact; 0 where nothing meets."""
        return max((k for _, k in self.orders), default=0)

    def tells(self, x: Array) -> bool:
        """Whether x, on a mode, is one of these: all that they meet within KNOWN of the mid curve is told."""
        surface = self.curve.surface
        u, w = surface.u(x), surface.w(x)
        if abs(self.curve.s(u)) > KNOWN:
            return False
        middle = self.curve.values_at(u)[0]
        try:
            own = surface.point(middle + surface.v * (w - surface.w(middle)), u, w)
        except (LostError, np.linalg.LinAlgError):
            return False
        return bool(np.abs(own - x).max() < SAME)

    def parity(self, u: float) -> float:
        """The side on which a mode lies at u, in that beyond all places: Π sign(u − u_i)^k_i."""
        return float(np.prod([np.sign(u - place) ** k for place, k in self.orders]))


def meeting(space: ClusterSpace, x: Array, P: Array, ahead: Array, options: BridgeOptions) -> Meeting:
    """What the modes do near a point x beside them.

    Parameters
    ----------
    space : ClusterSpace
        Of mobility 1.
    x : ndarray (nv,)
        Regular, or at the place.
    P : ndarray (nd, rows)
        Rows of φ that determine the mode.
    ahead : ndarray (nv,)
        A guess of the way to the place.
    options : BridgeOptions
        Gaps, in lengths, of what is certified (`closure_tolerance`), and of what counts as a meeting still.

    Raises
    ------
    LostError
        Where there is no mid curve: f does not bend across the modes.
    """
    surface = Surface(space, x, P)
    curve = mid_curve(surface, x, float(surface.t @ ahead))
    for _ in range(3):  # about the place that was found
        places, _ = divisor(curve, options.largest_gap)
        real = [s for s, p in places if p > 1] or [z.real for z in _zeros(curve.g) if abs(z.imag) < 0.3]
        if not real:
            break
        center = curve.values_at(curve.u0 + curve.R * float(np.mean(real)))[0]
        if np.abs(center - surface.reference).max() < SAME:
            break
        surface = Surface(space, center, P)
        curve = mid_curve(surface, center, 0.0)
    for R in WIDER:
        if curve.size > SLOW:
            break
        try:
            wide = mid_curve(surface, curve.values_at(curve.u0)[0], curve.u0, R)
        except LostError:
            break
        curve = wide if wide.R > curve.R else curve
    return _judged(curve, options.closure_tolerance, options.largest_gap)


def _judged(curve: MidCurve, closure_tolerance: float, largest_gap: float) -> Meeting:
    """The verdict."""
    samples = np.linspace(-1.0, 1.0, 41)
    if np.abs(chebyshev.chebval(samples, curve.g)).max() <= INSIDE:  # first: of zero everything is a zero
        return Meeting("inside", (), curve.size, curve)
    # what is no meeting to rounding may be one with a gap
    places, gap = divisor(curve, closure_tolerance)
    if all(p == 1 for _, p in places):
        again = divisor(curve, largest_gap)
        if any(p > 1 for _, p in again[0]):
            places, gap = again
    found = tuple((curve.u0 + curve.R * s, p) for s, p in places)
    bent = np.sign(curve.bend[0])
    if any(p > 1 and p % 2 for _, p in places):  # g changes sign: modes on one side alone
        return Meeting("cusp", found, gap, curve)
    if any(p > 1 for _, p in places):
        # w − w₀ = ±√(−2g/f_ww) must be real: the powers are even, so the quotient has the sign of g
        quotient = _divided(curve.g, curve.R, places)[1]
        real = -float(chebyshev.chebval(next(s for s, p in places if p > 1), quotient)) * bent > 0.0
        return Meeting("meets" if real else "isolated", found, gap, curve)
    return Meeting("turns" if places else "passes", found, gap, curve)


def divisor(curve: MidCurve, tolerance: float) -> tuple[list[tuple[float, int]], float]:
    """The coarsest real places (s, multiplicity) that leave a gap of `tolerance` or rounding, and that gap.

    The zeros of g are put together by single linkage, from coarse to fine. A place is the zero of the
    derivative of order p − 1 next to the mean of p of them, a simple one, and for p > 2 the best one to all
    of g.
    """
    zeros = _zeros(curve.g)
    if len(curve.g) < 2 or not len(zeros):
        return [], 0.0
    last = np.append(np.zeros(len(curve.g) - 1), ROUNDING)
    for level in (2.0, *np.geomspace(1.0, 1e-9, 46)):
        places: list[tuple[float, int]] | None = []
        for group in linked(zeros, level):
            mean, p = complex(np.mean(zeros[group])), len(group)
            if p == 1 and abs(mean.imag) > 1e-13:
                continue  # of a complex pair: no place
            s = _refined(curve.g, mean.real, p)  # the mean of p roots of ε^(1/p) is not known to ε itself
            if abs(mean.imag) > 1e-9 or not abs(s - mean.real) < 0.3:
                places = None
                break
            assert places is not None
            places.append((s, p))
        if places is None:
            continue
        if any(p > 2 for _, p in places):
            places = _fitted(curve.g, places)
        gap = _divided(curve.g, curve.R, places)[0] if places else 0.0
        rounding = _divided(last, curve.R, places)[0] if any(p >= MANY for _, p in places) else 0.0
        if gap <= max(tolerance, rounding):
            return sorted(places), gap
    return [], np.inf


def linked(points: Array, level: float) -> list[NDArray[np.int64]]:
    """Groups of complex numbers, each within `level` of another one of its group."""
    near = np.abs(points[:, None] - points[None, :]) <= level
    while True:
        further = (near.astype(float) @ near) > 0.0
        if (further == near).all():
            break
        near = further
    return [np.flatnonzero(row) for row in np.unique(near, axis=0)]


def _zeros(g: Array) -> Array:
    if len(g) < 2:
        return np.zeros(0, complex)
    found = chebyshev.chebroots(g).astype(complex)
    return found[(np.abs(found.real) < NEARBY[0]) & (np.abs(found.imag) < NEARBY[1])]


def _fitted(g: Array, places: list[tuple[float, int]]) -> list[tuple[float, int]]:
    """The places for which Π(s − s_i)^p_i q comes nearest to g, a polynomial q, by Gauss–Newton.

    A derivative of order p − 1 holds the rounding of the last coefficients, to the p-th power of their order.
    """
    s = nodes(2 * len(g))
    values, degree = chebyshev.chebval(s, g), len(g) - 1 - sum(p for _, p in places)
    for _ in range(3 if degree >= 0 else 0):
        product = np.prod([(s - place) ** p for place, p in places], axis=0)
        powers = product[:, None] * chebyshev.chebvander(s, degree)
        near = powers @ np.linalg.lstsq(powers, values, rcond=None)[0]
        slopes = np.column_stack([-p * near / (s - place) for place, p in places])
        found = np.linalg.lstsq(np.hstack([slopes, powers]), values, rcond=None)[0]
        places = [(place + float(d), p) for (place, p), d in zip(places, found, strict=False)]
    return places


def _divided(g: Array, R: float, places: list[tuple[float, int]]) -> tuple[float, Array]:
    """max |g mod Π(s − s_i)^p_i|, and the quotient."""
    product: Array = np.ones(1)
    zone = []
    for s, p in places:
        half = AROUND * half_width(p // 2) / R if p >= MANY else 2.0
        zone.append(np.linspace(max(s - half, -1.0), min(s + half, 1.0), 41))
        for _ in range(p):
            product = chebyshev.chebmul(product, [-s, 1.0])
    if len(product) > len(g):
        return float(np.abs(g).sum()), np.zeros(1)
    quotient, left = chebyshev.chebdiv(g, product)
    return float(np.abs(chebyshev.chebval(np.array(zone), left)).max()), np.asarray(quotient)


def _refined(g: Array, s: float, p: int) -> float:
    """The zero of the derivative of order p − 1 next to s."""
    slope = chebyshev.chebder(g, p - 1) if p > 1 else g
    bend = chebyshev.chebder(slope)
    for _ in range(8):
        rate = float(chebyshev.chebval(s, bend))
        if rate == 0.0:
            break
        step = -float(chebyshev.chebval(s, slope)) / rate
        s += min(max(step, -0.2), 0.2)
        if abs(step) < 1e-16:
            break
    return s
