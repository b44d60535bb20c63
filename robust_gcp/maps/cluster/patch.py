"""The bridge of a cluster of mobility m > 1: lines across a singular surface whose nodes follow the motion.

Each node is itself followed by a tracker of half the zone, so that where another surface is near the nodes
open bridges of their own: surfaces that overlap become nested lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from ...errors import SimulationError
from ...mechanism.tree.tree import Array
from ..explicit import CrossingKind
from .jet import Jet, LostError
from .line import jet_on_line
from .space import ClusterSpace

SAME = 1e-8
"""Distance, dimensionless, within which a point lies on a line: lines are certified to less."""

UPON, CLEAR = 0.1, 1.5
"""Distances to a singular surface, in zones: up to which a point is at it, and beyond which no line across
it is asked for."""

MAX_NEWTON, CONVERGED = 12, 1e-11
"""Steps in η to the point at y, and the size of the last: Γ changes by less than its error in it."""


class Follower(Protocol):
    """What follows a cluster's mode from a solved point, as `tracker.Tracker` does."""

    anchor: Jet

    def jet_at(self, y: Array) -> Jet:
        """The point at y on the mode, which becomes the anchor."""
        ...

    def nested(self: F, anchor: Jet, zone: float) -> F:
        """Another one from this point, for zones of this size."""
        ...

    def copy(self: F) -> F:
        """Another one from the same point."""
        ...

    def twin(self: F) -> F:
        """The same on a line of its own, where it is on one."""
        ...


F = TypeVar("F", bound=Follower)


@dataclass(eq=False)
class Patch(Generic[F]):
    """A certified line η₀ + s d across a singular surface, moved along with the motion.

    Its coordinates η = Cᵀ x are tangential to the mode, whatever y is: in coordinates that hardly move where
    others do the same mode is bent much more, and Γ across the line is interpolated by its values alone.

    Attributes
    ----------
    space : ClusterSpace
    C : ndarray (nv, m)
        Near enough to the tangent space beside the surface, in round numbers.
    d : ndarray (m,)
        Across the surface, in η; of unit arc length.
    origin : ndarray (m,)
        η₀.
    ss : sequence of float
        s of the nodes, ascending.
    trackers : list of Follower
        The nodes.
    left, right : float
        s of the innermost nodes: between them the line is used.
    kind : {"transversal", "near miss"}
    closure, transversality : float
        The certificate: max |φ| between the nodes, in lengths, and `null_pairing`.
    error : float
        Estimated relative error of Γ on the line.
    """

    space: ClusterSpace
    C: Array
    d: Array
    origin: Array
    ss: Sequence[float]
    trackers: list[F]
    left: float
    right: float
    kind: CrossingKind
    closure: float
    transversality: float
    error: float

    def twin(self) -> Patch[F]:
        """The same line with nodes of its own: they follow whoever uses it."""
        return replace(self, trackers=[node.twin() for node in self.trackers])

    @property
    def center(self) -> float:
        """Middle of the piece in use."""
        return 0.5 * (self.left + self.right)

    def s(self, eta: Array) -> float:
        """Parameter of the foot of η."""
        return float((eta - self.origin) @ self.d) / float(self.d @ self.d)

    def contains(self, s: float) -> bool:
        """Whether the line is used at s."""
        return self.left <= s <= self.right

    def towards(self, near: Jet, y: Array) -> Array:
        """η of the point at y in the chart of another point near by, to second order."""
        return np.asarray(self.C.T @ near.predicted(y - near.y))

    def jet_at(self, y: Array, C: Array, eta: Array) -> Jet | None:
        """The point with Cᵀ x = y in that chart, by Newton in η from a guess; None beside the line.

        Raises
        ------
        LostError
            When Newton does not converge.
        """
        for _ in range(MAX_NEWTON):
            point = self.point(eta)
            if point is None:
                return None
            step = np.linalg.solve(C.T @ point.J, y - C.T @ point.x)
            if np.abs(step).max() < CONVERGED:  # the rest to first order, without moving the nodes again
                J = point.J + np.einsum("i,ijn->nj", step, point.bend)
                return replace(point, x=point.x + point.J @ step, J=J).recharted(C)
            eta = np.asarray(eta + step)
        raise LostError("Newton along a line across a singular surface does not converge")

    def point(self, eta: Array) -> Jet | None:
        """The point at η from the line through it, with the nodes moved there; None beside the line."""
        s = self.s(eta)
        foot = eta - s * self.d  # the line moves with the motion, each node by its own tracker
        # also where s is beyond: a motion that leaves goes on from the inner node, which must be beside it
        for at, tracker in zip(self.ss, self.trackers, strict=True):
            tracker.jet_at(foot + at * self.d)
        if not self.contains(s):
            return None
        nodes = [tracker.anchor for tracker in self.trackers]
        return jet_on_line(self.space, self.C, self.d, self.ss, nodes, s)

    def passes(self, here: Jet, zone: float) -> bool:
        """Whether the line, moved there, goes through a point.

        For a point at a singular place, where it does not tell its mode, and no line can be begun.
        """
        eta = self.C.T @ here.x
        if here.nearest()[0] > UPON * zone or self.space is not here.space or not self.contains(self.s(eta)):
            return False
        try:
            point = self.point(eta)
        except (SimulationError, np.linalg.LinAlgError):
            return False
        return point is not None and float(np.linalg.norm(point.x - here.x)) < SAME

    def leads_to(self, here: Jet) -> bool:
        """Whether the surface next to a solved point is the one that the line crosses near its middle."""
        distance, way = here.nearest()  # σ grows that way
        ahead = self.s(self.C.T @ (here.x - here.J @ (distance * way)))  # the place, to first order
        return here.space is self.space and abs(ahead - self.center) < 0.25 * (self.right - self.left)

    def serves(self, here: Jet, y: Array) -> bool:
        """Whether the point at y, from a solved one, lies on the line or beyond it."""
        begun, s = self.s(self.C.T @ here.x), self.s(self.towards(here, y))
        return self.contains(s) or (begun - self.center) * (s - self.center) <= 0.0

    def inner(self, s: float) -> F:
        """The innermost node on the side of s."""
        half = len(self.ss) // 2
        return self.trackers[half if s > self.center else half - 1]


def stays_clear(here: Jet, y: Array, zone: float) -> bool:
    """Whether y is so far on a point's side of the singular surface that no line across it would reach it."""
    distance, way = here.nearest()  # σ grows that way, of unit arc length
    return distance + float((here.J @ (y - here.y)) @ (here.J @ way)) > CLEAR * zone
