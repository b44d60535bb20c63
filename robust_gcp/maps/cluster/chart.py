"""Charts: how well a choice of components parametrises a mode, and the best choice."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array
from .jet import Jet

CHANGE = 0.35
"""Share of the best choice's quality below which a chart is changed between steps."""


def quality(jet: Jet, chosen: NDArray[np.int64]) -> float:
    """σ_min of the chosen rows of an orthonormal tangent basis, against that of the best choice."""
    if jet.space.m == 0:
        return 1.0
    tangent = np.linalg.qr(jet.J / jet.space.balance[:, None])[0]  # else very short links always serve best
    return smallest(tangent, chosen) / smallest(tangent, best(tangent))


def best(tangent: Array) -> NDArray[np.int64]:
    """The components that parametrise a tangent space (nv, m) best: a pivoted QR of its transpose, sorted."""
    _, _, pivots = scipy.linalg.qr(tangent.T, mode="economic", pivoting=True)
    return np.sort(pivots[: tangent.shape[1]]).astype(np.int64)


def smallest(tangent: Array, chosen: NDArray[np.int64]) -> float:
    """σ_min of the chosen rows."""
    if tangent.shape[1] == 1:
        return float(abs(tangent[chosen[0], 0]))
    return float(np.linalg.svd(tangent[chosen], compute_uv=False)[-1])


def apart(T: Array, other: Array) -> float:
    """Sine of the largest angle between two tangent spaces, by their orthonormal bases."""
    return float(np.linalg.norm(other - T @ (T.T @ other), 2))


def turned_over(J: Array, other: Array) -> bool:
    """Whether a step in one chart, from J to another J, led across a fold where y turns back: det(Jᵀ J') < 0.

    Next to it there are two points at each y, nearer to each other than a step is long. Their tangent spaces
    are nearly the same, but J of the other point has the other orientation.
    """
    return bool(np.linalg.det(J.T @ other) < 0.0)
