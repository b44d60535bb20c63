"""Between the coordinates of a mechanism and those of its clusters: γ is the product of their maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .jet import Jet
from .space import ClusterSpace


def chart_coordinates(mechanism: Mechanism, space: ClusterSpace, y: Array) -> Array:
    """The mechanism's y (m,) in the chart of one cluster, whose independent joints have one number each."""
    cluster = space.cluster
    own = y[cluster.inputs]
    if not space.flat:
        own = own - space.reference[cluster.iq.searchsorted(mechanism.iq_independent[cluster.inputs])]
    return np.asarray(own / space.D[cluster.chosen])


def product(mechanism: Mechanism, jets: Sequence[Jet], y: Array, ydot: Array) -> tuple[Array, Array, Array]:
    """q (nq,), G (nv, m) and g (nv,) of the whole at y from one point of each cluster."""
    q = mechanism.home.copy()
    G, g = np.zeros((mechanism.nv, mechanism.m)), np.zeros(mechanism.nv)
    for found in jets:
        space, cluster = found.space, found.space.cluster
        rate = ydot[cluster.inputs] / space.D[cluster.chosen]
        q[cluster.iq] = space.q(found.x)
        turn, xdot = space.turn(found.x), found.J @ rate
        G[np.ix_(cluster.iv, cluster.inputs)] = turn @ found.J / space.D[cluster.chosen]
        bend = np.einsum("i,j,ijn->n", rate, rate, found.bend)
        g[cluster.iv] = turn @ bend + space.turn_rate(found.x, xdot) @ xdot
    q[mechanism.iq_independent] = y
    G[mechanism.iv_independent] = np.eye(mechanism.m)
    g[mechanism.iv_independent] = 0.0
    return q, G, g
