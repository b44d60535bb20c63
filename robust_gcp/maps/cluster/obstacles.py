"""Places near which a motion has no certified bridge: what they are, and how they are told apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...errors import SimulationError
from ...mechanism.tree.tree import Array
from .jet import Jet
from .options import BridgeOptions, NoBridgeError
from .singular_place import Place, place
from .touching.meeting import Meeting

DEEP = 0.3
"""Share of the zone within which an undecided place stops a motion that is followed with error control."""

FARTHEST_LOOK = 0.5
"""Distance beyond which nothing is looked for, dimensionless joint units."""

CLEARLY = 0.1
"""|λ₂/λ₁| of the form Q above which modes cross or pass each other, and do not touch."""

APEX = 1e-6
"""Distance to the singular set beside a cone within which the motion is refused: at the apex itself it is not
determined."""

CONE_WORDS = "an isolated cone of the configuration space: modes meet there in a point, none crosses it"

ObstacleKind = Literal["crossing", "toggle", "near miss", "tangential", "cusp", "cone", "unknown"]


@dataclass(frozen=True)
class Obstacle:
    """A place near which the motion has no certified bridge.

    Attributes
    ----------
    kind : {"crossing", "toggle", "near miss", "tangential", "cusp", "cone", "unknown"}
    x : ndarray (nv,)
        Where it was met.
    radius : float
        How far from there the verdict holds.
    gap : float
        By how much the loops fail to close at the singular place, in lengths; NaN where that is unknown.
    reason : str
    approach : float
        How near the motion comes to it; 0 where that is unknown.
    met : Meeting or None
        What the modes do there, of a cusp.
    """

    kind: ObstacleKind
    x: Array
    radius: float
    gap: float
    reason: str
    approach: float = 0.0
    met: Meeting | None = None

    def stops(self, distance: float, zone: float) -> bool:
        """Whether a motion followed with error control ends at this distance from the singular set."""
        if self.kind == "near miss":
            return False
        return distance < (APEX if self.kind == "cone" else DEEP * zone)

    def covers(self, x: Array) -> bool:
        """Whether x is still at this place."""
        return float(np.linalg.norm(x - self.x)) <= self.radius


UNBRIDGED = Obstacle("unknown", np.empty(0), 0.0, np.nan, "no bridge leads on from here")
"""What the compiled kernel met, where nobody need look again."""


class ObstacleError(SimulationError):
    """A fixed step would come near a singular place without a bridge."""

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(obstacle.reason)
        self.obstacle = obstacle


def is_near_miss(found: Place, options: BridgeOptions) -> bool:
    """Whether modes clearly pass each other: two directions bend at the place, and the loops stay open."""
    size = np.abs(found.eigenvalues)
    return found.found and found.gap > options.largest_gap and bool(size[1] > CLEARLY * size[0])


def judge(here: Jet, failure: NoBridgeError, options: BridgeOptions, zone: float) -> Obstacle:
    """What a place without a bridge is, by the singular configuration next to it."""
    delta = here.delta()
    # looked at again only where it decides: half way to a near miss, deep in the zone of anything else
    radius = max(0.9 * delta, 0.5 * DEEP * zone) if np.isfinite(delta) else 0.1
    if isinstance(failure.met, Meeting):
        star = failure.met.star
        radius = 1.05 * float(np.linalg.norm(here.x - star))  # all the way to it
        return Obstacle("cusp", star, radius, failure.met.gap, str(failure), met=failure.met)
    if np.isfinite(failure.separation):  # the loops close all along, but second order does not part the modes
        return Obstacle("tangential", here.x, radius, np.nan, str(failure))
    found = place(here)
    if found.is_cone:
        return Obstacle("cone", here.x, radius, found.gap, CONE_WORDS)
    if found.found and found.gap > options.largest_gap:
        return Obstacle("near miss", here.x, radius, found.gap, str(failure))
    return Obstacle("unknown", here.x, radius, np.nan, str(failure))


def approaching(here: Jet, options: BridgeOptions) -> Obstacle:
    """What the singular place ahead of a point is, before any bridge is tried."""
    found = place(here)
    radius = 0.5 * min(here.delta(), 1.0)  # the place is known better from half way
    if not found.found or np.linalg.norm(found.x - here.x) > 2.0 * FARTHEST_LOOK:
        return Obstacle("crossing", here.x, radius, np.nan, "nothing singular near by")
    if found.is_cone:
        # modes that meet in the apex have no gap, so `approach` is 0: then its distance bounds the motion's
        near = float(np.linalg.norm(found.x - here.x))
        return Obstacle("cone", here.x, radius, found.gap, CONE_WORDS, min(near, found.approach or near))
    if found.gap <= options.largest_gap:
        return Obstacle("crossing", here.x, radius, found.gap, "modes cross")
    words = "two modes pass each other"
    return Obstacle("near miss", here.x, radius, found.gap, words, found.approach)
