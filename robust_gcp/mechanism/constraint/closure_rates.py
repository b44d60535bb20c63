"""Derivatives of φ̇ and φ̈ by q and v, row by row, of all kinds of closures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..loops import ClosedLoops
from ..tree.columns import Columns
from ..tree.motions import Motions, Products, Vectors
from ..tree.tree import Array
from .closures import closure_frames
from .couplings import CouplingClosure, Couplings
from .rows import ALONG, ROTATION, Row, rows_of


@dataclass(frozen=True)
class Placement:
    """Where the parts of a spanning tree are.

    Attributes
    ----------
    J : ndarray (nv, 6)
        Joint Jacobian in world axes at the world's origin.
    p, R : ndarray (points, 3), (points, 3, 3)
        Frames of the closures: all firsts, then all seconds.
    q : ndarray (nq,)
        Configuration; read by couplings only.
    """

    J: Array
    p: Array
    R: Array
    q: Array


class ClosureRates:
    """φ, K, ∂φ̇/∂q, ∂φ̈/∂q and ∂φ̈/∂v of closed loops, dimensionless by rows.

    Every row is a sum of scalar products of points and directions that are fixed to bodies, so one product
    rule serves all kinds.

    Parameters
    ----------
    loops : ClosedLoops
    """

    def __init__(self, loops: ClosedLoops) -> None:
        self.loops, model = loops, loops.own_model
        self.columns = Columns(model, loops.joints)
        frames = closure_frames(model, loops.loops)
        self.part = np.array([self.columns.of_joint[joint] for joint, _ in frames], dtype=np.int64)
        self._loops, layout = len(loops.loops), rows_of(loops.loops)
        straight = [(i, row.closure, row.axis) for i, row in enumerate(layout) if row.axis >= 0]
        self._straight = np.array(straight, dtype=np.int64).reshape(-1, 3).T
        self._along, self._turned = (_Terms(layout, axis) for axis in (ALONG, ROTATION))
        tied = [c for c in loops.closures if isinstance(c, CouplingClosure)]
        self._couplings = Couplings(loops.joints, tied)
        self._rows, self._count = loops.implicit.rows, len(layout)
        self._scale = 1.0 / loops.row_scale

    def real(self, q: Array) -> Placement:
        """The placement at q (nq,), by the loops' own tree."""
        tree = self.loops.tree
        tree.jacobians(q)
        return Placement(tree.J.copy(), tree.frame_p.copy(), tree.frame_R.copy(), q)

    def products_at(self, place: Placement, v: Array, a: Array) -> Products:
        """All rows at (q, v, a): x is φ, d is φ̇, dd is φ̈, x_q is K; dimensionless by rows.

        Parameters
        ----------
        v, a : ndarray (nv,)
        """
        motions = Motions(self.columns, place.J, v, a)
        parts = [self._tied(place.q, v, a)]
        if self._loops:
            points = motions.points(self.part, place.p)
            ends = np.arange(self._loops)
            apart = points.take(ends) - points.take(ends + self._loops)
            parts.insert(0, self._between(motions, apart, place.R))  # as rows of φ come: loops first
        whole = [np.concatenate(same) for same in zip(*(vars(part).values() for part in parts), strict=True)]
        return Products(*((part[self._rows].T * self._scale).T for part in whole))

    def _between(self, motions: Motions, apart: Vectors, R: Array) -> Products:
        """The rows between frames whose origins are `apart`."""
        n, loops = self._count, self._loops
        rows, closures, axes = self._straight
        # along axes that do not turn, derivatives of a component are components of derivatives
        entries = (part[closures, ..., axes] for part in vars(apart).values())
        found = Products(*entries).summed(np.ones(len(rows)), rows, n)

        def fixed(ends: NDArray[np.int64], local: Array) -> Vectors:
            return motions.directions(self.part[ends], np.einsum("nij,nj->ni", R[ends], local))

        along, turned = self._along, self._turned
        if len(along.closure):
            normals = fixed(along.closure + loops, along.n)
            found = found + apart.take(along.closure).dot(normals).summed(along.weight, along.row, n)
        if len(turned.closure):
            axes_of = fixed(turned.closure, turned.u), fixed(turned.closure + loops, turned.n)
            found = found + axes_of[0].dot(axes_of[1]).summed(turned.weight, turned.row, n)
        return found

    def _tied(self, q: Array, v: Array, a: Array) -> Products:
        """The rows of couplings, q₁ − P(q₂) − Σ cᵢ qᵢ."""
        tied, two = self._couplings, self._couplings.iv[:, 1]
        _, bend, third = tied.slopes(q)
        # K has one entry that moves, −P′(q₂): φ̈ depends on q₂ by −P″ q̈₂ − P‴ q̇₂²
        x_q, d_q = tied.jacobian(q, len(v)), tied.jacobian_rate(q, v)
        dd_q = np.zeros(x_q.shape, np.result_type(q, v, a))
        dd_q[np.arange(len(two)), two] = -third * v[two] ** 2 - bend * a[two]
        # φ̈ = K a + K̇ v is quadratic in v, hence 2 K̇; in the precision of q, which may be extended
        return Products(tied.residual(q), x_q @ v, x_q @ a + d_q @ v, x_q, d_q, dd_q, 2.0 * d_q)


class _Terms:
    """The scalar products that rows of one sort are sums of."""

    def __init__(self, layout: Sequence[Row], axis: int) -> None:
        terms = [(i, row.closure, *t) for i, row in enumerate(layout) if row.axis == axis for t in row.terms]
        self.row = np.array([t[0] for t in terms], dtype=np.int64)
        self.closure = np.array([t[1] for t in terms], dtype=np.int64)
        self.weight = np.array([t[2] for t in terms])
        self.u = np.array([t[3] for t in terms]).reshape(-1, 3)
        self.n = np.array([t[4] for t in terms]).reshape(-1, 3)
