"""Factorisation of the scaled K_d, and the sign and conditioning of its diagonal blocks."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from math import sqrt

import numpy as np
import scipy
from numpy.typing import NDArray

from ..mechanism.coordinates.partition import Block
from ..mechanism.tree.tree import Array

Index = NDArray[np.int64]

NARROW = 4
"""A band this many times narrower than the matrix is factorised as a band."""


class BlockFactor:
    """LU of a block lower triangular matrix, with the sign and the conditioning of each block.

    Ordered by blocks, the K_d of loops in a row is a narrow band, and its LU costs linear time.

    Parameters
    ----------
    blocks : sequence of Block
        In the order of substitution.
    pattern : ndarray (n, n) of bool
        Entries that are not structurally zero.
    dependent : ndarray (n,) of int
        Columns of K that make up the matrix K_d.

    Attributes
    ----------
    det : ndarray (nblocks,)
        Determinant of each dimensionless block; changes sign where the block becomes singular.
    rcond : ndarray (nblocks,)
        σ_min/σ_max of each block (blocks up to 2 × 2), or LAPACK's estimate of the reciprocal
        condition number relative to `reference`: 0 at a singular configuration, near 1 far away.
    worst : float
        Smallest rcond.
    reference : ndarray (nblocks,)
        Reciprocal condition number of a large block at generic configurations; a block of many
        joints is never conditioned as well as one of two. Set by the owner, 1 until then.
    """

    def __init__(self, blocks: Sequence[Block], pattern: NDArray[np.bool_], dependent: Index) -> None:
        self.blocks = tuple(blocks)
        n, count = len(pattern), len(blocks)
        self.det: Array = np.ones(count)
        self.rcond: Array = np.ones(count)
        self.worst = 1.0
        self.reference: Array = np.ones(count)
        self._n = n
        self._pair = count == 1 and n == 2
        rows = np.concatenate([b.rows for b in blocks]) if blocks else np.zeros(0, dtype=np.int64)
        columns = np.concatenate([b.columns for b in blocks]) if blocks else rows
        self._rows, self._order, self._dependent = rows, np.ix_(rows, columns), dependent
        self._into = np.argsort(columns)
        self._layout_band(pattern[self._order])
        sizes = np.array([len(b.rows) for b in blocks])
        self._small = np.flatnonzero(sizes <= 2)
        self._large = [(i, np.ix_(b.rows, b.columns)) for i, b in enumerate(blocks) if len(b.rows) > 2]
        ends = np.array([(b.rows[[0, 0, -1, -1]], b.columns[[0, -1, 0, -1]]) for b in blocks], dtype=np.int64)
        self._corners = tuple(ends.reshape(-1, 2, 4)[self._small].transpose(1, 2, 0))
        self._single = sizes[self._small] == 1

    def fresh(self) -> BlockFactor:
        """Another one of the same structure, which shares nothing that is written to."""
        other = copy(self)
        other._band = self._band.copy()
        return other

    def _layout_band(self, ordered: NDArray[np.bool_]) -> None:
        """Where the entries of the ordered matrix go in LAPACK's band storage."""
        i, j = np.nonzero(ordered)
        self._kl = int((i - j).max(initial=0))
        self._ku = int((j - i).max(initial=0))
        self._banded = NARROW * (2 * self._kl + self._ku + 1) <= self._n
        height = 2 * self._kl + self._ku + 1  # row exchanges fill kl more diagonals
        self._band = np.zeros((height, self._n), order="F")
        self._band_from, self._band_at = (i, j), (self._kl + self._ku + i - j, j)

    def factor(self, K: Array) -> None:
        """Factorise the dependent columns of K (n, nv)."""
        K_d = K[:, self._dependent]
        if self._pair:
            self._factor_pair(K_d)
            return
        ordered = K_d[self._order]
        if self._banded:
            self._band[self._band_at] = ordered[self._band_from]
            self._lu, self._pivots, self._info = scipy.linalg.lapack.dgbtrf(self._band, self._kl, self._ku)
        else:
            self._lu, self._pivots, self._info = scipy.linalg.lapack.dgetrf(ordered)
        self._measure(K_d)

    def _factor_pair(self, K_d: Array) -> None:
        """A single 2 × 2 block in plain floats: its inverse, determinant and σ_min/σ_max."""
        a, b, c, d = K_d.ravel().tolist()
        det = a * d - b * c
        square = a * a + b * b + c * c + d * d
        root = sqrt(max(square * square - 4.0 * det * det, 0.0))  # σ₁² + σ₂² = square, σ₁ σ₂ = |det|
        self.worst = 2.0 * abs(det) / (square + root) if square > 0.0 else 0.0
        self.det, self.rcond = np.array([det]), np.array([self.worst])
        r = 1.0 / det if det else np.nan  # not finite, as LAPACK's: whoever asks looks
        self._inverse = np.array([[d * r, -b * r], [-c * r, a * r]])

    def _measure(self, K_d: Array) -> None:
        det, rcond = np.empty(len(self.blocks)), np.empty(len(self.blocks))
        if len(self._small):
            a, b, c, d = K_d[self._corners]
            small = np.where(self._single, a, a * d - b * c)
            square = a * a + b * b + c * c + d * d
            root = np.sqrt(np.maximum(square * square - 4.0 * small * small, 0.0))
            size = np.abs(small)
            det[self._small] = small
            rcond[self._small] = np.where(
                self._single, np.minimum(size, 1.0), 2.0 * size / np.maximum(square + root, 1e-300)
            )
        for i, grid in self._large:
            piece = K_d[grid]
            norm = float(np.abs(piece).sum(axis=0).max())
            lu, pivots, info = scipy.linalg.lapack.dgetrf(piece)
            swaps = int(np.count_nonzero(pivots != np.arange(len(pivots))))  # a factor of −1 each
            det[i] = float(np.prod(lu.diagonal())) * (-1.0 if swaps % 2 else 1.0)
            regular = info == 0 and np.isfinite(norm)
            estimate = float(scipy.linalg.lapack.dgecon(lu, norm)[0]) if regular else 0.0
            rcond[i] = min(estimate / self.reference[i], 1.0)
        self.det, self.rcond = det, rcond
        self.worst = float(rcond.min(initial=1.0))

    def solve(self, B: Array) -> Array:
        """A⁻¹ B for B (n,) or (n, k); NaN or infinite where a block is exactly singular."""
        if self._pair:
            return self._inverse @ B
        if self._info > 0:
            return np.full_like(B, np.nan)
        if B.ndim == 1:
            return self._solve_one(B)
        # one at a time: for several right-hand sides BLAS wakes its threads, at 100 times the cost
        return np.stack([self._solve_one(column) for column in B.T], axis=1)

    def _solve_one(self, b: Array) -> Array:
        if self._banded:
            x, _ = scipy.linalg.lapack.dgbtrs(self._lu, self._kl, self._ku, b[self._rows], self._pivots)
        else:
            x, _ = scipy.linalg.lapack.dgetrs(self._lu, self._pivots, b[self._rows])
        return np.asarray(x[self._into])
