"""Second-order tools: φ'' on the kernel of K, and how clearly a mode leaves a singular point."""

from __future__ import annotations

import numpy as np

from ..mechanism.loops import ClosedLoops
from ..mechanism.partition import numerical_rank
from ..mechanism.tolerances import RANK_BESIDE
from ..mechanism.tree import Array


def second_order_forms(mechanism: ClosedLoops, q: Array, left: Array, kernel: Array) -> list[Array]:
    """Q_u = Nᵀ (uᵀ φ'') N for each column u of `left` (dimensionless rows), (δ, δ) each.

    φ''[v, v] = −k(q, v), and by polarisation φ''[v, w] = −½ (k(v + w) − k(v) − k(w)): no new
    derivatives.
    """
    n = kernel.shape[1]
    square = [second_derivative(mechanism, q, kernel[:, i]) for i in range(n)]
    forms = np.zeros((left.shape[1], n, n))
    for i in range(n):
        forms[:, i, i] = left.T @ square[i]
        for j in range(i):
            mixed = second_derivative(mechanism, q, kernel[:, i] + kernel[:, j])
            forms[:, i, j] = forms[:, j, i] = 0.5 * left.T @ (mixed - square[i] - square[j])
    return list(forms)


def second_derivative(mechanism: ClosedLoops, q: Array, v: Array) -> Array:
    """φ''[v, v] = −k(q, v), dimensionless rows, (nc,)."""
    return -mechanism.k(q, v) / mechanism.row_scale


def transversality(mechanism: ClosedLoops, q: Array, G: Array, rank: int) -> float:
    """How clearly the mode with tangent space G leaves a singular q: 0 tangential, 1 orthogonal.

    Near q* write q = q* ⊕ s w. Then φ/s has the range part K w and, on the left null space U,
    ½ s Q_u(w, w). The mode through w = G is unique and smooth when the derivative of that system,
    the rows K and Q_u(G, ·), has the mechanism's generic rank: a second-order certificate for any
    corank.

    Parameters
    ----------
    rank : int
        Generic rank, nv − m.

    Returns
    -------
    float
        σ_rank/σ_1 of the stacked, row-normalised system.
    """
    K = mechanism.scaled(mechanism.K(q))
    U, s, Vt = full_svd(K)
    here = numerical_rank(s, RANK_BESIDE)
    if here >= rank:
        return 1.0
    tangents = orthonormal(G / mechanism.column_scale[:, None])
    left, kernel = U[:, here:], mechanism.column_scale[:, None] * Vt[here:].T
    rows = []
    for t in (mechanism.column_scale[:, None] * tangents).T:
        plain = second_derivative(mechanism, q, t)
        mixed = np.array(
            [
                0.5 * (second_derivative(mechanism, q, t + n) - plain - second_derivative(mechanism, q, n))
                for n in kernel.T
            ]
        )
        rows.append(left.T @ mixed.T)
    stacked = np.vstack(rows)
    needed = rank - here
    sigma = np.linalg.svd(stacked, compute_uv=False)
    if len(sigma) < needed or sigma[0] == 0.0:
        return 0.0
    return float(sigma[needed - 1] / max(sigma[0], 1.0))


def curvature(mechanism: ClosedLoops, q: Array) -> float:
    """Size of φ'' for single joints: what a second-order form is compared with."""
    sizes = [np.abs(second_derivative(mechanism, q, e)).max(initial=0.0) for e in np.eye(mechanism.nv)]
    return float(max(sizes, default=0.0)) or 1.0


def bending(forms: list[Array], size: float) -> tuple[Array, Array]:
    """Split the left null space by its forms: combinations whose form bends, and those that are flat.

    Redundant rows have flat forms, rows of a singularity bend.

    Parameters
    ----------
    forms : list of ndarray (δ, δ)
        One for each basis vector of the left null space.
    size : float
        Below this a form counts as flat.

    Returns
    -------
    ndarray (c, r), ndarray (c, c − r)
        Coefficients in that basis, orthonormal.
    """
    stacked = np.array([form.ravel() for form in forms])
    U, s, _ = np.linalg.svd(stacked)
    rank = int(np.sum(s > size))
    return U[:, :rank], U[:, rank:]


def full_svd(K: Array) -> tuple[Array, Array, Array]:
    """Full SVD that also serves a K without rows."""
    if K.shape[0] == 0:
        return np.zeros((0, 0)), np.zeros(0), np.eye(K.shape[1])
    U, s, Vt = np.linalg.svd(K)
    return U, s, Vt


def orthonormal(basis: Array) -> Array:
    """Orthonormal columns with the same span."""
    if basis.shape[1] == 0:
        return basis
    Q, _ = np.linalg.qr(basis)
    return np.asarray(Q, dtype=float)
