"""What the kernel's derivatives are told of a mode: its series about a place, near which K_d is singular."""

from __future__ import annotations

from ..dynamics.modes.around import Around
from ..mechanism.coordinates.clusters import LoopCluster
from .structures import Arrays, ModeSeries


def mode_series(cluster: LoopCluster, around: Around) -> Arrays:
    """For `rg_learn`."""
    terms = around.terms.copy()
    terms[0, 0] = around.q
    sizes = dict(zip(("inputs", "first", "second"), (len(around.center), *terms.shape[:2]), strict=True))
    told = Arrays(ModeSeries(count=len(cluster.iv), **sizes))
    told.integers(velocities=cluster.iv)
    told.reals(center=around.center, shares=around.inverse, terms=terms)
    return told
