"""The mid curve between two modes: smooth through any meeting of theirs, of any order of contact.

At corank one beside a singular place, with PK = U S Vᵀ for the nd rows P of the mode: U₁ the left vectors
but the last, a the last. The surface S = {U₁ᵀ φ = 0} is smooth through the place, with the chart (u, w) =
(t, v)ᵀ (x − x_ref), and the modes are the curves f(u, w) = aᵀ φ = 0 on it. v is the direction in which f
bends most, so that f_w = 0 has one solution w₀(u), the mid curve, whatever the modes do, and f = ½ f_ww (w
− w₀)² + g + … with g(u) = f(u, w₀(u)): its zeros are where the modes meet (Morse's splitting lemma).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from ....mechanism.tree.tree import Array
from ..interpolation import NewtonForm, chopped, fitted, nodes
from ..jet import LostError
from ..space import ClusterSpace

RADIUS, SAMPLES = 0.36, 28
"""Half length of the mid curve that is sampled, dimensionless, and at how many Chebyshev nodes."""

SHORTEN, ATTEMPTS, TAIL = 0.7, 5, 1e-13
"""A shorter piece is tried until the last coefficients are as small as this."""

BENDS = 0.1
"""Least share of its largest value that f_ww keeps along the mid curve."""

BEFORE = 6
"""Points that the next one is extrapolated from."""

CONVERGED, STAGNANT, MAX_NEWTON = 3e-16, 1e-11, 14


class Surface:
    """S = {U₁ᵀ φ = 0} about a point, and its chart (u, w).

    Parameters
    ----------
    space : ClusterSpace
        Of mobility 1.
    x : ndarray (nv,)
        Near a singular place; the origin of the chart.
    P : ndarray (nd, rows)
        Rows of φ that determine the mode.

    Attributes
    ----------
    t, v : ndarray (nv,)
        Along the modes, and from one to the other.
    """

    def __init__(self, space: ClusterSpace, x: Array, P: Array) -> None:
        self.space, self.reference = space, x
        nd = space.nd
        # frozen from here on: else x' and x'' on S would take derivatives of the singular vectors too
        U, _, Vt = np.linalg.svd(P @ space.K(x))
        self._U1, self._a, N = P.T @ U[:, : nd - 1], P.T @ U[:, nd - 1], Vt[nd - 1 :]
        form = np.array([self._a @ space.second(x, n) @ N.T for n in N])
        values, vectors = np.linalg.eigh(0.5 * (form + form.T))
        bent = int(np.argmax(np.abs(values)))
        self.v, self.t = (_upright(vectors[:, i] @ N) for i in (bent, 1 - bent))

    def u(self, x: Array) -> float:
        """Chart coordinate along the modes."""
        return float(self.t @ (x - self.reference))

    def w(self, x: Array) -> float:
        """Chart coordinate across them."""
        return float(self.v @ (x - self.reference))

    def f(self, x: Array) -> float:
        """aᵀ φ, in lengths."""
        return float(self._a @ self.space.phi(x))

    def _frame(self, K: Array) -> Array:
        return np.vstack([self._U1.T @ K, self.t, self.v])  # regular: without the row lost there

    def point(self, x: Array, u: float, w: float) -> Array:
        """The point of S at (u, w), by Newton from a guess.

        Raises
        ------
        LostError
        """
        last = np.inf
        for _ in range(MAX_NEWTON):
            phi, K = self.space.linear(x)
            off = np.concatenate([self._U1.T @ phi, [self.u(x) - u, self.w(x) - w]])
            dx = np.linalg.solve(self._frame(K), off)
            x = x - dx
            size = float(np.abs(dx).max())
            if size < CONVERGED or (size < STAGNANT and size > 0.3 * last):
                return x
            if not size < 1e3:
                break
            last = size
        raise LostError("no point of the surface through both modes")

    def along(
        self, x: Array, first: tuple[float, float], second: tuple[float, float]
    ) -> tuple[Array, Array, Array, Array]:
        """x' and x'' of a curve on S through x whose (u, w) have these derivatives; φ' and φ'' along it."""
        K = self.space.K(x)
        frame = self._frame(K)
        J = np.linalg.solve(frame, np.concatenate([np.zeros(len(frame) - 2), first]))
        form = self.space.second(x, J) @ J
        bend = np.linalg.solve(frame, np.concatenate([-self._U1.T @ form, second]))
        return J, bend, K @ J, form + K @ bend

    def across(self, x: Array) -> tuple[float, float, Array, Array]:
        """f_w and f_ww at x, and the derivatives z = x_w and x_ww on S."""
        z, bend, slope, second = self.along(x, (0.0, 1.0), (0.0, 0.0))
        return float(self._a @ slope), float(self._a @ second), z, bend

    def mid(self, x: Array, u: float) -> Array:
        """The point of the mid curve at u, by Newton on f_w = 0 from a guess.

        Raises
        ------
        LostError
        """
        x, last = self.point(x, u, self.w(x)), np.inf
        for _ in range(MAX_NEWTON):
            slope, bend, z, z_w = self.across(x)
            dw = -slope / bend if bend else np.inf
            if not abs(dw) <= 0.5:  # f_ww is about to vanish: a third mode, or none
                break
            x = self.point(x + z * dw + 0.5 * z_w * dw**2, u, self.w(x) + dw)
            if abs(dw) < 1e-15 or (abs(dw) < STAGNANT and abs(dw) > 0.3 * last):
                return x
            last = abs(dw)
        raise LostError("no mid curve between the modes: f does not bend across them")


def _upright(way: Array) -> Array:
    """The way in the sense in which its largest entry is positive, the first of those that are as large."""
    size = np.abs(way)
    return way * np.sign(way[np.flatnonzero(size > 0.999 * size.max())[0]])


class MidCurve:
    """The mid curve about u₀ as Chebyshev series of s = (u − u₀)/R, |s| ≤ 1.

    Attributes
    ----------
    surface : Surface
    u0, R : float
    g : ndarray (orders,)
        f on it, without the coefficients that are rounding.
    bend : ndarray (orders,)
        f_ww on it.
    x : ndarray (orders, nv)
    w : ndarray (orders,)
        w₀.
    tail : float
        The largest of the last coefficients.
    """

    def __init__(self, surface: Surface, x: Array, u0: float, R: float) -> None:
        self.surface, self.u0, self.R = surface, u0, R
        s = nodes(SAMPLES)
        start = surface.mid(x, u0)
        points = np.empty((SAMPLES, len(x)))
        for side in (np.flatnonzero(s > 0)[::-1], np.flatnonzero(s <= 0)):  # each way from u₀, nearest first
            at, known = [0.0], [start]  # outward, each from those before
            for i in side:
                ahead = NewtonForm(np.array(at[-BEFORE:]), np.array(known[-BEFORE:])[:, None])
                points[i] = surface.mid(ahead(s[i : i + 1])[0][0], u0 + R * s[i])
                at.append(s[i])
                known.append(points[i])
        values = [[surface.f(x), surface.across(x)[1]] for x in points]
        table = fitted(np.hstack([values, points]))
        self.tail = float(np.abs(table[-3:]).max())
        # zeros of g are told by its coefficients, so none of these may be rounding: the last show its size
        self.g = chopped(table[:, 0], max(5e-17, 3.0 * float(np.abs(table[-3:, 0]).max())))
        self.bend, self.x = table[:, 1], table[:, 2:]
        w = self.x @ surface.v
        w[0] -= float(surface.v @ surface.reference)
        self.w = chopped(w)

    @property
    def bends(self) -> bool:
        """Whether f bends across the modes all along: where f_ww vanishes three of them meet, or more."""
        bend = np.abs(chebyshev.chebval(np.linspace(-1.0, 1.0, 41), self.bend))
        return bool(bend.min() > BENDS * bend.max())

    @property
    def size(self) -> float:
        """The largest coefficient of g: how far the modes part."""
        return float(np.abs(self.g).max())

    def s(self, u: float) -> float:
        """Where u lies on the series."""
        return (u - self.u0) / self.R

    def values_at(self, u: float) -> tuple[Array, float, float]:
        """x, g and f_ww at u."""
        s = self.s(u)
        x = np.asarray(chebyshev.chebval(s, self.x))
        return x, float(chebyshev.chebval(s, self.g)), float(chebyshev.chebval(s, self.bend))


def mid_curve(surface: Surface, x: Array, u0: float, R: float = RADIUS) -> MidCurve:
    """The longest mid curve about u₀, up to R, whose series have converged.

    Raises
    ------
    LostError
    """
    for _ in range(ATTEMPTS):
        try:
            found = MidCurve(surface, x, u0, R)
        except (LostError, np.linalg.LinAlgError):
            found = None
        if found is not None and found.tail < TAIL and found.bends:
            return found
        R *= SHORTEN
    raise LostError("no mid curve between the modes")
