"""Between the coordinates of a mechanism and those of its clusters: γ is the product of their maps.

Exponential coordinates of clusters with spherical joints are about a reference. Where y of a cluster is in a
chart (`Coordinates.chart_joints`) both have the same origin, so that w of these joints is x of the cluster.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.coordinates.joint_charts import loop_charts
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..explicit import OUTGROWN, Point
from .jet import Jet
from .space import ClusterSpace


def reference(mechanism: Mechanism, cluster: LoopCluster, anchor: Point) -> Array:
    """The cluster's q (nq,) that coordinates which serve at this point are about."""
    charts = loop_charts(mechanism)
    if charts is None or anchor.origin is None:
        return anchor.q[cluster.iq]
    q = anchor.q.copy()
    q[charts.iq] = anchor.origin
    return np.asarray(q[cluster.iq])


def in_charts(mechanism: Mechanism, cluster: LoopCluster) -> bool:
    """Whether some of the cluster's independent velocities are no rates of numbers in q."""
    charts = loop_charts(mechanism)
    return charts is not None and bool(np.isin(cluster.inputs, charts.inputs).any())


def is_far(point: Jet) -> bool:
    """Whether a joint has turned far from what its cluster's coordinates are about."""
    space = point.space
    if space.flat:
        return False
    turned = np.where(space.tree.rotates, space.D * point.x, 0.0)
    return bool(np.abs(turned).max(initial=0.0) > OUTGROWN)


def chart_coordinates(mechanism: Mechanism, space: ClusterSpace, y: Array) -> Array:
    """The mechanism's y (m,) in the chart of one cluster; w in charts is x of the cluster already."""
    cluster = space.cluster
    own = y[cluster.inputs]
    if not space.flat:
        q = mechanism.home.copy()
        q[cluster.iq] = space.reference
        own = own - mechanism.y_about(q)[cluster.inputs]
    return np.asarray(own / space.D[cluster.chosen])


def product(mechanism: Mechanism, jets: Sequence[Jet], y: Array, ydot: Array) -> tuple[Array, Array, Array]:
    """q (nq,), G (nv, m) and g (nv,) of the whole at y from one point of each cluster."""
    q = mechanism.home.copy()
    G, g = np.zeros((mechanism.nv, mechanism.m)), np.zeros(mechanism.nv)
    for found in jets:
        space, cluster = found.space, found.space.cluster
        u = ydot[cluster.inputs]
        q[cluster.iq] = space.q(found.x)
        turn = space.turn(found.x)
        along = turn @ found.J  # v = along · rate of the chart
        charted = in_charts(mechanism, cluster)
        if charted:  # u are velocities: u = along[chosen] · rate
            to_rate = np.linalg.inv(along[cluster.chosen])
            rate, own = to_rate @ u, along @ to_rate
        else:
            rate, own = u / space.D[cluster.chosen], along / space.D[cluster.chosen]
        xdot = found.J @ rate
        bend = np.einsum("i,j,ijn->n", rate, rate, found.bend)
        left = turn @ bend + space.turn_rate(found.x, xdot) @ xdot  # d(T D ẋ)/dt at ÿ = 0 of the chart
        G[np.ix_(cluster.iv, cluster.inputs)] = own
        # ÿ = 0 of a chart is not u̇ = 0: what its own components accelerate by goes to G
        g[cluster.iv] = left - own @ left[cluster.chosen] if charted else left
    q[mechanism.iq_numbers] = y[mechanism.numbers]
    G[mechanism.iv_independent] = np.eye(mechanism.m)  # exactly, where inverses leave rounding
    g[mechanism.iv_independent] = 0.0
    return q, G, g


def turned(point: Point, mechanism: Mechanism) -> Point:
    """A point of several coordinates, all numbers in q, in those of `mechanism`: G (G_y)⁻¹, g − G g_y."""
    own = mechanism.iv_independent
    G = point.G @ np.linalg.inv(point.G[own])
    ydot = point.G[own] @ point.ydot
    y = point.q[mechanism.iq_independent].copy()
    return replace(point, y=y, ydot=ydot, G=G, g=point.g - G @ point.g[own], curvature=None)
