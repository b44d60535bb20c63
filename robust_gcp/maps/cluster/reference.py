"""What exponential coordinates of clusters with balls are about, and when another place serves better.

Where y of a cluster is in a chart (`Coordinates.chart_joints`) both have the same origin, so that w of these
joints is x of the cluster.
"""

from __future__ import annotations

import numpy as np

from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.coordinates.joint_charts import loop_charts
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from ..explicit import OUTGROWN
from ..point import Point
from .jet import Jet


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
