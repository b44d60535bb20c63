"""What ends a batch of steps: bounds of sums of joints, coordinates that others may better, safe ground.

A cheap test says after a step whether it is to be looked at closely: what is bounded is out of bounds, or
turned within the step so near to one that it may have been. It is the same in guard.h.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array
from ..structures import Arrays, Guarded


class Watch(NamedTuple):
    """Up to where steps go on in the same coordinates; see `simulation/runs/coordinates.py`.

    Attributes
    ----------
    sizes : ndarray (nv,)
        1 / unit of each velocity in its cluster's dimensionless coordinates; 0 where J does not matter.
    limit : float
        Largest entry of J.
    uneven : ndarray (m,)
        Largest unevenness, max |g| / (max |v|)² in radians and lengths, of the cluster of each input.
    """

    sizes: Array
    limit: float
    uneven: Array


class ErrorControl(NamedTuple):
    """That steps are taken with error control, by DOP853, up to a well-conditioned output.

    Attributes
    ----------
    rtol, atol : float
    safe_from : int
        Number of the first output of the batch that may be that one.
    """

    rtol: float
    atol: float
    safe_from: int


@functools.cache
def dop853() -> Array:
    """SciPy's DOP853: a below the diagonal row by row, b, c, and the weights of its two estimates."""
    from scipy.integrate import DOP853  # takes as long to load as many runs

    rows = [DOP853.A[s, :s] for s in range(1, len(DOP853.B))]
    # the weights left out are of the derivative at the step's end, and zero
    return np.concatenate([*rows, DOP853.B, DOP853.C, DOP853.E3[:-1], DOP853.E5[:-1]])


REACH = 8.0
"""Steps at the largest rate of one that turns within it, which it goes no further than beyond its end."""


@dataclass(frozen=True)
class Bounds:
    """lower < r < upper, or lower < ṙ < upper: numbers of joints in q and in v, and their weights in r."""

    in_q: tuple[int, ...]
    in_v: tuple[int, ...]
    weights: tuple[float, ...]
    of_rate: bool
    lower: float
    upper: float


class Guard:
    """What is to stay within bounds.

    Parameters
    ----------
    bounds : sequence of Bounds
        Those of the same sum are put together.

    Attributes
    ----------
    structure : Arrays
        The same for the kernel.
    """

    def __init__(self, bounds: Sequence[Bounds]) -> None:
        whole: dict[tuple[object, ...], Bounds] = {}
        # values before rates, as the kernel counts
        for each in sorted(bounds, key=lambda each: each.of_rate):
            key = each.in_v, each.weights, each.of_rate
            old = whole.get(key, each)
            lower, upper = max(old.lower, each.lower), min(old.upper, each.upper)
            whole[key] = Bounds(each.in_q, each.in_v, each.weights, each.of_rate, lower, upper)
        rows = list(whole.values())
        self._rates = np.array([row.of_rate for row in rows], dtype=bool)
        self._lower, self._upper = (
            np.array([getattr(row, end) for row in rows]) for end in ("lower", "upper")
        )
        self._begin = np.cumsum([0, *(len(row.weights) for row in rows)])
        self._in_q = np.array([i for row in rows for i in row.in_q], dtype=np.int64)
        self._in_v = np.array([i for row in rows for i in row.in_v], dtype=np.int64)
        self._weights = np.array([x for row in rows for x in row.weights])
        structure = Guarded(values=int(np.sum(~self._rates)), rates=int(np.sum(self._rates)))
        self.structure = Arrays(structure)
        self.structure.integers(begin=self._begin, in_q=self._in_q, in_v=self._in_v)
        self.structure.reals(weight=self._weights, lower=self._lower, upper=self._upper)

    def met(self, h: float, v0: Array, a0: Array, q: Array, v: Array, a: Array) -> bool:
        """Whether a step of length h from a motion (v0, a0) to q, v, a is to be looked at."""
        if not len(self._lower):
            return False
        rates, begin = self._rates, self._begin[:-1]

        def sums(x: Array, at: NDArray[np.int64]) -> Array:
            return np.asarray(np.add.reduceat(self._weights * x[at], begin))

        r, r1, r2 = sums(q, self._in_q), sums(v, self._in_v), sums(a, self._in_v)
        value = np.where(rates, r1, r)
        was = np.where(rates, sums(a0, self._in_v), sums(v0, self._in_v))
        now = np.where(rates, r2, r1)
        near = np.minimum(value - self._lower, self._upper - value)
        turned = (was * now < 0.0) & (near <= REACH * h * np.maximum(np.abs(was), np.abs(now)))
        return bool(np.any(~(near > 0.0) | turned))  # NaN is to be looked at too
