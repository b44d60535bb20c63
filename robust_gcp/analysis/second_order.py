"""Second-order tools: φ'' on the kernel of K, and the left null space split by its forms."""

from __future__ import annotations

import numpy as np

from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.tree import Array


def second_order_forms(mechanism: ClosedLoops, q: Array, left: Array, kernel: Array) -> list[Array]:
    """Q_u = Nᵀ (uᵀ φ'') N for each column u of `left` (dimensionless rows), (δ, δ) each.

    φ''[v, w] = K̇ w, K̇ along v; of joints that turn in space its symmetric part, as velocities of theirs
    do not commute.
    """
    rows, n = left.T / mechanism.row_scale, kernel.shape[1]
    along = np.reshape([rows @ mechanism.K_rate(q, v) @ kernel for v in kernel.T], (n, len(rows), n))
    return [0.5 * (form + form.T) for form in along.transpose(1, 0, 2)]


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
    # independent forms differ along random directions, almost surely; each costs one k instead of δ K̇
    ways = np.random.default_rng(4).normal(size=(directions, kernel.shape[1])) @ kernel.T
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    seen = left.T @ np.array([second_derivative(mechanism, q, way) for way in ways]).T
    return int(np.sum(np.linalg.svd(seen, compute_uv=False) > size))
