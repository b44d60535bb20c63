"""Many small products at once, at a small cost for few."""

from __future__ import annotations

import numpy as np

from .joints import Array


def skew(r: Array) -> Array:
    """The matrix of r ×, (3, 3)."""
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def apply(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector, (n, i, j) and (n, j) to (n, i).

    `matmul` has the smaller overhead, `einsum` the smaller cost per item.
    """
    if len(vectors) <= FEW:
        return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
    return np.asarray(np.einsum("pij,pj->pi", matrices, vectors))


FEW = 16
"""Most products for which `matmul` is the faster."""

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: Array, b: Array) -> Array:
    """a × b over the last axis; `np.cross` costs several times as much on few rows."""
    found: Array = a.take(_NEXT, -1) * b.take(_LAST, -1)
    found -= a.take(_LAST, -1) * b.take(_NEXT, -1)
    return found
