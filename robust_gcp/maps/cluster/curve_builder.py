"""Builds the bridge of a cluster of mobility 1: nodes on both sides of its singular places, certified.

Nodes are solved where K is regular, and one Hermite polynomial runs through them.
"""

from __future__ import annotations

import numpy as np

from ...mechanism.tree.tree import Array
from .certifying import COARSE, FINE, beyond, certified, closure, held_out, relative, rounded
from .curve import Curve
from .interpolation import HermiteCurve
from .jet import (
    Jet,
    is_singular,
    nearest_of,
    null_pairing,
    own_separation,
    pencil_roots,
    places_ahead,
    solved,
)
from .options import BridgeOptions, NoBridgeError

SHRINKS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08)
"""Half widths tried, relative to the zone's: a mode with much curvature needs a shorter bridge."""

SAME = 1e-9
"""Between singular places that are one."""

ALONE = 0.05
"""Share of the way to the next singular place at which a root of the pencil is of this one."""

REACH = 0.4
"""Continuation step as a fraction of the distance to the singular set."""

CORRECTION = 0.25
"""Newton's first correction against the step: more is another branch."""

MAX_STEPS = 400
"""Such steps at once: off the mode, K may lose rank ten times nearer than along it."""


def leads_astray(first: float, step: float, here: Jet) -> bool:
    """Whether Newton's first correction is so large, rounding apart, that it leads to another mode."""
    return first > CORRECTION * step + 1e-14 / max(here.sigma, 1e-12)


