"""All ways to assemble the loops: from many starts, until nothing new is met."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import ClosureError, OptionError
from ..coordinates.coordinates import Coordinates
from ..coordinates.partition import numerical_rank
from ..loops import ClosedLoops
from ..tolerances import RANK
from ..tree.joints import Array, Index, in_v
from .assembly import assembled
from .ranges import ranges_of

BATCH, LEAST, MOST = 256, 512, 20_000
"""Starts at once, at least and at most, for each cluster."""

MEETINGS = 5
"""How often each configuration is to be met. By Good and Turing's estimate what is not met has a share of the
starts near that of those met once."""

SAME = 1e-5
"""rad or lengths between configurations that are one; a singular one is met to the root of rounding."""

FAR = 2.0
"""Characteristic lengths that slides start away at most."""

COMBINED = 4096
"""Configurations at most that those of the clusters are combined to."""


@dataclass(frozen=True)
class Assemblies:
    """Ways to assemble a mechanism.

    Attributes
    ----------
    q : ndarray (N, nq)
        The nearest to the given configuration first.
    complete : bool
        Whether each was met at least `MEETINGS` times: another one is then not to be expected, which is no
        proof.
    inside : ndarray of bool (N,)
        Whether the joints are inside their ranges.
    starts : int
        How many were made.
    """

    q: Array
    complete: bool
    inside: NDArray[np.bool_]
    starts: int

    def __len__(self) -> int:
        """How many there are."""
        return len(self.q)


def assemblies(mechanism: Coordinates, q: Array, held: Index) -> Assemblies:
    """`Mechanism.assemblies`, the held joints by their velocities."""
    ways: list[Array] = []
    complete, starts = True, 0
    for cluster in mechanism.clusters:
        loops, here = cluster.loops, q[cluster.iq]
        free = np.flatnonzero(~np.isin(cluster.iv, held))
        found, met, made = _met(loops, here, free)
        complete, starts = complete and min(met, default=0) >= MEETINGS, starts + made
        ways.append(found)
    count = math.prod(map(len, ways))
    if count > COMBINED:
        raise OptionError(
            f"assemblies: the clusters have {' · '.join(str(len(w)) for w in ways)} = {count:,} together, "
            f"more than {COMBINED:,}; hold the joints of all but some"
        )
    every = []
    for choice in itertools.product(*ways):
        one = q.copy()
        for cluster, part in zip(mechanism.clusters, choice, strict=True):
            one[cluster.iq] = part
        every.append(one)
    apart = [float(np.abs(way_between(mechanism, q, one)).max(initial=0.0)) for one in every]
    order = np.argsort(apart, kind="stable")  # equal ones in the order in which they were met, on any machine
    ranges = ranges_of(mechanism)
    table = np.array([every[i] for i in order]).reshape(-1, mechanism.nq)
    return Assemblies(
        table, complete, np.array([not ranges.outside(one) for one in table], dtype=bool), starts
    )


def _met(loops: ClosedLoops, q: Array, free: Index) -> tuple[Array, list[int], int]:
    """Configurations of a cluster, how often each was met, and from how many starts."""
    rng, close = np.random.default_rng(0), _closer(loops, free)
    reach = np.where(loops.tree.rotates, np.pi, FAR * loops.length)  # every angle there is
    found: list[Array] = []
    met: list[int] = []
    places = np.zeros((16, 12 * loops.own_model.njoints))  # p and R of each joint
    moving = starts = 0
    while starts < LEAST or (starts < MOST and min(met, default=MEETINGS) < MEETINGS):
        steps = np.zeros((BATCH, loops.nv))
        steps[:, free] = rng.uniform(-1.0, 1.0, (BATCH, len(free))) * reach[free]
        steps[0] *= starts > 0  # the first is the given one
        starts += BATCH
        for one in close(np.array([loops.tree.integrate(q, step) for step in steps])):
            place = _places(loops, one)  # of bodies: quaternions have two signs, angles whole turns
            known = np.flatnonzero(np.abs(places[: len(found)] - place).max(axis=1, initial=0.0) < SAME)
            if len(known):
                met[int(known[0])] += 1
                continue
            # Of a motion all have a freedom; of assemblies the singular ones, so that a few prove nothing.
            moving += _moves(loops, one, free)
            if len(found) == len(places):
                places = np.vstack([places, np.zeros_like(places)])
            places[len(found)] = place
            found.append(_near(loops, q, one))
            met.append(1)
            if moving > len(found) / 2 and len(found) > 8:
                raise OptionError(
                    "assemblies: with these joints held the others still move, so that there is no end of "
                    f"them; hold more of {', '.join(c.name for c in in_v(loops.joints) if c.iv in free)}"
                )
    return np.array(found).reshape(-1, loops.nq), met, starts


def _closer(loops: ClosedLoops, free: Index) -> Callable[[Array], Array]:
    """Closes many guesses, those that can be."""
    from ...kernel.constraint.assembling import closed  # it stands above what it is made of

    def close(guesses: Array) -> Array:
        q, done = closed(loops, guesses, free)
        if np.any(done):  # none is where the kernel does not know a joint
            return q[done]
        found = []
        for guess in guesses:
            try:
                found.append(assembled(loops, guess, free, "", (0.0,)))
            except ClosureError:
                continue
        return np.array(found).reshape(-1, loops.nq)

    return close


def way_between(loops: ClosedLoops, one: Array, other: Array) -> Array:
    """v (nv,) from one configuration to the other, dimensionless; whole turns do not count."""
    step = loops.tree.difference(one, other)
    turns = loops.tree.periodic
    step[turns] -= 2.0 * np.pi * np.round(step[turns] / (2.0 * np.pi))
    return np.asarray(step / loops.units)


def _near(loops: ClosedLoops, q: Array, one: Array) -> Array:
    """The same configuration with angles within half a turn of those of q."""
    near = one.copy()
    for c in in_v(loops.joints):
        if c.periodic and c.iq >= 0:
            near[c.iq] -= 2.0 * np.pi * np.round((near[c.iq] - q[c.iq]) / (2.0 * np.pi))
    return near


def _places(loops: ClosedLoops, q: Array) -> Array:
    """Where all bodies are, in lengths, and how they are turned."""
    loops.tree.jacobians(q)
    return np.concatenate([(loops.tree.p / loops.length).ravel(), loops.tree.R.ravel()])


def _moves(loops: ClosedLoops, q: Array, free: Index) -> bool:
    """Whether K leaves a freedom to the free velocities."""
    s = np.linalg.svd(loops.scaled(loops.K(q))[:, free], compute_uv=False)
    return numerical_rank(s, RANK) < len(free)
