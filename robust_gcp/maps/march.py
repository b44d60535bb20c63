"""The test that notices when Newton went to another branch."""

from __future__ import annotations

from .explicit import Point

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
