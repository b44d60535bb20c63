"""The singular place itself, found in all joints at once, and what it says: crossing, near miss or cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...mechanism.tree.tree import Array
from .jet import Jet

FOUND = 1e-9
"""Newton's step from which it has converged."""

CONE = 0.02
"""|λ₃/λ₁| of the form Q beyond which it has more than two directions: an isolated cone or point."""


@dataclass(frozen=True)
class Place:
    """The nearest configuration at which K loses rank, on the mode or beside it.

    Attributes
    ----------
    x : ndarray (nv,)
    gap : float
        |uᵀ φ| there, in lengths: how far the loops are from closing at the singular configuration.
    eigenvalues : ndarray (m + 1,)
        Of Q = Nᵀ (uᵀ φ'') N, largest magnitude first.
    correction : float
        Newton's last step.
    """

    x: Array
    gap: float
    eigenvalues: Array
    correction: float

    @property
    def found(self) -> bool:
        """Whether Newton converged."""
        return self.correction < FOUND

    @property
    def is_cone(self) -> bool:
        """Whether Q bends in three directions or more: modes do not cross there, they meet in a point."""
        size = np.abs(self.eigenvalues)
        return self.found and len(size) > 2 and bool(size[2] > CONE * size[0])

    @property
    def approach(self) -> float:
        """Closest approach of veering modes, ρ = √(2 gap/|λ|)."""
        return float(np.sqrt(2.0 * self.gap / max(float(np.abs(self.eigenvalues[0])), 1e-300)))


def place(near: Jet) -> Place:
    """The singular place next to a solved point, found once."""
    return near.memo.once("place", lambda: _found(near))


def _found(near: Jet, iterations: int = 15) -> Place:
    """Newton from the point on U₁ᵀ φ = 0 (rank − 1 rows) and uᵀ K N = 0, N the last m + 1 right vectors.

    Square where the place is isolated, least norm along a surface of such places.
    """
    space, x = near.space, near.x
    balance = space.balance
    nd, size = space.nd, np.inf
    for _ in range(iterations):
        phi, K = space.linear(x)
        U, s, Vt = np.linalg.svd(K)
        u, N = U[:, nd - 1], Vt[nd - 1 :]
        bending = np.array([u @ space.second(x, w) for w in N])
        residual = np.concatenate([U[:, : nd - 1].T @ phi, N @ (K.T @ u)])
        # how u and N turn is left out: at the place Kᵀ u = 0 and K N = 0
        rows = np.vstack([s[: nd - 1, None] * Vt[: nd - 1], bending]) * balance
        sizes = np.abs(rows).max(axis=1)  # some are small between links of very different lengths
        weights = 1.0 / np.where(sizes > 1e-12, sizes, 1.0)
        # Least norm: along a surface of such places the system does not say where to go.
        dx = -balance * np.linalg.lstsq(weights[:, None] * rows, weights * residual, rcond=1e-6)[0]
        size, before = float(np.linalg.norm(dx)), size
        x = x + dx * min(1.0, 0.5 / size if size > 0.0 else 1.0)  # half a radian at once, no more
        if size < 1e-14 or (size < FOUND and size > 0.1 * before):  # the rest is rounding
            break
    phi, K = space.linear(x)
    U, _, Vt = np.linalg.svd(K)
    u, N = U[:, nd - 1], Vt[nd - 1 :]
    Q = np.array([u @ space.second(x, a) @ N.T for a in N])
    eigenvalues = np.linalg.eigvalsh(0.5 * (Q + Q.T))
    ordered = eigenvalues[np.argsort(-np.abs(eigenvalues))]
    return Place(x, abs(float(u @ phi)), ordered, size)
