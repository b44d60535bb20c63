"""Points of one mode that do not follow each other as those of a motion do."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..dynamics.modes.mode_rates import ModeRates
from ..dynamics.modes.taylor_series import INSIDE, Around, circles_of
from ..dynamics.problem import initial_value_problem
from ..errors import BranchError, SimulationError
from ..maps.cluster.cluster_map import ClusterMap
from ..maps.explicit import ExplicitMap, Point
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array

LEAP = 0.5
"""Largest move of a coordinate at once by the explicit map, rad or m."""

FARTHEST = 1e3
"""Largest move of a coordinate, rad or m: a solver that asks for more has lost its way."""

SAME_PLACE, SAME_WAY = 1e-8, 1e-5
"""How far a point and its G may be from those of a series, relative to units, to lie on it."""

APART = 0.05
"""How near to a place about which no circle could be made none is tried again, rad or m."""

EDGE = 0.15
"""Conditioning of K_d at the end of a circle below which another is made; the map's zones begin at 0.05."""

NEXT = 0.45
"""Where about a circle another one is made that leads on, as a share of its reach: not where it is poor."""

AHEAD = 1e-6
"""Share of a radius that counts as a move."""


class Followed:
    """An explicit map, and in place of its ways past singular configurations the series that are known there.

    The map looks for bridges on each way, for milliseconds. A mechanism of one cluster and one coordinate has
    circles beside singular configurations, made once for its derivatives (`dynamics.continuation`), inside of
    which its mode is a certified series: from one to the next, no way is looked at.

    Parameters
    ----------
    explicit : ExplicitMap
        Of a mechanism's motion.
    """

    def __init__(self, mechanism: Mechanism, explicit: ExplicitMap) -> None:
        self._mechanism, self._explicit = mechanism, explicit
        self._on: tuple[Around, Point] | None = None  # where the last point is a series'
        one = mechanism.m == len(mechanism.clusters) == 1 and isinstance(explicit, ClusterMap)
        alone = one and mechanism.tree.vector_space and len(mechanism.clusters[0].iq) == mechanism.nq
        self._cluster = mechanism.clusters[0] if alone else None

    def point_at(self, y: Array, u: Array) -> Point:
        """The point at y on the mode of the last one.

        Raises
        ------
        SimulationError
            Where the mode has none, or y is no number or farther than `FARTHEST`.
        """
        last, goal = self._explicit.anchor if self._on is None else self._on[1], float(y[0])
        if not np.abs(y - last.y).max(initial=0.0) < FARTHEST:
            raise BranchError(f"y = {y} is too far from y = {last.y} to be followed on a mode", last.y)
        while True:
            last = self._explicit.anchor if self._on is None else self._on[1]
            around = self._around(last, goal)
            if around is None and self._learned(last, goal):
                continue
            if around is not None:
                there = y if around.covers(y) else np.array([_inside(around, goal)])
                found = self._of(around, there, u)
                self._on = around, found
            else:
                far = np.abs(y - last.y).max(initial=0.0)
                there = last.y + LEAP / far * (y - last.y) if far > LEAP else y
                there = self._gate(last.y, there)
                found = self.explicit().point_at(there, u)
            if there is y:
                return found

    def explicit(self) -> ExplicitMap:
        """The map, to go on from the last point or, where a series has it, from an end of its circle."""
        if self._on is not None:
            around, last = self._on
            center, reach = float(around.center[0]), _reach(around)
            ends = [self._of(around, np.array([center + side * reach]), last.ydot) for side in (1.0, -1.0)]
            # of both ends of the circle the one farther from singular: there the map needs no bridge
            self._explicit.anchor = max(ends, key=self._conditioning)
            self._on = None
        return self._explicit

    def _conditioning(self, here: Point) -> float:
        """Of K_d at a series' point; 0 in a zone."""
        assert isinstance(self._explicit, ClusterMap)  # it has circles
        settled = self._explicit.path.settle(here.q.copy(), here.y, here.ydot)
        return 0.0 if settled is None else settled.conditioning

    def _learned(self, here: Point, goal: float) -> bool:
        """Whether another circle could be made, beside a singular configuration or where one ends near it."""
        mechanism, place = self._mechanism, float(here.y[0])
        if self._cluster is None:
            return False
        if self._on is not None:
            if self._conditioning(here) >= EDGE:
                return False
            place += NEXT * _reach(self._on[0]) * float(np.sign(goal - place))
        elif not (isinstance(self._explicit, ClusterMap) and self._explicit.in_zone):
            return False
        failed: list[float] = mechanism.memo.once("no circles about", list)
        if any(abs(place - other) < APART for other in failed):
            return False
        before, about = len(self._circles()), here.q.copy()
        about[mechanism.iq_independent] = place
        with suppress(SimulationError):
            ModeRates(
                initial_value_problem(mechanism, here.q, here.G[:, 0]).start, circles_of(mechanism)
            ).beside([about])
        if len(self._circles()) == before:
            failed.append(place)
        return len(self._circles()) > before

    def _around(self, here: Point, goal: float) -> Around | None:
        """The circle that leads on farthest to a goal, of those that a point lies on with its mode."""
        if self._cluster is None:
            return None
        y = float(here.y[0])
        ahead = np.array([goal])
        if self._on is not None and self._on[0].covers(ahead):
            return self._on[0]
        leading = [a for a in self._circles() if a.covers(here.y) and (a.covers(ahead) or _leads(a, y, goal))]
        for around in sorted(leading, key=lambda a: abs(_inside(a, goal) - goal)):
            if self._lies_on(here, around):
                return around
        return None

    def _lies_on(self, here: Point, around: Around) -> bool:
        """Whether a point is one of a circle's mode."""
        if self._on is not None and self._on[0] is around:
            return True
        assert self._cluster is not None  # it has circles
        iq, iv, unit = self._cluster.iq, self._cluster.iv, self._mechanism.units
        # modes that cross share the place: G tells which is which
        off = np.abs(here.q[iq] - around.q - around.moved(here.y)) / unit[iv]
        turned = np.abs(here.G[iv] - around.rates_at(here.y, np.ones(1)).G) / unit[iv, None]
        return bool(off.max() < SAME_PLACE and turned.max() < SAME_WAY * np.abs(here.G / unit[:, None]).max())

    def _of(self, around: Around, y: Array, u: Array) -> Point:
        """A circle's point."""
        here, cluster, mechanism = self._explicit.anchor, self._cluster, self._mechanism
        assert cluster is not None  # it has circles
        rates = around.rates_at(y, u)
        q, g, G = here.q.copy(), here.g.copy(), here.G.copy()
        q[cluster.iq], g[cluster.iv], G[cluster.iv] = around.q + around.moved(y), rates.g, rates.G
        # to the last bit, not to that of a sum of a series
        q[mechanism.iq_independent] = y
        return Point(y.copy(), u.copy(), q, G, g, None, here.det, here.rcond)

    def _gate(self, here: Array, there: Array) -> Array:
        """Where the way leads into a circle first; its end if into none."""
        if self._cluster is None:
            return there
        y, goal = float(here[0]), float(there[0])
        gates = [_inside(around, y) for around in self._circles() if not around.covers(here)]
        ahead = [gate for gate in gates if min(y, goal) < gate < max(y, goal)]
        return np.array([min(ahead, key=lambda gate: abs(gate - y))]) if ahead else there

    def _circles(self) -> list[Around]:
        assert self._cluster is not None  # they are asked for where there is one
        return circles_of(self._mechanism).get(self._cluster.index, [])


def _reach(around: Around) -> float:
    """How far a circle serves, rad or m."""
    return (1.0 - AHEAD) * INSIDE * abs(float(around.ways[0, 0]))


def _inside(around: Around, y: float) -> float:
    """The nearest to y that a circle covers."""
    center, reach = float(around.center[0]), _reach(around)
    return min(max(y, center - reach), center + reach)


def _leads(around: Around, y: float, goal: float) -> bool:
    """Whether a circle leads from y towards a goal."""
    return (_inside(around, goal) - y) * float(np.sign(goal - y)) > 1e-3 * _reach(around)
