"""Derivatives of G ẏ and G ÿ + g along a mode: how the explicit map bends.

Along y_j, with u = ẏ held and at u̇ = 0, v = G u and a = g change by

    V_y = −K_d⁻¹ (∂φ̇/∂q G),  A_y = −K_d⁻¹ (∂φ̈/∂q G + ∂φ̈/∂v V_y),  A_u = −K_d⁻¹ (∂φ̈/∂v G)

in the dependent components, and not in the others. ∂G_i/∂y is V_y at v = G_i; Σ u̇_i ∂G_i/∂y comes on top of
A_y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...errors import NotCertifiedError
from ...mechanism.constraint.closure_rates import ClosureRates, Placement
from ...mechanism.constraint.extended_precision import EPS, ExtendedClosures
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.tree.tree import Array

LOST = 1e-4
"""Conditioning of K_d below which rounding leaves the derivatives no nine digits."""

SLOW = 1e-3
"""Speed without units above which what is linear in v is taken from v itself, 1/s."""

MAX_POLISH = 4
"""Newton steps in extended precision; the second one is rounding already."""


@dataclass
class MapRates:
    """How the explicit map of a cluster, or of a mechanism, bends.

    Attributes
    ----------
    G : ndarray (nv, m)
    g : ndarray (nv,)
        At u.
    bend : ndarray (m, nv, m)
        bend[i][:, j] = ∂G_i/∂y_j.
    V_y, A_y, A_u : ndarray (nv, m)
        ∂v/∂y, ∂a/∂y at u̇ = 0, and ∂a/∂u; ∂v/∂u is G.
    """

    G: Array
    g: Array
    bend: Array
    V_y: Array
    A_y: Array
    A_u: Array


class ClusterRates:
    """`MapRates` of one cluster where its K is regular, for real or complex placements.

    Parameters
    ----------
    cluster : LoopCluster
    """

    def __init__(self, cluster: LoopCluster) -> None:
        self.cluster, self.rates = cluster, ClosureRates(cluster.loops)
        self.independent = cluster.chosen
        self.dependent = np.setdiff1d(np.arange(cluster.loops.nv), cluster.chosen)
        self.scale = cluster.loops.column_scale
        self._still = np.zeros(cluster.loops.nv)
        self._extended = ExtendedClosures(self.rates)

    def across(self, place: Placement, G: Array) -> Array:
        """The way in y, of unit length along the mode without units, in which K becomes regular fastest.

        With U and V the singular vectors of the r smallest singular values, V normal to the mode, K becomes
        regular along d as Uᵀ φ''[G d, V] does, the gradient of σ_min for r = 1.
        """
        scale, m = self.scale, len(self.independent)
        unit = G * scale[self.independent]
        length = np.linalg.norm(unit / scale[:, None], axis=0)
        if m == 1:
            return np.asarray(scale[self.independent] / length)
        nd = len(self.dependent)
        U, s, Vt = np.linalg.svd(self.rates.products_at(place, self._still, self._still).x_q * scale)
        r = max(1, int(np.sum(s[:nd] < 2.0 * s[nd - 1] + 1e-6)))  # all that vanish with the smallest
        T = np.linalg.qr(unit / scale[:, None])[0]
        # near the place null vectors of K mix with the mode's own tangents
        beside = Vt[nd - r :].T - T @ (T.T @ Vt[nd - r :].T)
        V = np.linalg.svd(beside)[0][:, :r]
        pairs = np.array(
            [
                U[:, nd - r : nd].T @ self.rates.products_at(place, scale * v, self._still).d_q @ unit
                for v in V.T
            ]
        )  # (r of V, r of U, m)
        rng = np.random.default_rng(7)
        tried = np.vstack([np.eye(m), rng.normal(size=(40, m))])
        ways = tried / np.linalg.norm((unit / scale[:, None]) @ tried.T, axis=0)[:, None]
        clear = [np.linalg.svd(pairs @ way, compute_uv=False)[-1] for way in ways]
        return np.asarray(scale[self.independent] * ways[int(np.argmax(clear))])

    def correction(self, place: Placement) -> tuple[Array, float]:
        """Newton's step of the dependent joints, (nv,), and max |φ| / length."""
        here = self.rates.products_at(place, self._still, self._still)
        return self._solver(here.x_q)(here.x), float(np.abs(here.x).max(initial=0.0))

    def closed(self, q: Array) -> Array:
        """q with its dependent joints closed as well as its own rounding lets them.

        Raises
        ------
        NotCertifiedError
            Where K_d is singular.
        """
        tree, size = self.cluster.loops.tree, np.inf
        for _ in range(MAX_POLISH):
            K = self.rates.products_at(self.rates.real(q), self._still, self._still).x_q
            dv = self._solver(K)(self._extended.residual(q).astype(float))
            before, size = size, float(np.abs(dv / self.scale).max(initial=0.0))
            if not size < 0.5 * before:  # all that is left is the rounding of q itself
                break
            q = tree.integrate(q, dv)
        return q

    def reopened(self, q: Array, rows: Array) -> Array:
        """q where φ would be computed with these errors, dimensionless by rows.

        Raises
        ------
        NotCertifiedError
            Where K_d is singular.
        """
        K = self.rates.products_at(self.rates.real(q), self._still, self._still).x_q
        return self.cluster.loops.tree.integrate(q, self._solver(K)(rows))

    def rates_at(self, place: Placement, u: Array) -> MapRates:
        """The map's rates at a closed placement, (m,) velocities.

        Raises
        ------
        NotCertifiedError
            Where K_d is singular.
        """
        G, solved = self._slope(place)
        return self.along(place, u, G, solved(self.rates.products_at(place, G @ u, self._still).dd))

    def slope(self, place: Placement) -> Array:
        """G at a closed placement.

        Raises
        ------
        NotCertifiedError
            Where K_d is singular.
        """
        return self._slope(place)[0]

    def _slope(self, place: Placement) -> tuple[Array, Callable[[Array], Array]]:
        """G, and `_solver` there."""
        K = self.rates.products_at(place, self._still, self._still).x_q
        solved = self._solver(K)
        G = solved(K[:, self.independent])
        G[self.independent] = np.eye(len(self.independent))
        return G, solved

    def along(self, place: Placement, u: Array, G: Array, g: Array) -> MapRates:
        """The same where G and g are known.

        Raises
        ------
        NotCertifiedError
            Where K_d is singular.
        """
        rates, still = self.rates, self._still
        here = rates.products_at(place, G @ u, g)
        solved = self._solver(here.x_q)
        if len(u) == 1 and abs(u[0]) > SLOW * self.scale[self.independent[0]]:
            bend = solved(here.d_q @ G)[None] / u[0]  # it is linear in v
        else:
            bend = np.array([solved(rates.products_at(place, column, still).d_q @ G) for column in G.T])
        V_y = np.einsum("i,inj->nj", u, bend)
        A_y = solved(here.dd_q @ G + here.dd_v @ V_y)
        return MapRates(G, g, bend, V_y, A_y, solved(here.dd_v @ G))

    def _solver(self, K: Array) -> Callable[[Array], Array]:
        """[0; −K_d⁻¹ rows] of rows, in the least-squares sense over redundant ones."""
        scale, nv = self.scale[self.dependent], len(self._still)
        # complex on circles; and no normal equations, which would square the conditioning
        Q, R = np.linalg.qr(K[:, self.dependent] * scale)
        size = np.abs(np.diag(R))
        if size.min(initial=1.0) < LOST * size.max(initial=1.0):
            raise NotCertifiedError(
                "derivatives: K_d is singular here, so the independent joints do not determine the motion"
            )

        def solved(rows: Array) -> Array:
            found = np.zeros((nv, *rows.shape[1:]), rows.dtype)
            found[self.dependent] = -(scale * np.linalg.solve(R, Q.conj().T @ rows).T).T
            return found

        return solved


