"""The default explicit map: classical GCP where K_d is good, a certified bridge where it is not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ...errors import BranchError, SimulationError
from ...mechanism.tree import Array
from ..explicit import Passage, sign_changes
from ..march import march, same_branch
from ..point import Counters, Point
from ..regular_path import RegularPath
from ..unrolled import regular_path
from .bridge import Bridge, BridgeOptions, Builder, NoBridgeError
from .line import Line
from .obstacle import Obstacle, UncertifiedZoneError, classify, reconsidered, refusal, steepest

MAX_BRIDGES = 16
"""Bridges kept for reuse; a mechanism that turns over meets a new one each half turn."""

SAME_POINT = 1e-6
"""Agreement of q and G, dimensionless, by which a point is known to lie on a bridge's mode."""

SAME_SURFACE = 1e-6
"""Distance, in widths of a bridge, within which two bridges tell of the same singular surface."""

ONE_TURN = 2.0 * np.pi
"""Largest rotation between evaluations, rad, or slide in lengths, that is followed in small steps."""

DEEP = 0.1
"""Fraction of the zone below which an undecided singularity stops the run."""


class BridgeMap:
    """q = γ(y), G and g on one mode, with full accuracy through singular configurations.

    Parameters
    ----------
    path : RegularPath
    start : Point
        A point of the mode.
    options : BridgeOptions
    error_controlled : bool
        Whether the caller controls its error, so that a zone without a certified bridge may be
        entered on the true curve; else `UncertifiedZoneError` is raised there.
    """

    def __init__(
        self,
        path: RegularPath,
        start: Point,
        options: BridgeOptions,
        error_controlled: bool = False,
    ) -> None:
        self.path, self.options = path, options
        self.error_controlled = error_controlled
        self.anchor = start
        self._builder = Builder(path, options)
        self._bridges: list[Bridge] = []
        self._current: Bridge | None = None
        self._obstacle: Obstacle | None = None

    @property
    def counters(self) -> Counters:
        """What was computed so far."""
        return self.path.counters

    @property
    def current(self) -> Bridge | None:
        """The bridge in use."""
        return self._current

    def resume(self, anchor: Point, on_bridge: bool) -> None:
        """Go on from a point that was reached elsewhere, still on the bridge in use or beside it."""
        self.anchor = anchor
        if not on_bridge:
            self._current = None

    def adopt(self, bridge: Bridge) -> None:
        """Start on this bridge: the motion begins at or beside the singular configuration."""
        self._keep(bridge)
        self._current = bridge

    @contextmanager
    def following_true_curve(self) -> Iterator[None]:
        """Within this context the caller controls its error."""
        before, self.error_controlled = self.error_controlled, True
        try:
            yield
        finally:
            self.error_controlled = before

    def at(self, y: Array, ydot: Array) -> Point:
        """The point at y on the mode.

        Raises
        ------
        ToggleError, NotCertifiedError, BranchError
            When y cannot be reached on this mode.
        UncertifiedZoneError
            See `error_controlled`.
        """
        point = self._on_current(y, ydot) if self._current is not None else None
        if point is None:
            point = self.path.step(self.anchor, y, ydot)
            if point is None or point.conditioning < self.options.zone or not same_branch(self.anchor, point):
                point = self._rare(y, ydot)
        self.anchor = point
        return point

    @property
    def met(self) -> bool:
        """Whether a bridge was built so far."""
        return bool(self._bridges)

    def passed(self, before: Point, after: Point) -> list[Passage]:
        """All singular surfaces between two accepted points."""
        if not self._bridges:
            return []
        if self.path.m == 1:
            return self._zeros_between(before, after)
        bridge, tree, found = self._bridges[-1], self.path.tree, []
        for share in sign_changes(before, after):
            y = before.y + share * (after.y - before.y)
            q = tree.integrate(before.q, share * tree.difference(before.q, after.q))
            found.append(Passage(y, q, bridge.kind, bridge.residual, bridge.separation))
        return found

    def _zeros_between(self, before: Point, after: Point) -> list[Passage]:
        """m = 1: what the kept bridges know of the way; a surface that two of them span counts once."""
        y0, y1 = float(before.y[0]), float(after.y[0])
        found: list[Passage] = []
        for bridge in reversed(self._bridges):
            near = SAME_SURFACE * (bridge.right - bridge.left)
            for z in bridge.zeros:
                y = float(bridge.line.origin[0]) + z
                passed = (y0 - y) * (y1 - y) < 0.0 or y0 != y == y1
                if passed and not any(abs(y - float(known.y[0])) < near for known in found):
                    point = bridge.line.at(z, after.ydot)
                    found.append(Passage(point.y, point.q, bridge.kind, bridge.residual, bridge.separation))
        return found

    # --------------------------------------------------------------------- on a bridge

    def _on_current(self, y: Array, ydot: Array) -> Point | None:
        """The point at y from the bridge in use; None, with a regular anchor, once y has left it."""
        bridge = self._current
        assert bridge is not None
        if self.path.m > 1:
            moved = self._moved(bridge, y)
            if moved is None:
                self._current, self.anchor = None, self._nearest_node(bridge, y)
                return None
            bridge = self._current = self._bridges[-1] = moved
        s = bridge.parameter(y)
        if bridge.contains(s):
            self.counters.zone_evaluations += 1
            return bridge.line.at(s, ydot)
        self._current, self.anchor = None, self._nearest_node(bridge, y)
        return None

    def _nearest_node(self, bridge: Bridge, y: Array) -> Point:
        """The innermost node on y's side of the surface."""
        half = len(bridge.line.nodes) // 2
        right = bridge.parameter(y) > 0.5 * (bridge.left + bridge.right)
        return bridge.line.nodes[half if right else half - 1][1]

    def _moved(self, bridge: Bridge, y: Array) -> Bridge | None:
        """The bridge along the parallel line through y, m > 1; None when it must be built anew."""
        line = bridge.line
        shift = bridge.parameter(y)
        try:
            nodes = [
                (s - shift, march(self.path, node, y + (s - shift) * line.direction, node.ydot))
                for s, node in line.nodes
            ]
        except BranchError:
            return None
        moved = Line(self.path, y, line.direction, nodes)
        left, right = bridge.left - shift, bridge.right - shift
        flipped = np.flatnonzero(nodes[0][1].det * nodes[-1][1].det < 0.0)
        zeros = [z for b in flipped if (z := moved.zero(int(b), left, right)) is not None]
        inner = len(nodes) // 2
        poor = min(nodes[i][1].conditioning for i in (inner - 1, inner)) < 0.4 * self.options.zone
        if not zeros or poor:
            return None
        residual = bridge.residual
        if left <= 0.0 <= right:
            residual = self.path.mechanism.closure_residual(moved.configuration(0.0))
            if residual > max(self.options.closure_tolerance, self.options.geometric_tolerance):
                return None
        return replace(bridge, line=moved, left=left, right=right, zeros=zeros, residual=residual)

    # --------------------------------------------------------------------- rare events

    def _rare(self, y: Array, ydot: Array) -> Point:
        """March towards y; bridge the zones on the way."""
        here, zone = self.anchor, self.options.zone
        turn = self.path.turn(here.G @ (y - here.y))
        if turn > ONE_TURN:
            raise BranchError(
                f"from y = {here.y} to {y} the stepper moves a joint by {turn:.3g} rad (or lengths) at once, "
                "more than a turn, in which no branch can be followed: the step is too large for this "
                "motion, or the motion has become unstable; use a smaller step",
                here.y,
            )
        for _ in range(50):
            if here.conditioning >= zone:
                here = march(self.path, here, y, ydot, stop_below=zone)
                if here.conditioning >= zone:
                    return here
            better = self._through_better_rows(here)
            if better is not None:
                here = better
                continue
            bridge = self._bridge_at(here)
            if bridge is None:
                return self._uncertified(here, y, ydot)
            if self.path.m > 1:
                moved = self._moved(bridge, y)
                bridge = moved or bridge
            s, s_here = bridge.parameter(y), bridge.parameter(here.y)
            if bridge.contains(s):
                self._current = bridge
                self.counters.zone_evaluations += 1
                return bridge.line.at(s, ydot)
            beside = s_here < bridge.left if s < bridge.left else s_here > bridge.right
            if beside:
                return march(self.path, here, y, ydot, stop_below=0.0)
            here = self._nearest_node(bridge, y)
            if here.conditioning < zone:
                return march(self.path, here, y, ydot)
        raise BranchError(f"too many singular surfaces on the way to y = {y}; use a smaller step", y)

    def _through_better_rows(self, here: Point) -> Point | None:
        """The point seen through other rows of redundant closures; None where no others do better."""
        mechanism = self.path.mechanism
        if mechanism.nc == self.path.nd:
            return None
        rows = mechanism.select_rows(mechanism.K(here.q))
        if np.array_equal(rows, self.path.rows):
            return None
        path = regular_path(mechanism, rows, self.counters)
        point = path.settle(here.q.copy(), here.y, here.ydot)
        if point is None or point.conditioning < max(2.0 * here.conditioning, self.options.zone):
            return None
        self.path, self._builder = path, Builder(path, self.options)
        self._bridges, self._current, self._obstacle = [], None, None
        return point

    def _bridge_at(self, point: Point) -> Bridge | None:
        """A kept or new bridge at a point in the zone; None at an obstacle."""
        for bridge in reversed(self._bridges if self.path.m == 1 else []):
            s = bridge.parameter(point.y)
            if bridge.reaches(s) and self._agrees(bridge.line.at(s, point.ydot), point):
                return bridge
            turned = self._turned(bridge, point)
            if turned is not None:
                self._keep(turned)
                return turned
        if self._obstacle is not None and self._obstacle.covers(point):
            return None
        try:
            bridge = self._builder.build(point, steepest(self.path, point))
        except NoBridgeError as failure:
            self._obstacle = classify(self.path, point, failure)
            return None
        self._keep(bridge)
        return bridge

    def _turned(self, bridge: Bridge, point: Point) -> Bridge | None:
        """A kept bridge that the mechanism meets again after whole turns of its hinges; None if not so."""
        line, periodic = bridge.line, self.path.tree.periodic
        if not line.one_polynomial or not periodic[self.path.independent[0]]:
            return None
        away = float(point.y[0]) - float(line.origin[0]) - 0.5 * (bridge.left + bridge.right)
        around = round(away / (2.0 * np.pi))
        s = bridge.parameter(point.y - 2.0 * np.pi * around)
        if around == 0 or not bridge.reaches(s):
            return None
        seen = line.at(s, point.ydot)
        turns = np.where(periodic, np.round((point.q - seen.q) / (2.0 * np.pi)), 0.0)
        turned = replace(bridge, line=line.turned(turns))
        met = turned.line.at(turned.parameter(point.y), point.ydot)
        return turned if self._agrees(met, point) else None

    def _keep(self, bridge: Bridge) -> None:
        self._bridges = [*self._bridges[-MAX_BRIDGES + 1 :], bridge]

    def _agrees(self, a: Point, b: Point) -> bool:
        scale = self.path.mechanism.column_scale
        apart = np.abs(self.path.tree.difference(a.q, b.q) / scale).max()
        turned = np.abs((a.G - b.G) / scale[:, None]).max() / np.abs(a.G / scale[:, None]).max()
        return bool(apart <= SAME_POINT and turned <= np.sqrt(SAME_POINT))

    # --------------------------------------------------------------------- obstacles

    def _uncertified(self, here: Point, y: Array, ydot: Array) -> Point:
        obstacle = self._obstacle
        assert obstacle is not None
        if not self.error_controlled:
            raise UncertifiedZoneError(obstacle)
        self.counters.zone_evaluations += 1
        try:
            point = march(self.path, here, y, ydot)
        except BranchError as error:
            raise refusal(self.path, obstacle, here) from error
        if point.conditioning < DEEP * self.options.zone:
            obstacle = self._obstacle = reconsidered(self.path, obstacle, point, self.options.zone)
            if obstacle.kind != "near miss":
                raise refusal(self.path, obstacle, point)
        return point

    def refusal(self) -> SimulationError:
        """The error to stop with when the present obstacle cannot be passed."""
        assert self._obstacle is not None
        return refusal(self.path, self._obstacle, self.anchor)
