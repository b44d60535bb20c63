"""Where K_d is poor and no bridge was certified: what it is, and what to say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...errors import BranchError, NotCertifiedError, SimulationError, ToggleError
from ...mechanism.partition import numerical_rank, spelled
from ...mechanism.tree import Array
from ..march import march
from ..point import Point
from ..regular_path import RegularPath
from .bridge import NoBridgeError

ObstacleKind = Literal["toggle", "near miss", "tangential", "unknown"]

DEPTH = 1e-3
"""How deep into the zone, in conditioning, an obstacle is looked at to tell what it is."""


CLEARLY = 5.0
"""K this many times better conditioned than K_d: the coordinates are at fault, not the mechanism."""


@dataclass(frozen=True)
class Obstacle:
    """A place where K_d is poor and no bridge was certified.

    Attributes
    ----------
    kind : {"toggle", "near miss", "tangential", "unknown"}
    y : ndarray (m,)
        Where it was met.
    reach : float
        Estimated distance in y to the singular surface.
    gap : float
        max |φ| / length of the best attempt at a bridge; infinite when there was none.
    reason : str
    """

    kind: ObstacleKind
    y: Array
    reach: float
    gap: float
    reason: str

    def covers(self, point: Point) -> bool:
        """Whether the point is still at this obstacle."""
        return float(np.linalg.norm(point.y - self.y)) <= 4.0 * self.reach


class UncertifiedZoneError(SimulationError):
    """A fixed step would enter a zone without a bridge; caught by the stepping loop."""

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(obstacle.reason, obstacle.y)
        self.obstacle = obstacle


def steepest(path: RegularPath, point: Point) -> Array:
    """∇_y det of the worst block, scaled so that each coordinate counts by the motion it makes."""
    if path.m == 1:
        return np.ones(1)
    block = int(np.argmin(point.rcond))
    motion = np.abs(point.G / path.mechanism.column_scale[:, None]).max(axis=0)
    eps = 1e-3 * max(point.conditioning, 1e-9) / motion
    gradient = np.zeros(path.m)
    for j, e in enumerate(np.diag(eps)):
        ahead = march(path, point, point.y + e, point.ydot)
        behind = march(path, point, point.y - e, point.ydot)
        gradient[j] = (ahead.det[block] - behind.det[block]) / motion[j] / (2.0 * eps[j])
    direction = gradient / motion
    return np.asarray(direction / np.linalg.norm(direction), dtype=float)


def classify(path: RegularPath, point: Point, failure: NoBridgeError) -> Obstacle:
    """Tell a toggle (K stays regular) from a near miss and from what second order leaves open."""
    d = steepest(path, point)
    block = int(np.argmin(point.rcond))
    size = path.size(point.G @ d)
    eps = 1e-3 * point.conditioning / size
    ahead = march(path, point, point.y + eps * d, point.ydot)
    change = float(ahead.det[block] - point.det[block]) / eps
    reach = abs(float(point.det[block]) / change) if change else 1.0 / size
    inward = d if float(point.det[block]) * change < 0.0 else -d
    reason = str(failure)
    if _regularity(path, point) > CLEARLY * point.conditioning:
        return Obstacle("toggle", point.y, reach, failure.residual, reason)
    if np.isfinite(failure.separation):
        return Obstacle("tangential", point.y, reach, failure.residual, reason)
    try:
        deep = march(path, point, point.y + 2.0 * reach * inward, point.ydot, DEPTH * point.conditioning)
    except BranchError:
        return Obstacle("unknown", point.y, reach, failure.residual, reason)
    if deep.conditioning > 2.0 * DEPTH * point.conditioning:
        return Obstacle("near miss", point.y, reach, failure.residual, reason)
    growth = _regularity(path, deep) / deep.conditioning
    if growth > 2.0 * _regularity(path, point) / point.conditioning:
        return Obstacle("toggle", point.y, reach, failure.residual, reason)
    kind: ObstacleKind = "near miss" if np.isfinite(failure.residual) else "unknown"
    return Obstacle(kind, point.y, reach, failure.residual, reason)


def reconsidered(path: RegularPath, obstacle: Obstacle, deep: Point, zone: float) -> Obstacle:
    """The obstacle as a point deep in its zone shows it, to which the motion came.

    With several coordinates the straight line that `classify` looks along may pass by a toggle that
    the motion runs into. Where modes pass each other K is as poor as K_d; at a toggle it is regular.
    """
    if obstacle.kind == "near miss" and _regularity(path, deep) >= zone:
        return replace(obstacle, kind="toggle")
    return obstacle


def _regularity(path: RegularPath, point: Point) -> float:
    """σ_min/σ_max of the selected rows of K: stays large at a toggle, vanishes where modes meet."""
    mechanism = path.mechanism
    s = np.linalg.svd(mechanism.scaled(mechanism.K(point.q))[path.rows], compute_uv=False)
    path.counters.svds += 1
    return float(s[-1] / s[0]) if numerical_rank(s, 0.0) else 0.0


def refusal(path: RegularPath, obstacle: Obstacle, here: Point) -> SimulationError:
    """The error that an obstacle ends a run with."""
    mechanism = path.mechanism
    where = f"y = {np.array2string(here.y, precision=6)} ({', '.join(mechanism.independent)})"
    figures = {"conditioning": here.conditioning, "gap": obstacle.gap}
    if obstacle.kind == "toggle":
        choices = [
            names
            for _, names in mechanism.coordinate_choices(here.q)
            if set(names) != set(mechanism.independent)
        ]
        return ToggleError(
            f"toggle at {where}: K_d is singular while K is not, the independent coordinates turn "
            f"back here and cannot parametrise the motion; joints that can: {spelled(choices)} (or pass "
            'on_toggle="repartition")',
            here.y,
            choices,
            **figures,
        )
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
