"""Why a motion cannot go on, and what to say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import BranchError, CuspError, NotCertifiedError, SimulationError, ToggleError
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.coordinates.partition import spelled
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..explicit import Point
from .chart import quality
from .obstacles import Obstacle, ObstacleError
from .regular_ground import POOR
from .touching.meeting_ahead import touches_ahead
from .tracker import Tracker

CLEARLY_TOUCHING = 1.7
"""Order of contact from which modes of several coordinates are taken to touch: 1 where they cross."""

SMALLER = 'use a smaller step, or one with error control: stepper="DOP853"'
"""Where a motion is too fast for its steps in a short stretch, as one that whips past a dead point."""


def toggle_at(tracker: Tracker, reason: str = "the independent components turn back here") -> Obstacle:
    """That the independent components of a tracker's chart turn back where it is."""
    return Obstacle("toggle", tracker.anchor.x, 0.1, np.nan, reason)


def what_stopped(cluster: LoopCluster, tracker: Tracker, stop: Exception) -> Obstacle:
    """What stopped a tracker: a toggle where the independent components are about to turn back."""
    here, reason = tracker.anchor.x, str(stop)
    known = stop.obstacle if isinstance(stop, ObstacleError) else tracker.obstacle
    known = known or Obstacle("unknown", here, 0.1, np.nan, reason)
    undecided = known.kind == "unknown" or not isinstance(stop, ObstacleError)
    if undecided and quality(tracker.anchor, cluster.chosen) < POOR:
        return toggle_at(tracker, reason)
    if undecided and cluster.m > 1 and touches_ahead(tracker.anchor, CLEARLY_TOUCHING):
        words = f"modes touch in a cluster of {cluster.m} coordinates"
        return Obstacle("tangential", here, 0.1, np.nan, words)
    return known


def refusal(mechanism: Mechanism, cluster: LoopCluster, obstacle: Obstacle, here: Point) -> SimulationError:
    """The error that an obstacle ends a run with."""
    where = f"y = {np.array2string(here.y, precision=6)} ({', '.join(mechanism.independent)})"
    if len(mechanism.clusters) > 1:
        where += f", in the loops of {', '.join(cluster.joints)}"
    figures = {"gap": obstacle.gap, "cluster": cluster.index}
    if obstacle.kind == "toggle":
        choices = [
            names
            for _, names in mechanism.coordinate_choices(here.q)
            if set(names) != set(mechanism.independent)
        ]
        return ToggleError(
            f"toggle at {where}: K_d is singular while K is not, the independent coordinates turn "
            f"back here and cannot parametrise the motion; joints that can: {spelled(choices)}",
            here.y,
            choices,
            **figures,
        )
    if obstacle.kind == "cusp":
        assert obstacle.met is not None
        error = CuspError(
            f"cusp ahead of {where}: both branches of the mode leave it to one side, and the equations of "
            'motion end there; on_cusp="turn" goes on along the other branch, as any linkage that is nearly '
            "this one does",
            here.y,
            **figures,
        )
        error.met, error.joints = obstacle.met, cluster.joints
        return error
    if obstacle.kind == "near miss":
        gap = f"{obstacle.gap:.2g} lengths" if np.isfinite(obstacle.gap) else "unknown size"
        return BranchError(
            f"near miss at {where}: two modes pass each other with a gap of {gap} "
            "and the true curve could not be followed; use a smaller step or, if the gap is an error "
            "of the model, raise geometric_tolerance above it",
            here.y,
            **figures,
        )
    return NotCertifiedError(
        f"singularity at {where} not certified: {obstacle.reason}; second order does not say how the "
        "motion goes on (see analyse(mech, q) at traj.q[-1])",
        here.y,
        **figures,
    )


def where_refused(mechanism: Mechanism, trackers: Sequence[Tracker], here: Point) -> SimulationError:
    """The error for a place that cannot be passed: what a tracker is at, or a toggle in a poor chart.

    Else that error control did not help.
    """
    for tracker in trackers:
        if tracker.obstacle is not None:
            return refusal(mechanism, tracker.space.cluster, tracker.obstacle, here)
    for tracker in trackers:
        cluster = tracker.space.cluster
        if quality(tracker.anchor, cluster.chosen) < POOR:
            return refusal(mechanism, cluster, toggle_at(tracker), here)
    words = "the motion could not be followed with error control"
    return BranchError(f"at y = {here.y}: {words}; {SMALLER}", here.y)


def too_large(anchor: Point, y: Array, turn: float) -> BranchError:
    """That a stepper goes so far at once that no branch can be followed."""
    return BranchError(
        f"from y = {anchor.y} to {y} the stepper moves a joint by {turn:.3g} rad (or lengths) at once, more "
        "than a turn, in which no branch can be followed: the step is too large for this motion, or the "
        f"motion has become unstable; {SMALLER}",
        anchor.y,
    )
