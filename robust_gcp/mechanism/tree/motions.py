"""First derivatives of the motions of bodies, of points and of directions on them, by q and by v.

All by world motions, six numbers (linear at the world's origin, angular). For the column j of the joint
Jacobian J, its part's parent p, its own part b(j), and any part b that j carries,

    ∂V_b/∂q_j = (V_p − V_b) × J_j,
    ∂A_b/∂q_j = (A_p − A_b) × J_j + (V_p − V_b) × (V_p × J_j),
    ∂A_b/∂v_j = ∂V_b/∂q_j + V_b(j) × J_j,

and zero for the others. ∂/∂q_j is along the velocity component j, so the same holds for spherical and free
bodies. The arithmetic is that of complex numbers too: nothing is conjugated.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .columns import Columns
from .tree import Array
from .vectors import cross


def motion_cross(a: Array, b: Array) -> Array:
    """Motion a × motion b, the rate of b where it moves along with a, over the last axis."""
    linear = cross(a[..., 3:], b[..., :3]) + cross(a[..., :3], b[..., 3:])
    return np.concatenate([linear, cross(a[..., 3:], b[..., 3:])], axis=-1)


Some = TypeVar("Some", bound="_Jets")


@dataclass
class _Jets:
    """n quantities and their derivatives: by time to second order, and of these by q and v; linear."""

    x: Array
    d: Array
    dd: Array
    x_q: Array
    d_q: Array
    dd_q: Array
    dd_v: Array

    def __add__(self: Some, other: Some) -> Some:
        return self._of(a + b for a, b in self._beside(other))

    def __sub__(self: Some, other: Some) -> Some:
        return self._of(a - b for a, b in self._beside(other))

    def _beside(self: Some, other: Some) -> Iterator[tuple[Array, Array]]:
        return zip(vars(self).values(), vars(other).values(), strict=True)

    def _of(self: Some, parts: Iterable[Array]) -> Some:
        return type(self)(*parts)


class Vectors(_Jets):
    """Vectors in space and their derivatives.

    Attributes
    ----------
    x, d, dd : ndarray (n, 3)
        The vectors, and their first and second rates.
    x_q, d_q, dd_q, dd_v : ndarray (n, nv, 3)
        ∂ẋ/∂v is x_q too.
    """

    def take(self, index: NDArray[np.int64]) -> Vectors:
        """Those at these places."""
        return self._of(a[index] for a in vars(self).values())

    def dot(self, other: Vectors) -> Products:
        """Their scalar products with others, one by one."""
        a, b = self, other
        column = "nx,njx->nj", "njx,nx->nj"

        def both(left: Array, right_q: Array, left_q: Array, right: Array) -> Array:
            return np.asarray(np.einsum(column[0], left, right_q) + np.einsum(column[1], left_q, right))

        def each(left: Array, right: Array) -> Array:
            return np.asarray(np.einsum("nx,nx->n", left, right))

        return Products(
            each(a.x, b.x),
            each(a.d, b.x) + each(a.x, b.d),
            each(a.dd, b.x) + 2.0 * each(a.d, b.d) + each(a.x, b.dd),
            both(a.x, b.x_q, a.x_q, b.x),
            both(a.d, b.x_q, a.d_q, b.x) + both(a.x, b.d_q, a.x_q, b.d),
            both(a.dd, b.x_q, a.dd_q, b.x)
            + 2.0 * both(a.d, b.d_q, a.d_q, b.d)
            + both(a.x, b.dd_q, a.x_q, b.dd),
            both(a.x, b.dd_v, a.dd_v, b.x) + 2.0 * both(a.d, b.x_q, a.x_q, b.d),
        )


class Products(_Jets):
    """Numbers and their derivatives; see `Vectors`.

    Attributes
    ----------
    x, d, dd : ndarray (n,)
    x_q, d_q, dd_q, dd_v : ndarray (n, nv)
    """

    def summed(self, weight: Array, owner: NDArray[np.int64], count: int) -> Products:
        """Σ weight times those with each owner, (count,)."""
        S = np.zeros((count, len(weight)))
        S[owner, np.arange(len(weight))] = weight
        return self._of(S @ part for part in vars(self).values())


class Motions:
    """Motions of all parts at (q, v, a).

    Parameters
    ----------
    columns : Columns
    J : ndarray (nv, 6)
        Joint Jacobian in world axes at the world's origin, row by row.
    v, a : ndarray (nv,)
    """

    def __init__(self, columns: Columns, J: Array, v: Array, a: Array) -> None:
        self.columns, self.J = columns, J
        self.V: Array = columns.carries @ (J * v[:, None])
        self.rate = motion_cross(self.V[columns.part], J)  # constant in the part's own frame
        """Time derivative of J."""
        self.A: Array = columns.carries @ (J * a[:, None] + self.rate * v[:, None])

    def points(self, part: NDArray[np.int64], p: Array) -> Vectors:
        """Points p (n, 3) in world axes that are fixed to these parts."""
        V, A, dV, dA, dAv, J = self._of(part)
        w, alpha, speed = V[:, 3:], A[:, 3:], V[:, :3] + cross(V[:, 3:], p)
        P, W, S = p[:, None], w[:, None], speed[:, None]
        p_q = J[..., :3] + cross(J[..., 3:], P)
        d_q = dV[..., :3] + cross(dV[..., 3:], P) + cross(W, p_q)
        dd_q = (
            dA[..., :3]
            + cross(dA[..., 3:], P)
            + cross(alpha[:, None], p_q)
            + cross(dV[..., 3:], S)
            + cross(W, d_q)
        )
        dd_v = dAv[..., :3] + cross(dAv[..., 3:], P) + cross(J[..., 3:], S) + cross(W, p_q)
        # A is spatial, of what passes the origin: a point of the body has ω × ṗ besides
        return Vectors(p, speed, A[:, :3] + cross(alpha, p) + cross(w, speed), p_q, d_q, dd_q, dd_v)

    def directions(self, part: NDArray[np.int64], u: Array) -> Vectors:
        """Directions u (n, 3) in world axes that are fixed to these parts."""
        V, A, dV, dA, dAv, J = (each[..., 3:] for each in self._of(part))
        d, U, W = cross(V, u), u[:, None], V[:, None]
        D = d[:, None]
        u_q = cross(J, U)
        d_q = cross(dV, U) + cross(W, u_q)
        dd_q = cross(dA, U) + cross(A[:, None], u_q) + cross(dV, D) + cross(W, d_q)
        dd_v = cross(dAv, U) + cross(J, D) + cross(W, u_q)
        return Vectors(u, d, cross(A, u) + cross(V, d), u_q, d_q, dd_q, dd_v)

    def _of(self, part: NDArray[np.int64]) -> tuple[Array, ...]:
        """V and A (n, 6) of parts; ∂V/∂q, ∂A/∂q, ∂A/∂v and J (n, nv, 6), zero where not carried."""
        columns, J = self.columns, self.J
        V, A = self.V[part], self.A[part]
        before, pull = self.V[columns.parent], self.A[columns.parent]
        carried = columns.carries[part][..., None]
        apart = before - V[:, None]
        dV = motion_cross(apart, J) * carried
        dA = (motion_cross(pull - A[:, None], J) + motion_cross(apart, motion_cross(before, J))) * carried
        return V, A, dV, dA, dV + self.rate * carried, J * carried
