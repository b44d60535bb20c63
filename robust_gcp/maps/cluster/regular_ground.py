"""Regular ground, where K_d is well conditioned and all clusters are solved at once."""

from __future__ import annotations

import numpy as np

from ...mechanism.tree.tree import Array
from ..charted_path import regular_path
from ..explicit import Point
from ..regular_path import RegularPath

DETERMINANT_RATIO = 2.5
"""Largest change of a poorly conditioned block's determinant in one step; keeps a step from jumping
over the zero of the determinant, where branches meet."""

POOR = 0.3
"""Conditioning below which a block's determinant is watched."""

CORRECTION = 0.25
"""Newton's first correction against the predicted step. The prediction errs by the third order of
the step; another branch lies at the first order of the distance to the singularity."""

ROUNDING = 1e-12
"""Correction always allowed, divided by the conditioning: the rounding of φ."""

FARTHEST = 0.5
"""Largest rotation in one predicted step, rad, or slide in lengths. Between the two good sides of a
crossing the links of a loop turn against each other by more than three joints can in such a step."""


def same_branch(before: Point, after: Point) -> bool:
    """Whether Newton, started from the prediction, stayed on the branch of `before`."""
    allowed = CORRECTION * after.distance + ROUNDING / max(after.conditioning, 1e-12)
    # a tree has no branches, whatever its steps
    if len(after.det) and (after.turn > FARTHEST or after.correction > allowed):
        return False
    rconds = zip(before.rcond.tolist(), after.rcond.tolist(), strict=True)
    for a, b, rcond in zip(before.det.tolist(), after.det.tolist(), map(min, rconds), strict=True):
        if not a * b > 0.0:  # NaN too
            return False
        if rcond < POOR and not 1.0 / DETERMINANT_RATIO < b / a < DETERMINANT_RATIO:
            return False
    return True


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
        if point is not None or mechanism.nc == self.path.nd:  # without redundant rows there are no others
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
