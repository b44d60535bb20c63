"""Looking after the independent joints: which clusters would do better with others, before a step is taken.

With T an orthonormal basis of a cluster's motions, components E serve as well as σ_min(T[E]) against that of
the best ones (pivoted QR of Tᵀ). In the chart E itself T = J R⁻¹ and J[E] = 1: while the entries of J stay
small, E is good, and nothing is computed. Fixed steps ask besides that the other joints move evenly; see
`evenness`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...kernel.simulation.guard import Watch
from ...maps.cluster.chart import CHANGE, best, smallest
from ...maps.explicit import Counters, Point
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import in_v
from ...mechanism.tree.tree import Array
from .evenness import GAIN, UNEVEN, bent, evenest, unevenness

GOOD = 0.6
"""Share of the best components' quality from which those that were named at first are taken again."""

PATIENCE = 1.2
"""By how much the largest entry of J grows until components that proved good are looked at again."""

PATIENCE_EVEN = 1.05
"""The same of the unevenness: little, so that the time of a change does not hang on the step."""

SOON = 0.75 * GAIN
"""Times that of the evenest others, from where on it is looked at so often."""

Index = NDArray[np.int64]


@dataclass(frozen=True)
class _Part:
    """A cluster whose components may be changed, with its places in the whole: v and y."""

    cluster: LoopCluster
    iv: Index
    inputs: Index
    units: Array
    candidates: Index
    at_first: Index | None


class Coordinates:
    """Looks after the independent joints of a motion.

    Parameters
    ----------
    mechanism : Mechanism
        In its present coordinates.
    named : sequence of str
        The joints that were independent at first: they are taken again where they serve.
    counters : Counters
    even : bool
        Whether the steps ask for joints that move evenly, as those with error control do not.

    Attributes
    ----------
    watch : Watch
        What tells that other joints may serve better.
    """

    def __init__(
        self, mechanism: Mechanism, named: Sequence[str], counters: Counters, even: bool = True
    ) -> None:
        self.mechanism, self._counters, self._even = mechanism, counters, even
        key = ("clusters with a choice of coordinates", *named)
        self._parts, sizes, self._weights = mechanism.memo.once(key, lambda: _sized(mechanism, named))
        uneven = np.full(mechanism.m, UNEVEN if even else np.inf)
        # σ_min(T[E]) = 1 / ‖J‖: for m = 1 J's largest entry is 1 / share of the best, else a sieve for it
        self.watch = Watch(sizes, 1.0 / CHANGE, uneven)
        self._evenest: dict[int, float] = {}  # by a cluster's first velocity: what others came to

    def suspicious(self, point: Point) -> bool:
        """Whether an entry of J is larger, or a cluster less even, than where coordinates are good."""
        return self.turns_back(point) or bool(self._uneven(point))

    def turns_back(self, point: Point) -> bool:
        """Whether an entry of J is larger than those of good coordinates."""
        # J = D⁻¹ G D_E, no unit: what is told by it is the same in millimetres
        return self.watch.limit < float((np.abs(point.G) * self._weights).max(initial=0.0)) < np.inf

    def better(self, point: Point) -> tuple[str, ...] | None:
        """Independent joints that serve better, changed in poor clusters alone; None where all do well."""
        turning, uneven = self.turns_back(point), self._uneven(point)
        if not turning and not uneven:
            return None
        names = self._changed(point, CHANGE if turning else 0.0)
        if names is not None:
            return names
        # No others do better: it is looked at again once these have become worse by some way.
        if turning:
            self.watch = self.watch._replace(limit=PATIENCE * float((np.abs(point.G) * self._weights).max()))
        for part, eta in uneven:
            self.watch.uneven[part.inputs] = max(PATIENCE_EVEN * eta, SOON * self._evenest[part.iv[0]])
        return None

    def best(self, point: Point) -> tuple[str, ...] | None:
        """The same with the worst cluster changed wherever others serve better at all."""
        shares = [_Choice(part, _tangent(part, point.G)).share for part in self._parts]
        # 1e-9: the worst itself is below its share, and rounding takes nothing in place of the best there are
        return self._changed(point, min(max(CHANGE, min(shares, default=0.0) + 1e-9), 1.0 - 1e-9))

    def at_rest(self, q: Array) -> tuple[str, ...] | None:
        """Independent joints for a start where those named turn back, by K's kernel; None where none help."""
        mechanism, groups, replaced = self.mechanism, groups_of(self.mechanism), dict[int, str]()
        for part in self._parts:
            own = (q if groups is None else q[groups.rest_iq])[part.cluster.iq]
            loops = part.cluster.loops
            # where y turns back K keeps its rank: its kernel is the tangent there, and G by K_d has no digits
            self._counters.svds += 1
            Vt = np.linalg.svd(loops.scaled(loops.K(own)))[2]
            tangent = Vt[loops.nv - part.cluster.m :].T
            choice = _Choice(part, tangent)
            if choice.share < CHANGE:
                replaced |= _names(part, choice.conditioned())
        return _renamed(mechanism, replaced)

    def _uneven(self, point: Point) -> list[tuple[_Part, float]]:
        """Clusters that move less evenly than was found to be good, and how evenly."""
        if not self._even:
            return []
        found, v = list[tuple[_Part, float]](), point.G.dot(point.ydot)
        for part in self._parts:
            eta = _unevenness(part, point, v)
            if self.watch.uneven[part.inputs[0]] < eta < np.inf:
                found.append((part, eta))
        return found

    def _changed(self, point: Point, share: float) -> tuple[str, ...] | None:
        """With other components where their quality is below a share of the best, or they are uneven."""
        replaced, v = dict[int, str](), point.G.dot(point.ydot)
        for part in self._parts:
            choice = _Choice(part, _tangent(part, point.G))
            if part.cluster.m > 1:  # else σ_min is an entry of T
                self._counters.svds += 1
            eta = _unevenness(part, point, v) if self._even else 0.0
            poor = choice.share < share
            if not poor and eta <= UNEVEN:
                continue
            # first what is well conditioned, then, among such, what moves evenly
            chosen = choice.conditioned() if poor else part.cluster.chosen
            if self._even:
                most = np.inf if poor else eta / GAIN  # poor ones are left even for others that gain less
                chosen, self._evenest[part.iv[0]] = choice.evenest(point, v, chosen, most)
            replaced |= _names(part, chosen)
        return _renamed(self.mechanism, replaced)


