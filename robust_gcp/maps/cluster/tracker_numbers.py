"""The state of trackers as plain numbers: what passes between this path and the compiled kernel.

An array is its rows, its columns, and its numbers column by column; a tracker's parts come in the order
of `Writer.tracker`, which kernel/cluster/tracker_numbers.h mirrors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...mechanism.tree.tree import Array
from ..explicit import Counters, CrossingKind
from .apex import BesideApex
from .curve import Curve
from .interpolation import HermiteCurve, Series
from .jet import Jet, jet
from .known_curves import KnownCurves
from .options import BridgeOptions
from .patch import Patch
from .space import ClusterSpace
from .tracker import Tracker


def written(trackers: Sequence[Tracker]) -> Array:
    """All that these trackers need to go on; what obstacles they know of is left out.

    The last number is σ where other rows of K were looked for last; −1: here, as is done with every step.
    """
    writer = Writer()
    for tracker in trackers:
        space = tracker.space
        writer.array(space.apex if isinstance(space, BesideApex) else np.empty(0))
        if not space.flat:
            writer.array(space.reference)
        writer.tracker(tracker)
    return np.array([*writer.numbers, -1.0])


def read(
    numbers: Array, spaces: Sequence[ClusterSpace], options: BridgeOptions, counters: Counters
) -> list[Tracker]:
    """The trackers that were written, one for each of these spaces."""
    reader = Reader(numbers, options, counters)
    trackers: list[Tracker] = []
    for space in spaces:
        apex = reader.array()[:, 0]
        if not space.flat:
            space = ClusterSpace(space.cluster, reader.array()[:, 0])
        trackers.append(reader.tracker(BesideApex(space, apex) if len(apex) else space))
    return trackers


class Writer:
    """Appends to a list of numbers."""

    def __init__(self) -> None:
        self.numbers: list[float] = []

    def array(self, values: Array) -> None:
        """An array with one or two axes."""
        table = np.atleast_2d(values.T).T
        self.numbers += [*table.shape, *table.ravel(order="F").tolist()]

    def tracker(self, tracker: Tracker) -> None:
        """A tracker with the bridges that it knows and uses."""
        curves = list(tracker.known.curves)

        def place(curve: Curve) -> int:
            if curve not in curves:
                curves.append(curve)
            return curves.index(curve)

        used = place(tracker.current) if isinstance(tracker.current, Curve) else -1
        space = tracker.space  # curves about another place were told of
        own = (c for c in tracker.touched if isinstance(c, Curve) and (space.flat or c.space is space))
        touched = [place(curve) for curve in own]
        self.numbers += [tracker.u, tracker.zone]
        self._jet(tracker.anchor)
        ahead = tracker.known.ahead
        self.array(np.empty(0) if ahead is None else ahead.x)
        misses = [miss for miss in space.near_misses if miss.options == tracker.options]
        self.numbers += [0.0 if ahead is None else ahead.radius, len(misses)]
        for miss in misses:
            self.array(miss.x)
            self.numbers.append(miss.since)
        self.numbers += [len(curves), used]
        self.array(np.array(touched, dtype=float))
        for curve in curves:
            self._curve(curve)
        patch = tracker.current if isinstance(tracker.current, Patch) else None
        self.numbers.append(patch is not None)
        if patch is not None:
            self._patch(patch)

    def _jet(self, point: Jet) -> None:
        m = point.space.m
        bend = point.bend.reshape(m * m, point.space.nv).T
        for values in (point.x, point.C, point.J, bend, point.P):
            self.array(values)
        self.numbers += [point.sigma, point.solved]

    def _curve(self, curve: Curve) -> None:
        for values in (curve.C, curve.reference, curve.shift, curve.through.us):
            self.array(values)
        for node in curve.through.nodes:
            self._jet(node)
        self.numbers += [curve.left, curve.right]
        self.array(np.array(curve.roots))
        self.array(np.array(curve.corank))
        self.numbers += [curve.closure, curve.transversality, curve.error, curve.kind == "near miss"]
        self.array(np.array(curve.orders, dtype=float))
        self.array(np.empty(0) if curve.inside is None else curve.inside.table.T)

    def _patch(self, patch: Patch[Tracker]) -> None:
        for values in (patch.d, patch.C, patch.origin):
            self.array(values)
        self.numbers += [patch.left, patch.right, patch.closure, patch.transversality, patch.error]
        self.numbers.append(patch.kind == "near miss")
        self.array(np.array(patch.ss))
        for tracker in patch.trackers:
            self.tracker(tracker)


class Reader:
    """Takes what `Writer` wrote, from the first number on."""

    def __init__(self, numbers: Array, options: BridgeOptions, counters: Counters) -> None:
        self._numbers, self._at = numbers, 0
        self._options, self._counters = options, counters

    def number(self) -> float:
        """The next number."""
        self._at += 1
        return float(self._numbers[self._at - 1])

    def array(self) -> Array:
        """The next array, (rows, columns)."""
        rows, columns = int(self.number()), int(self.number())
        begun, self._at = self._at, self._at + rows * columns
        return self._numbers[begun : self._at].reshape((rows, columns), order="F").copy()

    def tracker(self, space: ClusterSpace) -> Tracker:
        """The next tracker."""
        u, zone = self.number(), self.number()
        tracker = Tracker(self._jet(space), self._options, zone, self._counters)
        self.array(), self.number()  # what lies ahead, and is missed, is remembered by whoever found it
        for _ in range(int(self.number())):
            self.array(), self.number()
        count, used = int(self.number()), int(self.number())
        touched = [int(at) for at in self.array().ravel()]
        tracker.u = u
        if count:
            tracker.known = KnownCurves([self._curve(space) for _ in range(count)])
        if used >= 0:
            tracker.current = tracker.known.curves[used]
        if self.number():
            tracker.current = self._patch(space)
        tracker.touched = [tracker.known.curves[at] for at in touched]
        if isinstance(tracker.current, Patch):
            tracker.touched.append(tracker.current)
        return tracker

    def _jet(self, space: ClusterSpace) -> Jet:
        x, C, J, bend, P = (self.array() for _ in range(5))
        sigma, m = self.number(), C.shape[1]
        if self.number():
            # with P of other signs the last bits differ
            return replace(jet(space, x[:, 0], C), P=P)
        return Jet(space, x[:, 0], C, J, bend.T.reshape(m, m, -1), P, sigma)

    def _curve(self, space: ClusterSpace) -> Curve:
        C, reference, shift, us = (self.array() for _ in range(4))
        through = HermiteCurve(us[:, 0].tolist(), [self._jet(space) for _ in us])
        left, right = self.number(), self.number()
        roots, corank = self.array().ravel().tolist(), self.array().ravel().astype(int).tolist()
        closure, transversality, error, near_miss = (self.number() for _ in range(4))
        orders = tuple(self.array().ravel().astype(int).tolist())
        table = self.array().T
        inside = Series.between(left, right, table) if table.size else None
        kind: CrossingKind = (
            "within"
            if not roots
            else "near miss"
            if near_miss
            else "tangential"
            if max(orders, default=1) > 1
            else "transversal"
        )
        return Curve(
            space, C, reference[:, 0], through, left, right, roots, corank, kind, closure, transversality,
            error, shift[:, 0], orders, inside,
        )  # fmt: skip

    def _patch(self, space: ClusterSpace) -> Patch[Tracker]:
        d, C, origin = (self.array() for _ in range(3))
        left, right, closure, transversality, error, near_miss = (self.number() for _ in range(6))
        ss = self.array()[:, 0].tolist()
        trackers = [self.tracker(space) for _ in ss]
        kind: CrossingKind = "near miss" if near_miss else "transversal"
        return Patch(
            space, C, d[:, 0], origin[:, 0], ss, trackers, left, right, kind, closure, transversality, error
        )  # fmt: skip
