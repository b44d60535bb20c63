"""Following one branch in small steps, with a test that notices when Newton went elsewhere."""

from __future__ import annotations

import numpy as np

from ..errors import BranchError
from ..mechanism.tree import Array
from .point import Point
from .regular_path import RegularPath

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

SMALLEST = 1e-9
"""Smallest marching step relative to the whole way before the branch counts as lost."""


def same_branch(before: Point, after: Point) -> bool:
    """Whether Newton, started from the prediction, stayed on the branch of `before`."""
    if len(after.det) == 0:
        return True
    conditioning = after.conditioning
    if after.turn > FARTHEST:
        return False
    if after.correction > 0.0 and after.correction > CORRECTION * after.distance + ROUNDING / max(
        conditioning, 1e-12
    ):
        return False
    if conditioning >= POOR and before.conditioning >= POOR:
        signs = before.det * after.det
        return bool((signs[0] if len(signs) == 1 else signs.min()) > 0.0)
    rconds = zip(before.rcond.tolist(), after.rcond.tolist(), strict=True)
    for a, b, rcond in zip(before.det.tolist(), after.det.tolist(), map(min, rconds), strict=True):
        if not a * b > 0.0:
            return False
        if rcond < POOR and not 1.0 / DETERMINANT_RATIO < b / a < DETERMINANT_RATIO:
            return False
    return True


def march(path: RegularPath, start: Point, y: Array, ydot: Array, stop_below: float = 0.0) -> Point:
    """Follow the branch along the straight line from `start` to y.

    Parameters
    ----------
    stop_below : float
        Conditioning at which to stop on the way.

    Returns
    -------
    Point
        At y, or the first one with conditioning below `stop_below`.

    Raises
    ------
    BranchError
        When steps of 1e-9 of the way do not hold the branch either: y has no point on it.
    """
    here, way = start, float(np.abs(y - start.y).max(initial=0.0))
    h = 1.0
    while True:
        left = float(np.abs(y - here.y).max(initial=0.0))
        last = h * way >= left
        target = y if last else here.y + (y - here.y) * (h * way / left)
        point = path.step(here, target, ydot)
        path.counters.marching_steps += 1
        if point is not None and same_branch(here, point):
            here = point
            if last or (stop_below > 0.0 and point.conditioning < stop_below):
                return here
            h *= 2.0
            continue
        h = 0.5 * min(h, left / way if way > 0.0 else 0.0)
        if h < SMALLEST:
            raise BranchError(
                f"the dependent joints cannot be followed beyond y = {here.y}: no configuration near by "
                f"closes the loops at y = {y} on this branch (conditioning of K_d {here.conditioning:.2g})",
                here.y,
                conditioning=here.conditioning,
            )
