"""The explicit map of a mechanism with joints on groups: theirs is a chart, the rest has its own map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..mechanism.coordinates.groups import Groups
from ..mechanism.tree.tree import Array
from .classical import ClassicalMap
from .cluster.cluster_map import ClusterMap
from .explicit import OUTGROWN, Counters, Crossing, ExplicitMap, Point, Stretch
from .regular_path import RegularPath


@dataclass(slots=True)
class GroupPoint(Point):
    """A point whose y holds, for joints on groups, w with q = origin ⊕ w.

    `ydot` are the independent velocities u, in the axes of their joints: v = G u. Of w they are the rate at
    w = 0 alone; see `GroupMap.rate`.

    Attributes
    ----------
    rest : Point
        Of the mechanism without the joints on groups.
    """

    rest: Point = field(kw_only=True)


class GroupMap:
    """q = γ(y), G and g, where y holds w for the joints on groups: q = origin ⊕ w.

    Their rows of G are the identity and those of g are zero, as u are their velocities themselves. The chart
    is renewed at outputs (`renewed`), so that w stays small.

    Parameters
    ----------
    groups : Groups
    rest : ExplicitMap
        Of `groups.rest`.
    start : GroupPoint
    """

    def __init__(self, groups: Groups, rest: ExplicitMap, start: GroupPoint) -> None:
        self.groups, self.rest = groups, rest
        self._anchor = start

    @property
    def anchor(self) -> Point:
        """The point evaluated last; setting it takes its chart too."""
        return self._anchor

    @anchor.setter
    def anchor(self, point: Point) -> None:
        assert isinstance(point, GroupPoint)
        self._anchor = point
        self.rest.anchor = point.rest

    @property
    def origin(self) -> Array:
        """Of the present chart: the groups' numbers in q at w = 0."""
        return _origin(self._anchor)

    @property
    def path(self) -> RegularPath:
        """That of the rest."""
        return self.rest.path

    @property
    def counters(self) -> Counters:
        """What was computed so far."""
        return self.rest.counters

    @property
    def met(self) -> bool:
        """Whether a singular surface was met so far."""
        return self.rest.met

    def point_at(self, y: Array, ydot: Array) -> GroupPoint:
        """The point at y in the present chart, with velocities u = ydot."""
        own = self.groups.rest_inputs
        rest = self.rest.point_at(y[own], ydot[own])
        self._anchor = joined(self.groups, rest, _origin(self._anchor), y, ydot)
        return self._anchor

    def passed(self, before: Point, after: Point, stretch: Stretch) -> list[Crossing]:
        """Singular surfaces of the rest between two points; q, y and the stretch are its own."""
        assert isinstance(before, GroupPoint)
        assert isinstance(after, GroupPoint)
        return self.rest.passed(before.rest, after.rest, stretch)

    def rate(self, point: Point) -> Array:
        """ẏ at a point: that of the rest, and dexp⁻¹(w) u on groups."""
        assert isinstance(point, GroupPoint)
        groups, rate = self.groups, point.ydot.copy()
        rate[groups.rest_inputs] = self.rest.rate(point.rest)
        w, u = point.y[groups.inputs], point.ydot[groups.inputs]
        rate[groups.inputs] = groups.rate(_origin(point), w, u)
        return rate

    def renewed(self, point: Point) -> GroupPoint:
        """The same point as the origin of a new chart, which is taken."""
        assert isinstance(point, GroupPoint)
        groups, rest = self.groups, self.rest.renewed(point.rest)
        y = np.zeros_like(point.y)
        y[groups.rest_inputs] = rest.y
        self.anchor = self._anchor = replace(point, y=y, origin=point.q[groups.iq].copy(), rest=rest)
        return self._anchor

    def resume(self, anchor: Point, trackers: Callable[[], Array] | None, *told: bool | None) -> None:
        """Go on from a point that the kernel reached; see `ClusterMap.resume`."""
        assert isinstance(anchor, GroupPoint)
        assert isinstance(self.rest, ClusterMap | ClassicalMap)  # the kernel knows no other map
        self._anchor = anchor
        self.rest.resume(anchor.rest, trackers, *told)

    def outgrown(self, point: Point) -> bool:
        """Whether the chart ought to be renewed at a point."""
        assert isinstance(point, GroupPoint)
        w = point.y[self.groups.inputs]
        return bool(np.abs(w).max(initial=0.0) > OUTGROWN) or self.rest.outgrown(point.rest)

    def whole(self, rest: Array, y: Array) -> Array:
        """q of the whole from that of the rest and y in the present chart."""
        groups = self.groups
        q = np.empty(groups.mechanism.nq)
        q[groups.rest_iq] = rest
        q[groups.iq] = groups.place(_origin(self._anchor), y[groups.inputs])
        return q


def joined(groups: Groups, rest: Point, origin: Array, y: Array, u: Array) -> GroupPoint:
    """The point of the whole from one of the rest; y holds w for the joints on groups."""
    mechanism = groups.mechanism
    q = np.empty(mechanism.nq)
    q[groups.rest_iq] = rest.q
    q[groups.iq] = groups.place(origin, y[groups.inputs]) if np.any(y[groups.inputs]) else origin
    G, g = np.zeros((mechanism.nv, mechanism.m)), np.zeros(mechanism.nv)
    G[np.ix_(groups.rest_iv, groups.rest_inputs)] = rest.G
    G[groups.iv, groups.inputs] = 1.0
    g[groups.rest_iv] = rest.g
    return GroupPoint(
        y.copy(), u.copy(), q, G, g, None, rest.det, rest.rcond,
        rest.conditioning, rest.correction, rest.distance, rest.turn, rest=rest, origin=origin,
    )  # fmt: skip


def taken_apart(groups: Groups, point: Point, origin: Array | None = None) -> GroupPoint:
    """A point of the whole with that of the rest; without an origin w = 0 for the joints on groups."""
    own, iv = groups.rest_inputs, groups.rest_iv
    rest = Point(
        point.y[own], point.ydot[own], point.q[groups.rest_iq], point.G[np.ix_(iv, own)], point.g[iv], None,
        point.det, point.rcond, point.conditioning,
    )  # fmt: skip
    return GroupPoint(
        point.y, point.ydot, point.q, point.G, point.g, None, point.det, point.rcond,
        point.conditioning, rest=rest, origin=point.q[groups.iq] if origin is None else origin,
    )  # fmt: skip


def _origin(point: GroupPoint) -> Array:
    assert point.origin is not None
    return point.origin
