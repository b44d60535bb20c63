"""Builds the bridge of one mode through a meeting of any corank and any number of modes.

Along a mode ρ(u) = 1/tr(B⁻¹ B'), B = [P K; tᵀ], is (u − u*)/κ + …: its zero is the place, κ the sum of the
orders of contact of all modes that meet there. The mode is marched towards the place through Newton's basin
only, and its far side is found from the near one by the polynomial of least degree that meets the nodes to
their own rounding. A node counts where Newton's first correction is a quarter of its basin by Kantorovich's
theorem: without that test a mode may be swapped for another with closure to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from ....mechanism.tree.tree import Array
from ..certifying import best_of, closure
from ..curve import Curve
from ..interpolation import HermiteCurve, series
from ..jet import Jet, LostError, solved
from ..options import BridgeOptions, NoBridgeError
from ..space import ClusterSpace

SHARES = (1.0, 0.85, 0.7, 0.6, 0.5)
"""Half widths tried, as shares of the distance from the anchor to the place."""

SPOTS = (1.0, 0.75, 0.55, 0.4, 0.3, 0.22)
"""Where nodes lie, in half widths from the place; the third is the edge of what is used."""

BASIN = 0.25
"""Share of Newton's basin within which a node counts; Kantorovich's theorem needs a half."""

WHOLE, SAME_ORDER, SAME_PLACE = 0.1, 0.2, 0.05
"""How near κ must be to a whole number, and κ and the place from the far side to those from the near one."""

HELD_OUT = 1e-7
"""Error of Γ at points that the polynomial does not know."""

LARGEST_DEGREE, TRIED, POINTS = 22, 5, 36


def extrapolated(anchor: Jet, options: BridgeOptions) -> Curve:
    """The anchor's mode through the place ahead.

    Raises
    ------
    NoBridgeError
    """
    best, failures = best_of(lambda share: _Attempt(anchor, share, options), SHARES, lambda _: False)
    if best is None:
        raise NoBridgeError(str(failures[-1]))
    return best.curve()


@dataclass
class _Frame:
    """The chart u = tᵀ (x − x_ref) of a mode."""

    space: ClusterSpace
    P: Array
    t: Array
    reference: Array

    def u(self, x: Array) -> float:
        return float(self.t @ (x - self.reference))

    def node(self, guess: Array, u: float) -> tuple[Jet, float]:
        """The mode's point at u, and the size of Newton's first correction."""
        C = self.t[:, None]
        return solved(self.space, guess, C, C.T @ self.reference + u, self.P)

    def _B(self, x: Array) -> Array:
        return np.vstack([self.P @ self.space.K(x), self.t])

    def rho(self, at: Jet) -> float:
        """1/tr(B⁻¹ B')."""
        rate = np.zeros((self.space.nv, self.space.nv))
        rate[: self.space.nd] = self.P @ self.space.second(at.x, at.recharted(self.t[:, None]).J[:, 0])
        return float(1.0 / np.trace(np.linalg.solve(self._B(at.x), rate)))

    def bend(self, x: Array) -> float:
        """A bound of |φ''|."""
        sizes = [np.linalg.norm(self.P @ self.space.second(x, e), 2) for e in np.eye(self.space.nv)]
        return 1.5 * float(np.linalg.norm(sizes))

    def basin(self, x: Array, bend: float) -> float:
        """σ_min(B)/|φ''|."""
        return float(np.linalg.svd(self._B(x), compute_uv=False)[-1]) / bend


def _degrees(nodes: list[Jet]) -> int:
    """The degree from which series are not determined any more, or not tried."""
    return min(3 * len(nodes) - 2, LARGEST_DEGREE)


class _Attempt:
    """A bridge of one half width."""

    def __init__(self, anchor: Jet, share: float, options: BridgeOptions) -> None:
        space, t = anchor.space, anchor.J[:, 0] / float(np.linalg.norm(anchor.J))
        self._options = options
        frame = self._frame = _Frame(space, anchor.P, t, anchor.x)
        self._bend = frame.bend(anchor.x)
        here = frame.node(anchor.x, 0.0)[0]
        first = frame.rho(here)
        h = 0.02 * abs(first)  # κ = 1/ρ' by a difference
        kappa = h / (frame.rho(self._march(here, h)) - first)
        self._c, self._w = -first * kappa, share * abs(first * kappa)
        side = -float(np.sign(self._c))
        # ρ is a line next to the place alone: its zero is read again from nodes about the last one
        for _ in range(6):
            us = self._c + side * self._w * np.array(SPOTS)
            near = [self._march(here, us[0])]
            for u in us[1:]:
                near.append(self._march(near[-1], u))
            moved, _ = self._place(us - self._c, near)
            self._c += moved
            if abs(moved) < 0.01 * self._w:
                break
        table = self._series(us, near)
        star, way = (np.asarray(chebyshev.chebval(0.0, k)) for k in (table, chebyshev.chebder(table)))
        # in the chart of the tangent at the place: there mirrored nodes are as far from it as the near ones
        self._frame = _Frame(space, anchor.P, way / float(np.linalg.norm(way)), star)
        C = self._frame.t[:, None]
        self._through([node.recharted(C) for node in near])

    def _march(self, here: Jet, u: float) -> Jet:
        """Along the mode by steps within Newton's basin."""
        frame = self._frame
        limit = 0.5 * min(abs(frame.rho(here)), 1.0)
        for _ in range(400):
            at = frame.u(here.x)
            left = u - at
            if abs(left) < 1e-14:
                return here
            last = abs(left) <= limit
            step = left if last else float(np.copysign(limit, left))
            try:
                guess = here.predicted(np.array([step]))
                there, first = frame.node(guess, u if last else at + step)
            except (LostError, np.linalg.LinAlgError):
                there, first = here, np.inf
            if first > BASIN * frame.basin(there.x, self._bend):  # else the mode may be swapped
                limit *= 0.5
                if limit < 1e-9:
                    break
                continue
            here, limit = there, min(1.5 * limit, 0.5 * min(abs(frame.rho(there)), 1.0))
        raise LostError("digits do not suffice to stay on the mode")

    def _through(self, near: list[Jet]) -> None:
        """The far nodes, from those on the near side in the chart of the place."""
        frame = self._frame
        us = [frame.u(node.x) for node in near]
        self._w = max(map(abs, us))
        moved, kappa = self._place(np.array(us), near)
        self._c, self._w = moved, max(abs(u - moved) for u in us)
        self.order = round(kappa)
        if abs(kappa - self.order) > WHOLE or self.order < 1:  # 1.5 at a cusp, say
            raise NoBridgeError(f"the modes meet to the order {kappa:.2f}, which is no whole number")
        nodes = list(near)
        for u in us[::-1]:  # the nearest first: extrapolated least, and known to the next
            mirrored = 2.0 * self._c - u
            guess = np.asarray(chebyshev.chebval((mirrored - self._c) / self._w, self._series(us, nodes)))
            node, first = frame.node(guess, mirrored)
            if first > BASIN * frame.basin(node.x, self._bend):
                raise NoBridgeError("beyond the place the mode lies outside of what its series tells")
            us.append(mirrored)
            nodes.append(node)
        far = nodes[len(near) :]
        # a swapped mode closes to rounding as well; where it came from another order or place shows
        off, order = self._place(np.array(us[len(near) :]) - self._c, far)
        if abs(off) > SAME_PLACE * self._w or abs(order - self.order) > SAME_ORDER:
            raise NoBridgeError("from its far side the place looks another one")
        self._us, self._nodes = us, nodes
        self._fitted()
        held = 0.0
        for share in (-0.87, 0.87, 0.48, -0.48):
            x, _, bend = self._at(share * self._w)
            own = frame.node(x, self._c + share * self._w)[0]
            held = max(held, float(np.abs(own.bend[0, 0] - bend).max()))
        if held > HELD_OUT:
            raise NoBridgeError(f"digits do not suffice: Γ is off by {held:.0e}, {HELD_OUT:g} is allowed")
        self.error = max(self.closed, 1e-3 * held)

    def _fitted(self) -> None:
        """The series of the whole bridge, of the least degree above which the loops close no better."""
        frame, best, least, z = self._frame, np.inf, 3, np.linspace(-0.9, 0.9, 17)
        for _ in range(TRIED):
            if least >= _degrees(self._nodes):
                break
            table = self._series(self._us, self._nodes, least)
            least = len(table)
            left = max(frame.space.residual(x) for x in chebyshev.chebval(z, table).T)
            if left < 0.5 * best:
                best, self._table = left, table
        self._slope, self._second = (chebyshev.chebder(self._table, k) for k in (1, 2))
        samples = chebyshev.chebval(z, self._table).T
        self.closed, self.kind = closure(frame.space, self._options, samples, frame.reference)

    def _place(self, away: Array, at: list[Jet]) -> tuple[float, float]:
        """The zero of ρ, from the present guess of it, and κ there."""
        cubic = np.polyfit(away, [self._frame.rho(node) for node in at], 3)
        roots = np.roots(cubic)
        roots = roots[np.abs(roots.imag) < 1e-2 * self._w].real
        if not len(roots):
            raise NoBridgeError("no singular place lies ahead")
        root = float(roots[np.argmin(np.abs(roots))])
        return root, float(1.0 / np.polyval(np.polyder(cubic), root))

    def _series(self, us: Array | list[float], nodes: list[Jet], least: int = 3) -> Array:
        """Chebyshev series in (u − c)/w of the least degree that meets x, J and Γ to their own rounding.

        That is ε/σ times 1, 1/δ and 1/δ² at a distance δ: what the rows that keep their rank tell is known
        better, and shows in how the loops close.
        """
        z = (np.asarray(us) - self._c) / self._w
        best: tuple[float, Array] | None = None
        for degree in range(least, _degrees(nodes)):
            unit = np.eye(degree + 1)
            tables = [chebyshev.chebval(z, chebyshev.chebder(unit, k) if k else unit) for k in range(3)]
            rows, values = [], []
            for i, node in enumerate(nodes):
                near = max(abs(z[i]), 1e-3)
                for k, value in enumerate((node.x, node.J[:, 0] * self._w, node.bend[0, 0] * self._w**2)):
                    weight = near**k * max(node.sigma, 1e-12) / 2e-16
                    rows.append(weight * tables[k][:, i])
                    values.append(weight * value)
            A, b = np.array(rows), np.array(values)
            found = np.linalg.lstsq(A, b, rcond=None)[0]
            misfit = float(np.sqrt(np.mean((A @ found - b) ** 2)))
            if best is None or misfit < 0.7 * best[0]:
                best = misfit, found
            if misfit < 1.0:  # more terms would follow the rounding, and swing between the nodes
                break
        assert best is not None
        return best[1]

    def _at(self, p: float | Array) -> tuple[Array, Array, Array]:
        """x with its derivatives at u = c + p, or at many."""
        z, w = p / self._w, self._w
        tables = self._table, self._slope / w, self._second / w**2
        x, slope, bend = (np.ascontiguousarray(chebyshev.chebval(z, table).T) for table in tables)
        return x, slope, bend

    def curve(self) -> Curve:
        """The bridge."""
        frame, space = self._frame, self._frame.space
        outer = [i for i, u in enumerate(self._us) if abs(u - self._c) > 0.5 * self._w]
        inner = min(abs(self._us[i] - self._c) for i in outer)
        left, right = self._c - inner, self._c + inner
        star = self._at(0.0)[0]
        singular = int(np.sum(space.factors(star)[1][: space.nd] < 1e-6))
        return Curve(
            space,
            frame.t[:, None],
            frame.reference,
            HermiteCurve([self._us[i] for i in outer], [self._nodes[i] for i in outer]),
            left,
            right,
            [self._c],
            [max(singular, 1)],
            "tangential" if self.kind == "transversal" and self.order > singular else self.kind,
            self.closed,
            0.0,
            self.error,
            np.zeros(space.nv),
            (self.order,),
            series(lambda u: self._at(u - self._c), left, right, POINTS),
        )
