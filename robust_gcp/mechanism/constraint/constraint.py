"""The implicit constraint of all closures at once: φ(q) = 0, its Jacobian K and its bias k."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...errors import ModelError
from ..tolerances import CLOSED, STRUCTURAL
from ..tree.joints import Joint, joint_named, support
from ..tree.tree import Array, Tree
from ..tree.vectors import CROSS, apply, cross, skew
from .closures import Closure, Index
from .couplings import AnyClosure, CouplingClosure, Couplings
from .rows import ALONG, ROTATION, RotationRows, RowsAlong, rows_of


class ImplicitConstraint:
    """φ, K and k of all closures at once, evaluated at what the tree holds; it keeps no state of its own.

    Each row of K is a pair of wrenches, one on either body, applied to the joint Jacobian J: a
    position row along a world axis e is the unit force e at each body's point, (e, p × e); one along n
    fixed in body 2 is the force n at the first body's point, (n, p₁ × n), on both; a rotation row is the
    moment (0, Σ w u × n). The rows of couplings come last and hold two entries each.

    Parameters
    ----------
    tree : Tree
        Follows the frames of `closure_frames`; kinematics are read from its views.
    closures : sequence of closures and couplings
    rows : ndarray of int, optional
        Which rows of the full constraint to compute; all when left out.
    row_scale : ndarray (nrows,), optional
        φ, K and k are divided by it, row by row.
    column_scale : ndarray (nv,), optional
        K is multiplied by it, column by column.

    Attributes
    ----------
    vanishing : dict of str to float
        Rows that were left out although they move by more than rounding, and by how much, rad or lengths.
    """

    vanishing: Mapping[str, float] = MappingProxyType({})

    def __init__(
        self,
        tree: Tree,
        closures: Sequence[AnyClosure],
        rows: Index | None = None,
        row_scale: Array | None = None,
        column_scale: Array | None = None,
    ) -> None:
        self._tree = tree
        couplings = [c for c in closures if isinstance(c, CouplingClosure)]
        layout = _Layout(tree.joints, [c for c in closures if not isinstance(c, CouplingClosure)], couplings)
        self.rows = np.arange(len(layout.labels)) if rows is None else rows
        self.labels = [layout.labels[row] for row in self.rows]
        axis = np.array(layout.axis, dtype=np.int64)[self.rows]
        closure = np.array(layout.closure, dtype=np.int64)[self.rows]
        self.is_length: NDArray[np.bool_] = np.array(layout.is_length, dtype=bool)[self.rows]
        n, loops = len(self.rows), len(closures) - len(couplings)
        self._weight = 1.0 / (np.ones(n) if row_scale is None else row_scale)
        columns = np.ones(tree.nv) if column_scale is None else column_scale

        # φ: entries of the stacked differences p₁ − p₂
        self._loops = loops
        self._position = np.flatnonzero(axis >= 0)
        self._take = 3 * closure[self._position] + axis[self._position]
        # K: forces at the points, and the columns that each body's motion depends on
        self._wrench = np.zeros((2 * n, 6))
        self._moment_source = np.zeros((2 * n, 3), dtype=np.int64)
        self._moment_sign = np.zeros((2 * n, 3))
        wrenches: list[int] = []
        columns_at: list[int] = []
        weights: list[float] = []
        frames = [tree.model.frames[i] for i in range(tree.model.nframes - 2 * loops, tree.model.nframes)]
        joints = [int(frame.parentJoint) for frame in frames]
        for side, sign in ((0, 1.0), (1, -1.0)):
            for row in np.flatnonzero(closure >= 0).tolist():
                at, point = side * n + row, side * loops + int(closure[row])
                carrying = support(tree.model, joints[point])
                wrenches += [at] * len(carrying)
                columns_at += carrying
                weights += (sign * self._weight[row] * columns[carrying]).tolist()
                if axis[row] >= 0:
                    r, s, t = (int(axis[row] + i) % 3 for i in range(3))
                    self._wrench[at, r] = 1.0
                    # p × e_r has entries p_t on axis s and −p_s on axis t
                    self._moment_source[at, s], self._moment_sign[at, s] = 3 * point + t, 1.0
                    self._moment_source[at, t], self._moment_sign[at, t] = 3 * point + s, -1.0
        self._entry_wrench = np.array(wrenches, dtype=np.int64)
        self._entry_column = np.array(columns_at, dtype=np.int64)
        self._entry_weight = np.array(weights)
        self._entry_at = (self._entry_wrench % max(n, 1)) * tree.nv + self._entry_column
        self._read_motion(frames)
        self._rotation = RotationRows(self.rows, layout.rows, loops) if np.any(axis == ROTATION) else None
        self._along = RowsAlong(self.rows, layout.rows, loops) if np.any(axis == ALONG) else None
        self._coupled = np.flatnonzero(closure < 0)
        self._coupling: Couplings | None = None
        if len(self._coupled):
            which = self.rows[self._coupled] - (len(layout.labels) - len(couplings))
            self._couple(Couplings(tree.joints, [couplings[int(i)] for i in which]), columns)
        self._plain = len(self._position) == n

    def _read_motion(self, frames: Sequence[pin.Frame]) -> None:
        """For k: velocities and accelerations of the frames from those of their joints, in frame axes."""
        self._joint = np.array([int(frame.parentJoint) for frame in frames], dtype=np.int64)
        self._carried = np.zeros((len(frames), self._tree.nv))
        for point, joint in enumerate(self._joint.tolist()):
            self._carried[point, support(self._tree.model, joint)] = 1.0
        self._to_frame = np.array([_point_motion(frame) for frame in frames]).reshape(-1, 3, 6)
        self._turn = np.array([frame.placement.rotation.T for frame in frames]).reshape(-1, 3, 3)

    def _couple(self, coupling: Couplings, columns: Array) -> None:
        """Where the entries of couplings are in K, and what they are multiplied by."""
        nv, weight = self._tree.nv, self._weight[self._coupled]
        self._coupling = coupling
        self._coupled_at = self._coupled[:, None] * nv + coupling.iv
        self._coupled_weight = weight[:, None] * columns[coupling.iv]
        self._further = [
            (int(self._coupled[i]) * nv + iv, -value * weight[i] * columns[iv])
            for i, _, iv, value in coupling.further
        ]

    def residual(self) -> Array:
        """φ at the tree's present placements, (nc,), m and rad (or scaled); a new array."""
        p, loops = self._tree.frame_p, self._loops
        apart = (p[:loops] - p[loops:]).ravel()
        if self._plain:
            return np.asarray(apart[self._take] * self._weight)
        phi = np.empty(len(self.rows))
        phi[self._position] = apart[self._take]
        if self._rotation is not None:
            phi[self._rotation.at] = self._rotation.residual(self._tree.frame_R)
        if self._along is not None:
            phi[self._along.at] = self._along.residual(p, self._tree.frame_R)
        if self._coupling is not None:
            phi[self._coupled] = self._coupling.residual(self._tree.q)
        return phi * self._weight

    def _wrenches(self) -> Array:
        """The unit force and moment at the world's origin that each row is, on either body, (2 nc, 6)."""
        n, tree = len(self.rows), self._tree
        wrench = self._wrench.copy()
        moment = wrench[:, 3:]
        if self._loops:
            np.multiply(tree.frame_p.take(self._moment_source), self._moment_sign, out=moment)
        if self._rotation is not None:
            at = self._rotation.at
            moment[at] = moment[n + at] = self._rotation.normals(tree.frame_R)
        if self._along is not None:
            at = self._along.at
            wrench[at] = wrench[n + at] = self._along.wrenches(tree.frame_p, tree.frame_R)
        return wrench

    def jacobian(self) -> Array:
        """K = ∂φ/∂q (nc, nv) at the tree's present placements; a new array."""
        n, tree = len(self.rows), self._tree
        row, column, nv = self._entry_wrench, self._entry_column, tree.nv
        entries = np.einsum("ij,ij->i", self._wrenches().take(row, 0), tree.J.take(column, 0))
        entries *= self._entry_weight
        flat = np.bincount(self._entry_at, entries, minlength=n * nv).astype(float, copy=False)
        if self._coupling is not None:
            # a joint that is held has no second one: its own entry comes last
            flat[self._coupled_at[:, 1]] = -self._coupling.slope(tree.q) * self._coupled_weight[:, 1]
            flat[self._coupled_at[:, 0]] = self._coupled_weight[:, 0]
            for at, value in self._further:
                flat[at] = value
        return flat.reshape(n, nv)

    def jacobian_rate(self, v: Array) -> Array:
        """K̇ along v (nv,), (nc, nv), after the tree's `jacobian_rates` at q and v."""
        n, tree, loops = len(self.rows), self._tree, self._loops
        twist = self._carried @ (tree.J * v[:, None])  # of the frames' bodies, at the world's origin
        omega = twist[:, 3:]
        speed = twist[:, :3] + cross(omega, tree.frame_p)
        wrench = np.zeros((2 * n, 6))
        if loops:
            wrench[:, 3:] = speed.take(self._moment_source) * self._moment_sign
        if self._rotation is not None:
            rate = self._rotation.normal_rates(tree.frame_R, omega)
            wrench[self._rotation.at, 3:] = wrench[n + self._rotation.at, 3:] = rate
        if self._along is not None:
            turned = self._along.wrench_rates(tree.frame_p, tree.frame_R, speed, omega)
            wrench[self._along.at] = wrench[n + self._along.at] = turned
        at, column = self._entry_wrench, self._entry_column
        entries = np.einsum("ij,ij->i", wrench.take(at, 0), tree.J.take(column, 0))
        entries += np.einsum("ij,ij->i", self._wrenches().take(at, 0), tree.dJ.take(column, 0))
        entries *= self._entry_weight
        flat = np.bincount(self._entry_at, entries, minlength=n * tree.nv).astype(float, copy=False)
        if self._coupling is not None:
            rate = -self._coupling.slope_rate(tree.q, v)
            flat[self._coupled_at[:, 1]] = rate * self._coupled_weight[:, 1]
        return flat.reshape(n, tree.nv)

    def bias(self) -> Array:
        """k = −K̇ v (nc,) after the tree's `jacobians` at q and `rnea` at (q, v, 0).

        The joints' accelerations there include minus gravity, which cancels in every difference.
        """
        tree, loops = self._tree, self._loops
        v, a = tree.v[self._joint], tree.a[self._joint]
        omega = apply(self._turn, v[:, 3:])
        # a + ω × v of the cut points, in frame axes
        local = apply(self._to_frame, a)
        local += apply((omega @ CROSS).reshape(-1, 3, 3), apply(self._to_frame, v))
        world = apply(tree.frame_R, local)
        apart = (world[loops:] - world[:loops]).ravel()
        if self._plain:
            return np.asarray(apart[self._take] * self._weight)
        k = np.empty(len(self.rows))
        k[self._position] = apart[self._take]
        turning = apply(tree.frame_R, omega)
        speeding = apply(tree.frame_R, apply(self._turn, a[:, 3:]))
        if self._rotation is not None:
            k[self._rotation.at] = self._rotation.bias(tree.frame_R, turning, speeding)
        if self._along is not None:
            speed = apply(tree.frame_R, apply(self._to_frame, v))
            frames = tree.frame_p, tree.frame_R
            k[self._along.at] = self._along.bias(*frames, speed, world, turning, speeding)
        if self._coupling is not None:
            k[self._coupled] = self._coupling.bias(tree.q, tree.qdot)
        return k * self._weight


