"""Points and trackers of the clusters put anew: about another anchor, or in other coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..explicit import Counters, Point
from ..regular_path import RegularPath
from .apex import BesideApex
from .curve import Curve
from .jet import Jet, jet
from .options import BridgeOptions
from .product import product, reference
from .space import space_of
from .tracker import Tracker


def jet_at(mechanism: Mechanism, cluster: LoopCluster, anchor: Point, counters: Counters) -> Jet:
    """One cluster's part of a point of the whole, in coordinates that serve there."""
    space = space_of(mechanism, cluster, reference(mechanism, cluster, anchor))
    counters.svds += 1
    return jet(space, space.x(anchor.q[cluster.iq]), space.chart(cluster.chosen))


def tracker_at(
    mechanism: Mechanism,
    cluster: LoopCluster,
    anchor: Point,
    options: BridgeOptions,
    counters: Counters,
    before: Tracker | None,
) -> Tracker:
    """A tracker on the mode, in coordinates that serve at the anchor; it still tells of curves met."""
    tracker = Tracker(
        jet_at(mechanism, cluster, anchor, counters), options, options.reach(cluster.m), counters
    )
    if before is not None:
        tracker.touched = [bridge for bridge in before.touched if isinstance(bridge, Curve)]
    return tracker


def recharted(
    mechanism: Mechanism, path: RegularPath, here: Point, old: Sequence[Tracker], options: BridgeOptions
) -> tuple[RegularPath, Point, Mapping[int, Tracker]] | None:
    """A point beside the apex of a cone in the coordinates of `mechanism`; None where it is not there.

    There a start would find G anew from K_d, which is known to ε/δ² only.

    Parameters
    ----------
    mechanism : Mechanism
        The same in other coordinates.
    path : RegularPath
        Of the present ones.
    here : Point
    old : sequence of Tracker
        Of all clusters where they are followed one by one, else empty.
    options : BridgeOptions
    """
    known = all(t.current is None and t.anchor.solved and t.space.flat for t in old)
    if not (known and any(isinstance(t.space, BesideApex) for t in old)):
        return None
    trackers, jets = {}, []
    for cluster, tracker in zip(mechanism.clusters, old, strict=True):
        space = space_of(mechanism, cluster, here.q[cluster.iq])
        if isinstance(tracker.space, BesideApex):
            space = BesideApex(space, tracker.space.apex)
        anchor = replace(tracker.anchor.recharted(space.chart(cluster.chosen)), space=space)
        trackers[cluster.index] = Tracker(anchor, options, tracker.zone, path.counters)
        jets.append(anchor)
    y = mechanism.y_about(here.q)
    ydot = (here.G @ here.ydot)[mechanism.iv_independent]
    new = type(path)(mechanism, path.rows, path.counters)
    point = whole_point(y, ydot, product(mechanism, jets, y, ydot), 0.0, len(new.blocks))
    return new, new.renewed(point), trackers


def whole_point(
    y: Array, ydot: Array, parts: tuple[Array, Array, Array], conditioning: float, blocks: int
) -> Point:
    """The point at y with these q, G and g of the clusters' product."""
    none = np.zeros(blocks)  # K_d's blocks were not factorised
    return Point(y.copy(), ydot.copy(), *parts, None, none, none, conditioning)
