"""A point of a cluster's mode in a chart: x, its derivatives, and how near K is to singular."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from ...errors import SimulationError
from ...mechanism.memo import Memo
from ...mechanism.tree.tree import Array
from .space import ClusterSpace, Svd

FILTER = 0.6
"""σ_min of the dimensionless K above which no distance to the singular set is computed: it is far."""

CONVERGED = 3e-15
"""Newton's correction at which it stops."""

STAGNANT = 1e-11
"""Correction accepted once it shrinks no more: the rounding of long chains, or of poor conditioning."""

MAX_NEWTON = 12

SINGULAR = 1e-9
"""σ of the dimensionless K at a place that is singular."""


class LostError(SimulationError):
    """Newton left the mode, or there is no point of it there; a smaller step may help."""


@dataclass(frozen=True)
class Jet:
    """A point x on a mode in the chart y = Cᵀ x, with J = dx/dy and Γ = d²x/dy².

    Attributes
    ----------
    space : ClusterSpace
    x : ndarray (nv,)
    C : ndarray (nv, m)
        Any selection, or combination, of components.
    J : ndarray (nv, m)
    bend : ndarray (m, m, nv)
        Γ[i, j] = ∂²x/∂y_i∂y_j.
    P : ndarray (nd, rows)
        Combinations of the rows of φ that determine the dependent velocities hereabouts.
    sigma : float
        Smallest of the nd leading singular values of K · balance; 0 on a bridge.
    svd : Svd or None
        None on a bridge.
    memo : Memo
        What was made of the jet.
    """

    space: ClusterSpace
    x: Array
    C: Array
    J: Array
    bend: Array
    P: Array
    sigma: float = 0.0
    svd: Svd | None = None
    memo: Memo = field(default_factory=Memo, repr=False, compare=False)

    @property
    def y(self) -> Array:
        """Chart coordinates, (m,)."""
        return np.asarray(self.C.T @ self.x)

    @property
    def solved(self) -> bool:
        """Whether the point was solved for, not interpolated."""
        return self.svd is not None

    def recharted(self, C: Array) -> Jet:
        """The same point in another chart: W = (C'ᵀ J)⁻¹, J W, W·W·Γ − J W (C'ᵀ W·W·Γ)."""
        if C is self.C:
            return self
        W = np.linalg.inv(C.T @ self.J)
        J = self.J @ W
        bend = np.einsum("ai,bj,abk->ijk", W, W, self.bend)
        bend = bend - np.einsum("ijk,kl,nl->ijn", bend, C, J)
        return replace(self, C=C, J=J, bend=bend, memo=Memo())

    def predicted(self, step: Array) -> Array:
        """x + J Δ + ½ Γ[Δ, Δ]."""
        return np.asarray(self.x + self.J @ step + 0.5 * np.einsum("i,j,ijn->n", step, step, self.bend))

    def tangent(self) -> Array:
        """Orthonormal basis of the mode's tangent space, (nv, m)."""
        return np.asarray(np.linalg.qr(self.J)[0])

    def roots(self, d: Array) -> Array:
        """First-order places μ along the chart direction d where K loses rank: det(B + μ B') = 0, complex."""
        space = self.space
        B = np.vstack([self.P @ space.K(self.x), self.C.T])
        rate = np.zeros_like(B)
        rate[: space.nd] = self.P @ space.second(self.x, self.J @ d)
        inverse = np.linalg.eigvals(-np.linalg.solve(B, rate))
        return np.asarray(1.0 / inverse[np.abs(inverse) > 1e-3])  # the m rows of Cᵀ have their roots at ∞

    def nearest(self) -> tuple[float, Array]:
        """First-order distance along the mode to the singular set (arc length), and the way in the chart."""
        return self.memo.once("nearest", self._nearest)

    def ambient(self) -> tuple[float, Array]:
        """First-order distance to where K loses rank on or off the mode, and the shortest way dx there.

        uᵀ (K + φ''[dx]) w = 0 for w in {v_min, tangents}, least norm: near misses are seen by it.
        """
        return self.memo.once("ambient", self._ambient)

    def delta(self) -> float:
        """Distance to the singular set, the smaller of both; infinite where K is far from singular."""
        if self.svd is None or self.space.nd == 0 or self.sigma > FILTER:
            return np.inf
        # where two modes pass each other closest K along either has no root: it is singular between them
        return min(self.nearest()[0], self.ambient()[0])

    def _nearest(self) -> tuple[float, Array]:
        space, svd = self.space, self.svd
        far = np.inf, np.ones(space.m)
        if svd is None or space.nd == 0 or self.sigma > FILTER:
            return far
        if space.m == 1:  # by arc length: where y turns back the mode is not singular
            mu = self.recharted(self.tangent()).roots(np.ones(1))
            return (float(np.abs(mu).min()), np.ones(1)) if len(mu) else far
        u, v = svd.U[:, space.nd - 1], space.balance * svd.Vt[space.nd - 1]
        gradient = (u @ space.second(self.x, v)) @ self.J  # of σ_min by y
        way = np.linalg.solve(self.J.T @ self.J, gradient)  # steepest by arc length
        rate = float(np.sqrt(max(float(gradient @ way), 0.0)))
        return (self.sigma / rate, way / rate) if rate > 0.0 else far

    def _ambient(self) -> tuple[float, Array]:
        space, svd = self.space, self.svd
        if svd is None or space.nd == 0:
            return np.inf, np.zeros(space.nv)
        u = svd.U[:, space.nd - 1]
        # v_min and the tangents: uᵀ K must vanish on all of them, on the modes' common tangent space
        rows = np.array([u @ space.second(self.x, w) for w in space.balance * svd.Vt[space.nd - 1 :]])
        target = np.zeros(len(rows))
        target[0] = -svd.s[space.nd - 1]
        dx = np.linalg.lstsq(rows, target, rcond=1e-8)[0]
        return float(np.linalg.norm(dx)), dx


