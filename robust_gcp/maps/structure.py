"""The diagonal blocks of K_d, and how well they are conditioned at generic configurations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..mechanism.coordinates.partition import Block, triangular_blocks
from ..mechanism.tolerances import STRUCTURAL
from ..mechanism.tree.tree import Array
from .blocks import BlockFactor


def structured(
    jacobian: Callable[[Array], Array], configurations: Sequence[Array], dependent: NDArray[np.int64]
) -> BlockFactor:
    """The factorisation of K_d with its blocks and references.

    Parameters
    ----------
    jacobian : callable (q) -> ndarray (nd, nv)
        K, dimensionless.
    configurations : sequence of ndarray (nq,)
        At which nothing vanishes by accident.
    dependent : ndarray (nd,) of int
    """
    found = [jacobian(q) for q in configurations]
    pattern = np.any([np.abs(K[:, dependent]) > STRUCTURAL for K in found], axis=0)
    every = np.arange(len(dependent))
    blocks = triangular_blocks(pattern)
    if blocks is None:
        blocks = [Block(every, every)]
    factor = BlockFactor(blocks, pattern, dependent)
    seen = []
    for K in found:
        factor.factor(K)
        seen.append(factor.rcond)
    large = np.array([len(block.rows) > 2 for block in blocks])
    # LAPACK's estimate is far below 1 of good blocks too, so its best counts as 1; poor everywhere stays poor
    factor.reference = np.where(large, np.maximum(np.max(seen, axis=0), 1e-6), 1.0)
    return factor


def reference_of_whole(factor: BlockFactor, whole: BlockFactor) -> Array:
    """References of blocks that are parts of others: no more is asked of a part than of the whole."""
    owner = {int(row): b for b, block in enumerate(whole.blocks) for row in block.rows}
    wholes = [whole.reference[owner[int(block.rows[0])]] for block in factor.blocks]
    return np.minimum(factor.reference, wholes)
