"""What a run does for joints on groups, whose y is w in a chart: see `maps.grouped`. For others, nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..dynamics.equations import Evaluation
from ..maps.explicit import Crossing, ExplicitMap
from ..maps.grouped import GroupMap, GroupPoint
from ..maps.point import Point
from ..mechanism.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .dense import Interpolant


def map_of_rest(explicit: ExplicitMap) -> ExplicitMap:
    """The explicit map without joints on groups."""
    return explicit.rest if isinstance(explicit, GroupMap) else explicit


def point_of_rest(point: Point) -> Point:
    """The point without joints on groups."""
    return point.rest if isinstance(point, GroupPoint) else point


def q_of_rest(explicit: ExplicitMap, q: Array) -> Array:
    """q without joints on groups."""
    return q[explicit.groups.rest_iq] if isinstance(explicit, GroupMap) else q


def numbers(explicit: ExplicitMap, y: Array) -> Array:
    """Those of y that are numbers in q."""
    return y[explicit.groups.rest_inputs] if isinstance(explicit, GroupMap) else y


def in_new_chart(explicit: ExplicitMap, now: Evaluation, x: Array) -> tuple[Evaluation, Array]:
    """The present evaluation and state in a chart about it."""
    point = explicit.renewed(now.point)
    if point is now.point:
        return now, x
    return replace(now, point=point), np.concatenate([point.y, x[len(point.y) :]])


def placed(explicit: ExplicitMap, crossings: list[Crossing], y: Callable[[float], Array]) -> list[Crossing]:
    """Crossings of the rest with q of the whole, from y in the present chart by time."""
    if not isinstance(explicit, GroupMap):
        return crossings
    return [replace(c, q=explicit.whole(c.q, y(c.time))) for c in crossings]


def placed_between(
    mechanism: Mechanism, crossings: list[Crossing], times: tuple[float, float], *ends: tuple[Array, ...]
) -> list[Crossing]:
    """The same from q, v and a at two times, by the motion that these determine."""
    groups = groups_of(mechanism)
    if groups is None or not crossings:
        return crossings
    between = Interpolant(mechanism.tree, np.array(times), *map(np.array, zip(*ends, strict=True)))
    found = between(np.array([c.time for c in crossings]))[0]
    for q, crossing in zip(found, crossings, strict=True):
        q[groups.rest_iq] = crossing.q
    return [replace(c, q=q) for c, q in zip(crossings, found, strict=True)]


def coordinate_choices(mechanism: Mechanism, q: Array) -> list[tuple[str, ...]]:
    """Sets of independent joints, best conditioned first; those on groups are in all of them."""
    groups = groups_of(mechanism)
    if groups is None:
        return [names for _, names in mechanism.coordinate_choices(q)]
    kept = [name for name in mechanism.independent if name not in groups.rest.independent]
    return [(*kept, *names) for _, names in groups.rest.coordinate_choices(q[groups.rest_iq])]
