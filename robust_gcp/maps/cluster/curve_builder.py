"""Builds the bridge of a cluster of mobility 1: nodes on both sides of its singular places, certified.

Nodes are solved where K is regular, and one Hermite polynomial runs through them.
"""

from __future__ import annotations

import numpy as np

from ...mechanism.tree import Array
from .curve import Curve
from .hermite_curve import HermiteCurve
from .jet import Jet, LostError, null_pairing, own_separation, pencil_roots, places_ahead, solved
from .options import BridgeOptions, NoBridgeError

SHRINKS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08)
"""Half widths tried, relative to the zone's: a mode with much curvature needs a shorter bridge."""

SAME = 1e-9
"""Between singular places that are one."""

ALONE = 0.05
"""Share of the way to the next singular place at which a root of the pencil is of this one."""

GOOD = 1e-9
"""Relative error of Γ over the bridge at which no shorter one is tried."""

REACH = 0.4
"""Continuation step as a fraction of the distance to the singular set."""

FAR_SIDE = (0.1, 0.02)
"""Newton's first correction at the first node beyond, and at the others, in half widths."""

COARSE, FINE = 2.0**-6, 2.0**-12
"""Grids of the parameter's direction and origin, and of the nodes."""


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
        # near enough to the tangent, in numbers that do not carry the anchor's rounding: runs that differ by
        # rounding alone, as those of two backends do, get the same curve
        self._C = np.round(anchor.tangent() / COARSE) * COARSE
        self._reference = np.round(anchor.x / COARSE) * COARSE
        self._space, self._options, self._zone = anchor.space, options, zone
        self._anchor = anchor.recharted(self._C)

    def build(self) -> Curve:
        """The best certified curve of several widths.

        Raises
        ------
        NoBridgeError
            When no attempt earns a certificate.
        """
        best: Curve | None = None
        failures: list[NoBridgeError] = []
        for shrink in SHRINKS:
            try:
                curve = self._attempt(self._zone * shrink)
            except NoBridgeError as failure:
                failures.append(failure)
                continue
            except (LostError, np.linalg.LinAlgError) as lost:
                failures.append(NoBridgeError(str(lost)))
                continue
            if best is None or curve.error < best.error:
                best = curve
            if curve.error <= GOOD and curve.kind == "transversal":
                break
        if best is None:
            raise min(failures, key=lambda failure: failure.residual)
        return best

    def _u(self, x: Array) -> float:
        return float(self._C[:, 0] @ (x - self._reference))

    def _attempt(self, half_width: float) -> Curve:
        """The curve between nodes this far from the singular places."""
        anchor = self._anchor
        start, ahead = self._u(anchor.x), places_ahead(anchor, 3.0 * self._zone, 2.0 * half_width)
        if ahead is None:
            raise NoBridgeError("no singular place lies ahead")
        low, high = start + ahead[0], start + ahead[1]
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
        side = (
            -1.0 if center > self._u(self._anchor.x) else 1.0
        )  # where the anchor stands, seen from the centre
        us: list[float] = []
        nodes: list[Jet] = []
        here = self._anchor
        center, w = (FINE * round(number / FINE) for number in (center, w))
        for factor in self._options.nodes:
            u = center + side * factor * w
            here = self._march(here, u)
            us.append(u)
            nodes.append(here)
        P = nodes[0].P
        for k, factor in enumerate(self._options.nodes):
            u = center - side * factor * w
            guess = HermiteCurve(us, nodes).x(u)
            node, first = self._solve(guess, u, P)
            if first > FAR_SIDE[min(k, 1)] * w:
                raise NoBridgeError("beyond the singular place the mode does not go on smoothly", first)
            P = node.P
            us.append(u)
            nodes.append(node)
        self._left, self._right = center - w, center + w
        self._through = HermiteCurve(us, nodes)

    def _march(self, here: Jet, u: float) -> Jet:
        """Along the curve by short steps that stay on the mode."""
        for _ in range(60):
            at = self._u(here.x)
            limit = REACH * min(here.delta(), 1.0)
            last = abs(u - at) <= limit
            to = u if last else at + float(np.clip(u - at, -limit, limit))
            here, first = self._solve(here.predicted(np.array([to - at])), to, here.P)
            if first > 0.25 * abs(to - at) + 1e-14 / max(here.sigma, 1e-12):
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
        for again.
        """
        P = self._through.nodes[0].P

        def places(u: float) -> Array:
            x, slope, _ = self._through.at(u)
            mu = pencil_roots(self._space, P, x, slope, self._C)
            return np.asarray(mu[np.abs(mu.imag) <= 0.5 * np.abs(mu) + 1e-6].real)

        found: list[float] = []
        apart: list[float] = []  # how far from each the next one is
        for start in center + places(center):
            u = float(start)
            if any(abs(u - known) < ALONE * to_next for known, to_next in zip(found, apart, strict=True)):
                continue
            for _ in range(10):
                if not self._through.reaches(u):
                    break
                mu = places(u)
                if not len(mu):
                    break
                step = float(mu[np.argmin(np.abs(mu))])
                u += step
                if abs(step) < SAME:
                    if self._left < u < self._right and not any(abs(u - known) < SAME for known in found):
                        others = np.abs(mu)[np.abs(mu) >= SAME]
                        found.append(u)
                        apart.append(float(others.min(initial=self._right - self._left)))
                    break
        if not found:
            raise NoBridgeError("no singular place lies between the nodes")
        return sorted(found)

    def _certified(self, roots: list[float]) -> Curve:
        """The curve through the nodes, with what vouches for it."""
        space, options, through = self._space, self._options, self._through
        samples = np.linspace(self._left, self._right, 15)[1:-1]
        closure = max(space.residual(x) for x in through.sampled(samples)[0])
        allowed = options.closure_tolerance + space.noise(self._reference)
        if closure > max(allowed, options.geometric_tolerance):
            raise NoBridgeError("the interpolated mode does not close the loops", closure)
        corank, transversality = self._parting(roots)
        if transversality < options.transversality:
            raise NoBridgeError("the modes part at higher than second order", closure, transversality)
        return Curve(
            space,
            self._C,
            self._reference,
            through,
            self._left,
            self._right,
            roots,
            corank,
            "transversal" if closure <= allowed and sum(corank) > 0 else "near miss",
            closure,
            transversality,
            max(self._held_out(), closure),
            np.zeros(space.nv),
        )

    def _parting(self, roots: list[float]) -> tuple[list[int], float]:
        """How many singular values vanish at each place, and how clearly the modes part at the worst one."""
        space, through, P = self._space, self._through, self._through.nodes[0].P
        pairs = [null_pairing(space, P, *through.at(u)[:2], self._C) for u in roots]
        transversality = min(t for _, t in pairs)
        if transversality < self._options.transversality and len(roots) == 1:
            (root,) = roots
            ends = [(through.at(u)[0], u - root) for u in (self._left, self._right)]
            transversality = own_separation(space, P, *through.at(root)[:2], self._C, ends)
        return [r for r, _ in pairs], transversality

    def _held_out(self) -> float:
        """Error of Γ over the bridge, from solved points that the polynomial does not know."""
        us, nodes, worst = self._through.us, self._through.nodes, 0.0
        n, center = len(us), 0.5 * (self._left + self._right)
        for inner, outer in ((n // 2 - 1, n // 2 - 2), (n // 2, n // 2 + 1)):
            u = 0.5 * (us[inner] + us[outer])
            x, _, bend = self._through.at(u)
            known, _ = self._solve(x, u, nodes[inner].P)
            off = float(np.abs(known.bend[0, 0] - bend).max() / (1.0 + np.abs(known.bend[0, 0]).max()))
            growth = float(np.prod(np.abs((us - center) / (us - u)))) ** 2
            worst = max(worst, off * min(growth, 1e3))
        return worst
