"""Chebyshev series of sampled values, and a curve as one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import acos

import numpy as np
import scipy

from ...mechanism.tree import Array


def nodes(n: int) -> Array:
    """Chebyshev nodes, descending."""
    return np.asarray(np.cos(np.pi * (np.arange(n) + 0.5) / n))


def fitted(values: Array) -> Array:
    """Chebyshev coefficients (n, …) of values at `nodes(n)`."""
    n = len(values)
    table: Array = scipy.fft.dct(values, type=2, axis=0) / n
    table[0] *= 0.5
    return table


def chopped(table: Array, noise: float = 4e-16) -> Array:
    """Without the trailing coefficients that are rounding, whose derivatives would grow as their order⁴."""
    kept = np.flatnonzero(np.abs(table) > noise)
    return table[: kept[-1] + 1 if len(kept) else 1]


def series(
    sampled: Callable[[Array], tuple[Array, Array, Array]], left: float, right: float, n: int
) -> Series:
    """Chebyshev series of n terms between two parameters, from x, dx/du and d²x/du² at those of an array."""
    middle, half = 0.5 * (left + right), 0.5 * (right - left)
    return Series.between(left, right, fitted(np.hstack(sampled(middle + half * nodes(n)))))


@dataclass(frozen=True, eq=False)
class Series:
    """x, dx/du and d²x/du² as Chebyshev series of (u − middle) / half, |·| ≤ 1.

    Attributes
    ----------
    table : ndarray (orders, 3 nv)
    orders : ndarray (orders,)
        0, 1, 2, …
    middle, half : float
    """

    table: Array
    orders: Array
    middle: float
    half: float

    @staticmethod
    def between(left: float, right: float, table: Array) -> Series:
        """The series with these coefficients between two parameters."""
        return Series(table, np.arange(float(len(table))), 0.5 * (left + right), 0.5 * (right - left))

    def at(self, u: float) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du² at u."""
        s = min(max((u - self.middle) / self.half, -1.0), 1.0)
        values = np.cos(self.orders * acos(s)) @ self.table
        n = len(values) // 3
        return values[:n], values[n : 2 * n], values[2 * n :]