def _names(part: _Part, chosen: Index) -> dict[int, str]:
    """The names of components in a cluster, by their positions in y."""
    numbers = in_v(part.cluster.loops.joints)
    return dict(zip(part.inputs.tolist(), (numbers[i].name for i in chosen.tolist()), strict=True))


class _Choice:
    """How well the components of a cluster serve at a point.

    Parameters
    ----------
    part : _Part
    tangent : ndarray (n, m)
        Orthonormal basis of its motions, dimensionless.

    Attributes
    ----------
    share : float
        σ_min of the present components against that of the best ones.
    """

    def __init__(self, part: _Part, tangent: Array) -> None:
        self._part, self._tangent = part, tangent
        self._best = part.candidates[best(tangent[part.candidates])]
        self._most = smallest(tangent, self._best)
        self.share = smallest(tangent, part.cluster.chosen) / self._most

    def _serves(self, chosen: Index) -> bool:
        return smallest(self._tangent, chosen) >= GOOD * self._most

    def conditioned(self) -> Index:
        """The best conditioned components, or those named at first where they are not much worse."""
        first = self._part.at_first
        return first if first is not None and self._serves(first) else self._best

    def evenest(self, point: Point, v: Array, chosen: Index, most: float) -> tuple[Index, float]:
        """`chosen`, or well-conditioned components that are by far more even, and more so than `most`.

        Also the least unevenness that was found.
        """
        part = self._part
        J = point.G[np.ix_(part.iv, part.inputs)] / part.units[:, None]
        g, v = point.g[part.iv] / part.units, v[part.iv] / part.units

        def eta(way: Index) -> float:
            return unevenness(J, way, g, v)

        # single exchanges end at an optimum of their own, which is not the same from both
        found = [evenest(J, start, g, part.candidates, self._serves) for start in (chosen, self._best)]
        found = [way for way in found if self._serves(way)]
        etas, now = [eta(way) for way in found], eta(chosen)
        least = min(etas, default=now)
        if not least < min(most, now / GAIN):  # twice as even, or coordinates would go to and fro
            return chosen, least
        first = part.at_first
        if first is not None and self._serves(first) and eta(first) <= max(least, UNEVEN / GAIN):
            return first, least
        return found[int(np.argmin(etas))], least


