"""A curve of a one-cluster mechanism as series in its coordinate y, for the compiled kernel."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos

import numpy as np
import scipy

from ...mechanism.tree import Array
from ..point import Point
from ..regular_path import RegularPath
from .curve import Curve

ORDERS = 30
"""Chebyshev terms of q(y): u(y) is no polynomial, and the terms fall by a factor of five or more."""

LAST_TERMS = 1e-13
"""Largest of the last three terms against q, G and γ'' for the series to be used."""


@dataclass(frozen=True, eq=False)
class CurveTable:
    """γ, γ' and γ'' between a curve's innermost nodes as Chebyshev series of (y − middle) / half.

    Attributes
    ----------
    coefficients : ndarray (orders, 3 nv + nblocks)
        Of q − reference, G, γ'' and, for the determinants of K_d's blocks, the number one.
    reference : ndarray (nq,)
    middle, half : float
        y.
    zeros : tuple of float
        y of the singular places.
    before, after : Point
        Regular points where the curve is left, below and above.
    """

    coefficients: Array
    reference: Array
    middle: float
    half: float
    zeros: tuple[float, ...]
    before: Point
    after: Point

    def point(self, y: float, ydot: float, independent: int) -> Point | None:
        """The point at y; None beside the curve. `independent` is y's place in q and v."""
        u = (y - self.middle) / self.half
        if not abs(u) <= 1.0:
            return None
        values = np.cos(np.arange(len(self.coefficients)) * acos(u)) @ self.coefficients
        n = len(self.reference)
        q, G, bend = self.reference + values[:n], values[n : 2 * n, None], values[2 * n : 3 * n]
        q[independent], G[independent], bend[independent] = y, 1.0, 0.0
        none = np.zeros(self.coefficients.shape[1] - 3 * n)
        return Point(np.array([y]), np.array([ydot]), q, G, bend * ydot**2, bend, none, none, 0.0)


def tabulated(curve: Curve, path: RegularPath, zone: float) -> CurveTable | None:
    """The table, or None where y does not serve well along the whole curve."""
    mechanism, space = path.mechanism, curve.space
    cluster = space.cluster
    C, unit = space.chart(cluster.chosen), float(space.D[cluster.chosen[0]])
    nodes = [curve.inner(curve.left), curve.inner(curve.right)]
    ends = [float((C.T @ node.x)[0]) for node in nodes]
    slopes = [float((C.T @ curve.point(u)[1])[0]) for u in np.linspace(curve.left, curve.right, 9)]
    if not min(slopes) * max(slopes) > 0.0:
        return None  # y turns back on it
    points = []
    for node in nodes:
        q = np.zeros(mechanism.nq)
        q[cluster.iq] = space.q(node.x)
        point = path.settle(q, np.array([unit * float((C.T @ node.x)[0])]), np.zeros(1))
        if point is None or point.conditioning < 0.3 * zone:
            return None
        points.append(point)
    points.sort(key=lambda point: float(point.y[0]))
    low, high = sorted(ends)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    angles = np.pi * (np.arange(ORDERS) + 0.5) / ORDERS
    rows, u = [], curve.center
    for y in middle + half * np.cos(angles):
        found = curve.parameter(C, float(y), u)
        if found is None:
            return None
        u = found
        jet = curve.jet(C, u)
        orders = np.zeros((3, mechanism.nv))
        orders[:, cluster.iv] = jet.x, jet.J[:, 0] / unit, jet.bend[0, 0] / unit**2
        orders[:, cluster.iv] *= space.D
        rows.append(np.concatenate([orders.ravel(), np.ones(len(path.blocks))]))
    values = np.array(rows)
    reference = values[ORDERS // 2, : mechanism.nv].copy()
    values[:, : mechanism.nv] -= reference
    table: Array = scipy.fft.dct(values, type=2, axis=0) / ORDERS
    table[0] *= 0.5
    if np.abs(table[-3:]).max() > LAST_TERMS * (1.0 + np.abs(values).max()):
        return None
    zeros = tuple(unit * float((C.T @ curve.point(root)[0])[0]) for root in curve.roots)
    return CurveTable(table, reference, unit * middle, unit * half, zeros, *points)
