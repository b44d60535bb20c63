"""Loop clusters: the closures that share joints, each group as a small mechanism of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..constraint.couplings import AnyClosure
from ..loops import ClosedLoops, once_more
from .loop_graph import LoopGroup, loop_groups, part_of


@dataclass(frozen=True, eq=False)
class LoopCluster:
    """Closures that share joints, with these joints alone, rooted at their lowest common ancestor.

    In the frame of that ancestor φ depends on these joints and on no other: not on a floating base, not on
    joints that carry the loops, on the constraint or off it.

    Attributes
    ----------
    index : int
        Position in `Mechanism.clusters`.
    joints : tuple of str
    closures : tuple of closures
    independent : tuple of str
        Those of the mechanism's independent joints that are in the cluster.
    iq, iv : ndarray of int
        Where the cluster's q and v are in those of the mechanism.
    chosen : ndarray (m,) of int
        Positions among the cluster's v of its independent components.
    inputs : ndarray (m,) of int
        Positions of the same in the mechanism's y.
    loops : ClosedLoops
    """

    index: int
    joints: tuple[str, ...]
    closures: tuple[AnyClosure, ...]
    independent: tuple[str, ...]
    iq: NDArray[np.int64]
    iv: NDArray[np.int64]
    chosen: NDArray[np.int64]
    inputs: NDArray[np.int64]
    loops: ClosedLoops

    @property
    def m(self) -> int:
        """Mobility: how many independent components the cluster has."""
        return len(self.chosen)

    def __repr__(self) -> str:
        return (
            f"LoopCluster({', '.join(self.joints)}: {len(self.closures)} closures, "
            f"y = {', '.join(self.independent) or 'none'})"
        )


def loop_clusters(
    loops: ClosedLoops, independent: Sequence[str], iv_independent: NDArray[np.int64]
) -> tuple[LoopCluster, ...]:
    """The clusters of a mechanism, in the order of their first joint."""
    model = loops.own_model
    clusters: list[LoopCluster] = []
    for group in loop_groups(model, loops.closures):
        members = [model.joints[j] for j in group.joints]
        iq = np.concatenate([np.arange(j.idx_q, j.idx_q + j.nq) for j in members])
        iv = np.concatenate([np.arange(j.idx_v, j.idx_v + j.nv) for j in members])
        inputs = np.flatnonzero(np.isin(iv_independent, iv))
        names = tuple(str(model.names[j]) for j in group.joints)
        closures = tuple(loops.closures[i] for i in group.closures)
        own = tuple(n for n in independent if n in names or n.rpartition(".")[0] in names)
        order = np.argsort(iv)  # couplings may tie a branch beyond a joint of no loop, see `loop_groups`
        chosen = order[np.searchsorted(iv, iv_independent[inputs], sorter=order)]
        # of the loops alone, so that a change of coordinates finds them made
        part = loops.of_loops.once(("loops of", names), partial(_by_itself, loops, closures, group))
        clusters.append(LoopCluster(len(clusters), names, closures, own, iq, iv, chosen, inputs, part))
    return tuple(clusters)


def _by_itself(loops: ClosedLoops, closures: tuple[AnyClosure, ...], group: LoopGroup) -> ClosedLoops:
    """The loops of a group; those of all joints are what they are."""
    model = loops.own_model
    if group.joints == tuple(range(1, model.njoints)) and len(closures) == len(loops.closures):
        return once_more(loops, ClosedLoops)
    return ClosedLoops(part_of(model, closures, group.joints, group.roots), closures)
