"""Hermite interpolation in Newton's form: a polynomial from values and derivatives, and its derivatives."""

from __future__ import annotations

from math import factorial

import numpy as np

from ...mechanism.tree import Array


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

    def __call__(self, x: Array) -> Array:
        """The functions at each x, (len(x), r)."""
        value = np.broadcast_to(self._newton[-1], (len(x), self._newton.shape[1]))
        for node, coefficient in zip(self._nodes[-2::-1], self._newton[-2::-1], strict=True):
            value = value * (x - node)[:, None] + coefficient
        return value

    def with_derivatives(self, x: Array) -> tuple[Array, Array, Array]:
        """f, f' and f'' at each x, (len(x), r) each."""
        value = np.broadcast_to(self._newton[-1], (len(x), self._newton.shape[1]))
        slope = bend = np.zeros_like(value)
        for node, coefficient in zip(self._nodes[-2::-1], self._newton[-2::-1], strict=True):
            step = (x - node)[:, None]
            bend = bend * step + slope
            slope = slope * step + value
            value = value * step + coefficient
        return value, slope, 2.0 * bend
