"""How the explicit map of a whole mechanism bends at a point of a mode, singular or not.

The product of the clusters' maps and of the free joints: block diagonal. A cluster far from singular is
differentiated where it is; near a singular place, from a circle around it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import NotCertifiedError, SimulationError
from ..maps.choice import MapChoice
from ..maps.cluster.obstacles import ObstacleError
from ..maps.explicit import ExplicitMap
from ..maps.point import Point
from ..maps.start import Start
from ..mechanism.closure_rates import Placement
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .continuation import Circle, circle
from .map_rates import ClusterRates, MapRates

ZONE = 0.05
"""Conditioning of K_d, as `Point` has it, below which rounding is looked at."""

STEADY, UNSTEADY = 3e-12, 3e-11
"""Change of a cluster's rates, where q is rounded otherwise, up to which they are taken where they are; and
from which they are not even where no circle serves, as on modes that veer."""

ROUNDING = 8.0 * float(np.finfo(float).eps)

RADII = (0.8, 0.5, 0.3, 0.15)
"""Of circles that are tried, dimensionless joint units along the mode."""

ACCURATE = 1e-11
"""Error of a circle at which no other is tried."""

LARGEST_ERROR = 1e-9
"""Of a circle that is used."""

SAME_MODE = 1e-7
"""Agreement of the circle's mean with the map, and of its far side with the real mode there."""

INSIDE = 0.5
"""Share of its radius within which a circle of mobility 1 serves other points."""

STRIDE = 0.1
"""Step in which a map walks to a circle, dimensionless joint units."""


@dataclass(frozen=True)
class _Around:
    """A circle of a cluster of mobility 1 as a Taylor series about its centre, at u = 1."""

    circle: Circle
    coefficients: Array

    def covers(self, y: float) -> bool:
        return abs(y - self.circle.center[0]) <= INSIDE * abs(self.circle.radius[0])

    def at(self, y: float, u: float) -> MapRates:
        share = (y - self.circle.center[0]) / self.circle.radius[0]
        one = self.circle.unflattened(share ** np.arange(len(self.coefficients)) @ self.coefficients)
        return MapRates(one.G, one.g * u * u, one.bend, one.V_y * u, one.A_y * u * u, one.A_u * u)