def _unevenness(part: _Part, point: Point, v: Array) -> float:
    """That of the present components, whose part of g is zero."""
    return bent(point.g[part.iv] / part.units, v[part.iv] / part.units)


def _renamed(mechanism: Mechanism, replaced: dict[int, str]) -> tuple[str, ...] | None:
    """The independent joints with other names at these positions in y, joints whole; None: the same ones."""
    numbers, names, at = in_v(mechanism.joints), list[str](), 0
    for name in mechanism.independent:
        places = range(at, at + len(mechanism.velocities_of(name)))
        at = places.stop
        if replaced.keys().isdisjoint(places):
            names.append(name)
        else:
            names += [replaced.get(k, numbers[mechanism.iv_independent[k]].name) for k in places]
    return None if set(names) == set(mechanism.independent) else tuple(names)


def _tangent(part: _Part, G: Array) -> Array:
    """Orthonormal basis of a cluster's motions, dimensionless."""
    J = G[np.ix_(part.iv, part.inputs)] / part.cluster.loops.column_scale[:, None]
    return np.asarray(np.linalg.qr(J)[0])  # orthonormal: σ_min of its rows is then the same in any chart


def _sized(mechanism: Mechanism, named: Sequence[str]) -> tuple[list[_Part], Array, Array]:
    """Clusters with a choice, 1 / unit of each velocity (nv,), and what makes their J of G, (nv, m)."""
    parts = _parts(mechanism, named)
    sizes, weights = np.zeros(mechanism.nv), np.zeros((mechanism.nv, mechanism.m))
    for part in parts:
        size = 1.0 / part.cluster.loops.column_scale
        sizes[part.iv] = size
        weights[np.ix_(part.iv, part.inputs)] = size[:, None] / size[part.cluster.chosen]
    return parts, sizes, weights


def _parts(mechanism: Mechanism, named: Sequence[str]) -> list[_Part]:
    """Clusters with a choice of independent velocities: joints of one number where these are such joints."""
    groups = groups_of(mechanism)
    own = mechanism if groups is None else groups.rest
    found = []
    for cluster in own.clusters:
        joints = cluster.loops.joints
        candidates = np.array([joint.idx_v for joint in joints if joint.single], dtype=np.int64)
        if not set(cluster.chosen) <= set(candidates.tolist()):
            candidates = np.arange(cluster.loops.nv)
        if not 0 < cluster.m < len(candidates):
            continue
        iv, inputs = cluster.iv, cluster.inputs
        if groups is not None:
            iv, inputs = groups.rest_iv[iv], groups.rest_inputs[inputs]
        known = [n for n in named if n in cluster.joints or n.rpartition(".")[0] in cluster.joints]
        first = [i for n in known for i in cluster.loops.velocities_of(n) if i in candidates]
        at_first = np.array(first, dtype=np.int64) if len(first) == cluster.m else None
        found.append(_Part(cluster, iv, inputs, mechanism.units[iv], candidates, at_first))
    return found


def in_coordinates(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """The mechanism in these coordinates, made once."""
    made: Mechanism = mechanism.memo.once(
        ("in coordinates", *names), lambda: mechanism.with_independent(names)
    )
    return made
