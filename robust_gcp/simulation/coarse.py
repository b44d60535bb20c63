"""A warning where fixed steps were too long to see the motion."""

from __future__ import annotations

import numpy as np

from ..warning import warn
from .trajectory import Trajectory

FARTHEST = 1.0
"""Largest motion of a joint in one step, rad or characteristic lengths, that is not warned of: RK4 errs
by 1e-2 of a circle's radius there, and two crossings may lie so close together."""


class CoarseStepWarning(RuntimeWarning):
    """A fixed step took a joint so far that crossings in it may be missing and its error is large."""


def warn_if_coarse(run: Trajectory, step: float) -> None:
    """Warn once when a step (s) of a run with closed loops took a joint further than `FARTHEST`."""
    if run.mechanism.nc == 0 or len(run.t) < 2:
        return
    pace = np.abs(run.v[:-1] / run.mechanism.units).max(axis=1)
    steps = np.minimum(np.diff(run.t), step)
    i = int(np.argmax(pace * steps))
    if not pace[i] * steps[i] > FARTHEST:
        return
    warn(
        f"the step at t = {run.t[i]:.6g} s takes a joint {pace[i] * steps[i]:.2g} rad (or lengths) far: the "
        "stepper's error is large there, and crossings in such a step may be missing from the list; use a "
        f"step of {0.1 * FARTHEST / pace[i]:.1g} s",
        CoarseStepWarning,
    )
