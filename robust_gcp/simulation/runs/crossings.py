"""Crossings of a step placed in time, in the clusters' coordinates and in those of spherical joints.

For joints whose y is w in a chart see `maps.grouped` and `maps.charted_path`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...dynamics.equations import Evaluation
from ...maps.explicit import Crossing, ExplicitMap, Point, Stretch
from ...maps.grouped import GroupMap, GroupPoint
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..trajectories.interpolant import Interpolant


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
    rest, u = explicit.rest, v[mechanism.iv_independent]
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
    # the quintic errs by h⁶, the step by h⁵: a crossing is placed as well as the motion is known
    if not explicit.rest.path.mechanism.chart_joints:
        points = ((point.y, point.ydot, ydd) for point, ydd in ends)
        return hermite(*times, *([numbers(explicit, part) for part in end] for end in points))
    states = [motion_at(point, ydd) for point, ydd in ends]
    between = Interpolant(mechanism.tree, np.array(times), *map(np.array, zip(*states, strict=True)))
    path, here = explicit.rest.path, point_of_rest(ends[0][0])

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
        q[groups.rest_iq] = crossing.q  # closed to rounding on the bridge, as the polynomial is not
    return [replace(c, q=q) for c, q in zip(crossings, found, strict=True)]


AT_ONCE = 1e-9
"""Seconds between singular places that are one crossing of a cluster. By time, which is the same in all
coordinates: a distance would be another one for each spanning tree."""


def together(crossings: Sequence[Crossing]) -> list[Crossing]:
    """What a cluster passes within `AT_ONCE` as one crossing, the first with the sum of the coranks.

    Parameters
    ----------
    crossings : sequence of Crossing
        In the order of time.
    """
    found: list[Crossing] = []
    for new in crossings:
        at = _met_before(found, new)
        if at is None:
            found.append(new)
            continue
        one = found[at]
        found[at] = replace(
            one,
            # the least certain of both kinds: a gap or a contact is not made a crossing by its neighbour
            kind=next(
                (kind for kind in ("near miss", "tangential") if kind in (one.kind, new.kind)), one.kind
            ),
            certificate=max(one.certificate, new.certificate),
            transversality=min(one.transversality, new.transversality),
            corank=one.corank + new.corank,
            order=max(one.order, new.order),
        )
    return found


def _met_before(found: Sequence[Crossing], new: Crossing) -> int | None:
    """Which of those found the new one is."""
    for i in range(len(found) - 1, -1, -1):
        if new.time - found[i].time > AT_ONCE:  # all before are earlier still
            break
        if new.cluster is not None and found[i].cluster == new.cluster:
            return i
    return None


def hermite(t0: float, t1: float, before: Sequence[Array], after: Sequence[Array]) -> Stretch:
    """The stretch whose y is the quintic through (y, ẏ, ÿ) at both ends."""
    h = t1 - t0
    c0, c1, c2, c3, c4, c5 = quintic(h, before, after)

    def y(t: float) -> Array:
        u = (t - t0) / h
        value: Array = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        return value

    return Stretch(t0, t1, y)


def quintic(h: float, before: Sequence[Array], after: Sequence[Array]) -> tuple[Array, ...]:
    """Coefficients in u = (t − t₀)/h, lowest first, through (p, ṗ, p̈) at both ends of a step h."""
    (p0, v0, a0), (p1, v1, a1) = before, after
    v0, v1, a0, a1 = h * v0, h * v1, h * h * a0, h * h * a1
    jump = p1 - p0 - v0 - 0.5 * a0
    turn, bend = v1 - v0 - a0, a1 - a0
    c3 = 10.0 * jump - 4.0 * turn + 0.5 * bend
    c4 = -15.0 * jump + 7.0 * turn - bend
    c5 = 6.0 * jump - 3.0 * turn + 0.5 * bend
    return p0, v0, 0.5 * a0, c3, c4, c5
