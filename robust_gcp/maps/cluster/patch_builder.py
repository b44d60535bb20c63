"""Builds the line of a cluster of mobility m > 1 across a singular surface, and certifies it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic

import numpy as np

from ...mechanism.tree.tree import Array
from .certifying import COARSE, beyond, certified, closure, held_out, relative, rounded
from .jet import Jet, nearest_of, null_pairing, pencil_roots, solved
from .line import jet_on_line
from .obstacles import ObstacleError
from .options import BridgeOptions, NoBridgeError
from .patch import F, Patch

SHRINKS, SHORTER = (1.0, 0.6, 0.36), (0.216, 0.13)
"""Half widths tried, relative to the zone's, and those where none serves: a mode that is much curved needs a
shorter line, on which rounding leaves more."""

NODES = (1.0, 2.0, 3.0, 4.0)
"""Distances of the nodes in half widths. Γ across a line is interpolated by its values alone: one node a side
more than a curve has brings its error from w⁶ to w⁸, and far apart they multiply its rounding by 3 alone."""

LARGEST_ERROR = 1e-7
"""Relative error of Γ up to which a line is used: rounding leaves more of the shortest ones, which lie next
to several surfaces at once."""

NESTED = 0.5
"""Zone of the nodes' own bridges, in half widths: that of the surface crossed does not reach them."""


class PatchBuilder(Generic[F]):
    """Builds a line from a solved point beside a singular surface.

    Parameters
    ----------
    tracker : Follower
        Makes the trackers of the nodes.
    anchor : Jet
    options : BridgeOptions
    zone : float
        Half width.
    """

    def __init__(self, tracker: F, anchor: Jet, options: BridgeOptions, zone: float) -> None:
        self._C = rounded(anchor.tangent(), COARSE)
        self._space, self._options, self._zone = anchor.space, options, zone
        self._tracker, self._anchor = tracker, anchor.recharted(self._C)
        self._d = self._anchor.nearest()[1]
        self._origin = self._anchor.y

    def build(self) -> Patch[F]:
        """The best certified line of several widths.

        Raises
        ------
        NoBridgeError
            When no attempt earns a certificate.
        """
        mu = self._anchor.roots(self._d)
        mu = mu[(np.abs(mu) < 3.0 * self._zone) & (np.abs(mu.imag) < 0.5 * np.abs(mu))].real
        if not len(mu):
            raise NoBridgeError("no singular surface lies ahead")
        self._ahead = nearest_of(mu).real
        half_widths = ([self._zone * shrink for shrink in shrinks] for shrinks in (SHRINKS, SHORTER))
        return certified(self._attempt, *half_widths)

    def _attempt(self, w: float) -> Patch[F]:
        """The line between nodes this far from the surface."""
        center = self._ahead
        for _ in range(4):
            self._place_nodes(center, w)
            zero = self._zero(center)
            if abs(zero - center) < 0.1 * w:  # nodes about a guess of first order are laid anew
                return self._certified(zero)
            center = zero
        raise NoBridgeError("the singular surface could not be located")

    def _place_nodes(self, center: float, w: float) -> None:
        """Near nodes by continuation, far nodes by extrapolation of all so far, then Newton."""
        side = -1.0 if self._ahead > 0.0 else 1.0  # where the anchor stands, seen from the centre
        ss = [center + side * factor * w for factor in NODES]
        far = [center - side * factor * w for factor in NODES]
        trackers: list[F] = []
        here = self._tracker.nested(self._anchor, NESTED * w)  # from node to node, each keeps its own
        for s in ss:
            here = here.copy()
            self._follow(here, s)
            trackers.append(here)
        near = [tracker.anchor for tracker in trackers]
        jets = beyond(ss, near, far, w, lambda ss, nodes, s: self._between(ss, nodes, s).x, self._solve)
        trackers += [self._beside(jet, s, w) for jet, s in zip(jets, far, strict=True)]
        order = np.argsort(ss + far)
        self._ss, self._trackers = [(ss + far)[i] for i in order], [trackers[i] for i in order]
        self._left, self._right = center - w, center + w

    def _beside(self, solved: Jet, s: float, w: float) -> F:
        """A node from its solved point: on a line of its own where that is next to another surface."""
        node = self._tracker.nested(solved, NESTED * w)
        self._follow(node, s)
        return node

    def _follow(self, node: F, s: float) -> None:
        """Put a node at s; where another surface stops it there, nodes of a shorter line may pass."""
        try:
            node.jet_at(self._eta(s))
        except ObstacleError as met:
            raise NoBridgeError(met.obstacle.reason) from met

    def _eta(self, s: float) -> Array:
        return np.asarray(self._origin + s * self._d)

    def _solve(self, guess: Array, s: float, P: Array) -> tuple[Jet, float]:
        return solved(self._space, guess, self._C, self._eta(s), P)

    def _at(self, s: float) -> Jet:
        """The point at s by interpolation."""
        return self._between(self._ss, [tracker.anchor for tracker in self._trackers], s)

    def _between(self, ss: Sequence[float], nodes: Sequence[Jet], s: float) -> Jet:
        return jet_on_line(self._space, self._C, self._d, ss, nodes, s)

    def _zero(self, start: float) -> float:
        """Where the line meets the surface, to rounding."""
        s = start
        for _ in range(10):
            point = self._at(s)
            mu = pencil_roots(self._space, point.P, point.x, point.J @ self._d, self._C)
            step = nearest_of(mu)
            s += step.real
            if not self._ss[0] <= s <= self._ss[-1]:
                raise NoBridgeError("no singular surface lies between the nodes")
            if abs(step) < 1e-12:
                break
        return s

    def _certified(self, zero: float) -> Patch[F]:
        """The line through the nodes, with what vouches for it."""
        space, options = self._space, self._options
        samples = np.linspace(self._left, self._right, 9)[1:-1]
        beside = self._trackers[0].anchor.x
        left, kind = closure(space, options, (self._at(s).x for s in samples), beside)
        point = self._at(zero)
        _, transversality = null_pairing(space, point.P, point.x, point.J @ self._d, self._C)
        if transversality < options.transversality:  # |φ| below cannot tell modes that touch
            raise NoBridgeError("the modes part at higher than second order", left, transversality)
        error = max(self._held_out(), left)
        if error > LARGEST_ERROR:
            raise NoBridgeError("the mode is too curved, or told too little, for a line across", left)
        return Patch(
            space,
            self._C,
            self._d,
            self._origin,
            self._ss,
            self._trackers,
            self._left,
            self._right,
            kind,
            left,
            transversality,
            error,
        )

    def _held_out(self) -> float:
        """Relative error of Γ on the line, from solved points that the polynomials do not know."""

        def off(s: float, inner: int) -> float:
            guess = self._at(s)
            solved, _ = self._solve(guess.x, s, self._trackers[inner].anchor.P)
            # K may be near another surface there: the node's own line tells Γ, not the solved point
            known = self._beside(solved, s, 0.5 * (self._right - self._left)).anchor
            return relative(guess.bend, known.bend)

        # Γ across the line is interpolated by its values: Π itself, where curves have Π²
        return held_out(self._ss, 0.5 * (self._left + self._right), off, lambda growth: growth)
