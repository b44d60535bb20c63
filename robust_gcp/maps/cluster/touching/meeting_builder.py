"""Builds the bridge of a mode of mobility 1 through a meeting of any order of contact, and certifies it.

On the surface S through both modes (`mid_curve`) a mode is w = w₀(u) + Π(u) z(u), Π = Π(u − u_i)^k_i, z
analytic: a weighted fit of z from where w is known well, and x(u) is the point of S there. Which mode is
which is the sign of (w − w₀) Π, which a mode keeps: a discrete decision, the parity of the orders.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from ....mechanism.tree.tree import Array
from ..certifying import best_of, closure
from ..curve import Curve
from ..interpolation import HermiteCurve, Series, chopped, fitted, nodes, series
from ..jet import Jet, LostError, solved
from ..options import BridgeOptions, NoBridgeError
from .meeting import Meeting, half_width

POINTS, LEAST_POINTS, LARGEST_DEGREE, SERIES = 60, 12, 28, 48
"""Points of the mode that z is fitted to, how few serve, up to which degree, and those of series."""

KNOWN = 1e-9
"""|f_w Π| below which w says nothing of z."""

WIDTHS = (1.0, 0.85, 0.7, 0.55, 0.4)
"""Shares of the mid curve that are tried."""

GOOD, BAD = 5e-12, 1e-11
"""Errors, in lengths, at which no shorter one is tried, and of which none is used."""

INNER, NODES = 0.62, (1.0, 1.25, 1.5)
"""Share of the fit that is used at most, and where the mode's own points lie, in units of what is used."""


def bridge_through(found: Meeting, anchor: Jet, options: BridgeOptions) -> Curve | None:
    """The anchor's mode through a meeting; None where the anchor lies too far away to tell.

    Raises
    ------
    NoBridgeError
        Where the mode is not known well enough.
    """
    surface, u = found.curve.surface, found.curve.surface.u(anchor.x)
    if abs(found.curve.s(u)) > 0.9:  # at their ends series of x are known worst
        return None
    x0 = found.curve.values_at(u)[0]
    side = float(np.sign(surface.w(anchor.x) - surface.w(x0))) * found.parity(u)
    return mode_through(found, side, anchor.P, options)


def mode_through(found: Meeting, side: float, P: Array, options: BridgeOptions) -> Curve:
    """One of the two modes through a meeting: that with (w − w₀) Π of this sign.

    Raises
    ------
    NoBridgeError
        Where it is not known well enough.
    """
    if side not in found.bridges:  # half a second, each once for a mechanism
        found.bridges[side] = _best(found, side, _Through(found), options).curve(P)
    return found.bridges[side]


def _best(found: Meeting, side: float, way: _Through | _Round, options: BridgeOptions) -> _Branch:
    """The branch of this side, on the longest piece on which it is good, else on that of the least error."""

    def branch(share: float) -> _Branch:
        return _Branch(found, side, way, share * way.reach, options)

    best, failures = best_of(
        branch, WIDTHS, lambda made: made.error < GOOD, (LostError, np.linalg.LinAlgError)
    )
    if best is None:
        raise NoBridgeError(str(failures[-1]))
    if best.error > BAD:
        raise NoBridgeError(f"digits do not suffice: {best.error:.0e} lengths where {BAD:g} are needed")
    return best


class _Through:
    """u = u_c + p about the middle of the places, and Π(p) = Π(u − u_i)^k_i."""

    def __init__(self, found: Meeting) -> None:
        self.orders = found.orders
        self.center = 0.5 * (self.orders[0][0] + self.orders[-1][0])
        self.reach = 0.98 * found.curve.R - abs(self.center - found.curve.u0)

    def u(self, p: float) -> tuple[float, float, float]:
        """u with its two derivatives."""
        return self.center + p, 1.0, 0.0

    def pi(self, p: float) -> float:
        """Π."""
        return float(np.prod([(self.center + p - place) ** k for place, k in self.orders]))


class _Round:
    """u = u* ± p² about a cusp of multiplicity n, and Π(p) = pⁿ: both its branches as one curve."""

    def __init__(self, found: Meeting) -> None:
        curve = found.curve
        self.center, self._n = next((u, p) for u, p in found.places if p > 1 and p % 2)
        room = 0.98 * curve.R - abs(self.center - curve.u0)
        _, g, bend = curve.values_at(self.center + 0.5 * room)
        self.side = 1.0 if -g * bend > 0.0 else -1.0  # where the modes are real
        self.reach = float(np.sqrt(room))

    def u(self, p: float) -> tuple[float, float, float]:
        """u with its two derivatives."""
        return self.center + self.side * p * p, 2.0 * self.side * p, 2.0 * self.side

    def pi(self, p: float) -> float:
        """Π."""
        return p**self._n


def round_cusp(found: Meeting, options: BridgeOptions) -> Series:
    """Both branches of a cusp as one curve, x(p) with u = u* ± p², as Chebyshev series.

    Raises
    ------
    NoBridgeError
        Where it is not known well enough.
    """
    branch = _best(found, 1.0, _Round(found), options)
    return series(branch.sampled, -0.9 * branch.R, 0.9 * branch.R, SERIES)


