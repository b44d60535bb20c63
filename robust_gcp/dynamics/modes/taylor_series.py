"""A cluster's mode around a place, singular or not, as a Taylor series in its one or two coordinates.

Along a mode the map is analytic where K has lost rank too; `circle` and `torus` sample it in complex numbers
around the place, and their Fourier coefficients are its Taylor coefficients (Cauchy). With the integral Γ of
the velocities along the mode, Γ_a = G_a, and by its further derivatives

    g = Γ_ab u_a u_b,  ∂v/∂y_a = Γ_ab u_b,  ∂a/∂y_a = Γ_abc u_b u_c at u̇ = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .map_rates import MapRates

INSIDE = 0.5
"""Share of its radius, along each of its ways, within which a series serves."""


@dataclass(frozen=True)
class Around:
    """The series about a place of one cluster.

    Attributes
    ----------
    center : ndarray (n,)
        The cluster's y there, n = 1 or 2.
    ways : ndarray (n, n)
        y is center + ways @ share; the sampled shares have modulus 1.
    terms : ndarray (J, K, nv)
        Of Γ less what it is at the centre, by the powers of the first share and of the second; K = 1 where
        n = 1.
    q : ndarray (nq,)
        The cluster's at the centre.
    """

    center: Array
    ways: Array
    terms: Array
    q: Array

    def covers(self, y: Array) -> bool:
        """Whether it serves at y (n,)."""
        return bool(np.abs(self._shares(y)).max() <= INSIDE)

    def moved(self, y: Array) -> Array:
        """∫ G dy from the centre, (nv,)."""
        return self._sums(y, 1)[0, 0]

    def rates_at(self, y: Array, u: Array) -> MapRates:
        """The map's rates at y (n,) and u (n,)."""
        sums, by, n = self._sums(y, 4), self.inverse, len(u)
        # an entry by how many of its indices are the second share
        first = np.array([sums[1 - i, i] for i in range(n)])
        second = np.array([[sums[2 - i - j, i + j] for j in range(n)] for i in range(n)])
        third = np.array(
            [[[sums[3 - i - j - k, i + j + k] for k in range(n)] for j in range(n)] for i in range(n)]
        )
        G = np.einsum("iv,ia->va", first, by)
        bend = np.einsum("ijv,ia,jb->avb", second, by, by)
        V_y = np.einsum("avb,a->vb", bend, u)
        w = by @ u
        A_y = np.einsum("ijkv,ia,j,k->va", third, by, w, w)
        return MapRates(G, V_y @ u, bend, V_y, A_y, 2.0 * V_y)  # ∂g/∂u = ∂Γ[u, u]/∂u = 2 Γ[u, ·]

    @cached_property
    def inverse(self) -> Array:
        """Shares by changes of y, (n, n)."""
        return np.asarray(np.linalg.inv(self.ways))

    def _shares(self, y: Array) -> Array:
        return np.asarray(self.inverse @ (y - self.center))

    def _sums(self, y: Array, orders: int) -> Array:
        """Γ and its derivatives up to an order by each share, (orders, orders, nv)."""
        shares = [*self._shares(y).tolist(), 0.0]
        powers = [_powers(z, n, orders) for z, n in zip(shares, self.terms.shape[:2], strict=False)]
        return np.einsum("aj,bk,jkv->abv", *powers, self.terms)


def _powers(z: float, count: int, orders: int) -> Array:
    """The derivatives of z⁰, z¹, … of order 0, 1, …, (orders, count)."""
    found = np.zeros((orders, count))
    found[0] = z ** np.arange(count)
    for order in range(1, orders):
        found[order, 1:] = np.arange(1, count) * found[order - 1, :-1]
    return found


Circles = dict[int, list[Around]]
"""Those that were made, by cluster."""


def circles_of(mechanism: Mechanism) -> Circles:
    """Those that a mechanism's derivatives have in common, whatever the modes."""
    made: Circles = mechanism.memo.once("circles around singular places", dict)
    return made