def jet(space: ClusterSpace, x: Array, C: Array) -> Jet:
    """The jet at a closed x where K is regular: B = [P K; Cᵀ], J = B⁻¹ [0; I], Γ = −B⁻¹ [P φ''[J, J]; 0]."""
    nd, m = space.nd, space.m
    U, s, Vt = svd = space.factors(x)
    P = U[:, :nd].T
    B = np.vstack([s[:nd, None] * Vt[:nd], C.T * space.balance])
    inverse = space.balance[:, None] * np.linalg.inv(B)
    J = inverse[:, nd:]
    bend = np.zeros((m, m, space.nv))
    for i in range(m):
        rate = P @ space.second(x, J[:, i])
        bend[i] = -(inverse[:, :nd] @ (rate @ J)).T
    bend = 0.5 * (bend + bend.transpose(1, 0, 2))  # φ'' is symmetric, its rounding divided by σ is not
    sigma = float(s[nd - 1]) if nd else np.inf
    return Jet(space, x, C, J, bend, P, sigma, svd)


def solve(space: ClusterSpace, x: Array, C: Array, y: Array, P: Array) -> tuple[Array, float]:
    """Newton on P φ = 0, Cᵀ x = y from the guess x; also the size of the first correction.

    Raises
    ------
    LostError
        When it does not converge.
    """
    first, last, size = np.inf, np.inf, np.inf
    for iteration in range(MAX_NEWTON):
        phi, K = space.linear(x)
        B = np.vstack([P @ K, C.T])
        try:
            dx = np.linalg.solve(B, np.concatenate([P @ phi, C.T @ x - y]))
        except np.linalg.LinAlgError as singular:
            raise LostError("K is singular on the way") from singular
        x = x - dx
        if iteration == 0:
            first = float(np.abs(dx).max(initial=0.0))  # in x, as the steps of continuation are
        size = float(np.abs(dx / space.balance).max(initial=0.0))  # rounding of φ turns short links far
        if not size < 1e3:  # NaN too
            break
        if size < CONVERGED or (size < STAGNANT and size > 0.3 * last):
            return x, first
        last = size
    if size < 1e-9:
        return x, first
    raise LostError("Newton does not converge")


def solved(space: ClusterSpace, guess: Array, C: Array, y: Array, P: Array) -> tuple[Jet, float]:
    """`solve` and the jet there."""
    x, first = solve(space, guess, C, y, P)
    return jet(space, x, C), first


def nearest_of(mu: Array) -> complex:
    """The nearest of some places along a way; infinite where there is none."""
    return complex(mu[np.argmin(np.abs(mu))]) if len(mu) else complex(np.inf)