class _Branch:
    """w of one mode along a parameter p, |p| ≤ R, and its error."""

    def __init__(
        self, found: Meeting, side: float, way: _Through | _Round, R: float, options: BridgeOptions
    ) -> None:
        self._found, self._way, self.R, self._options = found, way, R, options
        self._surface, self._mid = found.curve.surface, found.curve
        s = nodes(POINTS)
        rows = [(si, *row) for si in s if (row := self._seen(float(si), side)) is not None]
        if len(rows) < LEAST_POINTS:
            raise LostError("too few digits tell the modes apart")
        at, z, weight = np.array(rows).T
        weight /= weight.max()
        held, degree = _degree(at, z, weight)  # every second point: a fit to all has no error to show
        self._z = _fit(at, z, weight, degree)
        self._series()
        samples = [self._x(float(q)) for q in np.linspace(-0.9, 0.9, 15)]
        self.closed, self.kind = closure(self._surface.space, options, samples, self._surface.reference)
        self.error = max(self.closed, held)

    def _seen(self, s: float, side: float) -> tuple[float, float] | None:
        """z and its weight |f_w Π| at a node, from the mode's own point there; None where it says nothing."""
        surface, p = self._surface, self.R * s
        u, pi = self._way.u(p)[0], self._way.pi(p)
        x0, g, bend = self._mid.values_at(u)
        squared = -2.0 * g / bend
        if abs(pi * bend) * np.sqrt(abs(squared)) < KNOWN:
            return None
        if squared < 0.0:
            raise LostError("there is no mode on one side of the place")
        w0, away = surface.w(x0), side * float(np.sign(pi)) * float(np.sqrt(squared))
        # Newton in w on f = 0 at this u, from ±√(−2g/f_ww): second order of Morse's lemma
        x, last = surface.point(x0 + surface.across(x0)[2] * away, u, w0 + away), np.inf
        for _ in range(12):
            slope, _, z, _ = surface.across(x)
            step = -surface.f(x) / slope
            if abs(step) > 0.3 * abs(away):  # towards w₀ f_w vanishes, and beyond is the other mode
                raise LostError("the modes cannot be told apart")
            away += step
            x = surface.point(x + z * step, u, w0 + away)
            if abs(step) < 1e-16 or (abs(step) < 1e-11 and abs(step) > 0.3 * last):
                break
            last = abs(step)
        return away / pi, abs(slope * pi)  # f is known to ε, w to ε/f_w and z to ε/|f_w Π|

    def _series(self) -> None:
        """w as one Chebyshev series, with its derivatives; cut where coefficients are rounding."""
        s = nodes(SERIES)
        us, pis = np.array([(self._way.u(p)[0], self._way.pi(p)) for p in self.R * s]).T
        w = chebyshev.chebval((us - self._mid.u0) / self._mid.R, self._mid.w) + pis * chebyshev.chebval(
            s, self._z
        )
        self._w = [chopped(fitted(w))]  # before it is differentiated, which would raise rounding
        self._w += [chebyshev.chebder(self._w[0], 1) / self.R, chebyshev.chebder(self._w[0], 2) / self.R**2]

    def _x(self, s: float) -> Array:
        """The point of the mode."""
        u, w = self._way.u(self.R * s)[0], float(chebyshev.chebval(s, self._w[0]))
        x0 = self._mid.values_at(u)[0]
        return self._surface.point(x0 + self._surface.v * (w - self._surface.w(x0)), u, w)

    def point(self, p: float) -> tuple[Array, Array, Array]:
        """x with its two derivatives by p."""
        s = p / self.R
        x = self._x(s)
        first, second = (float(chebyshev.chebval(s, w)) for w in self._w[1:])
        _, pace, turn = self._way.u(p)
        return x, *self._surface.along(x, (pace, first), (turn, second))[:2]

    def sampled(self, ps: Array) -> tuple[Array, Array, Array]:
        """The same at many p."""
        x, slope, bend = zip(*map(self.point, ps.tolist()), strict=True)
        return np.array(x), np.array(slope), np.array(bend)

    def curve(self, P: Array) -> Curve:
        """The bridge: the series where the modes are near each other, between solved points of the mode."""
        orders, center = self._found.orders, self._way.center
        spread = 0.5 * (orders[-1][0] - orders[0][0])
        # no farther than Newton needs it: beyond, the mode's own points are better than the fit
        inner = min(INNER * self.R, half_width(sum(k for _, k in orders)) + spread)
        surface = self._surface
        C, us = surface.t[:, None], [center + side * f * inner for side in (-1.0, 1.0) for f in NODES]
        own = []
        for u in us:
            guess = self.point(u - center)[0]
            jet, first = solved(surface.space, guess, C, C.T @ surface.reference + u, P)
            if first > 1e-6:  # 1e-13 where they agree
                raise NoBridgeError("the mode's own points lie beside its series")
            own.append(jet)
        left, right = center - inner, center + inner
        return Curve(
            surface.space,
            C,
            surface.reference,
            HermiteCurve(us, own),
            left,
            right,
            [u for u, _ in orders],
            [1] * len(orders),
            "tangential" if self.kind == "transversal" and self._found.order > 1 else self.kind,
            max(self.closed, self._found.gap),
            0.0,
            self.error,
            np.zeros(surface.space.nv),
            tuple(k for _, k in orders),
            series(lambda u: self.sampled(u - center), left, right, SERIES),
        )


def _fit(s: Array, z: Array, weight: Array, degree: int) -> Array:
    powers = chebyshev.chebvander(s, degree) * weight[:, None]
    return np.asarray(np.linalg.lstsq(powers, z * weight, rcond=None)[0])


def _degree(s: Array, z: Array, weight: Array) -> tuple[float, int]:
    """The error at every second point of the best fit to the others, and its degree."""
    odd = np.arange(len(s)) % 2 == 1
    best = np.inf, 2
    for degree in range(2, min(len(s) // 2, LARGEST_DEGREE), 2):
        known = _fit(s[~odd], z[~odd], weight[~odd], degree)
        off = float(np.abs((chebyshev.chebval(s[odd], known) - z[odd]) * weight[odd]).max())
        if off < 0.5 * best[0]:
            best = off, degree
    return best
