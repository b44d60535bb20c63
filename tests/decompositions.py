"""Decompositions as another LAPACK might give them: other signs, other bases where these are free."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME = 1e-13
"""Relative difference of singular values, or eigenvalues, whose vectors are turned into each other."""


def groups(values: Array, apart: float) -> Iterator[slice]:
    """Runs of equal values."""
    begin = 0
    for i in range(1, len(values) + 1):
        if i == len(values) or abs(values[i] - values[begin]) > apart:
            yield slice(begin, i)
            begin = i


def turn_decompositions(patch: pytest.MonkeyPatch, seed: int) -> None:
    """Let `numpy.linalg.svd` and `eigh` return other bases than they do, each as good."""
    rng, svd, eigh = np.random.default_rng(seed), np.linalg.svd, np.linalg.eigh

    def turn(n: int) -> Array:
        return np.asarray(np.linalg.qr(rng.normal(size=(n, n)))[0])

    def turned_svd(A: Any, *args: Any, **options: Any) -> Any:
        found = svd(A, *args, **options)
        if isinstance(found, np.ndarray) or np.ndim(A) > 2 or not np.all(np.isfinite(A)):
            return found
        U, s, Vt = (part.copy() for part in found)
        least = SAME * float(s[0]) if len(s) else 0.0
        rank = int(np.sum(s > 10.0 * least))
        for run in groups(s[:rank], least):
            R = turn(run.stop - run.start)
            U[:, run], Vt[run] = U[:, run] @ R, R.T @ Vt[run]
        U[:, rank:] = U[:, rank:] @ turn(U.shape[1] - rank)
        Vt[rank:] = turn(len(Vt) - rank) @ Vt[rank:]
        return U, s, Vt

    def turned_eigh(A: Any, *args: Any, **options: Any) -> Any:
        values, vectors = eigh(A, *args, **options)
        vectors = vectors.copy()
        for run in groups(values, SAME * float(np.abs(values).max(initial=0.0))):
            vectors[:, run] = vectors[:, run] @ turn(run.stop - run.start)
        return values, vectors

    patch.setattr(np.linalg, "svd", turned_svd)
    patch.setattr(np.linalg, "eigh", turned_eigh)
