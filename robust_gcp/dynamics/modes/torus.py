"""A cluster's mode of two coordinates around a place, from a torus in the complex plane of each of its ways.

K is singular on curves of the mode. One way leads across such a curve and is the longer one, so that the
curve, straight or bent, stays off the torus |z₁| = |z₂| = 1 of shares of both. The mode is followed from a
real regular point along z₂, and from each place there once around z₁; the lower half of z₂'s circle is the
upper one's mirror image. The two-dimensional Fourier coefficients of G are those of its Taylor series (see
`continuation`, whose Newton steps these are).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from ...errors import NotCertifiedError
from ...mechanism.constraint.closure_rates import Placement
from ...mechanism.tree.tree import Array
from .continuation import Place, led
from .map_rates import ClusterRates
from .taylor_series import INSIDE, Around

POINTS = 24, 20
"""Points around each circle."""

TERMS = 18, 15
"""Terms of the series by each share: further coefficients are those of negative orders too."""

BACK = 1e-9
"""How far from where it began a way once around may end, dimensionless: elsewhere is another mode."""


@dataclass(frozen=True)
class Torus:
    """A series, and the largest relative error of G and of what it has second derivatives by."""

    around: Around
    error: float


def ways_about(rates: ClusterRates, place: Placement, G: Array) -> Array:
    """A way across the singular curve at a place and one along it, of unit length on the mode, (2, 2)."""
    unit = rates.scale[rates.independent]
    across = rates.across(place, G) / unit
    moved = G * unit / rates.scale[:, None]
    normal = moved.T @ (moved @ across)
    along = np.array([-normal[1], normal[0]])
    return unit[:, None] * np.column_stack([across, along / np.linalg.norm(moved @ along)])


def torus(rates: ClusterRates, q: Array, center: Array, ways: Array) -> Torus:
    """Follow the mode around from the real configuration q at center + ways @ [1, 1].

    Raises
    ------
    NotCertifiedError
        Where Newton leaves the mode, or a way around does not come back.
    """
    first, second = POINTS
    turns = [np.exp(2j * np.pi * np.arange(n + 1) / n) for n in POINTS]
    rate = np.empty((first, second, rates.cluster.loops.nv, 2), dtype=complex)
    place, here = Place(rates, q), rates.rates.real(q)
    numbers = np.empty((first, second, len(here.q)), dtype=complex)
    G = rates.slope(here)
    for k in range(second // 2 + 1):
        if k > 0:
            here = led(rates, place, G @ ways[:, 1] * (turns[1][k] - turns[1][k - 1]))
            G = rates.slope(here)
        around, there, rate[0, k], numbers[0, k] = copy.copy(place), here, G, here.q
        for j in range(1, first + 1):
            last = rate[j - 1, k]
            ahead = last if j == 1 else 1.5 * last - 0.5 * rate[j - 2, k]  # Adams–Bashforth
            there = led(rates, around, ahead @ ways[:, 0] * (turns[0][j] - turns[0][j - 1]))
            if j < first:
                rate[j, k], numbers[j, k] = rates.slope(there), there.q
        # else a branch point lies inside, or another mode was met
        if np.abs((there.q - here.q) / rates.scale).max() > BACK:
            raise NotCertifiedError("derivatives: the mode does not come back around the singular curve")
    mirrored = -np.arange(first) % first  # the mode is real at real y: γ(ȳ) is the conjugate of γ(y)
    for part in (rate, numbers):
        part[:, second // 2 + 1 :] = part[mirrored, second // 2 - 1 : 0 : -1].conj()
    found = (np.fft.fft2(rate, axes=(0, 1)) / (first * second)).real
    return _series(rates, found, center, ways, numbers.mean((0, 1)).real)


def _series(rates: ClusterRates, found: Array, center: Array, ways: Array, q: Array) -> Torus:
    """The series with these Fourier coefficients of G, (N, N', nv, 2), negative orders last."""
    by_share = found @ ways / rates.scale[:, None]
    J, K = TERMS
    orders = np.arange(1, J), np.arange(1, K)
    terms = np.zeros((J, K, found.shape[2]))
    terms[1:] = by_share[: J - 1, :K, :, 0] / orders[0][:, None, None]
    terms[0, 1:] = by_share[0, : K - 1, :, 1] / orders[1][:, None]
    other = by_share[:J, : K - 1, :, 1] / orders[1][:, None]  # the same terms by the second share
    size = 1.0 + float(np.abs(by_share[0, 0]).max())
    kept = by_share[:J, :K]
    error = max(
        float(np.abs(by_share[-3:]).max()),  # negative orders: zero for what is analytic inside
        float(np.abs(by_share[:, -3:]).max()),
        float(np.abs(terms[:, 1:] - other).max()),  # ∂G₁/∂z₂ = ∂G₂/∂z₁: G is a derivative of one map
        *(float(np.abs(np.take(kept, n - 1, i)).max()) * n**2 * INSIDE**n for i, n in enumerate(TERMS)),
    )
    return Torus(Around(center, ways, terms * rates.scale, q), error / size)
