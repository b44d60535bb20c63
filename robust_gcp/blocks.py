"""Factorisation of the scaled K_d, one small block per loop where the structure allows it."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from .partition import Block
from .tree import Array


class BlockFactor:
    """LU of a block lower triangular matrix, with the sign and the conditioning of each block.

    Parameters
    ----------
    blocks : sequence of Block
        In the order of substitution.

    Attributes
    ----------
    det : ndarray (nblocks,)
        Determinant of each dimensionless block; changes sign where the block becomes singular.
    rcond : ndarray (nblocks,)
        σ_min/σ_max of each block (blocks up to 2 × 2), or LAPACK's estimate of the reciprocal
        condition number relative to `reference`: 0 at a singular configuration, near 1 far away.
    reference : ndarray (nblocks,)
        Reciprocal condition number of a large block at generic configurations; a block of many
        joints is never conditioned as well as one of two. Set by the owner, 1 until then.
    """

    def __init__(self, blocks: Sequence[Block]) -> None:
        self.blocks = tuple(blocks)
        self.det: Array = np.ones(len(blocks))
        self.rcond: Array = np.ones(len(blocks))
        self.reference: Array = np.ones(len(blocks))
        self._whole = len(blocks) == 1
        self._factors: list[tuple[Array, NDArray[np.int32] | None]] = []
        self._A: Array = np.zeros((0, 0))
        self._grids = [np.ix_(b.rows, b.columns) for b in blocks]
        seen: list[int] = []
        self._before: list[NDArray[np.int64]] = []
        for b in blocks:
            self._before.append(np.array(seen, dtype=np.int64))
            seen += b.columns.tolist()

    def couple(self, pattern: NDArray[np.bool_]) -> None:
        """Keep, for each block, only the earlier columns that its rows can see in `pattern` (n, n)."""
        self._before = [
            before[np.any(pattern[np.ix_(block.rows, before)], axis=0)]
            for block, before in zip(self.blocks, self._before, strict=True)
        ]

    def factor(self, A: Array) -> None:
        """Factorise A (n, n), which is not changed and not copied: it must stay until the last solve."""
        self._A = A
        if self._whole:
            self._factors = [self._factor_block(0, A)]
        else:
            self._factors = [self._factor_block(i, A[grid]) for i, grid in enumerate(self._grids)]

    def _factor_block(self, i: int, piece: Array) -> tuple[Array, NDArray[np.int32] | None]:
        """LU and pivots of a block; its inverse, without pivots, up to 2 × 2."""
        if len(piece) == 1:
            det = float(piece[0, 0])
            self.det[i], self.rcond[i] = det, min(abs(det), 1.0)
            return np.array([[1.0 / det if det else np.nan]]), None
        if len(piece) == 2:
            (a, b), (c, d) = piece.tolist()
            det = a * d - b * c
            square = a * a + b * b + c * c + d * d
            root = sqrt(max(square * square - 4.0 * det * det, 0.0))
            self.det[i] = det
            self.rcond[i] = 2.0 * abs(det) / (square + root) if square > 0.0 else 0.0
            r = 1.0 / det if det else np.nan
            return np.array([[d * r, -b * r], [-c * r, a * r]]), None
        norm = float(np.abs(piece).sum(axis=0).max())
        lu, pivots, info = dgetrf(piece)
        swaps = int(np.count_nonzero(pivots != np.arange(len(pivots))))
        self.det[i] = float(np.prod(lu.diagonal())) * (-1.0 if swaps % 2 else 1.0)
        regular = info == 0 and np.isfinite(norm)
        self.rcond[i] = min(float(dgecon(lu, norm)[0]) / self.reference[i], 1.0) if regular else 0.0
        return lu, pivots

    def solve(self, B: Array) -> Array:
        """A⁻¹ B for B (n, k); NaN or infinite where a block is exactly singular."""
        if self._whole:
            return self._solve_block(0, B)
        X = np.zeros_like(B)
        for i, (block, before) in enumerate(zip(self.blocks, self._before, strict=True)):
            rhs = B[block.rows]
            if len(before):
                rhs = rhs - self._A[np.ix_(block.rows, before)] @ X[before]
            X[block.columns] = self._solve_block(i, rhs)
        return X

    def _solve_block(self, i: int, B: Array) -> Array:
        piece, pivots = self._factors[i]
        if pivots is None:
            return piece @ B
        solution, info = dgetrs(piece, pivots, B)
        return solution if info == 0 else np.full_like(B, np.nan)
