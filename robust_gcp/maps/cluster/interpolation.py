"""Curves through solved points: Hermite interpolation in Newton's form, and Chebyshev series."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import acos, factorial

import numpy as np
import scipy

from ...mechanism.tree.tree import Array
from .jet import Jet


class NewtonForm:
    """The polynomial with given values and derivatives at distinct nodes.

    Divided differences with each node repeated as often as it has data, evaluated by Horner's rule
    (de Boor, A Practical Guide to Splines, chapter I). SciPy's `KroghInterpolator` is the same
    polynomial; it is not used because its loops over single differences take longer than all else
    that a bridge computes.

    Parameters
    ----------
    x : ndarray (n,)
        Nodes.
    data : ndarray (n, d, r)
        f, f', …, f^(d−1) of r functions at each node.
    """

    def __init__(self, x: Array, data: Array) -> None:
        n, d, _ = data.shape
        self._nodes = nodes = np.repeat(x, d)
        table = np.repeat(data[:, 0], d, axis=0)
        newton = [table[0]]
        for order in range(1, n * d):
            apart = nodes[order:] - nodes[:-order]
            same = apart == 0.0
            table = (table[1:] - table[:-1]) / np.where(same, 1.0, apart)[:, None]
            if order < d:  # differences between equal nodes are derivatives
                table[same] = np.repeat(data[:, order], d - order, axis=0) / factorial(order)
            newton.append(table[0])
        self._newton = np.array(newton)

    def __call__(self, x: Array) -> tuple[Array, Array, Array]:
        """f, f' and f'' at each x, (len(x), r) each."""
        value = np.broadcast_to(self._newton[-1], (len(x), self._newton.shape[1]))
        slope = bend = np.zeros_like(value)
        for node, coefficient in zip(self._nodes[-2::-1], self._newton[-2::-1], strict=True):
            step = (x - node)[:, None]
            bend = bend * step + slope  # f''/2; from the top, as each takes the one below as it was before
            slope = slope * step + value
            value = value * step + coefficient
        return value, slope, 2.0 * bend


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
    middle, half : float
    """

    table: Array
    middle: float
    half: float

    @staticmethod
    def between(left: float, right: float, table: Array) -> Series:
        """The series with these coefficients between two parameters."""
        return Series(table, 0.5 * (left + right), 0.5 * (right - left))

    def values_at(self, u: float) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du² at u."""
        s = min(max((u - self.middle) / self.half, -1.0), 1.0)  # the ends are rounded
        values = np.cos(np.arange(float(len(self.table))) * acos(s)) @ self.table
        n = len(values) // 3
        return values[:n], values[n : 2 * n], values[2 * n :]


class HermiteCurve:
    """x(u) through the nodes' x, J and Γ.

    Parameters
    ----------
    us : sequence of float
        Parameters of the nodes, in any order.
    nodes : sequence of Jet
        In a chart whose coordinate differs from u by a constant.

    Attributes
    ----------
    us, nodes
        Ascending.
    first, last : float
        The outermost nodes.
    """

    def __init__(self, us: Sequence[float], nodes: Sequence[Jet]) -> None:
        order = np.argsort(us)
        self.us: Array = np.array(us)[order]
        self.nodes = [nodes[i] for i in order]
        self.first, self.last = float(self.us[0]), float(self.us[-1])
        self._middle, self._half = float(np.mean(us)), float(np.ptp(us)) / 2.0
        half = self._half  # in u itself differences of order 17 would be of the size w⁻¹⁷
        data = [[node.x, node.J[:, 0] * half, node.bend[0, 0] * half**2] for node in self.nodes]
        self._form = NewtonForm((self.us - self._middle) / half, np.array(data))

    def reaches(self, u: float, beyond: float = 0.0) -> bool:
        """Whether u lies between the outermost nodes, where the polynomial holds."""
        return self.first - beyond <= u <= self.last + beyond

    def values_at(self, u: float) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du² at u."""
        x, slope, bend = self.sampled(np.array([u]))
        return x[0], slope[0], bend[0]

    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du², (len(u), nv) each."""
        x, slope, bend = self._form((u - self._middle) / self._half)
        return x, slope / self._half, bend / self._half**2

    def series(self, left: float, right: float) -> Series:
        """The same polynomial between two parameters as Chebyshev series, which are evaluated at once."""
        return series(self.sampled, left, right, 3 * len(self.us))  # as many terms as data: exact
