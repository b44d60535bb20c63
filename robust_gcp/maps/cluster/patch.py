"""The bridge of a cluster of mobility m > 1: lines across a singular surface whose nodes follow the motion.

Each node is itself followed by a tracker of half the zone, so that where another surface is near the nodes
open bridges of their own: surfaces that overlap become nested lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from ...mechanism.tree import Array
from ..explicit import CrossingKind
from .curve_builder import COARSE
from .jet import Jet, LostError, null_pairing, pencil_roots, solve
from .jet import jet as jet_at
from .line import Line
from .options import BridgeOptions, NoBridgeError
from .space import ClusterSpace

SHRINKS = (1.0, 0.6, 0.36)
"""Half widths tried, relative to the zone's: a mode with much curvature needs a shorter line."""

GOOD = 1e-9
"""Relative error of Γ on the line at which no shorter one is tried."""

NESTED = 0.5
"""Zone of the nodes' own bridges, in half widths: that of the surface crossed does not reach them."""

FAR_SIDE = (0.1, 0.02)
"""Newton's first correction at the first node beyond, and at the others, in half widths."""

MAX_NEWTON, CONVERGED = 12, 1e-11
"""Steps in η to the point at y, and the size of the last: Γ changes by less than its error in it."""


class Follower(Protocol):
    """What follows a cluster's mode from a solved point, as `tracker.Tracker` does."""

    anchor: Jet

    def at(self, y: Array) -> Jet:
        """The point at y on the mode, which becomes the anchor."""
        ...

    def nested(self: F, anchor: Jet, zone: float) -> F:
        """Another one from this point, for zones of this size."""
        ...

    def copy(self: F) -> F:
        """Another one from the same point."""
        ...


F = TypeVar("F", bound=Follower)