class ModeRates:
    """`MapRates` of a mechanism along the mode of a start.

    Parameters
    ----------
    start : Start
    """

    def __init__(self, start: Start) -> None:
        self._start, self._mechanism = start, start.mechanism
        self._clusters = cluster_rates(self._mechanism)
        self._known: list[list[_Around]] = [[] for _ in self._clusters]

    def at(self, point: Point, udot: Array) -> MapRates:
        """At a point of the mode.

        Raises
        ------
        NotCertifiedError
            Where the mode has no derivatives that could be certified.
        """
        mechanism, u = self._mechanism, point.ydot
        nv, m = mechanism.nv, mechanism.m
        G, g = point.G.copy(), point.g.copy()
        bend = np.zeros((m, nv, m))
        V_y, A_y, A_u = (np.zeros((nv, m)) for _ in range(3))
        for rates in self._clusters:
            cluster = rates.cluster
            own, inputs = cluster.iv, cluster.inputs
            if not len(inputs):
                continue
            here = np.ix_(own, inputs)
            found = self._of(rates, point, u[inputs], udot[inputs])
            G[here], g[own] = found.G, found.g
            bend[np.ix_(inputs, own, inputs)] = found.bend
            V_y[here], A_y[here], A_u[here] = found.V_y, found.A_y, found.A_u
        return MapRates(G, g, bend, V_y, A_y, A_u)

    def _of(self, rates: ClusterRates, point: Point, u: Array, udot: Array) -> MapRates:
        """Those of one cluster."""
        place = rates.rates.real(point.q[rates.cluster.iq])
        cluster = rates.cluster
        G, g = point.G[np.ix_(cluster.iv, cluster.inputs)], point.g[cluster.iv]
        if point.conditioning >= ZONE:
            return rates.along(place, u, udot, G, g)
        found = self._remembered(rates, point, u, G)
        if found is None:
            change = _rounding(rates, point.q[cluster.iq])
            if change < STEADY:
                return rates.along(place, u, udot, G, g)
            try:
                found = self._around(rates, point, place, u, G)
            except NotCertifiedError:
                if change >= UNSTEADY:
                    raise
                return rates.at(place, u, udot)
        # on the circle u̇ = 0; ∂(G u̇)/∂y is linear in it
        return MapRates(
            found.G, found.g, found.bend, found.V_y,
            found.A_y + np.einsum("i,inj->nj", udot, found.bend), found.A_u,
        )  # fmt: skip

    def _remembered(self, rates: ClusterRates, point: Point, u: Array, G: Array) -> MapRates | None:
        """From a circle that was made before, for a cluster of mobility 1."""
        cluster = rates.cluster
        if len(cluster.inputs) != 1:
            return None
        y = float(point.y[cluster.inputs[0]])
        for around in self._known[cluster.index]:
            if around.covers(y):
                found = around.at(y, float(u[0]))
                if _apart(rates, found.G, G) < SAME_MODE:
                    return found
        return None

    def _around(self, rates: ClusterRates, point: Point, place: Placement, u: Array, G: Array) -> MapRates:
        """From a new circle, which is kept for mobility 1."""
        cluster = rates.cluster
        inputs = cluster.inputs
        if not np.isin(inputs, self._mechanism.numbers).all():
            raise NotCertifiedError(
                f"derivatives at y = {point.y}: beside this singular configuration there are none by the "
                f"velocities of a ball among {', '.join(cluster.independent)}; choose other joints",
                point.y,
            )
        if len(inputs) > 1:
            return self._circle(rates, point, place, u, G).mean()
        made = self._circle(rates, point, place, np.ones(1), G)
        kept = _Around(made, made.coefficients())
        self._known[cluster.index].append(kept)
        return kept.at(float(point.y[inputs[0]]), float(u[0]))

    def _circle(self, rates: ClusterRates, point: Point, place: Placement, u: Array, G: Array) -> Circle:
        """The best certified circle about a point; G is what the map has there."""
        inputs = rates.cluster.inputs
        best: Circle | None = None
        reason = "none could be followed"
        for size in RADII:
            radius = size * rates.across(place, G)
            try:
                near, far = (self._walked(point, inputs, radius * side) for side in (1.0, -1.0))
                made = circle(rates, near.q[rates.cluster.iq], point.y[inputs], radius, u)
            except SimulationError as error:
                reason = str(error)
                continue
            there = rates.rates.real(far.q[rates.cluster.iq])
            off = max(
                _apart(rates, made.mean().G, G),
                float(np.abs(made.far.p - there.p).max(initial=0.0)) / rates.cluster.loops.length,
                float(np.abs(made.far.J[:, 3:] - there.J[:, 3:]).max(initial=0.0)),
            )
            if off > SAME_MODE:
                reason = "followed around the singular place in complex numbers, it is not the same mode"
            elif best is None or made.error < best.error:
                best = made
                if best.error < ACCURATE:
                    break
        if best is None or best.error > LARGEST_ERROR:
            raise NotCertifiedError(
                f"derivatives at y = {point.y}: beside this singular configuration the mode has none that "
                f"could be certified ({reason if best is None else f'error {best.error:.1e}'})",
                point.y,
            )
        return best

    def _walked(self, point: Point, inputs: NDArray[np.int64], radius: Array) -> Point:
        """The mode's real point beside this one, by a map of its own from the start."""
        goal = point.y.copy()
        goal[inputs] += radius
        try:
            return self._led(MapChoice().over(self._start), point.y, goal)
        except ObstacleError:  # no bridge, or coordinates that serve poorly: the true curve
            return self._led(MapChoice(error_controlled=True).over(self._start), point.y, goal)

    def _led(self, explicit: ExplicitMap, *goals: Array) -> Point:
        """The point at the last goal, reached by way of the others in small steps."""
        mechanism = self._mechanism
        unit, here, found = mechanism.units[mechanism.iv_independent], explicit.anchor.y, explicit.anchor
        for goal in goals:
            count = max(1, int(np.ceil(np.abs((goal - here) / unit).max() / STRIDE)))
            for share in np.arange(1, count + 1) / count:
                found = explicit.at(here + share * (goal - here), np.zeros(mechanism.m))
            here = goal
        return found


def cluster_rates(mechanism: Mechanism) -> list[ClusterRates]:
    """Those of all clusters, made once for a mechanism."""
    made: list[ClusterRates] = mechanism.memo.once(
        "cluster rates", lambda: [ClusterRates(cluster) for cluster in mechanism.clusters]
    )
    return made


def _rounding(rates: ClusterRates, q: Array) -> float:
    """How much G and its two derivatives change, without units, where q is rounded otherwise."""
    scale, tree = rates.scale, rates.cluster.loops.tree
    unit, still = scale[rates.independent], np.zeros(len(rates.independent))
    found: list[Array] = []
    try:
        for seed in range(3):
            size = ROUNDING * np.random.default_rng(seed).choice([-1.0, 1.0], len(scale)) * min(seed, 1)
            at = rates.at(rates.rates.real(tree.integrate(q, size * scale)), unit, still)
            parts = (at.G, *at.bend, at.A_y)
            found.append(np.array(parts) / scale[:, None] * unit)
    except NotCertifiedError:
        return np.inf
    here = found[0]
    return max(float(np.max(np.abs(here - other) / (1.0 + np.abs(here)))) for other in found[1:])


def _apart(rates: ClusterRates, one: Array, other: Array) -> float:
    """Largest difference of two G, without units."""
    off = np.abs(one - other) / rates.scale[:, None] * rates.scale[rates.independent]
    return float(off.max(initial=0.0))
