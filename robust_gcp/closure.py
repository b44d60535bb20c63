"""Loop closures: the implicit constraint φ(q) = 0, its Jacobian K and its bias k.

A cut joint is a pair of frames. Each closure contributes rows of two kinds:

- position rows: p₁ − p₂, the difference of the two frames' origins in world axes, m;
- rotation rows: sums of w (u · n) with u fixed in body 1 and n fixed in body 2, rad for small angles.
  A dot product of two body-fixed vectors is polynomial in the rotations, so φ, K and k are exact
  everywhere, not only where the loop is closed (Haug, *Computer Aided Kinematics and Dynamics of
  Mechanical Systems*, 1989, the "dot-1" constraint).
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .errors import ModelError
from .tree import Array, Tree

Term = tuple[int, float, tuple[float, float, float], tuple[float, float, float]]
"""A rotation row's term: row within the closure, weight w, u in frame 1, n in frame 2."""

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class PointClosure:
    """Two frames share their origin: three rows, φ = p₁ − p₂ (a spherical cut joint).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    """

    frame1: str
    frame2: str
    kind: ClassVar[str] = "3d"

    def rotation_terms(self) -> list[Term]:
        """No rotation is constrained."""
        return []


@dataclass(frozen=True)
class FrameClosure:
    """Two frames coincide: six rows, p₁ − p₂ and the axial part of R₂ᵀ R₁ (a cut weld).

    The rotation rows are sin θ times the axis of the rotation from frame 2 to frame 1.
    """

    frame1: str
    frame2: str
    kind: ClassVar[str] = "6d"

    def rotation_terms(self) -> list[Term]:
        """½ (R₃₂ − R₂₃, R₁₃ − R₃₁, R₂₁ − R₁₂) of R = R₂ᵀ R₁, whose entry ij is n_i · u_j."""
        return [
            (0, 0.5, _Y, _Z),
            (0, -0.5, _Z, _Y),
            (1, 0.5, _Z, _X),
            (1, -0.5, _X, _Z),
            (2, 0.5, _X, _Y),
            (2, -0.5, _Y, _X),
        ]


@dataclass(frozen=True)
class RevoluteClosure:
    """Two frames share their origin and an axis: five rows (a cut hinge).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis : tuple of float
        The hinge axis, with the same components in both frames; z unless given.
    """

    frame1: str
    frame2: str
    axis: tuple[float, float, float] = _Z
    kind: ClassVar[str] = "revolute"

    def rotation_terms(self) -> list[Term]:
        """The axis in frame 1 is normal to two directions of frame 2."""
        axis = np.asarray(self.axis, dtype=float)
        norm = float(np.linalg.norm(axis))
        if axis.shape != (3,) or not np.isfinite(norm) or norm == 0.0:
            raise ModelError(f"RevoluteClosure: axis {self.axis!r} is not a direction in space")
        axis = axis / norm
        first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        u: tuple[float, float, float] = tuple(axis.tolist())
        return [(0, 1.0, u, tuple(first.tolist())), (1, 1.0, u, tuple(second.tolist()))]


Closure = PointClosure | FrameClosure | RevoluteClosure


