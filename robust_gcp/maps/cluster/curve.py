"""The bridge of a cluster of mobility 1: its curve through singular places, with certificate.

The curve is parametrised by u = tᵀ (x − x_ref), t the tangent at the anchor, so that neither the
independent joint nor its turning back matters. Nodes are solved on both sides of the singular places where
K is regular, and one Hermite polynomial runs through them.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy

import numpy as np

from ...mechanism.tree import Array
from ..explicit import CrossingKind
from .hermite_curve import HermiteCurve
from .jet import Jet, LostError, null_pairing, own_separation, pencil_roots, places_ahead, solved
from .options import BridgeOptions, NoBridgeError
from .space import ClusterSpace

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

SAME_PLACE = 1e-7
"""Agreement of x by which a point is known to lie on a curve."""


class Curve:
    """A certified piece of a mode of mobility 1, through one or several singular places.

    Parameters
    ----------
    anchor : Jet
        A solved point beside the places.
    options : BridgeOptions
    zone : float
        Half width.

    Attributes
    ----------
    left, right : float
        u of the innermost nodes: between them the curve is used.
    roots : list of float
        u of the singular places, ascending.
    corank : list of int
        How many singular values vanish at each.
    through : HermiteCurve
        The polynomial through the nodes.
    closure : float
        The certificate: max |φ| between the nodes, in lengths.
    transversality : float
        The smallest over the places; see `null_pairing`.
    kind : {"transversal", "near miss"}
    error : float
        Estimated relative error of Γ over the bridge.

    Raises
    ------
    NoBridgeError
        When no attempt earns a certificate.
    """

    C: Array
    reference: Array
    roots: list[float]
    corank: list[int]
    kind: CrossingKind

    def __init__(self, anchor: Jet, options: BridgeOptions, zone: float) -> None:
        self.space: ClusterSpace = anchor.space
        self.options = options
        # near enough to the tangent, in numbers that do not carry the anchor's rounding: runs that differ by
        # rounding alone, as those of two backends do, get the same curve
        self.C = np.round(anchor.tangent() / COARSE) * COARSE
        self.reference = np.round(anchor.x / COARSE) * COARSE
        self.shift = np.zeros(self.space.nv)
        best: dict[str, object] | None = None
        failures: list[NoBridgeError] = []
        for shrink in SHRINKS:
            try:
                self._attempt(anchor.recharted(self.C), zone * shrink, zone)
            except NoBridgeError as failure:
                failures.append(failure)
                continue
            except (LostError, np.linalg.LinAlgError) as lost:
                failures.append(NoBridgeError(str(lost)))
                continue
            if best is None or self.error < best["error"]:  # type: ignore[operator]
                best = dict(self.__dict__)
            if self.error <= GOOD and self.kind == "transversal":
                break
        if best is None:
            raise min(failures, key=lambda failure: failure.residual)
        self.__dict__.update(best)
        self._series = self.through.series(self.left, self.right)

    @classmethod
    def known(
        cls,
        space: ClusterSpace,
        options: BridgeOptions,
        C: Array,
        reference: Array,
        attributes: Mapping[str, object],
    ) -> Curve:
        """A curve that was built elsewhere, from its attributes."""
        curve = cls.__new__(cls)
        curve.space, curve.options, curve.reference = space, options, reference
        vars(curve).update(attributes, C=C)
        curve._series = curve.through.series(curve.left, curve.right)
        return curve

    # ----------------------------------------------------------------- use

    def u(self, x: Array) -> float:
        """Parameter of a configuration."""
        return float(self.C[:, 0] @ (x - self.shift - self.reference))

    def point(self, u: float) -> tuple[Array, Array, Array]:
        """x, dx/du and d²x/du² at u."""
        x, slope, bend = self._series.at(u) if self.contains(u) else self.through.at(u)
        return x + self.shift, slope, bend

    def contains(self, u: float) -> bool:
        """Whether the curve is used at u."""
        return self.left <= u <= self.right

    @property
    def center(self) -> float:
        """Middle of the piece in use."""
        return 0.5 * (self.left + self.right)

    def inner(self, u: float) -> Jet:
        """The innermost node on u's side."""
        nodes = self.through.nodes
        node = nodes[len(nodes) // 2 - int(u <= self.center)]
        return Jet(node.space, node.x + self.shift, node.C, node.J, node.bend, node.P, node.sigma, node.svd)

    def parameter(self, C: Array, y: float, u: float) -> float | None:
        """u with Cᵀ x(u) = y, from a guess; None once it leaves the nodes."""
        c, width = C[:, 0], self.right - self.left
        u = min(max(u, self.through.first), self.through.last)
        for _ in range(30):
            if not self.through.reaches(u, 1e-9):
                return None
            x, slope, _ = self.point(u)
            du = (y - float(c @ x)) / float(c @ slope)
            du = min(max(du, -0.5 * width), 0.5 * width)
            u += du
            if abs(du) < 1e-15 + 4e-16 * abs(u):
                break
        return u if self.through.reaches(u, 1e-9) else None

    def jet(self, C: Array, u: float) -> Jet:
        """The point at u in the chart C: J = x'/y_u, Γ = x''/y_u² − J (C x''/y_u²)."""
        x, slope, bend = self.point(u)
        pace = float(C[:, 0] @ slope)
        J = slope / pace
        second = bend / pace**2
        second = second - J * float(C[:, 0] @ second)
        return Jet(self.space, x, C, J[:, None], second[None, None], self.through.nodes[0].P)

    def turned(self, shift: Array) -> Curve:
        """The same curve after whole turns of hinges, x + shift."""
        other = copy(self)
        other.shift = self.shift + shift
        return other

    def passes(self, x: Array) -> float | None:
        """u of a configuration that lies on the curve; None of another."""
        u = self.u(x)
        if self.through.reaches(u) and np.abs(self.point(u)[0] - x).max() < SAME_PLACE:
            return u
        return None

    # ----------------------------------------------------------------- building

    def _attempt(self, anchor: Jet, half_width: float, zone: float) -> None:
        start, ahead = self.u(anchor.x), places_ahead(anchor, 3.0 * zone, 2.0 * half_width)
        if ahead is None:
            raise NoBridgeError("no singular place lies ahead")
        low, high = start + ahead[0], start + ahead[1]
        for _ in range(5):
            center, w = 0.5 * (low + high), half_width + 0.5 * (high - low)
            self._place_nodes(anchor, center, w)
            self.roots = self._singular_places(center, w)
            first, last = self.roots[0], self.roots[-1]
            if abs(first - low) <= 0.2 * half_width and abs(last - high) <= 0.2 * half_width:
                return self._certify()
            low, high = first, last
        raise NoBridgeError("the singular place could not be located")

    def _place_nodes(self, anchor: Jet, center: float, w: float) -> None:
        """Near nodes by continuation, far nodes by extrapolation of all so far, then Newton."""
        side = -1.0 if center > self.u(anchor.x) else 1.0  # where the anchor stands, seen from the centre
        us: list[float] = []
        nodes: list[Jet] = []
        here = anchor
        center, w = (FINE * round(number / FINE) for number in (center, w))
        for factor in self.options.nodes:
            u = center + side * factor * w
            here = self._march(here, u)
            us.append(u)
            nodes.append(here)
        P = nodes[0].P
        for k, factor in enumerate(self.options.nodes):
            u = center - side * factor * w
            guess = HermiteCurve(us, nodes).x(u)
            node, first = self._solve(guess, u, P)
            if first > FAR_SIDE[min(k, 1)] * w:
                raise NoBridgeError("beyond the singular place the mode does not go on smoothly", first)
            P = node.P
            us.append(u)
            nodes.append(node)
        self.left, self.right = center - w, center + w
        self.through = HermiteCurve(us, nodes)

    def _march(self, here: Jet, u: float) -> Jet:
        """Along the curve by short steps that stay on the mode."""
        for _ in range(60):
            at = self.u(here.x)
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
        y = self.C.T @ self.reference + u
        return solved(self.space, guess, self.C, y, P)

    def _singular_places(self, center: float, w: float) -> list[float]:
        """u of all singular places between the inner nodes, to rounding: Newton by the pencil's roots.

        Of loops that are singular at once the pencil has as many roots that are one: they are not looked
        for again.
        """
        P = self.through.nodes[0].P

        def places(u: float) -> Array:
            x, slope, _ = self.through.at(u)
            mu = pencil_roots(self.space, P, x, slope, self.C)
            return np.asarray(mu[np.abs(mu.imag) <= 0.5 * np.abs(mu) + 1e-6].real)

        found: list[float] = []
        apart: list[float] = []  # how far from each the next one is
        for start in center + places(center):
            u = float(start)
            if any(abs(u - known) < ALONE * to_next for known, to_next in zip(found, apart, strict=True)):
                continue
            for _ in range(10):
                if not self.through.reaches(u):
                    break
                mu = places(u)
                if not len(mu):
                    break
                step = float(mu[np.argmin(np.abs(mu))])
                u += step
                if abs(step) < SAME:
                    if self.left < u < self.right and not any(abs(u - known) < SAME for known in found):
                        others = np.abs(mu)[np.abs(mu) >= SAME]
                        found.append(u)
                        apart.append(float(others.min(initial=self.right - self.left)))
                    break
        if not found:
            raise NoBridgeError("no singular place lies between the nodes")
        return sorted(found)

    def _certify(self) -> None:
        space, options = self.space, self.options
        samples = np.linspace(self.left, self.right, 15)[1:-1]
        self.closure = max(space.residual(x) for x in self.through.sampled(samples)[0])
        allowed = options.closure_tolerance + space.noise(self.reference)
        if self.closure > max(allowed, options.geometric_tolerance):
            raise NoBridgeError("the interpolated mode does not close the loops", self.closure)
        P = self.through.nodes[0].P
        pairs = []
        for u in self.roots:
            x, slope, _ = self.through.at(u)
            pairs.append(null_pairing(space, P, x, slope, self.C))
        self.corank = [r for r, _ in pairs]
        self.transversality = min(t for _, t in pairs)
        if self.transversality < options.transversality and len(self.roots) == 1:
            (root,) = self.roots
            ends = [(self.through.at(u)[0], u - root) for u in (self.left, self.right)]
            self.transversality = own_separation(space, P, *self.through.at(root)[:2], self.C, ends)
        if self.transversality < options.transversality:
            words = "the modes part at higher than second order"
            raise NoBridgeError(words, self.closure, self.transversality)
        certified = self.closure <= allowed and sum(self.corank) > 0
        self.kind = "transversal" if certified else "near miss"
        self.error = max(self._held_out(), self.closure)

    def _held_out(self) -> float:
        """Error of Γ over the bridge, from solved points that the polynomial does not know."""
        us, nodes, worst = self.through.us, self.through.nodes, 0.0
        n = len(us)
        for inner, outer in ((n // 2 - 1, n // 2 - 2), (n // 2, n // 2 + 1)):
            u = 0.5 * (us[inner] + us[outer])
            x, _, bend = self.through.at(u)
            known, _ = self._solve(x, u, nodes[inner].P)
            off = float(np.abs(known.bend[0, 0] - bend).max() / (1.0 + np.abs(known.bend[0, 0]).max()))
            growth = float(np.prod(np.abs((us - self.center) / (us - u)))) ** 2
            worst = max(worst, off * min(growth, 1e3))
        return worst
