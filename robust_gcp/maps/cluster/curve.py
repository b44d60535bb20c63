"""The bridge of a cluster of mobility 1: its curve through singular places, with certificate.

The curve is parametrised by u = tᵀ (x − x_ref), t the tangent beside the places, so that neither the
independent joint nor its turning back matters; see `curve_builder`, which builds it.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from ...mechanism.tree.tree import Array
from ..explicit import CrossingKind
from .interpolation import HermiteCurve, Series
from .jet import Jet, nearest_of
from .space import ClusterSpace

FARTHEST, SAME_ROOT = 4.0, 0.3
"""How far from a curve, in its widths, its places are recognised, and by which share of their distance."""

SAME_PLACE = 1e-7
"""Agreement of x by which a point is known to lie on a curve."""


@dataclass(eq=False)
class Curve:
    """A certified piece of a mode of mobility 1, through one or several singular places.

    Attributes
    ----------
    space : ClusterSpace
    C : ndarray (nv, 1)
        The direction t of the parameter.
    reference : ndarray (nv,)
        Its origin x_ref.
    through : HermiteCurve
        The polynomial through solved points on both sides.
    left, right : float
        u of the innermost nodes: between them the curve is used.
    roots : list of float
        u of the singular places, ascending.
    corank : list of int
        How many singular values vanish at each.
    kind : {"transversal", "tangential", "near miss", "within"}
        "within": a window of a mode that lies in the singular set, without singular places of its own.
    closure : float
        The certificate: max |φ| between the nodes, in lengths.
    transversality : float
        The smallest over the places; see `null_pairing`.
    error : float
        Estimated relative error of Γ over the bridge.
    shift : ndarray (nv,)
        Whole turns of revolute joints by which it was moved.
    orders : tuple of int
        The order of contact of the modes at each place, where it is above one at some.
    inside : Series or None
        What is used between `left` and `right`; the polynomial where None.
    """

    space: ClusterSpace
    C: Array
    reference: Array
    through: HermiteCurve
    left: float
    right: float
    roots: list[float]
    corank: list[int]
    kind: CrossingKind
    closure: float
    transversality: float
    error: float
    shift: Array
    orders: tuple[int, ...] = ()
    inside: Series | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._series = self.inside or self.through.series(self.left, self.right)

    def u(self, x: Array) -> float:
        """Parameter of a configuration."""
        return float(self.C[:, 0] @ (x - self.shift - self.reference))

    def point(self, u: float) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du² at u."""
        x, slope, bend = self._series.values_at(u) if self.contains(u) else self.through.values_at(u)
        return x + self.shift, slope, bend

    def order(self, i: int) -> int:
        """The order of contact at place i."""
        return self.orders[i] if self.orders else 1

    def contains(self, u: float) -> bool:
        """Whether the curve is used at u."""
        return self.left <= u <= self.right

    @property
    def center(self) -> float:
        """Middle of the piece in use."""
        return 0.5 * (self.left + self.right)

    def inner(self, u: float) -> Jet:
        """The innermost node on u's side."""
        nodes = self.through.nodes
        node = nodes[len(nodes) // 2 - int(u <= self.center)]
        return Jet(node.space, node.x + self.shift, node.C, node.J, node.bend, node.P, node.sigma, node.svd)

    def parameter(self, C: Array, y: float, u: float) -> float | None:
        """u with Cᵀ x(u) = y, from a guess; None once it leaves the nodes."""
        c, width = C[:, 0], self.right - self.left
        u = min(max(u, self.through.first), self.through.last)  # beyond its nodes degree 17 is wild
        for _ in range(30):
            if not self.through.reaches(u, 1e-9):
                return None
            x, slope, _ = self.point(u)
            du = (y - float(c @ x)) / float(c @ slope)
            # where y turns back along the curve the slope is nearly zero, and a whole step would leave it
            du = min(max(du, -0.5 * width), 0.5 * width)
            u += du
            if abs(du) < 1e-15 + 4e-16 * abs(u):  # u to its last digits: G and Γ are read off there
                break
        return u if self.through.reaches(u, 1e-9) else None

    def beyond(self, C: Array, y: float, u: float) -> float:
        """u of y by the slope at u, where y lies beyond the nodes."""
        u = min(max(u, self.left), self.right)  # a polynomial says nothing far beyond its nodes
        x, slope, _ = self.point(u)
        return u + (y - float(C[:, 0] @ x)) / float(C[:, 0] @ slope)

    def jet(self, C: Array, u: float) -> Jet:
        """The point at u in the chart C: J = x'/y_u, Γ = x''/y_u² − J (C x''/y_u²)."""
        x, slope, bend = self.point(u)
        pace = float(C[:, 0] @ slope)
        J = slope / pace
        second = bend / pace**2
        # y is its own coordinate: Cᵀ J = 1 holds all along, so that Cᵀ Γ = 0
        second = second - J * float(C[:, 0] @ second)
        return Jet(self.space, x, C, J[:, None], second[None, None], self.through.nodes[0].P)

    def beside(self, here: Jet) -> list[float]:
        """How far each of its places lies from the singular place next to a point beside the curve.

        Where modes are in contact of order k that lies k times as far as to first order, shared among the
        ranks that are lost.
        """
        u, first = self.u(here.x), nearest_of(here.recharted(self.C).roots(np.ones(1))).real
        ranks = [max(r, 1) for r in self.corank]  # where modes cross the order is one for each
        places = zip(self.roots, self.orders or ranks, ranks, strict=True)
        return [abs(u + k / r * first - root) for root, k, r in places]

    def is_beside(self, here: Jet) -> bool:
        """Whether the singular place next to a point beside the curve is one of the curve's."""
        u = self.u(here.x)
        if abs(u - self.center) > FARTHEST * (self.right - self.left):
            return False
        pairs = zip(self.beside(here), self.roots, strict=True)
        return any(off < SAME_ROOT * abs(u - root) for off, root in pairs)

    def turned(self, shift: Array) -> Curve:
        """The same curve after whole turns of revolute joints, x + shift."""
        other = copy(self)
        other.shift = self.shift + shift
        return other

    def passes(self, x: Array) -> float | None:
        """u of a configuration that lies on the curve; None of another."""
        u = self.u(x)
        if self.through.reaches(u) and np.abs(self.point(u)[0] - x).max() < SAME_PLACE:
            return u
        return None
