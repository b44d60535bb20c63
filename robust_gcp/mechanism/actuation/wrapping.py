"""The shortest line between two points round a sphere or a cylinder.

Both reduce to a circle in a plane: of a sphere the plane of its centre and the two points, of a cylinder the
one across its axis, along which the line then climbs evenly. The line is two tangents and an arc. It goes the
shorter way where it would cross the circle, else straight; but where a point given on its side lies between
the directions opposite to its ends it goes round the other way, always. Where that point is inside the
surface, the line goes through the inside of the circle and touches it at one point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..tree.tree import Array
from ..tree.vectors import cross

SPHERE, CYLINDER = "sphere", "cylinder"

TINY = 1e-15


class Wrapped(NamedTuple):
    """Where a line touches, world axes, and the length of its arc, m."""

    first: Array
    last: Array
    length: float


def wrapped(
    start: Array, end: Array, centre: Array, R: Array, radius: float, cylinder: bool, side: Array | None
) -> Wrapped | None:
    """The line's way round, None where it goes straight.

    Parameters
    ----------
    start, end : ndarray (3,)
    centre, R : ndarray (3,), (3, 3)
        Of the sphere or cylinder, whose axis is R's third column.
    radius : float
    side : ndarray (3,) or None
    """
    a, b = R.T @ (start - centre), R.T @ (end - centre)
    if min(float(a @ a), float(b @ b)) < TINY**2:  # an end in the centre has no direction
        return None
    plane = np.eye(2, 3) if cylinder else _plane(a, b)
    flat_a, flat_b = plane @ a, plane @ b
    inside, toward = False, None
    if side is not None:
        local = R.T @ (side - centre)
        inside = bool(local @ local < radius**2)
        toward = plane @ local
        size = math.hypot(*toward)
        toward = toward / size * radius if size > TINY else np.array([radius, 0.0])
    found = _through(flat_a, flat_b, radius) if inside else _round(flat_a, flat_b, radius, toward)
    if found is None:
        return None
    first, last, arc = found
    one, two = first @ plane, last @ plane
    if cylinder:
        before, after = math.dist(flat_a, first), math.dist(flat_b, last)
        # unrolled, the line is straight: it climbs alike on tangents and arc
        climb = (b[2] - a[2]) / (before + arc + after)
        one[2], two[2] = a[2] + climb * before, a[2] + climb * (before + arc)
        arc = math.hypot(arc, two[2] - one[2])
    return Wrapped(centre + R @ one, centre + R @ two, arc)


def _plane(a: Array, b: Array) -> Array:
    """Orthonormal axes (2, 3) of the plane of two points and the origin, the first along `a`."""
    first = a / np.linalg.norm(a)
    normal = cross(a, b)
    if np.linalg.norm(normal) < TINY:  # on one line: any plane through it
        normal = cross(first, np.where(np.arange(3) == np.abs(first).argmax(), 0.0, 1.0))
    second = cross(normal, first)
    return np.array([first, second / np.linalg.norm(second)])


def _round(a: Array, b: Array, radius: float, side: Array | None) -> tuple[Array, Array, float] | None:
    """Tangent points and arc on a circle about the origin; None where the line goes straight."""
    aa, bb, square, d = float(a @ a), float(b @ b), radius**2, b - a
    dd = float(d @ d)
    if min(aa, bb) < square or radius < TINY or dd < TINY:  # from inside there is no tangent
        return None
    around = side is not None and _is_between(side, -a, -b)
    nearest = a + min(max(-float(d @ a) / dd, 0.0), 1.0) * d  # of the piece between them, not of its line
    if nearest @ nearest > square and not around:
        return None
    clockwise = (float(a[0] * b[1] - a[1] * b[0]) < 0.0) != around
    way = 1.0 if clockwise else -1.0
    one = (a * square + way * radius * math.sqrt(aa - square) * np.array([a[1], -a[0]])) / aa
    two = (b * square - way * radius * math.sqrt(bb - square) * np.array([b[1], -b[0]])) / bb
    angle = math.acos(min(max(float(one @ two) / square, -1.0), 1.0))
    turn = float(one[1] * two[0] - one[0] * two[1])
    if turn * way < 0.0:  # an arc over half a turn, which acos does not tell
        angle = 2.0 * math.pi - angle
    return one, two, radius * angle


def _is_between(point: Array, a: Array, b: Array) -> bool:
    """Whether a direction lies in the angle below half a turn between two others."""
    turn = float(a[0] * b[1] - a[1] * b[0])
    first, last = float(a[0] * point[1] - a[1] * point[0]), float(point[0] * b[1] - point[1] * b[0])
    return first * turn > 0.0 and last * turn > 0.0


def _through(a: Array, b: Array, radius: float) -> tuple[Array, Array, float] | None:
    """The point of a circle at which a line that passes its inside is shortest; None where it goes straight.

    At angles x from a and G − x from b both parts meet the radius at equal angles. Between the points where
    they would be tangents the sines of these rise with x and G − x, which brackets Newton's method.
    """
    la, lb, d = math.hypot(*a), math.hypot(*b), b - a
    if min(la, lb) <= radius or radius < TINY:
        return None
    dd = float(d @ d)
    if dd > TINY:
        share = -float(d @ a) / dd
        if 0.0 < share < 1.0 and math.hypot(*(a + share * d)) <= radius:
            return None
    G = math.acos(min(max(float(a @ b) / (la * lb), -1.0), 1.0))
    if math.pi - G < 1e-12:  # of opposite ends rounding would choose the way round
        return None
    low, high = max(0.0, G - math.acos(radius / lb)), min(G, math.acos(radius / la))
    x = 0.5 * (low + high)
    for _ in range(60):  # halvings that bring half a turn to rounding
        f, slope = _bending(x, la, radius), _bending_slope(x, la, radius)
        g, back = _bending(G - x, lb, radius), _bending_slope(G - x, lb, radius)
        if f < g:
            low = x
        else:
            high = x
        step = -(f - g) / (slope + back) if slope + back > 0.0 else 0.0
        # Newton's step where it stays in the bracket, else half of that
        new = x + step if low < x + step < high and step else 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * (1.0 + G):
            break
        x = new
    u = a / la
    way = 1.0 if a[0] * b[1] - a[1] * b[0] > 0.0 else -1.0
    point = radius * (math.cos(x) * u + way * math.sin(x) * np.array([-u[1], u[0]]))
    return point, point.copy(), 0.0


def _bending(x: float, far: float, radius: float) -> float:
    """Sine of the angle at which a line from the distance `far`, at the angle x, meets the radius."""
    return far * math.sin(x) / math.sqrt(far**2 + radius**2 - 2.0 * far * radius * math.cos(x))


def _bending_slope(x: float, far: float, radius: float) -> float:
    square = far**2 + radius**2 - 2.0 * far * radius * math.cos(x)
    return (far * math.cos(x) - far**2 * radius * math.sin(x) ** 2 / square) / math.sqrt(square)
