"""Regular ground, where K_d is well conditioned and all clusters are solved at once."""

from __future__ import annotations

import numpy as np

from ...mechanism.tree.tree import Array
from ..charted_path import regular_path
from ..explicit import Point
from ..march import POOR, same_branch
from ..regular_path import RegularPath

PACE = 3.0
"""Conditioning that a regular step needs, in units of how far it turns a joint: a step does not jump over
a singular place."""

SAME_PLACE = 1e-6
"""Largest step, dimensionless, by which Newton may move a configuration that is solved already."""


class RegularGround:
    """Points that the regular path finds and that lie far enough from singular places.

    Parameters
    ----------
    path : RegularPath
    zone : float
        Conditioning of K_d below which the ground is not regular.

    Attributes
    ----------
    path : RegularPath
        Replaced where other rows of K determine the dependent joints better.
    """

    def __init__(self, path: RegularPath, zone: float) -> None:
        self.path, self._zone = path, zone

    def step(self, anchor: Point, y: Array, ydot: Array) -> Point | None:
        """The point at y, one predicted step from the anchor; None where it is not good enough."""
        point = self.path.step(anchor, y, ydot)
        if point is None:
            return None
        needed = max(self._zone, min(POOR, PACE * point.turn))
        return point if point.conditioning >= needed and same_branch(anchor, point) else None

    def settled(self, q: Array, y: Array, ydot: Array, origin: Array | None) -> Point | None:
        """The point at a solved q, by other rows where the present ones fail; None where K_d is poor."""
        mechanism = self.path.mechanism
        point = self._at(self.path, q, y, ydot, origin)
        if point is not None or mechanism.nc == self.path.nd:
            return point
        rows = mechanism.select_rows(mechanism.K(q))
        if np.array_equal(rows, self.path.rows):
            return None
        path = regular_path(mechanism, rows, self.path.counters)
        point = self._at(path, q, y, ydot, origin)
        if point is not None:
            self.path = path
        return point

    def _at(self, path: RegularPath, q: Array, y: Array, ydot: Array, origin: Array | None) -> Point | None:
        point = path.settle(q.copy(), y, ydot, origin=origin)
        if point is None or point.conditioning < self._zone:
            return None
        moved = path.size(path.tree.difference(q, point.q))
        return point if moved < SAME_PLACE else None