def pencil_roots(space: ClusterSpace, P: Array, x: Array, way: Array, C: Array) -> Array:
    """Places μ along `way` (dx/ds) from x where [P K; Cᵀ] loses rank, complex: B v = −μ B' v by QZ.

    At a transversal singularity of any corank the root is semisimple, so it is found to rounding.
    """
    B, rate = _pencil(space, P, x, way, C)
    # not B⁻¹ B': at the place that is looked for B is singular itself
    alpha, beta = scipy.linalg.eig(B, -rate, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-9 * np.abs(alpha) + 1e-300  # m roots at infinity are the rows of Cᵀ
    return np.asarray(alpha[finite] / beta[finite])


def _pencil(space: ClusterSpace, P: Array, x: Array, way: Array, C: Array) -> tuple[Array, Array]:
    """B and B' along `way`, columns balanced: [P K; Cᵀ] and [P φ''[way]; 0]."""
    chart = C.T * space.balance
    chart = chart / np.maximum(1.0, np.linalg.norm(chart, axis=1))[:, None]  # σ are compared with those of K
    B = np.vstack([(P @ space.K(x)) * space.balance, chart])
    rate = np.zeros_like(B)
    rate[: space.nd] = (P @ space.second(x, way)) * space.balance
    return B, rate


def is_singular(space: ClusterSpace, x: Array) -> bool:
    """Whether K itself loses rank at x: combinations P of redundant rows may do so where K does not."""
    return space.rows == space.nd or bool(space.factors(x)[1][space.nd - 1] < SINGULAR)


def null_pairing(space: ClusterSpace, P: Array, x: Array, way: Array, C: Array) -> tuple[int, float]:
    """Corank of [P K; Cᵀ] at x, and the transversality of the mode with tangent `way` there.

    U_rᵀ B' V_r on the r null vectors is regular where the modes part at second order; returned is its
    smallest singular value against |φ''| and |way|; 1 where nothing is singular.
    """
    B, rate = _pencil(space, P, x, way, C)
    U, s, Vt = np.linalg.svd(B)
    r = int(np.sum(s < 1e-6))  # at a place that was found they are 1e-16, the others of order 1
    if r == 0:
        return 0, 1.0
    pairing = U[:, -r:].T @ rate @ Vt[-r:].T
    smallest = np.linalg.svd(pairing, compute_uv=False)[-1]
    return r, float(smallest / (space.phi_size * np.linalg.norm(way)))


def own_separation(
    space: ClusterSpace, P: Array, x: Array, way: Array, C: Array, beside: Sequence[tuple[Array, float]]
) -> float:
    """Transversality at a singular x of a mode, against the second-order form there instead of all of φ''.

    Between links of very different lengths the form that parts the modes is small, and parts them well. It
    counts if σ_min of [P K; Cᵀ] grows along the mode as the form says it does.

    Parameters
    ----------
    beside : sequence of (ndarray (nv,), float)
        Other points of the mode, and by how much the parameter of `way` differs there.
    """
    B, rate = _pencil(space, P, x, way, C)
    U, s, Vt = np.linalg.svd(B)
    r = max(1, int(np.sum(s < 1e-6)))
    left, V = U[: space.nd, -r:], Vt[-r:] * space.balance
    pairing = U[:, -r:].T @ rate @ Vt[-r:].T
    smallest = float(np.linalg.svd(pairing, compute_uv=False)[-1])
    # a small form may be rounding of a zero one; then σ grows by the next order, and not by this rate
    for near, distance in beside:
        grown = np.linalg.svd(_pencil(space, P, near, way, C)[0], compute_uv=False)[-1]
        if not 0.3 * grown < smallest * abs(distance) < 3.0 * grown:
            return 0.0
    form = max(float(np.abs(left.T @ P @ space.second(x, v) @ V.T).max()) for v in V)
    length = float(np.linalg.norm(way / space.balance))
    return smallest / max(form * length, float(np.abs(pairing).max()))


def places_ahead(anchor: Jet, within: float, together: float) -> tuple[float, float] | None:
    """First-order range of the singular places on the nearer side of an anchor of mobility 1; None without.

    Parameters
    ----------
    within : float
        Farther ones are left out.
    together : float
        Those farther than this behind the nearest one are left out too.
    """
    mu = anchor.roots(np.ones(1))  # complex ones too: of modes that veer by a gap which may be bridged
    mu = mu[np.abs(mu) < within]
    if not len(mu):
        return None
    nearest = nearest_of(mu).real
    near = np.abs(mu) < abs(nearest) + together
    side = mu.real[near & (mu.real * nearest > 0.0)]
    return (float(side.min()), float(side.max())) if len(side) else None