class ImplicitConstraint:
    """φ, K and k of all closures at once, into arrays allocated once.

    Parameters
    ----------
    tree : Tree
        Kinematics are read from its views.
    closures : sequence of closures
    rows : ndarray of int, optional
        Which rows of the full constraint to compute; all when left out.

    Raises
    ------
    ModelError
        For a frame that the model does not have.
    """

    def __init__(
        self, tree: Tree, closures: Sequence[Closure], rows: NDArray[np.int64] | None = None
    ) -> None:
        self._tree = tree
        points: list[tuple[int, Array]] = []
        vectors: list[tuple[int, Array]] = []
        weights: list[float] = []
        term_rows: list[int] = []
        position_rows: list[int] = []
        labels: list[str] = []
        for closure in closures:
            label = f"{closure.frame1} – {closure.frame2}"
            first, second = (frame_of(tree.model, f, label) for f in (closure.frame1, closure.frame2))
            position_rows += range(len(labels), len(labels) + 3)
            for frame in (first, second):
                points.append((frame.parentJoint, frame.placement.translation))
            terms = closure.rotation_terms()
            base = len(labels) + 3
            for row, weight, u, n in terms:
                for frame, vector in ((first, u), (second, n)):
                    vectors.append((frame.parentJoint, frame.placement.rotation @ np.array(vector)))
                weights.append(weight)
                term_rows.append(base + row)
            labels += [label] * (3 + len({term[0] for term in terms}))
        self._total = len(labels)
        self.rows = np.arange(self._total) if rows is None else rows
        self.labels = [labels[row] for row in self.rows]
        self.is_length = np.isin(self.rows, position_rows)

        self._nl = len(position_rows) // 3
        self._point_joint = np.array([j for j, _ in points], dtype=np.int64)
        self._point = np.array([r for _, r in points], dtype=float).reshape(-1, 3, 1)
        self._point_cross = np.array([_skew(r) for _, r in points], dtype=float).reshape(-1, 3, 3)
        self._vector_joint = np.array([j for j, _ in vectors], dtype=np.int64)
        self._vector = np.array([r for _, r in vectors], dtype=float).reshape(-1, 3, 1)
        self._weights = np.array(weights, dtype=float).reshape(-1, 1)
        self._term_rows = np.array(term_rows, dtype=np.int64)
        self._rotation_rows, self._row_of_term = np.unique(self._term_rows, return_inverse=True)
        self._position_rows = np.array(position_rows, dtype=np.int64)

        self._phi_all = np.zeros(self._total)
        self._K_all = np.zeros((self._total, tree.nv))
        self._sides = [self._side(side) for side in (0, 1)]

    def _side(self, side: int) -> tuple[NDArray[np.int64], ...]:
        """Which columns of J reach which rows of K, on one side of every closure."""
        tree = self._tree
        owner: list[int] = []
        column: list[int] = []
        for closure in range(self._nl):
            for v in _support(tree.model, int(self._point_joint[2 * closure + side])):
                owner.append(2 * closure + side)
                column.append(v)
        turn_row: list[int] = []
        turn_column: list[int] = []
        for row, full in enumerate(self._rotation_rows):
            term = int(np.flatnonzero(self._term_rows == full)[0])
            for v in _support(tree.model, int(self._vector_joint[2 * term + side])):
                turn_row.append(row)
                turn_column.append(v)
        owners, columns = np.array(owner, dtype=np.int64), np.array(column, dtype=np.int64)
        starts = self._position_rows[::3][owners // 2] if owner else owners
        flat = (starts[:, None] + np.arange(3)) * tree.nv + columns[:, None]
        turn_rows, turn_columns = (np.array(x, dtype=np.int64) for x in (turn_row, turn_column))
        turn_flat = self._rotation_rows[turn_rows] * tree.nv + turn_columns
        return owners, columns, flat, turn_rows, turn_columns, turn_flat

    def residual(self) -> Array:
        """φ at the tree's present placements, (nc,), m and rad; a new array."""
        tree = self._tree
        arm = tree.R[self._point_joint] @ self._point
        self._world = arm[:, :, 0] + tree.p[self._point_joint]
        phi = self._phi_all
        phi[self._position_rows] = (self._world[0::2] - self._world[1::2]).ravel()
        if len(self._term_rows):
            turned = (tree.R[self._vector_joint] @ self._vector)[:, :, 0]
            self._u, self._n = turned[0::2], turned[1::2]
            dots = np.einsum("ij,ij->i", self._u, self._n) * self._weights[:, 0]
            phi[self._rotation_rows] = np.bincount(
                self._row_of_term, dots, minlength=len(self._rotation_rows)
            )
        selected: Array = phi[self.rows]
        return selected

    def jacobian(self) -> Array:
        """K = ∂φ/∂q (nc, nv) after `residual` at the same placements; a new array."""
        tree, K = self._tree, self._K_all
        K[:] = 0.0
        flat_K = K.reshape(-1)
        normals = self._turn_normals() if len(self._term_rows) else None
        for side, (owner, column, flat, turn_row, turn_column, turn_flat) in enumerate(self._sides):
            J = tree.J[column]
            velocity = J[:, :3] + _cross(J[:, 3:], self._world[owner])
            if side == 0:
                flat_K[flat] = velocity
            else:
                flat_K[flat] -= velocity
            if normals is not None:
                turn = np.einsum("ij,ij->i", tree.J[turn_column, 3:], normals[turn_row])
                flat_K[turn_flat] += turn if side == 0 else -turn
        selected: Array = K[self.rows]
        return selected

    def bias(self) -> Array:
        """k = −K̇ v (nc,) after `residual` at q and the tree's `rnea` at (q, v, 0).

        The joints' accelerations there include minus gravity, which cancels in every difference.
        """
        tree = self._tree
        k = np.empty(self._total)
        joint = self._point_joint
        v, a = tree.v[joint], tree.a[joint]
        omega = v[:, 3:]
        speed = v[:, :3] - (self._point_cross @ omega[:, :, None])[:, :, 0]
        local = a[:, :3] - (self._point_cross @ a[:, 3:, None])[:, :, 0] + _cross(omega, speed)
        world = (tree.R[joint] @ local[:, :, None])[:, :, 0]
        k[self._position_rows] = (world[1::2] - world[0::2]).ravel()
        if len(self._term_rows):
            joint = self._vector_joint
            R = tree.R[joint]
            omega = (R @ tree.v[joint, 3:, None])[:, :, 0]
            alpha = (R @ tree.a[joint, 3:, None])[:, :, 0]
            normal = _cross(self._u, self._n)
            rate = _cross(_cross(omega[0::2], self._u), self._n) + _cross(
                self._u, _cross(omega[1::2], self._n)
            )
            terms = np.einsum("ij,ij->i", alpha[0::2] - alpha[1::2], normal) + np.einsum(
                "ij,ij->i", omega[0::2] - omega[1::2], rate
            )
            k[self._rotation_rows] = -np.bincount(
                self._row_of_term, terms * self._weights[:, 0], minlength=len(self._rotation_rows)
            )
        selected: Array = k[self.rows]
        return selected

    def _turn_normals(self) -> Array:
        """Σ w u × n of each rotation row, (rows, 3): φ̇ = (ω₁ − ω₂) · Σ w u × n."""
        crossed = _cross(self._u, self._n) * self._weights
        normals = np.zeros((len(self._rotation_rows), 3))
        np.add.at(normals, self._row_of_term, crossed)
        return normals


def frame_of(model: pin.Model, name: str, owner: str) -> pin.Frame:
    """The frame of that name, or a ModelError that names near ones."""
    if not model.existFrame(name):
        near = difflib.get_close_matches(name, [f.name for f in model.frames], n=3)
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        raise ModelError(f"closure {owner}: the model has no frame {name!r}{hint}")
    return model.frames[model.getFrameId(name)]


def _support(model: pin.Model, joint: int) -> list[int]:
    """Velocity indices of all joints between the root and this joint."""
    return [
        v
        for ancestor in model.supports[joint]
        for v in range(model.idx_vs[ancestor], model.idx_vs[ancestor] + model.nvs[ancestor])
        if ancestor
    ]


def _skew(r: Array) -> Array:
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def _cross(a: Array, b: Array) -> Array:
    """Row by row a × b, (n, 3); `np.cross` costs ten times as much on few rows."""
    out = np.empty_like(a)
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out
