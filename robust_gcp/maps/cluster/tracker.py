"""Following one cluster's mode: regular ground by continuation, singular places by bridges."""

from __future__ import annotations

import numpy as np

from ...mechanism.tree.tree import Array
from ..explicit import Counters
from .apex import BESIDE, LEFT, BesideApex, apex_near
from .chart import apart, turned_over
from .curve import Curve
from .curve_builder import CORRECTION, MAX_STEPS, REACH
from .jet import Jet, LostError, jet, solved
from .known_curves import KnownCurves
from .obstacles import APEX, CONE_WORDS, FARTHEST_LOOK, Obstacle, ObstacleError, approaching, judge
from .options import BridgeOptions, NoBridgeError
from .patch import Patch, stays_clear
from .patch_builder import PatchBuilder
from .space import ClusterSpace

NEAR_APEX, TURNED = 0.1, 0.3
"""In place of `REACH` beside the apex of a cone, and the sine by which its tangent plane may turn in such a
step: two sheets are as near to each other there as the apex is."""

STAGES_AHEAD = 40.0
"""How many stages of a fixed step away modes must stay that veer without a crossing: 20 steps of RK4."""


class Tracker:
    """One mode of one cluster, followed from point to point.

    Parameters
    ----------
    anchor : Jet
        A solved point of the mode, in the chart that y is given in.
    options : BridgeOptions
    zone : float
        Distance to the singular set at which bridges take over.
    counters : Counters

    Attributes
    ----------
    current : Curve, Patch or None
        The bridge in use.
    error_controlled : bool
        Whether the caller controls its error, so that places without a bridge may be passed.
    touched : list of Curve or Patch
        Bridges met since the list was emptied.
    """

    def __init__(self, anchor: Jet, options: BridgeOptions, zone: float, counters: Counters) -> None:
        self.space: ClusterSpace = anchor.space
        self.anchor, self.options, self.zone, self.counters = anchor, options, zone, counters
        self.C = anchor.C
        # curves through places where modes touch that other runs with these options have built
        self.known = KnownCurves([curve for given, curve in self.space.bridged if given == options])
        self.current: Curve | Patch[Tracker] | None = None
        self.u = 0.0  # of `current`, where that is a curve
        self.error_controlled = False
        self.touched: list[Curve | Patch[Tracker]] = []
        self.obstacles: list[Obstacle] = []
        self.seen: Obstacle | None = None
        self._beside: Patch[Tracker] | None = None  # built last where the motion had not reached it
        self._left: Patch[Tracker] | None = None  # in use before the tracker was put elsewhere
        self._apexless = np.full(self.space.nv, np.inf)  # where no apex was found last

    def copy(self) -> Tracker:
        """Another tracker at the same point, which knows the same curves."""
        other = self.nested(self.anchor, self.zone)
        other.known, other.u = KnownCurves(self.known.curves), self.u
        other.current = self.current if isinstance(self.current, Curve) else None
        return other

    def twin(self) -> Tracker:
        """Another one at the same point with a line of its own: the nodes of one follow whoever uses it."""
        other = self.copy()
        other.current = self.current.twin() if isinstance(self.current, Patch) else other.current
        return other

    def nested(self, anchor: Jet, zone: float) -> Tracker:
        """A tracker of a smaller zone for a node."""
        other = Tracker(anchor, self.options, zone, self.counters)
        other.error_controlled = self.error_controlled
        return other

    def place_at(self, anchor: Jet) -> None:
        """Go on from another solved point of the mode."""
        self._left = self.current if isinstance(self.current, Patch) else self._left
        self.anchor, self.C, self.current = anchor, anchor.C, None

    def back_at(self, x: Array) -> bool:
        """Go on at a point of a bridge where K may tell nothing; whether there is one."""
        found = self.known.curve_at(x)
        if found is not None:
            self.current, self.u = found
            self.anchor = found[0].jet(self.C, self.u)
        return found is not None

    @property
    def obstacle(self) -> Obstacle | None:
        """What it is at, where it has no bridge."""
        at = self.anchor.x
        known = reversed(self.obstacles) if self.current is None else ()
        return next((obstacle for obstacle in known if obstacle.covers(at)), None)

    def jet_at(self, y: Array) -> Jet:
        """The point at y on the mode.

        Raises
        ------
        LostError
            When y cannot be reached on this mode by the steps taken.
        ObstacleError
            At a place without a bridge, unless `error_controlled`.
        """
        for _ in range(40):  # each round enters or leaves one bridge
            found = self._on_bridge(y) if self.current is not None else self._continue(y)
            if found is not None:
                self.anchor = found
                return found
        raise LostError("too many singular places on the way")

    # ----------------------------------------------------------------- on a bridge

    def _on_bridge(self, y: Array) -> Jet | None:
        """The point from the bridge in use; None, with the anchor on regular ground, once y has left it."""
        bridge = self.current
        assert bridge is not None
        if isinstance(bridge, Patch):
            eta = bridge.towards(self.anchor, y)
            point = bridge.jet_at(y, self.C, eta)
            if point is not None:
                self._touch(bridge)
                return point
            node = bridge.inner(bridge.s(eta))
            self.anchor, self.current, self.u = node.anchor.recharted(self.C), node.current, node.u
            return None
        u = bridge.parameter(self.C, float(y[0]), self.u)
        if u is not None and bridge.contains(u):
            self._touch(bridge)
            self.u = u
            return bridge.jet(self.C, u)
        to = bridge.beyond(self.C, float(y[0]), self.u) if u is None else u
        if bridge.kind == "within":
            self.current, self.u = self.known.next_window(bridge, to, self.options)
            return None
        self.current = None
        self.anchor = bridge.inner(to).recharted(self.C)
        return None

    # ----------------------------------------------------------------- on regular ground

    def _continue(self, y: Array) -> Jet | None:
        """March towards y; None with a bridge in use where one is entered."""
        here = self.anchor
        if not here.solved:
            here = self.anchor = jet(self.space, here.x, self.C)  # interpolated: σ, U are not known
        limit = 1.0
        for _ in range(MAX_STEPS):
            distance = here.nearest()[0]
            if self.error_controlled and self.space.m > 1:
                self._look_for_apex(here, distance)
            step = y - here.y
            size = float(np.linalg.norm(here.J @ step))  # along the mode: y may be turning back
            if distance < self.zone and self._enter(here, y):
                return None
            self._look_ahead(here, size)
            reach = (NEAR_APEX if isinstance(self.space, BesideApex) else REACH) * min(here.delta(), limit)
            share = min(1.0, reach / size) if size > 0.0 else 1.0
            target = y if share == 1.0 else here.y + share * step
            found = self._step(here, share * step, target, share * size)
            if found is None:
                limit = 0.5 * min(limit, share * size / REACH)  # half of what failed, as a distance
                if limit < 1e-9:
                    raise LostError("the mode cannot be followed")
                continue
            limit = min(1.0, 2.0 * limit)
            here = self.anchor = found
            if share == 1.0:
                return None if here.nearest()[0] < self.zone and self._enter(here, y) else here
        raise LostError("the mode cannot be followed: too many small steps")

    def _look_ahead(self, here: Jet, size: float) -> None:
        """Refuse a fixed step that would pass too fast by modes that veer away from each other."""
        if self.error_controlled or here.delta() >= min(max(self.zone, STAGES_AHEAD * size), FARTHEST_LOOK):
            return
        self._at_obstacle()
        if self.seen is None or not self.seen.covers(here.x):
            self.seen = approaching(here, self.options)
        obstacle = self.seen
        if obstacle.kind != "crossing" and obstacle.approach < STAGES_AHEAD * size:
            self.obstacles = [*self.obstacles[-MAX_STEPS:], obstacle]
            raise ObstacleError(obstacle)

    def _step(self, here: Jet, step: Array, target: Array, size: float) -> Jet | None:
        """One continuation step; None where Newton left the mode."""
        self.counters.marching_steps += 1
        try:
            found, first = solved(self.space, here.predicted(step), self.C, target, here.P)
        except LostError:
            return None
        self.counters.svds += 1
        # rounding of φ looks like a lost branch where K is poor
        allowed = CORRECTION * size + 1e-12 + 1e-14 / max(min(here.sigma, found.sigma), 1e-12)
        lost = first > allowed or turned_over(here.J, found.J)
        lost = lost or (
            isinstance(self.space, BesideApex) and apart(here.tangent(), found.tangent()) > TURNED
        )
        return None if lost else found

    # ----------------------------------------------------------------- bridges

    def _enter(self, here: Jet, y: Array) -> bool:
        """Put a bridge in use at a point in the zone, when y lies on it or beyond it."""
        if self._at_obstacle():
            return False
        return self._enter_patch(here, y) if self.space.m > 1 else self._enter_curve(here, y)

    def _enter_curve(self, here: Jet, y: Array) -> bool:
        found = self.known.through(here, self.zone)
        if found is None:
            try:
                built = self.known.built(here, self.zone, self.options)
            except NoBridgeError as failure:
                return self._blocked(here, failure)
            if built is None:
                return False
            self.counters.bridges_built += 1
            self.counters.second_order += 1
            found = built, built.u(here.x)
        curve, u = found
        there = curve.parameter(self.C, float(y[0]), u)
        to = curve.beyond(self.C, float(y[0]), u) if there is None else there
        if not curve.contains(to) and (u - curve.center) * (to - curve.center) > 0.0:
            return False  # beside it, not across
        self._touch(curve)
        self.current, self.u = curve, u
        return True

    def _enter_patch(self, here: Jet, y: Array) -> bool:
        if isinstance(self.space, BesideApex) or stays_clear(here, y, self.zone):  # no mode crosses an apex
            return False
        if self._beside is not None and self._beside.leads_to(here) and not self._beside.serves(here, y):
            return False
        if self._left is not None and self._left.passes(here, self.zone):
            self.current = self._left
            return True
        try:
            patch = PatchBuilder(self, here, self.options, self.zone).build()
            self.counters.bridges_built += 1
        except (NoBridgeError, ObstacleError) as failure:
            return self._blocked(here, failure)
        if not patch.serves(here, y):
            self._beside = patch  # to say so of the next points without building again
            return False
        self.current = patch
        return True

    def _look_for_apex(self, here: Jet, distance: float) -> None:
        """Take φ relative to the apex of a cone that is near; an error where it is too near."""
        space = self.space
        if isinstance(space, BesideApex):
            if distance > LEFT:
                self.space = space.plain
            elif distance < APEX:
                raise ObstacleError(Obstacle("cone", here.x, 0.5 * distance, 0.0, CONE_WORDS, distance))
        elif distance < BESIDE and float(np.linalg.norm(here.x - self._apexless)) > 0.5 * distance:
            apex = apex_near(here, self.options.largest_gap)
            if apex is None:
                self._apexless = here.x
            else:
                self.space = BesideApex(space, apex)

    def _blocked(self, here: Jet, failure: NoBridgeError | ObstacleError) -> bool:
        """Remember a place without a bridge; an error unless the caller controls its own."""
        if isinstance(failure, ObstacleError):  # met by a node
            if not self.error_controlled:
                raise failure
            failure = NoBridgeError(failure.obstacle.reason)
        obstacle = judge(here, failure, self.options, self.zone)
        self.obstacles = [*self.obstacles[-MAX_STEPS:], obstacle]
        self._require_passable(obstacle)
        return False

    def _at_obstacle(self) -> bool:
        """Whether it is at one still; an error unless the caller controls its own."""
        obstacle = self.obstacle
        if obstacle is not None:
            self._require_passable(obstacle)
        return obstacle is not None

    def _require_passable(self, obstacle: Obstacle) -> None:
        if not self.error_controlled or obstacle.stops(self.anchor.nearest()[0], self.zone):
            raise ObstacleError(obstacle)

    def _touch(self, bridge: Curve | Patch[Tracker]) -> None:
        if bridge not in self.touched:
            self.touched.append(bridge)
            if isinstance(bridge, Curve):
                self.known.used(bridge)