def without_zero_rows(
    tree: Tree, closures: Sequence[AnyClosure], length: float, configurations: Sequence[Array]
) -> ImplicitConstraint:
    """The constraint of the closures, less rows that vanish with their K at all of these configurations.

    Raises
    ------
    ModelError
        Where such a row of K leaves frames apart that no joint can bring together.
    """
    full = ImplicitConstraint(tree, closures)
    scale = np.where(full.is_length, length, 1.0)
    moved = np.zeros(len(full.rows))
    constant = np.zeros(len(full.rows))
    for q in configurations:
        tree.jacobians(q)
        constant = full.residual() / scale
        moved = np.maximum(moved, np.max(np.abs(full.jacobian()), axis=1, initial=0.0) / scale)
    used = moved > STRUCTURAL
    open_rows = np.flatnonzero(~used & (np.abs(constant) > STRUCTURAL))
    if len(open_rows):
        row = int(open_rows[0])
        raise ModelError(
            f"closure {full.labels[row]}: its frames stay "
            f"{abs(constant[row] * scale[row]):.3g} {'m' if full.is_length[row] else 'rad'} "
            "apart in every configuration, along a direction that no joint moves; "
            "shift or turn one of the two frames"
        )
    kept = ImplicitConstraint(tree, closures, np.flatnonzero(used))
    kept.vanishing = {
        full.labels[row]: float(moved[row]) for row in np.flatnonzero(~used & (moved > CLOSED)).tolist()
    }
    return kept


class _Layout:
    """Where the rows of the full constraint come from."""

    def __init__(
        self, joints: Sequence[Joint], closures: Sequence[Closure], couplings: Sequence[CouplingClosure]
    ) -> None:
        self.labels: list[str] = []
        self.closure: list[int] = []
        """−1 for the row of a coupling."""
        self.axis: list[int] = []
        """As `Row.axis`; _COUPLED for the row of a coupling."""
        self.is_length: list[bool] = []
        self.rows = rows_of(closures)
        for row in self.rows:
            closure = closures[row.closure]
            self.labels.append(f"{closure.frame1} – {closure.frame2}")
            self.closure.append(row.closure)
            self.axis.append(row.axis)
            self.is_length.append(row.axis != ROTATION)
        for coupling in couplings:
            self.labels.append(coupling.label)
            self.closure.append(-1)
            self.axis.append(_COUPLED)
            self.is_length.append(joint_named(joints, coupling.joint1).components[0].unit == "m")


def _point_motion(frame: pin.Frame) -> Array:
    """(3, 6): linear motion of the frame's origin, in its own axes, from its joint's motion."""
    M = frame.placement
    return np.asarray(M.rotation.T @ np.hstack([np.eye(3), -skew(M.translation)]))


_COUPLED = -3
