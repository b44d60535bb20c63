"""A meeting of modes ahead of a point: when it is looked at, what it is, and the bridge through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....mechanism.tree.tree import Array
from ..curve import Curve
from ..jet import Jet, LostError, nearest_of, solved
from ..options import BridgeOptions, NoBridgeError
from .extrapolation import extrapolated
from .meeting import Meeting, meeting
from .meeting_builder import bridge_through

SEEN, MOST_CONTACT, FARTHEST = 0.1, 8.0, 0.7
"""Share of the first-order distance over which it is seen to shrink; orders and distances looked for."""

TOUCHING = 1.3
"""Order from which modes are taken to touch ahead: 1 where they cross, 1.5 at a cusp, 2 and more else."""

MOST_KEPT = 16
"""Meetings kept with a cluster; a mechanism that turns over comes to new ones each turn."""

TOLD = 0.12
"""First-order distance at which a meeting is looked at: one of order k lies k times as far."""


@dataclass(frozen=True)
class MeetingAhead:
    """Modes that meet too far ahead to be told apart: within `radius` of x it is not looked at again.

    `failure` says why second order does not serve.
    """

    x: Array
    radius: float
    failure: NoBridgeError

    def covers(self, x: Array) -> bool:
        """Whether x is that near to where it was looked at."""
        return float(np.linalg.norm(x - self.x)) <= self.radius


def met_before(here: Jet, options: BridgeOptions) -> Meeting | None:
    """The meeting near by that was found before, from here or elsewhere on its modes."""
    known = (met for given, met in reversed(here.space.met) if given == options)
    return next((met for met in known if met.tells(here.x)), None)


def through_meeting(here: Jet, options: BridgeOptions, failure: NoBridgeError) -> Curve | None:
    """The bridge of a mode through the meeting ahead of a regular point; None where that is too far away yet.

    Raises
    ------
    NoBridgeError
        Where no modes meet, or digits do not suffice; `failure` where second order says why.
    """
    try:
        found = meeting(here.space, here.x, here.P, _way_to_place(here), options)
    except (LostError, np.linalg.LinAlgError):
        return extrapolated(here, options)  # more than two modes, or of corank above one
    if found.kind not in ("meets", "cusp"):  # a place where second order failed for another reason
        raise failure
    here.space.met = (*here.space.met[1 - MOST_KEPT :], (options, found))
    return through(found, here, options)


def through(found: Meeting, here: Jet, options: BridgeOptions) -> Curve | None:
    """The bridge of a mode through a meeting; None where that is too far away yet.

    Raises
    ------
    NoBridgeError
        At a cusp, and where digits do not suffice.
    """
    if found.kind == "cusp":
        raise NoBridgeError("the mode ends in a cusp", met=found)
    return bridge_through(found, here, options)


def touches_ahead(here: Jet, order: float = TOUCHING) -> bool:
    """Whether modes seem to touch at the place ahead, from how fast it comes nearer to first order."""
    try:
        return _order_ahead(here)[1] > order
    except (LostError, np.linalg.LinAlgError):
        return False


def _way_to_place(here: Jet) -> Array:
    """The way to the place ahead, along the tangent."""
    first, order = _order_ahead(here)
    return here.tangent()[:, 0] * float(np.clip(order * first, -FARTHEST, FARTHEST))


def _order_ahead(here: Jet) -> tuple[float, float]:
    """The place ahead to first order along the tangent, and the order of contact there.

    To first order modes in contact of order k meet k times as near as they do: the place comes nearer by
    1/k of what is gone towards it.
    """
    tangent = here.recharted(here.tangent())
    way = np.ones(1) if here.space.m == 1 else tangent.nearest()[1]
    first = _first_order(tangent, way)
    step = SEEN * first
    near, _ = solved(here.space, tangent.predicted(step * way), tangent.C, tangent.y + step * way, here.P)
    # beside a mode that hardly comes nearer, as one in the singular set, the order would be infinite
    return first, 1.0 / max((first - _first_order(near, way)) / step, 1.0 / MOST_CONTACT)


def _first_order(jet: Jet, way: Array) -> float:
    """The singular place next to a point of a mode, to first order, this way in its chart."""
    mu = jet.roots(way)
    if not len(mu):
        raise LostError("no singular place lies ahead")
    return nearest_of(mu).real
