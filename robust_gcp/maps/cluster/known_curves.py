"""Bridges that were built before, taken again at points that lie on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...mechanism.tree.tree import Array
from .curve import Curve
from .curve_builder import CurveBuilder
from .jet import Jet
from .obstacles import Obstacle, ObstacleError, is_near_miss
from .options import BridgeOptions, NoBridgeError
from .singular_place import place
from .space import ClusterSpace
from .touching.meeting_ahead import TOLD, MeetingAhead, met_before, through, through_meeting, touches_ahead
from .touching.singular_mode import OVERLAP, window

SAME = 1e-8
"""Distance, dimensionless, within which two singular places are one."""

MAX_CURVES = 16
"""Curves kept for reuse; a mechanism that turns over meets a new one each half turn."""


class KnownCurves:
    """Curves that were built, to be met again, and what is known of places without one.

    Attributes
    ----------
    curves : list of Curve
        The last ones; those through modes that touch in the order of their use.
    ahead : MeetingAhead or None
        Where modes seemed to touch farther ahead.
    """

    def __init__(self, curves: Sequence[Curve] = ()) -> None:
        self.curves = list(curves)
        self.ahead: MeetingAhead | None = None

    def through(self, here: Jet, zone: float) -> tuple[Curve, float] | None:
        """The last curve through a point and its u there, if the nearest singular place is one of its own.

        Each stands for itself after any whole turns of its revolute joints too.
        """
        for curve in reversed(self.curves):  # a crank comes back to the one that it used last
            turned = turned_to(curve, here.x)
            u = turned.passes(here.x)
            if u is not None and (
                turned.contains(u) or min(turned.beside(here), default=np.inf) < 0.5 * zone
            ):
                if turned is not curve:
                    self.keep(turned)
                return turned, u
        return None

    def curve_at(self, x: Array) -> tuple[Curve, float] | None:
        """The curve that was used last at a point, where K may tell nothing, and u there.

        Of modes that touch, and such as lie in the singular set.
        """
        for curve in reversed(self.curves):
            u = curve.passes(x) if curve.inside is not None else None
            if u is not None and curve.contains(u):
                return curve, u
        return None

    def keep(self, curve: Curve) -> None:
        """Remember a curve."""
        self.curves = [*self.curves[-MAX_CURVES + 1 :], curve]

    def used(self, curve: Curve) -> None:
        """Remember that it was used."""
        if curve.inside is not None and curve in self.curves:
            self.curves = [*(known for known in self.curves if known is not curve), curve]

    def built(self, here: Jet, zone: float, options: BridgeOptions) -> Curve | None:
        """A new curve; None where the next place is one of a curve's beside, or too far ahead to be told.

        Raises
        ------
        NoBridgeError
        """
        if self.ahead is not None and self.ahead.covers(here.x):
            return None
        # beside modes in contact K is nearly singular long before their place: it is known already
        if any(known.is_beside(here) for known in self.curves if known.orders):
            return None
        curve = None if (met := met_before(here, options)) is None else through(met, here, options)
        if curve is None:
            distance = here.nearest()[0]
            _require_new(here, distance, options)
            try:
                curve = self._of_any_order(here, distance, zone, options)
            except NoBridgeError as failure:
                _remember(here, distance, options, failure)
                raise
        if curve is None:
            return None
        self.keep(curve)
        if curve.orders:
            here.space.bridged = (*here.space.bridged[1 - MAX_CURVES :], (options, curve))
        # a meeting is known from beyond the piece of mode that its curve holds
        return curve if curve.inside is None or curve.through.reaches(curve.u(here.x)) else None

    def _of_any_order(self, here: Jet, distance: float, zone: float, options: BridgeOptions) -> Curve | None:
        """A new curve by second order, or else by the meeting ahead; None where that is too far away yet."""
        before = self.ahead
        if before is not None and touches_ahead(here):  # second order has failed from farther away
            failure = before.failure
        else:
            try:
                return CurveBuilder(here, options, zone).build()
            except NoBridgeError as found:
                # no look from nearer would change these: the order of modes that touch alone is told there
                if is_near_miss(place(here), options) or (distance > TOLD and not touches_ahead(here)):
                    raise
                failure = found
        if distance <= TOLD:
            touching = through_meeting(here, options, failure)
            if touching is not None:
                return touching
        # once in 0.05 of the way at most: a look takes up to half a second
        self.ahead = MeetingAhead(here.x, max(distance - TOLD, 0.05), failure)
        return None

    def next_window(self, last: Curve, u: float, options: BridgeOptions) -> tuple[Curve, float]:
        """The window in which a mode in the singular set goes on where it leaves the last one at u.

        Raises
        ------
        ObstacleError
            Where the mode leaves it.
        """
        edge = min(max(u, last.left), last.right)
        x = last.point(edge)[0]
        for curve in reversed(self.curves):
            at = curve.passes(x) if curve is not last and curve.kind == "within" else None
            if at is not None and abs(at - curve.center) < OVERLAP * 0.5 * (curve.right - curve.left):
                return curve, at
        try:
            made = window(last.space, x, last.through.nodes[0].P, options)
        except NoBridgeError as failure:
            raise ObstacleError(Obstacle("unknown", x, 0.1, np.nan, str(failure))) from failure
        self.keep(made)
        return made, made.u(x)


class NearMiss(NamedTuple):
    """A singular place that modes pass without a bridge, as it was judged with some options.

    Attributes
    ----------
    options : BridgeOptions
    x : ndarray (nv,)
        The place.
    since : float
        Half how far from it a bridge was tried: nearer, one is tried again; 0 where no look decides more.
    words : str
    residual : float
        Of the `NoBridgeError`.
    """

    options: BridgeOptions
    x: Array
    since: float
    words: str
    residual: float


def _require_new(here: Jet, distance: float, options: BridgeOptions) -> None:
    """The error that was raised beside a near miss before, where it would be again."""
    # Attempts at bridges take half a second, the place alone a millisecond, and a crank passes it each turn.
    known = [miss for miss in here.space.near_misses if miss.options == options]
    at = place(here).x if known else here.x
    for miss in known:
        off = at - miss.x
        if np.abs(off - _whole_turns(here.space, off)).max() < SAME and distance > miss.since:
            raise NoBridgeError(miss.words, miss.residual)


def _remember(here: Jet, distance: float, options: BridgeOptions, failure: NoBridgeError) -> None:
    """That there is no bridge where modes pass each other."""
    at, space = place(here), here.space
    if at.found and at.gap > options.largest_gap and failure.met is None and np.isnan(failure.separation):
        since = 0.0 if distance <= TOLD else 0.5 * distance  # nearer than TOLD all was tried
        miss = NearMiss(options, at.x, since, str(failure), failure.residual)
        space.near_misses[:] = [*space.near_misses[1 - MAX_CURVES :], miss]


def turned_to(curve: Curve, x: Array) -> Curve:
    """The curve after the whole turns of the revolute joints that bring it next to x."""
    space = curve.space
    turns = _whole_turns(space, x - curve.point(curve.center)[0])
    return curve.turned(turns) if np.any(turns) else curve


def _whole_turns(space: ClusterSpace, away: Array) -> Array:
    """Those of revolute joints in a difference of two points."""
    if not space.flat:
        return np.zeros(len(away))
    turns = np.where(space.tree.periodic, np.round(away * space.D / (2.0 * np.pi)), 0.0)
    return np.asarray(2.0 * np.pi * turns / space.D)
