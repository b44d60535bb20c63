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
    size : int
        Number of rows and columns.

    Attributes
    ----------
    det : ndarray (nblocks,)
        Determinant of each dimensionless block; changes sign where the block becomes singular.
    rcond : ndarray (nblocks,)
        σ_min/σ_max of each block (blocks up to 2 × 2) or LAPACK's estimate of the reciprocal
        condition number: 0 at a singular configuration, 1 far away.
    """

    def __init__(self, blocks: Sequence[Block], size: int) -> None:
        self._size = size
        self.blocks = tuple(blocks)
        self.det: Array = np.ones(len(blocks))
        self.rcond: Array = np.ones(len(blocks))
        self._factors: list[tuple[Array, NDArray[np.int32]]] = []
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
        self._factors = []
        for i, grid in enumerate(self._grids):
            piece = A[grid]
            if len(piece) == 1:
                det = float(piece[0, 0])
                rcond = min(abs(det), 1.0)
            elif len(piece) == 2:
                (a, b), (c, d) = piece.tolist()
                det = a * d - b * c
                square = a * a + b * b + c * c + d * d
                root = sqrt(max(square * square - 4.0 * det * det, 0.0))
                rcond = 2.0 * abs(det) / (square + root) if square > 0.0 else 0.0
            else:
                norm = float(np.abs(piece).sum(axis=0).max())
                lu, pivots, info = dgetrf(piece)
                self._factors.append((lu, pivots))
                diagonal = lu.diagonal()
                swaps = int(np.count_nonzero(pivots != np.arange(len(pivots))))
                det = float(np.prod(diagonal)) * (-1.0 if swaps % 2 else 1.0)
                rcond = float(dgecon(lu, norm)[0]) if info == 0 and np.isfinite(norm) else 0.0
                self.det[i], self.rcond[i] = det, rcond
                continue
            self._factors.append((piece, _NO_PIVOTS))
            self.det[i], self.rcond[i] = det, rcond

    def solve(self, B: Array) -> Array:
        """A⁻¹ B for B (n, k); infinite or NaN where a block is exactly singular."""
        if len(self.blocks) == 1 and len(self.blocks[0].rows) == self._size:
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
        if len(piece) == 1:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.divide(B, piece[0, 0])
        if len(piece) == 2:
            (a, b), (c, d) = piece.tolist()
            with np.errstate(divide="ignore", invalid="ignore"):
                top = np.divide(d * B[0] - b * B[1], self.det[i])
                bottom = np.divide(a * B[1] - c * B[0], self.det[i])
            return np.stack((top, bottom))
        solution, info = dgetrs(piece, pivots, B)
        if info != 0:
            return np.full_like(B, np.nan)
        return solution


_NO_PIVOTS = np.zeros(0, dtype=np.int32)
