"""Second-order tools: φ'' on the kernel of K, and the left null space split by its forms."""

from __future__ import annotations

import numpy as np

from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.tree import Array


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


def bending_along(
    mechanism: ClosedLoops, q: Array, left: Array, kernel: Array, directions: int, size: float
) -> int:
    """How many combinations of the columns of `left` have forms that bend, seen in random directions."""
    ways = np.random.default_rng(4).normal(size=(directions, kernel.shape[1])) @ kernel.T
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    seen = left.T @ np.array([second_derivative(mechanism, q, way) for way in ways]).T
    return int(np.sum(np.linalg.svd(seen, compute_uv=False) > size))


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
