"""How the explicit map of a whole mechanism bends at a point of a mode, singular or not.

The product of the clusters' maps and of the free joints: block diagonal. A cluster far from singular is
differentiated where it is; near a singular place, from a circle around it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np

from ...errors import NotCertifiedError, SimulationError
from ...maps.explicit import Point
from ...maps.start import Start
from ...mechanism.constraint.closure_rates import Placement
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .continuation import Circle, circle
from .map_rates import ClusterRates, MapRates, rounding
from .real_points import Walk
from .taylor_series import Around, Circles
from .torus import Torus, torus, ways_about

ZONE = 0.05
"""Conditioning of K_d, as `Point` has it, below which rounding is looked at."""

SPARED = 5e-3
"""The same for a motion that is followed in coordinates that serve, in short steps, and for clusters of
several coordinates, of which a series takes a second to make: rounding costs their rates some 8 ε/σ² of their
size, 7e-11."""

STEADY, UNSTEADY = 2e-11, 2e-10
"""Change of a cluster's rates, where q and φ are rounded otherwise, up to which they are taken where they
are; and from which they are not even where no circle serves, as on modes that veer. Beside change points of
four four-bars missed by 1e-4 to 1e-9 m the error was 1.6 times as large at most, and a tenth mostly."""

RADII = (0.8, 0.5, 0.3, 0.15, 0.1)
"""Of circles that are tried, dimensionless joint units along the mode."""

TORI = (0.4, 0.25, 0.12)
"""Of tori that are tried, across the singular curve, as `RADII`."""

ALONG = 0.5
"""The radius of a torus along the singular curve over that across it."""

ACCURATE = 5e-12
"""Error of a circle at which no other is tried."""

LARGEST_ERROR = 1e-9
"""Of a circle that is used."""

SAME_MODE = 1e-7
"""Agreement of a circle's far side with the real mode there, and of its configuration with the map's."""

SAME_WAY = 1e-5
"""Agreement of its G with the map's, which K_d leaves uncertain by ε/δ² at a distance δ."""

OTHER_MODE = "followed around the singular place in complex numbers, it is not the same mode"

Sampled = TypeVar("Sampled", Circle, Torus)


