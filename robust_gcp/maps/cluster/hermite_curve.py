"""A curve through solved points of a mode of mobility 1: one Hermite polynomial."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...mechanism.tree import Array
from .chebyshev_series import Series, series
from .jet import Jet
from .newton_form import NewtonForm


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
        half = self._half
        data = [[node.x, node.J[:, 0] * half, node.bend[0, 0] * half**2] for node in self.nodes]
        self._form = NewtonForm((self.us - self._middle) / half, np.array(data))

    def reaches(self, u: float, beyond: float = 0.0) -> bool:
        """Whether u lies between the outermost nodes, where the polynomial holds."""
        return self.first - beyond <= u <= self.last + beyond

    def x(self, u: float) -> Array:
        """x at u."""
        return self._form(np.array([(u - self._middle) / self._half]))[0]

    def at(self, u: float) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du² at u."""
        x, slope, bend = self.sampled(np.array([u]))
        return x[0], slope[0], bend[0]

    def sampled(self, u: Array) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du², (len(u), nv) each."""
        x, slope, bend = self._form.with_derivatives((u - self._middle) / self._half)
        return x, slope / self._half, bend / self._half**2

    def series(self, left: float, right: float) -> Series:
        """The same polynomial between two parameters as Chebyshev series, which are evaluated at once."""
        return series(self.sampled, left, right, 3 * len(self.us))
