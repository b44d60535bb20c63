"""Looking after the independent joints: which clusters would do better with others, before a step is taken.

With T an orthonormal basis of a cluster's motions, components E serve as well as σ_min(T[E]) against that of
the best ones (pivoted QR of Tᵀ). In the chart E itself T = J R⁻¹ and J[E] = 1: while the entries of J stay
small, E is good, and nothing is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..dynamics.equations import Torque
from ..dynamics.problem import Problem, set_out
from ..errors import PartitionError, SimulationError, ToggleError
from ..maps.choice import MapChoice
from ..maps.cluster.chart import CHANGE, best, smallest
from ..maps.point import Counters, Point
from ..mechanism.clusters import LoopCluster
from ..mechanism.groups import groups_of
from ..mechanism.joints import in_v
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array

GOOD = 0.6
"""Share of the best components' quality from which those that were named at first are taken again."""

PATIENCE = 1.2
"""By how much the largest entry of J grows until components that proved good are looked at again."""

Index = NDArray[np.int64]


@dataclass(frozen=True)
class _Part:
    """A cluster whose components may be changed, with its places in the whole: v and y."""

    cluster: LoopCluster
    iv: Index
    inputs: Index
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

    Attributes
    ----------
    sizes : ndarray (nv,)
        1 / unit of each velocity in its cluster's dimensionless coordinates; 0 outside of clusters.
    limit : float
        Largest entry of J up to which the coordinates are good.
    """

    def __init__(self, mechanism: Mechanism, named: Sequence[str], counters: Counters) -> None:
        self.mechanism, self._counters = mechanism, counters
        key = ("clusters with a choice of coordinates", *named)
        self._parts, self.sizes, self._weights = mechanism.memo.once(key, lambda: _sized(mechanism, named))
        self.limit = 1.0 / CHANGE

    def suspicious(self, point: Point) -> bool:
        """Whether an entry of J is larger than those of good coordinates."""
        return self.limit < float((np.abs(point.G) * self._weights).max(initial=0.0)) < np.inf

    def better(self, point: Point) -> tuple[str, ...] | None:
        """Independent joints that serve better, changed in poor clusters alone; None where all do well."""
        if not self.suspicious(point):
            return None
        names = self._changed(point.G, CHANGE)
        if names is None:
            self.limit = PATIENCE * float((np.abs(point.G) * self._weights).max())
        return names

    def best(self, point: Point) -> tuple[str, ...] | None:
        """The same with the worst cluster changed wherever others serve better at all."""
        shares = [_quality(part, _tangent(part, point.G)) for part in self._parts]
        return self._changed(point.G, min(max(CHANGE, min(shares, default=0.0) + 1e-9), 1.0 - 1e-9))

    def at_rest(self, q: Array) -> tuple[str, ...] | None:
        """Independent joints for a start where those named turn back, by K's kernel; None where none help."""
        G, groups = np.zeros_like(self._weights), groups_of(self.mechanism)
        for part in self._parts:
            own = (q if groups is None else q[groups.rest_iq])[part.cluster.iq]
            loops = part.cluster.loops
            self._counters.svds += 1
            Vt = np.linalg.svd(loops.scaled(loops.K(own)))[2]
            kernel = loops.column_scale[:, None] * Vt[loops.nv - part.cluster.m :].T
            G[np.ix_(part.iv, part.inputs)] = kernel
        return self._changed(G, CHANGE)

    def _changed(self, G: Array, share: float) -> tuple[str, ...] | None:
        replaced: dict[int, str] = {}
        for part in self._parts:
            tangent = _tangent(part, G)
            if part.cluster.m > 1:
                self._counters.svds += 1
            if _quality(part, tangent) >= share:
                continue
            chosen = part.candidates[best(tangent[part.candidates])]
            if part.at_first is not None and GOOD * smallest(tangent, chosen) < smallest(
                tangent, part.at_first
            ):
                chosen = part.at_first
            numbers = in_v(part.cluster.loops.joints)
            replaced |= zip(part.inputs.tolist(), (numbers[i].name for i in chosen.tolist()), strict=True)
        names = _renamed(self.mechanism, replaced)
        return None if set(names) == set(self.mechanism.independent) else names


def _renamed(mechanism: Mechanism, replaced: dict[int, str]) -> tuple[str, ...]:
    """The independent joints with other names at these positions in y; joints stay whole where they are."""
    numbers, names, at = in_v(mechanism.joints), list[str](), 0
    for name in mechanism.independent:
        places = range(at, at + len(mechanism.velocities_of(name)))
        at = places.stop
        if replaced.keys().isdisjoint(places):
            names.append(name)
        else:
            names += [replaced.get(k, numbers[mechanism.iv_independent[k]].name) for k in places]
    return tuple(names)


def _tangent(part: _Part, G: Array) -> Array:
    """Orthonormal basis of a cluster's motions, dimensionless."""
    J = G[np.ix_(part.iv, part.inputs)] / part.cluster.loops.column_scale[:, None]
    return np.asarray(np.linalg.qr(J)[0])


def _quality(part: _Part, tangent: Array) -> float:
    return smallest(tangent, part.cluster.chosen) / smallest(
        tangent, part.candidates[best(tangent[part.candidates])]
    )


def _sized(mechanism: Mechanism, named: Sequence[str]) -> tuple[list[_Part], Array, Array]:
    """Clusters with a choice, 1 / unit of each velocity (nv,), and what makes their J of G, (nv, m)."""
    parts, sizes, weights = (
        _parts(mechanism, named),
        np.zeros(mechanism.nv),
        np.zeros((mechanism.nv, mechanism.m)),
    )
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
        found.append(_Part(cluster, iv, inputs, candidates, at_first))
    return found


def set_out_well(
    mechanism: Mechanism,
    q0: ArrayLike | None,
    v0: ArrayLike | None,
    mode: ArrayLike | None,
    torque: Torque | ArrayLike | None,
    choice: MapChoice,
    counters: Counters,
) -> Problem:
    """`set_out`, in other coordinates where those of the mechanism turn back at the start.

    Raises
    ------
    ToggleError
        Where no others serve either.
    """
    try:
        return set_out(mechanism, q0, v0, mode, torque, choice, counters)
    except ToggleError as stop:
        q = mechanism.home if q0 is None else mechanism.configuration(q0, "q0")
        found = Coordinates(mechanism, mechanism.independent, counters).at_rest(q)
        for names in ([] if found is None else [found]) + _whole(mechanism, stop.choices):
            other = mechanism.with_independent(names)
            try:
                return set_out(other, q0, v0, mode, torque, choice, counters)
            except (SimulationError, PartitionError):
                continue
        raise


def _whole(mechanism: Mechanism, choices: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Choices of independent joints with those on groups, which are in all of them."""
    groups = groups_of(mechanism)
    kept = [] if groups is None else [n for n in mechanism.independent if n not in groups.rest.independent]
    return [(*kept, *names) for names in choices]