class ModeRates:
    """`MapRates` of a mechanism along the mode of a start.

    Parameters
    ----------
    start : Start
    known : Circles, optional
        Of other starts of the mechanism, whatever their modes; those made here are added.
    sparing : bool
        Whether no circle is tried where nine digits are left without, as beside modes that veer, where a
        trial takes long and comes to nothing.
    """

    def __init__(self, start: Start, known: Circles | None = None, sparing: bool = False) -> None:
        self._start, self._mechanism = start, start.mechanism
        self._clusters = cluster_rates(self._mechanism)
        self._known: Circles = {} if known is None else known
        self._alone = known is None
        self._zone, self._steady = (SPARED, UNSTEADY) if sparing else (ZONE, STEADY)
        self._last: tuple[Point, MapRates] | None = None

    def rates_at(self, point: Point) -> MapRates:
        """At a point of the mode.

        Raises
        ------
        NotCertifiedError
            Where the mode has no derivatives that could be certified.
        """
        if self._last is None or self._last[0] is not point:  # others may act there than when last asked
            self._last = point, self._rates_at(point)
        return self._last[1]

    def _rates_at(self, point: Point) -> MapRates:
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
            found = self._of(rates, point, u[inputs])
            G[here], g[own] = found.G, found.g
            bend[np.ix_(inputs, own, inputs)] = found.bend
            V_y[here], A_y[here], A_u[here] = found.V_y, found.A_y, found.A_u
        return MapRates(G, g, bend, V_y, A_y, A_u)

    def beside(self, places: Iterable[Array]) -> list[tuple[LoopCluster, Around]]:
        """New series about places of the mode, (nq,): of clusters of one or two coordinates that none covers.

        Raises
        ------
        SimulationError
            Where the mode cannot be followed there.
        """
        return [new for q in places for new in self._about(q)]

    def _about(self, q: Array) -> list[tuple[LoopCluster, Around]]:
        """Those about one place."""
        mechanism, made = self._mechanism, list[tuple[LoopCluster, Around]]()
        place = self._start.point.y.copy()
        place[mechanism.numbers] = q[mechanism.iq_numbers]
        point = Walk(self._start, place, np.arange(0)).to(np.zeros(0))
        for rates in self._clusters:
            cluster, n = rates.cluster, len(rates.cluster.inputs)
            if n not in (1, 2) or not cluster.loops.tree.vector_space:
                continue
            G = point.G[np.ix_(cluster.iv, cluster.inputs)]
            if self._remembered(rates, point, np.ones(n), G) is not None:
                continue
            if n == 2 and not self._lost(rates, point):  # a torus takes a second
                continue
            try:
                if n == 2:
                    self._torus(rates, point, G)
                else:
                    self._around(rates, point, rates.rates.real(point.q[cluster.iq]), np.ones(1), G)
            except NotCertifiedError:
                continue
            made.append((cluster, self._known[cluster.index][-1]))
        return made

    def _lost(self, rates: ClusterRates, point: Point) -> bool:
        """Whether rounding costs a cluster's rates there more than a series does."""
        return point.conditioning < ZONE and rounding(rates, point.q[rates.cluster.iq])[1] >= ACCURATE

    def _of(self, rates: ClusterRates, point: Point, u: Array) -> MapRates:
        """Those of one cluster."""
        q = point.q[rates.cluster.iq]
        cluster = rates.cluster
        G, g = point.G[np.ix_(cluster.iv, cluster.inputs)], point.g[cluster.iv]
        # the map's own G and g serve; nearer they have lost digits themselves, and are found anew below
        if point.conditioning >= self._zone:
            return rates.along(rates.rates.real(q), u, G, g)
        found = self._remembered(rates, point, u, G)  # `rounding` would take three times as long
        if found is not None:
            return found
        q, change = rounding(rates, q)
        if change < (self._steady if len(u) == 1 else UNSTEADY):
            return rates.rates_at(rates.rates.real(q), u)
        try:
            return self._around(rates, point, rates.rates.real(q), u, G)
        except NotCertifiedError:
            if change >= UNSTEADY:
                raise
            return rates.rates_at(rates.rates.real(q), u)

    def _remembered(self, rates: ClusterRates, point: Point, u: Array, G: Array) -> MapRates | None:
        """From a series that was made before, for a cluster of one or two coordinates."""
        cluster = rates.cluster
        y, q, tree = point.y[cluster.inputs], point.q[cluster.iq], cluster.loops.tree
        for around in self._known.get(cluster.index, []):
            if not around.covers(y):
                continue
            found = around.rates_at(y, u)
            off = 0.0
            if tree.vector_space:  # on groups G alone tells the mode
                off = float(np.abs((q - around.q - around.moved(y)) / rates.scale).max())
            if off < SAME_MODE and _apart(rates, found.G, G) < SAME_WAY:
                return found
        return None

    def _around(self, rates: ClusterRates, point: Point, place: Placement, u: Array, G: Array) -> MapRates:
        """From a new circle, which is kept for mobility 1."""
        cluster = rates.cluster
        inputs = cluster.inputs
        if not np.isin(inputs, self._mechanism.numbers).all():
            raise NotCertifiedError(
                f"derivatives at y = {point.y}: beside this singular configuration there are none by "
                f"velocities of a spherical joint ({', '.join(cluster.independent)}); choose other joints",
                point.y,
            )
        if len(inputs) > 1:
            return self._circle(rates, point, place, u, G).mean()  # of this u alone: not kept
        kept = self._circle(rates, point, place, np.ones(1), G).around(point.q[cluster.iq])
        if self._alone or cluster.loops.tree.vector_space:  # else it does not tell whose mode it is
            self._known.setdefault(cluster.index, []).append(kept)
        return kept.rates_at(point.y[inputs], u)

    def _torus(self, rates: ClusterRates, point: Point, G: Array) -> None:
        """Keep a series from a new torus, for a cluster of two coordinates."""
        cluster = rates.cluster
        inputs, place = cluster.inputs, rates.rates.real(point.q[cluster.iq])
        ways, walk = ways_about(rates, place, G), Walk(self._start, point.y, inputs)

        def attempt(size: float) -> Torus:
            reach = ways * (size * np.array([1.0, ALONG]))
            near = walk.to(reach.sum(axis=1))
            made = torus(rates, near.q[cluster.iq], point.y[inputs], reach)
            if _apart(rates, made.around.rates_at(point.y[inputs], np.zeros(2)).G, G) > SAME_WAY:
                raise NotCertifiedError(OTHER_MODE)
            return made

        self._known.setdefault(cluster.index, []).append(_best(point, TORI, attempt).around)

    def _circle(self, rates: ClusterRates, point: Point, place: Placement, u: Array, G: Array) -> Circle:
        """The best certified circle about a point; G is what the map has there."""
        inputs, across = rates.cluster.inputs, rates.across(place, G)
        walks = [Walk(self._start, point.y, inputs) for _ in range(2)]

        def attempt(size: float) -> Circle:
            radius = size * across
            near, far = (walk.to(radius * side) for walk, side in zip(walks, (1.0, -1.0), strict=True))
            made = circle(rates, near.q[rates.cluster.iq], point.y[inputs], radius, u)
            there = rates.rates.real(far.q[rates.cluster.iq])
            # going half round in complex numbers must lead to where the real mode leads straight through
            off = max(
                float(np.abs(made.far.p - there.p).max(initial=0.0)) / rates.cluster.loops.length,
                float(np.abs(made.far.J[:, 3:] - there.J[:, 3:]).max(initial=0.0)),
            )
            if off > SAME_MODE or _apart(rates, made.mean().G, G) > SAME_WAY:
                raise NotCertifiedError(OTHER_MODE)
            return made

        return _best(point, RADII, attempt)


def cluster_rates(mechanism: Mechanism) -> list[ClusterRates]:
    """Those of all clusters, made once for a mechanism."""
    made: list[ClusterRates] = mechanism.memo.once(
        "cluster rates", lambda: [ClusterRates(cluster) for cluster in mechanism.clusters]
    )
    return made


def _best(point: Point, sizes: Iterable[float], attempt: Callable[[float], Sampled]) -> Sampled:
    """The circle or torus of the first size that is accurate, else that of the least error.

    Raises
    ------
    NotCertifiedError
        Where none is accurate enough; with the last reason.
    """
    best: Sampled | None = None
    reason = "none could be followed"
    for size in sizes:
        try:
            made = attempt(size)
        except SimulationError as error:
            reason = str(error)
            continue
        if best is None or made.error < best.error:
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


def _apart(rates: ClusterRates, one: Array, other: Array) -> float:
    """Largest difference of two G, without units."""
    off = np.abs(one - other) / rates.scale[:, None] * rates.scale[rates.independent]
    return float(off.max(initial=0.0))
