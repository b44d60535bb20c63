"""How a point of a motion lies in the kernel's memory; see point.h."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..maps.grouped import GroupPoint, taken_apart
from ..maps.point import Point
from ..maps.regular_path import RegularPath
from ..mechanism.coordinates.groups import Groups
from ..mechanism.coordinates.joint_charts import loop_charts
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array


class Layout:
    """Points of a mechanism as rows of numbers.

    Parameters
    ----------
    mechanism : Mechanism
    path : RegularPath
        Whose blocks the points tell of.
    groups : Groups or None
        The joints on groups.

    Attributes
    ----------
    size : int
        Numbers of a point.
    q : slice
        Where its configuration is.
    """

    def __init__(self, mechanism: Mechanism, path: RegularPath, groups: Groups | None) -> None:
        self._groups, self._nv, self._m = groups, mechanism.nv, mechanism.m
        self._charts = charts = loop_charts(path.mechanism)
        if charts is not None:
            self._in_charts = charts.iq if groups is None else groups.rest_iq[charts.iq]
        self._looped = bool(path.blocks)
        nv, m, blocks = self._nv, self._m, len(path.blocks)
        widths = [m, m, mechanism.nq, nv * m, nv, nv if m == 1 else 0, blocks, blocks, 1]
        self._slices = [slice(a, b) for a, b in pairwise(np.cumsum([0, *widths]).tolist())]
        self.size, self.q = sum(widths), self._slices[2]

    def pack(self, point: Point, into: Array) -> None:
        """Write a point."""
        y, ydot, q, G, g, bend, det, rcond, worst = self._slices
        into[y], into[ydot], into[q] = point.y, point.ydot, point.q
        into[G], into[g] = point.G.ravel(), point.g
        if point.curvature is not None:
            into[bend] = point.curvature
        elif self._m == 1:
            into[bend] = 0.0  # no loop: γ is linear
        if self._looped:
            into[det], into[rcond] = point.det, point.rcond
        into[worst] = point.conditioning

    def origin(self, point: Point) -> Array:
        """q where a point's charts have their origins, (nq,); other joints as they are."""
        q, groups = point.q.copy(), self._groups
        if groups is not None:
            q[groups.iq] = point.origin
        if self._charts is not None:
            q[self._in_charts] = _rest_of(point).origin
        return q

    def point(self, packed: Array, origin: Array | None = None) -> Point:
        """The point at the front of these numbers, in charts about q, or about another whole q."""
        flat = packed[: self.size].copy()
        y, ydot, q, G, g, bend, det, rcond, _ = self._slices
        one = np.ones(0)
        point = Point(
            flat[y],
            flat[ydot],
            flat[q],
            flat[G].reshape(self._nv, self._m),
            flat[g],
            flat[bend] if self._m == 1 and self._looped else None,
            flat[det] if self._looped else one,
            flat[rcond] if self._looped else one,
            float(flat[-1]),
        )
        origin = point.q if origin is None else origin
        if self._groups is not None:
            point = taken_apart(self._groups, point, origin[self._groups.iq])
        if self._charts is not None:
            _rest_of(point).origin = origin[self._in_charts]
        return point


def _rest_of(point: Point) -> Point:
    return point.rest if isinstance(point, GroupPoint) else point