class CurveBuilder:
    """Builds a curve from a solved point beside singular places.

    Parameters
    ----------
    anchor : Jet
    options : BridgeOptions
    zone : float
        Half width.
    """

    def __init__(self, anchor: Jet, options: BridgeOptions, zone: float) -> None:
        self._C = rounded(anchor.tangent(), COARSE)
        self._reference = rounded(anchor.x, COARSE)
        self._space, self._options, self._zone = anchor.space, options, zone
        self._anchor = anchor.recharted(self._C)

    def build(self) -> Curve:
        """The best certified curve of several widths.

        Raises
        ------
        NoBridgeError
            When no attempt earns a certificate.
        """
        return certified(self._attempt, [self._zone * shrink for shrink in SHRINKS])

    def _u(self, x: Array) -> float:
        return float(self._C[:, 0] @ (x - self._reference))

    def _attempt(self, half_width: float) -> Curve:
        """The curve between nodes this far from the singular places."""
        anchor = self._anchor
        # places within 2 w of each other share a curve: between them no node could be w away from both
        start, ahead = self._u(anchor.x), places_ahead(anchor, 3.0 * self._zone, 2.0 * half_width)
        if ahead is None:
            raise NoBridgeError("no singular place lies ahead")
        low, high = start + ahead[0], start + ahead[1]
        # The anchor tells the places to first order only: nodes about these tell them anew, until they agree.
        for _ in range(5):
            center, w = 0.5 * (low + high), half_width + 0.5 * (high - low)
            self._place_nodes(center, w)
            roots = self._singular_places(center)
            first, last = roots[0], roots[-1]
            if abs(first - low) <= 0.2 * half_width and abs(last - high) <= 0.2 * half_width:
                return self._certified(roots)
            low, high = first, last
        raise NoBridgeError("the singular place could not be located")

    def _place_nodes(self, center: float, w: float) -> None:
        """Near nodes by continuation, far nodes by extrapolation of all so far, then Newton."""
        here = self._anchor
        side = -1.0 if center > self._u(here.x) else 1.0  # where the anchor stands, seen from the centre
        center, w = rounded(np.array([center, w]), FINE).tolist()
        us = [center + side * factor * w for factor in self._options.nodes]
        nodes: list[Jet] = []
        for u in us:
            here = self._continued_to(here, u)
            nodes.append(here)
        far = [center - side * factor * w for factor in self._options.nodes]
        nodes += beyond(
            us, nodes, far, w, lambda us, at, u: HermiteCurve(us, at).values_at(u)[0], self._solve
        )
        self._left, self._right = center - w, center + w
        self._through = HermiteCurve(us + far, nodes)

    def _continued_to(self, here: Jet, u: float) -> Jet:
        """Along the curve by short steps that stay on the mode."""
        for _ in range(MAX_STEPS):
            at = self._u(here.x)
            limit = REACH * min(here.delta(), 1.0)
            last = abs(u - at) <= limit
            to = u if last else at + float(np.clip(u - at, -limit, limit))
            here, first = self._solve(here.predicted(np.array([to - at])), to, here.P)
            if leads_astray(first, abs(to - at), here):
                raise NoBridgeError("a node beside the singular place is out of reach")
            if last:
                return here
        raise NoBridgeError("a node beside the singular place is out of reach")

    def _solve(self, guess: Array, u: float, P: Array) -> tuple[Jet, float]:
        y = self._C.T @ self._reference + u
        return solved(self._space, guess, self._C, y, P)

    def _singular_places(self, center: float) -> list[float]:
        """u of all singular places between the inner nodes, to rounding: Newton by the pencil's roots.

        Of loops that are singular at once the pencil has as many roots that are one: they are not looked
        for again. Those next to a place are known best from there.
        """
        found: dict[float, tuple[int, float]] = {}  # how many roots are there, and how far the next one is
        starts = (center + self._places(center)).tolist()
        for start in starts:  # which grows
            if any(abs(start - known) < ALONE * to_next for known, (_, to_next) in found.items()):
                continue
            u = start
            for _ in range(10):
                if not self._through.reaches(u):  # Newton from a place of another mode or of none
                    break
                mu = self._places(u)
                step = nearest_of(mu).real
                u += step
                if abs(step) >= SAME:
                    continue
                if self._left < u < self._right and not any(abs(u - known) < SAME for known in found):
                    others = (mu - step)[np.abs(mu - step) >= SAME]
                    to_next = float(np.abs(others).min(initial=self._right - self._left))
                    found[u] = len(mu) - len(others), to_next
                    starts += [other for other in (u + others).tolist() if self._left < other < self._right]
                break
        if not found:
            raise NoBridgeError("no singular place lies between the nodes")
        self._count = {u: count for u, (count, _) in found.items()}
        return sorted(found)

    def _places(self, u: float) -> Array:
        """Places to first order from the curve at u, real ones."""
        x, slope, _ = self._through.values_at(u)
        mu = pencil_roots(self._space, self._through.nodes[0].P, x, slope, self._C)
        return np.asarray(mu[np.abs(mu.imag) <= 0.5 * np.abs(mu) + 1e-6].real)  # others: modes that veer

    def _certified(self, roots: list[float]) -> Curve:
        """The curve through the nodes, with what vouches for it."""
        space, options, through = self._space, self._options, self._through
        samples = np.linspace(self._left, self._right, 15)[1:-1]  # at the nodes themselves φ is closed
        left, kind = closure(space, options, through.sampled(samples)[0], self._reference)
        known, transversality = self._parting(roots)
        # where the loops stay open K keeps its rank all along, and what the pencil counts has to do
        gap = kind == "near miss"
        corank = [self._count[u] if gap or is_singular(space, through.values_at(u)[0]) else 0 for u in roots]
        # after `closure`: what stays open is a near miss, what closes and parts too little a contact
        if transversality < options.transversality:
            raise NoBridgeError("the modes part at higher than second order", left, transversality)
        return Curve(
            space,
            self._C,
            self._reference,
            through,
            self._left,
            self._right,
            roots,
            corank,
            kind if known else "near miss",  # no σ vanishes: a gap that φ's rounding hides
            left,
            transversality,
            max(self._held_out(), left),
            np.zeros(space.nv),
        )

    def _parting(self, roots: list[float]) -> tuple[bool, float]:
        """Whether singular values vanish at some place, and how clearly the modes part at the worst one."""
        space, through, P = self._space, self._through, self._through.nodes[0].P
        pairs = [null_pairing(space, P, *through.values_at(u)[:2], self._C) for u in roots]
        transversality = min(t for _, t in pairs)
        # where modes touch K and φ'' say nothing: the ends of the curve tell whether it is apart from others
        if transversality < self._options.transversality and len(roots) == 1:
            (root,) = roots
            ends = [(through.values_at(u)[0], u - root) for u in (self._left, self._right)]
            transversality = own_separation(space, P, *through.values_at(root)[:2], self._C, ends)
        return any(r for r, _ in pairs), transversality

    def _held_out(self) -> float:
        """Error of Γ over the bridge, from solved points that the polynomial does not know."""
        through = self._through

        def off(u: float, inner: int) -> float:
            x, _, bend = through.values_at(u)
            known, _ = self._solve(x, u, through.nodes[inner].P)
            return relative(bend, known.bend[0, 0])

        center = 0.5 * (self._left + self._right)
        # x errs by Π³, three data a node; where Π' = 0, in the middle and half way between nodes, Γ by Π²
        return held_out(through.us, center, off, lambda growth: min(growth**2, 1e3))
