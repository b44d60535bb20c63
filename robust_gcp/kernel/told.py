"""What the kernel's derivatives are told of a mode: its series about a place, near which K_d is singular."""

from __future__ import annotations

from ..dynamics.continuation import Around
from ..mechanism.clusters import LoopCluster
from .structures import Arrays, ModeSeries


def mode_series(cluster: LoopCluster, around: Around) -> Arrays:
    """For `rg_learn`."""
    series = around.series()
    center, radius = float(around.circle.center[0]), float(around.circle.radius[0])
    told = Arrays(ModeSeries(count=len(cluster.iv), orders=len(series), center=center, radius=radius))
    told.integers(velocities=cluster.iv)
    told.reals(q=around.q, coefficients=series)
    return told