class Patch(Generic[F]):
    """A certified line η₀ + s d across a singular surface, moved along with the motion.

    Its coordinates η = Cᵀ x are tangential to the mode, whatever y is: in coordinates that hardly move where
    others do the same mode is bent much more, and Γ across the line is interpolated by its values alone.

    Parameters
    ----------
    tracker : Follower
        Makes the trackers of the nodes.
    anchor : Jet
        A solved point beside the surface.
    options : BridgeOptions
    zone : float
        Half width.

    Attributes
    ----------
    C : ndarray (nv, m)
        Near enough to the tangent space at the anchor, in round numbers.
    d : ndarray (m,)
        Across the surface, in η; of unit arc length.
    left, right : float
        s of the innermost nodes: between them the line is used.
    kind : {"transversal", "near miss"}
    closure, transversality : float
        The certificate: max |φ| between the nodes, in lengths, and `null_pairing`.

    Raises
    ------
    NoBridgeError
        When no attempt earns a certificate.
    """

    kind: CrossingKind

    def __init__(self, tracker: F, anchor: Jet, options: BridgeOptions, zone: float) -> None:
        self.space, self.options = anchor.space, options
        self.C: Array = np.round(anchor.tangent() / COARSE) * COARSE
        anchor = anchor.recharted(self.C)
        self.d: Array = anchor.nearest()[1]
        self.origin: Array = anchor.y
        self._line = Line(self.space, self.C, self.d)
        best: dict[str, object] | None = None
        least = np.inf
        failures: list[NoBridgeError] = []
        for shrink in SHRINKS:
            try:
                self._build(tracker, anchor, zone * shrink, zone)
                error = max(self._held_out(), self.closure)
            except NoBridgeError as failure:
                failures.append(failure)
                continue
            except (LostError, np.linalg.LinAlgError) as lost:
                failures.append(NoBridgeError(str(lost)))
                continue
            if error < least:
                best, least = dict(vars(self)), error
            if error <= GOOD and self.kind == "transversal":
                break
        if best is None:
            raise min(failures, key=lambda failure: failure.residual)
        vars(self).update(best)

    @classmethod
    def known(
        cls,
        space: ClusterSpace,
        options: BridgeOptions,
        C: Array,
        d: Array,
        origin: Array,
        attributes: Mapping[str, object],
    ) -> Patch[F]:
        """A line that was built elsewhere, from its attributes."""
        patch = cls.__new__(cls)
        patch.space, patch.options, patch.C, patch.d, patch.origin = space, options, C, d, origin
        patch._line = Line(space, C, d)
        vars(patch).update(attributes)
        return patch

    # ----------------------------------------------------------------- use

    @property
    def center(self) -> float:
        """Middle of the piece in use."""
        return 0.5 * (self.left + self.right)

    def s(self, eta: Array) -> float:
        """Parameter of the foot of η."""
        return float((eta - self.origin) @ self.d) / float(self.d @ self.d)

    def contains(self, s: float) -> bool:
        """Whether the line is used at s."""
        return self.left <= s <= self.right

    def towards(self, near: Jet, y: Array) -> Array:
        """η of the point at y in the chart of another point near by, to second order."""
        return np.asarray(self.C.T @ near.predicted(y - near.y))

    def at(self, y: Array, C: Array, eta: Array) -> Jet | None:
        """The point with Cᵀ x = y in that chart, by Newton in η from a guess; None beside the line.

        Raises
        ------
        LostError
            When Newton does not converge.
        """
        for _ in range(MAX_NEWTON):
            point = self.point(eta)
            if point is None:
                return None
            step = np.linalg.solve(C.T @ point.J, y - C.T @ point.x)
            if np.abs(step).max() < CONVERGED:
                J = point.J + np.einsum("i,ijn->nj", step, point.bend)
                return replace(point, x=point.x + point.J @ step, J=J).recharted(C)
            eta = np.asarray(eta + step)
        raise LostError("Newton along a line across a singular surface does not converge")

    def point(self, eta: Array) -> Jet | None:
        """The point at η from the line through it, with the nodes moved there; None beside the line."""
        s = self.s(eta)
        foot = eta - s * self.d
        for at, tracker in zip(self.ss, self.trackers, strict=True):
            tracker.at(foot + at * self.d)
        return self._line.at(self.ss, self.nodes, s) if self.contains(s) else None

    def leads_to(self, here: Jet) -> bool:
        """Whether the surface next to a solved point is the one that the line crosses near its middle."""
        distance, way = here.nearest()  # σ grows that way
        ahead = self.s(self.C.T @ (here.x - here.J @ (distance * way)))
        return here.space is self.space and abs(ahead - self.center) < 0.25 * (self.right - self.left)

    def serves(self, here: Jet, y: Array) -> bool:
        """Whether the point at y, from a solved one, lies on the line or beyond it."""
        begun, s = self.s(self.C.T @ here.x), self.s(self.towards(here, y))
        return self.contains(s) or (begun - self.center) * (s - self.center) <= 0.0

    def inner(self, s: float) -> F:
        """The innermost node on the side of s."""
        half = len(self.ss) // 2
        return self.trackers[half if s > self.center else half - 1]

    @property
    def nodes(self) -> list[Jet]:
        """The nodes' present points."""
        return [tracker.anchor for tracker in self.trackers]

    # ----------------------------------------------------------------- building

    def _build(self, tracker: F, anchor: Jet, w: float, zone: float) -> None:
        space, d = self.space, self.d
        mu = anchor.roots(d)
        mu = mu[(np.abs(mu) < 3.0 * zone) & (np.abs(mu.imag) < 0.5 * np.abs(mu))].real
        if not len(mu):
            raise NoBridgeError("no singular surface lies ahead")
        center = float(mu[np.argmin(np.abs(mu))])
        side = -1.0 if center > 0.0 else 1.0
        for _ in range(4):
            ss: list[float] = []
            trackers: list[F] = []
            here = tracker.nested(anchor, NESTED * w)
            for factor in self.options.nodes:
                s = center + side * factor * w
                here = here.copy()
                here.at(self.origin + s * d)
                ss.append(s)
                trackers.append(here)
            P = trackers[0].anchor.P
            for k, factor in enumerate(self.options.nodes):
                s = center - side * factor * w
                guess = self._line.at(ss, [t.anchor for t in trackers], s).x
                x, first = solve(space, guess, self.C, self.origin + s * d, P)
                if first > FAR_SIDE[min(k, 1)] * w:
                    raise NoBridgeError("beyond the singular surface the mode does not go on smoothly", first)
                beyond = jet_at(space, x, self.C)
                P = beyond.P
                ss.append(s)
                trackers.append(tracker.nested(beyond, NESTED * w))
            order = np.argsort(ss)
            self.ss, self.trackers = np.array(ss)[order], [trackers[i] for i in order]
            self.left, self.right = center - w, center + w
            zero = self.zero(center)
            if zero is None:
                raise NoBridgeError("no singular surface lies between the nodes")
            if abs(zero - center) < 0.1 * w:
                return self._certify(zero)
            center = zero
        raise NoBridgeError("the singular surface could not be located")

    def _certify(self, zero: float) -> None:
        space, options = self.space, self.options
        samples = np.linspace(self.left, self.right, 9)[1:-1]
        self.closure = max(space.residual(self._line.at(self.ss, self.nodes, s).x) for s in samples)
        allowed = options.closure_tolerance + space.noise(self.nodes[0].x)
        if self.closure > max(allowed, options.geometric_tolerance):
            raise NoBridgeError("the interpolated mode does not close the loops", self.closure)
        self.kind = "transversal" if self.closure <= allowed else "near miss"
        point = self._line.at(self.ss, self.nodes, zero)
        _, self.transversality = null_pairing(space, point.P, point.x, point.J @ self.d, self.C)
        if self.transversality < options.transversality:
            words = "the modes part at higher than second order"
            raise NoBridgeError(words, self.closure, self.transversality)

    def zero(self, start: float) -> float | None:
        """Where the line meets the surface, to rounding; None where it does not."""
        s = start
        for _ in range(10):
            point = self._line.at(self.ss, self.nodes, s)
            mu = pencil_roots(self.space, point.P, point.x, point.J @ self.d, self.C)
            if not len(mu):
                return None
            step = complex(mu[np.argmin(np.abs(mu))])
            s += step.real
            if not self.ss[0] <= s <= self.ss[-1]:
                return None
            if abs(step) < 1e-12:
                break
        return s

    def _held_out(self) -> float:
        """Relative error of Γ on the line, from solved points that the polynomials do not know."""
        ss, nodes, worst = self.ss, self.nodes, 0.0
        n = len(ss)
        for inner, outer in ((n // 2 - 1, n // 2 - 2), (n // 2, n // 2 + 1)):
            s = 0.5 * (ss[inner] + ss[outer])
            guess = self._line.at(ss, nodes, s)
            x, _ = solve(self.space, guess.x, self.C, self.origin + s * self.d, nodes[inner].P)
            known = jet_at(self.space, x, self.C).bend
            off = float(np.abs(known - guess.bend).max() / (1.0 + np.abs(known).max()))
            worst = max(worst, off * float(np.prod(np.abs((ss - self.center) / (ss - s)))))
        return worst
