"""The bridge of a cluster of mobility m > 1: lines across a singular surface whose nodes follow the motion.

Each node is itself followed by a tracker of half the zone, so that where another surface is near the nodes
open bridges of their own: surfaces that overlap become nested lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Generic, Protocol, TypeVar

import numpy as np

from ...mechanism.tree import Array
from ..explicit import CrossingKind
from .jet import Jet, LostError, null_pairing, pencil_roots, solve
from .jet import jet as jet_at
from .newton_form import NewtonForm
from .options import BridgeOptions, NoBridgeError
from .space import ClusterSpace

SHRINKS = (1.0, 0.7, 0.5, 0.35)
FAR_SIDE = (0.1, 0.02)
"""Newton's first correction at the first node beyond, and at the others, in half widths."""


class Follower(Protocol):
    """What follows a cluster's mode from a solved point, as `tracker.Tracker` does."""

    anchor: Jet

    def at(self, y: Array) -> Jet:
        """The point at y on the mode, which becomes the anchor."""
        ...

    def nested(self: F, anchor: Jet) -> F:
        """Another one from this point, for zones half as wide."""
        ...

    def copy(self: F) -> F:
        """Another one from the same point."""
        ...


F = TypeVar("F", bound=Follower)


class Patch(Generic[F]):
    """A certified line y₀ + s d across a singular surface, moved along with y.

    Parameters
    ----------
    tracker : Follower
        Makes the trackers of the nodes.
    anchor : Jet
        A solved point beside the surface.
    d : ndarray (m,)
        Towards the surface, in the chart; of unit arc length.
    zone : float
        Half width.

    Raises
    ------
    NoBridgeError
        When no attempt earns a certificate.
    """

    kind: CrossingKind

    def __init__(self, tracker: F, anchor: Jet, d: Array, options: BridgeOptions, zone: float) -> None:
        self.space, self.options = anchor.space, options
        self.C, self.d, self.origin = anchor.C, d, anchor.y
        failures: list[NoBridgeError] = []
        for shrink in SHRINKS:
            try:
                return self._build(tracker, anchor, zone * shrink, zone)
            except NoBridgeError as failure:
                failures.append(failure)
            except (LostError, np.linalg.LinAlgError) as lost:
                failures.append(NoBridgeError(str(lost)))
        raise min(failures, key=lambda failure: failure.residual)

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
        vars(patch).update(attributes)
        return patch

    # ----------------------------------------------------------------- use

    @property
    def center(self) -> float:
        """Middle of the piece in use."""
        return 0.5 * (self.left + self.right)

    def s(self, y: Array) -> float:
        """Parameter of the foot of y."""
        return float((y - self.origin) @ self.d) / float(self.d @ self.d)

    def contains(self, s: float) -> bool:
        """Whether the line is used at s."""
        return self.left <= s <= self.right

    def at(self, y: Array) -> Jet | None:
        """The point at y from the line through it, with the nodes moved there; None beside the line."""
        s = self.s(y)
        foot = y - s * self.d
        for at, tracker in zip(self.ss, self.trackers, strict=True):
            tracker.at(foot + at * self.d)
        return self._interpolated(self.ss, self.nodes, s) if self.contains(s) else None

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
            here = tracker.nested(anchor)
            for factor in self.options.nodes:
                s = center + side * factor * w
                here = here.copy()
                here.at(self.origin + s * d)
                ss.append(s)
                trackers.append(here)
            P = trackers[0].anchor.P
            for k, factor in enumerate(self.options.nodes):
                s = center - side * factor * w
                guess = self._interpolated(np.array(ss), [t.anchor for t in trackers], s).x
                x, first = solve(space, guess, self.C, self.origin + s * d, P)
                if first > FAR_SIDE[min(k, 1)] * w:
                    raise NoBridgeError("beyond the singular surface the mode does not go on smoothly", first)
                beyond = jet_at(space, x, self.C)
                P = beyond.P
                ss.append(s)
                trackers.append(tracker.nested(beyond))
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
        self.closure = max(space.residual(self._interpolated(self.ss, self.nodes, s).x) for s in samples)
        allowed = options.closure_tolerance + space.noise(self.nodes[0].x)
        if self.closure > max(allowed, options.geometric_tolerance):
            raise NoBridgeError("the interpolated mode does not close the loops", self.closure)
        self.kind = "transversal" if self.closure <= allowed else "near miss"
        point = self._interpolated(self.ss, self.nodes, zero)
        _, self.transversality = null_pairing(space, point.P, point.x, point.J @ self.d, self.C)
        if self.transversality < options.transversality:
            words = "the modes part at higher than second order"
            raise NoBridgeError(words, self.closure, self.transversality)

    def zero(self, start: float) -> float | None:
        """Where the line meets the surface, to rounding; None where it does not."""
        s = start
        for _ in range(10):
            point = self._interpolated(self.ss, self.nodes, s)
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

    def _interpolated(self, ss: Array, nodes: list[Jet], s: float) -> Jet:
        """x by Hermite in (x, J d, Γ[d, d]), J in (J, Γ[d, ·]); Γ by values, its parts along d from these."""
        d, m, nv = self.d, self.space.m, self.space.nv
        ss = np.asarray(ss)
        order = np.argsort(ss)
        center, half = float(ss.mean()), float(np.ptp(ss)) / 2.0 or 1.0
        at, z = (ss[order] - center) / half, np.array([(s - center) / half])
        sorted_nodes = [nodes[i] for i in order]
        along = [np.einsum("i,ijn->jn", d, node.bend) for node in sorted_nodes]  # Γ[d, ·], (m, nv)
        x_data = [
            [n.x, (n.J @ d) * half, (d @ row) * half**2] for n, row in zip(sorted_nodes, along, strict=True)
        ]
        J_data = [[n.J.T.ravel(), row.ravel() * half] for n, row in zip(sorted_nodes, along, strict=True)]
        x_form = NewtonForm(at, np.array(x_data)).with_derivatives(z)
        J_form = NewtonForm(at, np.array(J_data)).with_derivatives(z)
        bend_form = NewtonForm(at, np.array([[n.bend.ravel()] for n in sorted_nodes]))
        J = J_form[0][0].reshape(m, nv).T
        rate = J_form[1][0].reshape(m, nv) / half
        bend = bend_form(z)[0].reshape(m, m, nv)
        # in a basis whose first direction is d, the parts along d are derivatives of what is known better
        basis = np.linalg.qr(np.column_stack([d, np.eye(m)]))[0]
        length = float(basis[:, 0] @ d)
        turned = np.einsum("ia,jb,ijn->abn", basis, basis, bend)
        row = (basis.T @ rate) / length
        row[0] = x_form[2][0] / (half * length) ** 2
        turned[0] = row
        turned[:, 0] = row
        bend = np.einsum("ia,jb,abn->ijn", basis, basis, turned)
        best = max(sorted_nodes, key=lambda node: node.sigma)
        return Jet(self.space, x_form[0][0], self.C, J, bend, best.P)
