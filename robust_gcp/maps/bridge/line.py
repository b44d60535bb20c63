"""Interpolation of the explicit map along a line in y, between solved points."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from math import acos

import numpy as np
import scipy

from ...mechanism.tree import Array
from ..point import Point
from ..regular_path import RegularPath
from .newton_form import NewtonForm


@dataclass(frozen=True)
class Polynomial:
    """γ, γ', γ'' and det between the innermost nodes as Chebyshev series, for m = 1.

    At s the argument is u = ((s − center)/unit − middle)/half in [−1, 1]. The series' values are
    q − reference, G times pace, γ'' times pace² and the determinants, side by side.

    Attributes
    ----------
    coefficients : ndarray (orders, 3 nv + nblocks)
    reference : ndarray (nq,)
    center, unit, middle, half, pace : float
    """

    coefficients: Array
    reference: Array
    center: float
    unit: float
    middle: float
    half: float
    pace: float


class Line:
    """γ, G and g along y₀ + s d, interpolated from solved points.

    For m = 1 one Hermite polynomial through q, G and γ'' at n nodes, of degree 3n − 1, and its
    derivatives. Else q is interpolated with its derivative in the chart at the first node, and G
    with its derivative dG/ds = γ''[d, ·] where that is known, both of degree 2n − 1.

    Parameters
    ----------
    path : RegularPath
    origin, direction : ndarray (m,)
        y₀ and d.
    nodes : sequence of (float, Point)
        Arc parameter s and the point there.
    """

    def __init__(
        self,
        path: RegularPath,
        origin: Array,
        direction: Array,
        nodes: Sequence[tuple[float, Point]],
    ) -> None:
        self.path, self.origin, self.direction = path, origin, direction
        self.nodes = sorted(nodes, key=lambda node: node[0])
        self.s = np.array([s for s, _ in self.nodes])
        self._reference = self.nodes[0][1].q
        self._center = float(self.s.mean())
        self._unit = float(np.ptp(self.s)) / 2.0 or 1.0
        self._x = (self.s - self._center) / self._unit
        inner = self._x[[len(self._x) // 2 - 1, len(self._x) // 2]]
        self._middle, self._half = float(inner.mean()), float(np.ptp(inner)) / 2.0 or 1.0
        self._orders = np.arange(3 * len(self.nodes))

    def turned(self, turns: Array) -> Line:
        """The same line with whole turns added to hinges, q + 2π turns (nq,); for `one_polynomial` only."""
        added = 2.0 * np.pi * turns
        other = copy(self)
        other.origin = self.origin + added[self.path.iq]
        other._reference = self._reference + added
        other.nodes = [
            (s, replace(node, y=node.y + added[self.path.iq], q=node.q + added)) for s, node in self.nodes
        ]
        return other

    def x(self, s: float) -> float:
        """s in units that put the nodes on [−1, 1]."""
        return (s - self._center) / self._unit

    @property
    def one_polynomial(self) -> bool:
        """Whether `polynomial` says all about the line."""
        return self._smooth

    def polynomial(self) -> Polynomial:
        """The line between its innermost nodes, where `one_polynomial` holds."""
        pace = float(self.direction[0]) * self._unit
        return Polynomial(
            self._table, self._reference, self._center, self._unit, self._middle, self._half, pace
        )

    @cached_property
    def _smooth(self) -> bool:
        """Whether γ'' on the line is the derivative of G there: one coordinate, no chart."""
        return self.path.m == 1 and self.path.tree.vector_space

    @cached_property
    def _q(self) -> NewtonForm:
        tree = self.path.tree
        data: list[list[Array]] = []
        for _, node in self.nodes:
            rate = tree.difference_rate(self._reference, node.q) @ (node.G @ self.direction)
            data.append([tree.difference(self._reference, node.q), rate * self._unit])
            if self._smooth and node.curvature is not None:
                data[-1].append(node.curvature * (float(self.direction[0]) * self._unit) ** 2)
        return NewtonForm(self._x, np.array(data))

    @cached_property
    def _G(self) -> NewtonForm:
        columns = [[node.G.ravel()] for _, node in self.nodes]
        if self.path.m == 1 or self.path.tree.vector_space:
            for (_, node), column in zip(self.nodes, columns, strict=True):
                column.append(self._G_rate(node).ravel() * self._unit)
        # else values only: ∂G_j/∂d is not symmetric in body-fixed velocities, so it is not γ''[d, e_j]
        return NewtonForm(self._x, np.array(columns))

    def _G_rate(self, node: Point) -> Array:
        """dG/ds = γ''[d, e_j] for each j, (nv, m), by polarisation."""
        path, d = self.path, self.direction
        if node.curvature is not None:
            return node.curvature[:, None] * d
        columns = [
            0.25 * (path.second_derivative(node, d + e) - path.second_derivative(node, d - e))
            for e in np.eye(path.m)
        ]
        return np.array(columns).T

    def configuration(self, s: float) -> Array:
        """q on the line, (nq,); its independent entries are exact."""
        return self.configurations(np.array([s]))[0]

    def configurations(self, s: Array) -> Array:
        """q at each s, (len(s), nq)."""
        steps = self._q((s - self._center) / self._unit)
        q = np.array([self.path.tree.integrate(self._reference, step) for step in steps])
        q[:, self.path.iq] = self.origin + s[:, None] * self.direction
        return q

    def at(self, s: float, ydot: Array) -> Point:
        """The point at y₀ + s d for velocity ẏ; conditioning 0: K_d says nothing of it."""
        path, x = self.path, self.x(s)
        if self._smooth:
            return self._smooth_point(s, x, ydot)
        shape = (path.tree.nv, path.m)
        values = self._G.with_derivatives(np.array([x]))
        G = values[0][0].reshape(shape)
        known = path.m == 1 or path.tree.vector_space
        rate = values[1][0].reshape(shape) / self._unit if known else None
        G[path.independent] = np.eye(path.m)
        g, curvature = self._second(x, ydot, rate)
        return self._point(s, self.configuration(s), ydot, G, g, curvature)

    def _smooth_point(self, s: float, x: float, ydot: Array) -> Point:
        nv, pace = self.path.tree.nv, float(self.direction[0]) * self._unit
        u = (x - self._middle) / self._half
        if abs(u) <= 1.0:
            values = np.cos(self._orders * acos(u)) @ self._table
        else:
            values = self._sampled(np.array([x]))[0]
        q = self._reference + values[:nv]
        q[self.path.iq] = self.origin + s * self.direction
        G = values[nv : 2 * nv, None] / pace
        G[self.path.independent] = 1.0
        curvature = values[2 * nv : 3 * nv] / pace**2
        curvature[self.path.independent] = 0.0
        g = curvature * float(ydot[0]) ** 2
        y, det = self.origin + s * self.direction, values[3 * nv :]
        return Point(y, ydot.copy(), q, G, g, curvature, det, np.zeros_like(det), 0.0)

    @cached_property
    def _table(self) -> Array:
        """Chebyshev coefficients of q, G, γ'' and det between the innermost nodes, (3n, 3nv + nblocks).

        The same polynomial, in a form that costs one small product to evaluate; G and γ'' have
        coefficients of their own, since differentiating those of q would amplify their rounding.
        """
        n = len(self._orders)
        x = self._middle + self._half * np.cos(np.pi * (self._orders + 0.5) / n)
        coefficients: Array = scipy.fft.dct(self._sampled(x), type=2, axis=0) / n
        coefficients[0] *= 0.5
        return coefficients

    def _sampled(self, x: Array) -> Array:
        """q, dq/dx, d²q/dx² and det side by side at each x."""
        return np.column_stack([*self._q.with_derivatives(x), self._det(x)])

    def _point(self, s: float, q: Array, ydot: Array, G: Array, g: Array, curvature: Array | None) -> Point:
        det = np.asarray(self._det(self.x(s)))
        y = self.origin + s * self.direction
        return Point(y, ydot.copy(), q, G, g, curvature, det, np.zeros_like(det), 0.0)

    def _second(self, x: float, ydot: Array, rate: Array | None) -> tuple[Array, Array | None]:
        """g and, for m = 1, γ''; the parts along d are derivatives of G, the rest is interpolated."""
        path = self.path
        if path.m == 1 and rate is not None:
            curvature = rate[:, 0] / self.direction[0]
            curvature[path.independent] = 0.0
            return curvature * float(ydot[0]) ** 2, curvature
        if rate is None:
            return self._interpolated_g(x, ydot), None
        d = self.direction
        along = float(d @ ydot) / float(d @ d)
        across = ydot - along * d
        g = along * along * (rate @ d) + 2.0 * along * (rate @ across)
        if np.any(np.abs(across) > 0.0):
            g = g + self._interpolated_g(x, across)
        g[path.independent] = 0.0
        return g, None

    def _interpolated_g(self, x: float, ydot: Array) -> Array:
        values = [self.path.second_derivative(node, ydot) for _, node in self.nodes]
        return np.asarray(scipy.interpolate.BarycentricInterpolator(self._x, np.array(values))(x))

    @cached_property
    def _det(self) -> scipy.interpolate.BarycentricInterpolator:
        return scipy.interpolate.BarycentricInterpolator(self._x, np.array([p.det for _, p in self.nodes]))

    def zero(self, block: int, low: float, high: float) -> float | None:
        """Where det of a block changes sign between low and high; None where it does not."""
        ends = [float(self._det(self.x(s))[block]) for s in (low, high)]
        if not ends[0] * ends[1] < 0.0:
            return None
        root = scipy.optimize.brentq(
            lambda x: float(self._det(x)[block]), self.x(low), self.x(high), xtol=1e-13
        )
        return self._center + self._unit * float(root)
