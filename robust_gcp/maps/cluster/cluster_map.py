"""The default explicit map: classical GCP where K_d is good, cluster by cluster where it is not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from ...errors import SimulationError
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..explicit import Charted, Crossing, Point, Stretch
from ..regular_path import RegularPath
from .apex import rounding
from .chart import CHANGE, quality
from .jet import Jet, LostError
from .obstacles import Obstacle, ObstacleError
from .options import LAST_RESORT, BridgeOptions
from .passages import passages
from .product import chart_coordinates, in_charts, is_far, product
from .refusal import refusal, toggle_at, too_large, what_stopped, where_refused
from .regular_ground import RegularGround
from .renewal import jet_at, recharted, tracker_at, whole_point
from .space import space_of
from .tracker import Tracker
from .tracker_numbers import read, written

ONE_TURN = 2.0 * np.pi
"""Largest rotation between evaluations, rad, or slide in lengths, that is followed in small steps."""

LEFT_OPEN = 1e-9
"""max |φ| / length that rows may keep which depend on the others: the rounding of a model's numbers."""


class ClusterMap(Charted):
    """q = γ(y), G and g on one mode, with full accuracy through singular configurations.

    On regular ground all clusters are solved at once (`RegularPath`). Where K_d is poorly conditioned γ is
    the product of the clusters' own maps and of the free joints, and G is block diagonal.

    Parameters
    ----------
    path : RegularPath
    start : Point
        A point of the mode.
    options : BridgeOptions
    error_controlled : bool
        Whether the caller controls its error, so that places without a certified bridge may be passed on
        the true curve; else `ObstacleError` is raised there.
    trackers : mapping of int to Tracker
        For clusters that start at a singular configuration: on the mode, at the start.

    Attributes
    ----------
    in_zone : bool
        Whether the point evaluated last was found cluster by cluster, beside or on a bridge.
    """

    def __init__(
        self,
        path: RegularPath,
        start: Point,
        options: BridgeOptions,
        error_controlled: bool = False,
        trackers: Mapping[int, Tracker] | None = None,
        last_resort: float = LAST_RESORT,
    ) -> None:
        self._ground, self.options = RegularGround(path, options.zone), options
        self.error_controlled, self._last_resort = error_controlled, last_resort
        self.mechanism = path.mechanism
        self.clusters = self.mechanism.clusters
        self._trackers: list[Tracker] | None = None
        self.in_zone = False
        self.anchor = start
        self._own: Point | None = start  # the anchor, where trackers are at it
        self._arriving: Callable[[], Array] | None = None
        self._arriving_met: bool | None = None
        if trackers:
            self._enter(start, trackers)

    @property
    def path(self) -> RegularPath:
        """What solves on regular ground."""
        return self._ground.path

    @contextmanager
    def following_true_curve(self) -> Iterator[None]:
        """Within this context the caller controls its error."""
        before, self.error_controlled = self.error_controlled, True
        try:
            yield
        finally:
            self.error_controlled = before

    def point_at(self, y: Array, ydot: Array) -> Point:
        """The point at y on the mode.

        Raises
        ------
        ToggleError, NotCertifiedError, BranchError
            When y cannot be reached on this mode.
        ObstacleError
            See `error_controlled`.
        """
        # a rejected step, or a stage back in time: the trackers are still where that one ended
        if self.anchor is not self._own:
            self._restart()
        point = None if self.in_zone else self._ground.step(self.anchor, y, ydot)
        if point is None:
            self._own = None  # where it is refused, trackers may have gone some of the way: not on from there
            point = self._by_clusters(y, ydot)
        self.anchor = self._own = point
        return point

    @property
    def on_bridge(self) -> bool:
        """Whether the point evaluated last, here, lies on a bridge."""
        return self.in_zone and any(tracker.current is not None for tracker in self._trackers or [])

    def rounding(self) -> tuple[float, float, float]:
        """What rounding costs of G where there is no bridge, see `apex.rounding`."""
        trackers = self._known_trackers() if self.in_zone else []
        return rounding(tracker.anchor for tracker in trackers if tracker.current is None)

    def beside_apex(self, mechanism: Mechanism) -> tuple[RegularPath, Point, Mapping[int, Tracker]] | None:
        """Where the map is, in the coordinates of `mechanism`; None but beside the apex of a cone."""
        trackers = self._known_trackers() if self.in_zone else []
        return recharted(mechanism, self.path, self.anchor, trackers, self.options)

    @property
    def met(self) -> bool:
        """Whether a bridge was met so far."""
        if self._arriving is not None and self._arriving_met is not None:
            return self._arriving_met
        return any(tracker.touched for tracker in self._known_trackers())

    def passed(self, before: Point, after: Point, stretch: Stretch) -> list[Crossing]:
        """All singular places between two accepted points."""
        return passages(self._known_trackers(), before, after, stretch, self.mechanism)

    # --------------------------------------------------------------------- regular ground

    def _restart(self) -> None:
        """Go on from a point that the caller put back: solved anew, with the present rows of K."""
        anchor = self.anchor
        found = self._ground.settled(anchor.q, anchor.y, anchor.ydot, anchor.origin)
        if found is not None:
            self.in_zone = False
            self.anchor = self._own = found
        else:
            self._enter(anchor, {})
            self._own = anchor

    # --------------------------------------------------------------------- by clusters

    def _enter(self, anchor: Point, known: Mapping[int, Tracker]) -> None:
        """Put every cluster's tracker on its mode."""
        self.in_zone = True
        old, self._trackers = self._trackers, []
        for c in self.clusters:
            before = None if old is None else old[c.index]
            if c.index in known:
                tracker = known[c.index].twin()
            elif before is None or not before.space.flat:  # exponential coordinates: about this anchor
                tracker = tracker_at(self.mechanism, c, anchor, self.options, self.counters, before)
            else:
                tracker = before
                # where modes touch, or lie in the singular set, K tells no jet: the curve used last does
                if not tracker.back_at(tracker.space.x(anchor.q[c.iq])):
                    tracker.place_at(jet_at(self.mechanism, c, anchor, self.counters))
            self._trackers.append(tracker)

    def renewed(self, point: Point) -> Point:
        """See `ExplicitMap.renewed`; not on a bridge, which is in coordinates of its own."""
        turning = [t for t in self._trackers or [] if self.in_zone and not t.space.flat]
        if any(tracker.current is not None for tracker in turning):
            return point
        new = super().renewed(point)
        if new is not point:
            self._own = new
        for tracker in turning:
            cluster = tracker.space.cluster
            if in_charts(self.mechanism, cluster) or is_far(tracker.anchor):
                assert self._trackers is not None
                made = tracker_at(self.mechanism, cluster, new, self.options, self.counters, tracker)
                self._trackers[cluster.index] = made
        return new

    def outgrown(self, point: Point) -> bool:
        """See `ExplicitMap.outgrown`."""
        trackers = self._trackers if self.in_zone else None
        return super().outgrown(point) or any(is_far(tracker.anchor) for tracker in trackers or [])

    def _by_clusters(self, y: Array, ydot: Array) -> Point:
        """The point at y as the product of the clusters' maps."""
        if not self.in_zone:
            # a tracker would follow even a diverging stepper, for as long as that goes on
            turn = self.path.turn(self.anchor.G @ (y - self.anchor.y))
            if turn > ONE_TURN:
                raise too_large(self.anchor, y, turn)
            self._enter(self.anchor, {})
        trackers = self._known_trackers()
        jets = [self._tracked(c, t, y) for c, t in zip(self.clusters, trackers, strict=True)]
        parts = product(self.mechanism, jets, y, ydot)
        if all(tracker.current is None for tracker in trackers):
            regular = self._ground.settled(parts[0], y, ydot, self.anchor.origin)
            if regular is not None:
                self.in_zone = False
                return regular
        self.counters.zone_evaluations += 1
        # On a bridge K_d says nothing of how good the point is. Without one, steps are under error control
        # until K_d is well conditioned again.
        obstructed = any(t.obstacle is not None for t in trackers)
        conditioning = self.path.worst_conditioning(parts[0]) if obstructed else 0.0
        point = whole_point(y, ydot, parts, conditioning, len(self.path.blocks))
        if len(y) == 1:
            point.curvature = product(self.mechanism, jets, y, np.ones(1))[2]  # g at ẏ = 1
        point.origin = self.anchor.origin
        return point

    def _tracked(self, cluster: LoopCluster, tracker: Tracker, y: Array) -> Jet:
        """One cluster's point, or why there is none."""
        space = tracker.space
        tracker.error_controlled = self.error_controlled
        wanted = chart_coordinates(self.mechanism, space, y)
        here = quality(tracker.anchor, cluster.chosen)
        # Where y is about to turn back fixed steps lose their order; those with error control become shorter.
        if here < CHANGE and not (self.error_controlled and here >= self._last_resort):
            raise self._stop(cluster, toggle_at(tracker))
        try:
            return tracker.jet_at(wanted)
        except (ObstacleError, LostError, np.linalg.LinAlgError) as stop:
            if isinstance(stop, ObstacleError) and not self.error_controlled:
                raise
            raise self._stop(cluster, what_stopped(cluster, tracker, stop)) from stop

    def _stop(self, cluster: LoopCluster, obstacle: Obstacle) -> SimulationError:
        """What ends the motion there, or asks for error control."""
        if self.error_controlled or (obstacle.kind == "tangential" and cluster.m > 1):
            return refusal(self.mechanism, cluster, obstacle, self.anchor)
        return ObstacleError(obstacle)

    def require_closed(self, q: Array, when: str) -> None:
        """All rows of φ at an output, not only those that determine the dependent joints.

        Raises
        ------
        ClosureError
            Where others are left open: the mechanism has not the mobility that y claims.
        """
        self.counters.constraint_evaluations += 1
        self.mechanism.require_closed(q, max(LEFT_OPEN, self.options.largest_gap), when)

    def refusal(self) -> SimulationError:
        """The error to stop with where the present place cannot be passed."""
        return where_refused(self.mechanism, self._known_trackers(), self.anchor)

    # --------------------------------------------------------------------- for the compiled kernel

    def written(self) -> Array:
        """The trackers as plain numbers, as they came where nothing was done since."""
        return written(self._known_trackers()) if self._arriving is None else self._arriving()

    def resume(
        self,
        anchor: Point,
        trackers: Callable[[], Array] | None,
        in_zone: bool | None = None,
        met: bool | None = None,
    ) -> None:
        """Go on from a point that was reached elsewhere, with these trackers as plain numbers.

        Where they are given it is in a zone, unless said otherwise: they know then what was met. `met`
        says whether anything was, where that is known without them.
        """
        self.anchor, self._own, self._arriving, self._arriving_met = anchor, anchor, trackers, met
        self.in_zone = trackers is not None if in_zone is None else in_zone
        # until the numbers are read: what these trackers had met was told of
        for tracker in self._trackers or []:
            tracker.current, tracker.touched = None, []

    def _known_trackers(self) -> list[Tracker]:
        """Of all clusters, once a zone was met; those from elsewhere are read when they are needed."""
        if self._arriving is not None:
            spaces = [space_of(self.mechanism, c, self.anchor.q[c.iq]) for c in self.clusters]
            known = self._trackers or []
            self._trackers = read(self._arriving(), spaces, self.options, self.counters)
            for before, now in zip(known, self._trackers, strict=False):
                now.known.ahead = before.known.ahead  # with the failure in it, which the numbers leave out
            self._arriving = None
        return self._trackers or []
