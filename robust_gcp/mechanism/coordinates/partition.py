"""The split into independent and dependent joints: which rows, which blocks, which joints can serve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from itertools import combinations
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

from ..tolerances import DETERMINES
from ..tree.joints import Array, Index

MAX_ENUMERATED = 2000
"""Sets of joints examined one by one before a rank-revealing choice takes over (a few ms)."""

TIE = 1e-9
"""Share by which a joint is preferred to the next one: above rounding, below any difference that matters."""


@dataclass(frozen=True)
class Block:
    """A square diagonal block of the permuted K_d: these dependent joints close these rows.

    Attributes
    ----------
    rows, columns : ndarray of int
        Positions in the selected rows of K and among the dependent joints.
    """

    rows: Index
    columns: Index


def triangular_blocks(pattern: NDArray[np.bool_]) -> list[Block] | None:
    """Order a square K_d by its zero pattern so that it becomes block lower triangular.

    A perfect matching of rows and columns followed by the strongly connected components of the
    matched graph (Dulmage and Mendelsohn; Duff and Reid, 1978). One block a loop where the
    mechanism's structure allows it.

    Parameters
    ----------
    pattern : ndarray (n, n) of bool
        Entries of K_d that are not structurally zero.

    Returns
    -------
    list of Block or None
        In the order of substitution; None when no matching exists, that is, K_d is structurally
        singular.
    """
    n = len(pattern)
    if n == 0:
        return []
    row_of_column = scipy.sparse.csgraph.maximum_bipartite_matching(
        scipy.sparse.csr_array(pattern), perm_type="row"
    )
    if np.any(row_of_column < 0):
        return None
    matched = pattern[row_of_column]  # with nonzero entries all along the diagonal
    count, label = scipy.sparse.csgraph.connected_components(
        scipy.sparse.csr_array(matched), directed=True, connection="strong"
    )
    order: TopologicalSorter[int] = TopologicalSorter({b: set() for b in range(count)})
    for i, j in zip(*np.nonzero(matched), strict=True):
        if label[i] != label[j]:
            order.add(int(label[i]), int(label[j]))  # row i needs the column j of another block solved before
    blocks = []
    for b in order.static_order():
        columns = np.flatnonzero(label == b)
        blocks.append(Block(np.sort(row_of_column[columns]).astype(np.int64), columns))
    return blocks


def independent_rows(K_d: Array, count: int) -> Index:
    """Positions of `count` rows of K_d that span its row space best (pivoted QR), sorted.

    Parameters
    ----------
    K_d : ndarray (nc, nd)
        Dimensionless (scaled) dependent columns at a generic configuration.
    """
    if K_d.shape[0] == count:
        return np.arange(count)  # none to spare
    _, _, pivots = scipy.linalg.qr(K_d.T, mode="economic", pivoting=True)
    return np.sort(pivots[:count]).astype(np.int64)


def numerical_rank(singular_values: Array, tolerance: float) -> int:
    """How many singular values exceed `tolerance` times the largest; 0 for a zero matrix."""
    if len(singular_values) == 0 or singular_values[0] == 0.0:
        return 0
    return int(np.sum(singular_values > tolerance * singular_values[0]))


def spelled(choices: Sequence[Sequence[str]]) -> str:
    """Sets of joints in words, for a message."""
    return ", or ".join(" + ".join(names) for names in choices) or "none"


def spanning(vectors: Array, count: int) -> list[int]:
    """Which of the rows span most, one after the other by pivoted QR; of equal ones the first.

    Without a preference the last bits of a machine's LAPACK would decide between equal ones, such as the two
    spins of a rod between spherical joints.
    """
    first = 1.0 - TIE * np.arange(len(vectors))  # earlier rows weigh a little more
    pivots = scipy.linalg.qr((vectors * first[:, None]).T, mode="economic", pivoting=True)[2]
    return [int(pivot) for pivot in pivots[:count]]


def ranked_choices(
    kernel: Array, candidates: Index, names: list[str], limit: int = 5, weight: Array | float = 1.0
) -> list[tuple[float, tuple[str, ...]]]:
    """Sets of joints that parametrise the directions `kernel`, best conditioned first.

    A set S serves when the rows N_S of an orthonormal kernel basis N are regular; σ_min(N_S) in
    (0, 1] says how well: the joints in S move at that fraction of the whole motion at least.

    Parameters
    ----------
    kernel : ndarray (nv, m)
        Orthonormal basis of the instantaneous motions.
    candidates : ndarray of int
        Velocity indices that may be chosen, in the order of `names`.
    weight : float or ndarray (len(candidates), 1)
        Of each where there are too many sets to examine one by one.
    """
    m = kernel.shape[1]
    if m == 0 or m > len(candidates):
        return []
    if comb(len(candidates), m) <= MAX_ENUMERATED:
        sets: list[tuple[int, ...]] = list(combinations(range(len(candidates)), m))
    else:
        sets = [tuple(sorted(spanning(weight * kernel[candidates], m)))]
    scored = []
    for chosen in sets:
        quality = float(np.linalg.svd(kernel[candidates[list(chosen)]], compute_uv=False)[-1])
        if quality > DETERMINES:
            # rounded, so that of equal sets the first is taken and not the one that LAPACK's last bits favour
            scored.append((round(quality, 12), tuple(names[i] for i in chosen)))
    scored.sort(key=lambda item: -item[0])
    return scored[:limit]