ROUNDINGS, DOUBLE = 8.0, float(np.finfo(float).eps)
"""How many roundings q and φ are taken to be off by, and their size in q; `extended_precision.EPS` in φ."""

SAMPLES = 4
"""Ways of rounding that are tried."""


def rounding(rates: ClusterRates, q: Array) -> tuple[Array, float]:
    """q closed anew, and how much G and its two derivatives change there, without units.

    Where q, and what φ was when q was closed, are rounded otherwise.
    """
    scale, tree = rates.scale, rates.cluster.loops.tree
    unit = scale[rates.independent]

    def parts(at: Array) -> Array:
        found = rates.rates_at(rates.rates.real(at), unit)
        return np.array((found.G, *found.bend, found.A_y)) / scale[:, None] * unit

    try:
        q = rates.closed(q)
        here, change = parts(q), 0.0
        for seed in range(1, SAMPLES + 1):
            # φ and q are off by independent roundings: the first moves q along the dependent joints by 1/σ
            sign = np.random.default_rng(seed).choice([-1.0, 1.0], len(scale) + rates.cluster.loops.nc)
            moved = rates.reopened(q, ROUNDINGS * EPS * sign[len(scale) :])
            moved = tree.integrate(moved, ROUNDINGS * DOUBLE * sign[: len(scale)] * scale)
            off = np.abs(here - parts(moved)) / (1.0 + np.abs(here))
            change = max(change, float(off.max()))
    except NotCertifiedError:
        return q, np.inf
    return q, change
