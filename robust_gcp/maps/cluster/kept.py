"""Bridges that were built before, taken again at points that lie on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from ...errors import SimulationError
from ...mechanism.tree import Array
from .curve import Curve
from .jet import Jet
from .patch import Follower, Patch

F = TypeVar("F", bound=Follower)

SAME = 1e-8
"""Distance, dimensionless, within which a point lies on a line: lines are certified to less."""

UPON, CLEAR = 0.1, 1.5
"""Distances to a singular surface, in zones: up to which a point is at it, and beyond which no line across
it is asked for."""


def curve_through(curves: Sequence[Curve], here: Jet, zone: float) -> tuple[Curve, float] | None:
    """The last curve through a point and its u there, if the nearest singular place is one of its own.

    Parameters
    ----------
    curves : sequence of Curve
        Each stands for itself after any whole turns of its hinges too.
    here : Jet
    zone : float
    """
    for curve in reversed(curves):
        turned = _turned(curve, here.x)
        u = turned.passes(here.x)
        if u is None:
            continue
        mu = here.recharted(turned.C).roots(np.ones(1))
        first = float(mu[np.argmin(np.abs(mu))].real)  # of modes in contact of order k, k times as far
        off = [abs(u + turned.times_as_far(i) * first - root) for i, root in enumerate(turned.roots)]
        if turned.contains(u) or min(off, default=np.inf) < 0.5 * zone:
            return turned, u
    return None


def _turned(curve: Curve, x: Array) -> Curve:
    """The curve after the whole turns of the hinges that bring it next to x."""
    space = curve.space
    if not space.flat:
        return curve
    away = (x - curve.point(curve.center)[0]) * space.D
    turns = np.where(space.tree.periodic, np.round(away / (2.0 * np.pi)), 0.0)
    return curve.turned(2.0 * np.pi * turns / space.D) if np.any(turns) else curve


def stays_clear(here: Jet, y: Array, zone: float) -> bool:
    """Whether y is so far on a point's side of the singular surface that no line across it would reach it."""
    distance, way = here.nearest()  # σ grows that way, of unit arc length
    return distance + float((here.J @ (y - here.y)) @ (here.J @ way)) > CLEAR * zone


def passes(patch: Patch[F], here: Jet, zone: float) -> bool:
    """Whether a line, moved there, goes through a point.

    For a point at a singular place, where it does not tell its mode, and no line can be begun.
    """
    eta = patch.C.T @ here.x
    if here.nearest()[0] > UPON * zone or patch.space is not here.space or not patch.contains(patch.s(eta)):
        return False
    try:
        point = patch.point(eta)
    except (SimulationError, np.linalg.LinAlgError):
        return False
    return point is not None and float(np.linalg.norm(point.x - here.x)) < SAME
