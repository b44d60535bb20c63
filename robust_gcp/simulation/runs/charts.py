"""What a run does for joints whose y is w in a chart; see `maps.grouped`, `maps.charted_path`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...dynamics.equations import Evaluation
from ...maps.explicit import Crossing, ExplicitMap, Stretch
from ...maps.grouped import GroupMap, GroupPoint
from ...maps.point import Point
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from ..trajectories.dense import Interpolant
from .crossings import hermite


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


def coordinates(explicit: ExplicitMap, mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """y in the present chart and u of a configuration and its velocity."""
    rest, u = map_of_rest(explicit), v[mechanism.iv_independent]
    own = rest.path.y_of(rest.anchor, q_of_rest(explicit, q))
    if not isinstance(explicit, GroupMap):
        return own, u
    groups, y = explicit.groups, np.empty(mechanism.m)
    y[groups.rest_inputs] = own
    y[groups.inputs] = groups.apart(explicit.origin, q[groups.iq])
    return y, u


def in_new_chart(explicit: ExplicitMap, now: Evaluation, x: Array) -> tuple[Evaluation, Array]:
    """The present evaluation and state in a chart about it."""
    point = explicit.renewed(now.point)
    if point is now.point:
        return now, x
    return replace(now, point=point), np.concatenate([point.y, x[len(point.y) :]])


def stretch_between(
    explicit: ExplicitMap, mechanism: Mechanism, times: tuple[float, float], *ends: tuple[Point, Array]
) -> Stretch:
    """y of the rest on a step, from the points and ÿ at its ends.

    In charts by the motion on the group that these determine, as there ẏ are not the velocities.
    """
    if not map_of_rest(explicit).path.mechanism.chart_joints:
        points = ((point.y, point.ydot, ydd) for point, ydd in ends)
        return hermite(*times, *([numbers(explicit, part) for part in end] for end in points))
    states = [motion_at(point, ydd) for point, ydd in ends]
    between = Interpolant(mechanism.tree, np.array(times), *map(np.array, zip(*states, strict=True)))
    path, here = map_of_rest(explicit).path, point_of_rest(ends[0][0])

    def y(t: float) -> Array:
        return path.y_of(here, q_of_rest(explicit, between(np.array([t]))[0][0]))

    return Stretch(*times, y)


def motion_at(point: Point, ydd: Array) -> tuple[Array, Array, Array]:
    """q, v and a at a point with the acceleration ÿ."""
    return point.q, point.G @ point.ydot, point.G @ ydd + point.g


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
