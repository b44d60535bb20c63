"""The implicit constraint of all closures at once: φ(q) = 0, its Jacobian K and its bias k."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .closures import Closure, Index, Term
from .couplings import AnyClosure, CouplingClosure, Couplings
from .joints import support
from .tree import Array, Tree


class ImplicitConstraint:
    """φ, K and k of all closures at once, evaluated at what the tree holds; it keeps no state of its own.

    Each row of K is a pair of wrenches, one on either body, applied to the joint Jacobian J: a
    position row along e is the unit force e at the cut point, (e, p × e); a rotation row is the
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
    """

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
        layout = _Layout(tree.model, [c for c in closures if not isinstance(c, CouplingClosure)], couplings)
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
        # k: velocities and accelerations of the frames from those of their joints, in frame axes
        self._joint = np.array(joints, dtype=np.int64)
        self._carried = np.zeros((len(joints), tree.nv))
        for point, joint in enumerate(joints):
            self._carried[point, support(tree.model, joint)] = 1.0
        self._to_frame = np.array([_point_motion(frame) for frame in frames]).reshape(-1, 3, 6)
        self._turn = np.array([frame.placement.rotation.T for frame in frames]).reshape(-1, 3, 3)
        self._rotation = _RotationRows(self.rows, layout, loops) if np.any(axis == _ROTATION) else None
        self._coupled = np.flatnonzero(closure < 0)
        self._coupling: Couplings | None = None
        if len(self._coupled):
            which = self.rows[self._coupled] - (len(layout.labels) - len(couplings))
            self._coupling = Couplings(tree.model, [couplings[int(i)] for i in which])
            self._coupled_at = self._coupled[:, None] * tree.nv + self._coupling.iv
            self._coupled_weight = self._weight[self._coupled, None] * columns[self._coupling.iv]
        self._plain = self._rotation is None and self._coupling is None

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
        return wrench

    def jacobian(self) -> Array:
        """K = ∂φ/∂q (nc, nv) at the tree's present placements; a new array."""
        n, tree = len(self.rows), self._tree
        entries = np.einsum("ij,ij->i", self._wrenches()[self._entry_wrench], tree.J[self._entry_column])
        entries *= self._entry_weight
        nv = tree.nv
        flat = np.bincount(self._entry_at, entries, minlength=n * nv).astype(float)
        if self._coupling is not None:
            flat[self._coupled_at[:, 0]] = self._coupled_weight[:, 0]
            flat[self._coupled_at[:, 1]] = -self._coupling.slope(tree.q) * self._coupled_weight[:, 1]
        return flat.reshape(n, nv)

    def jacobian_rate(self, v: Array) -> Array:
        """K̇ along v (nv,), (nc, nv), after the tree's `jacobian_rates` at q and v."""
        n, tree = len(self.rows), self._tree
        twist = self._carried @ (tree.J * v[:, None])  # of the frames' bodies, at the world's origin
        omega = twist[:, 3:]
        speed = twist[:, :3] + _cross(omega, tree.frame_p)
        wrench = np.zeros((2 * n, 6))
        wrench[:, 3:] = speed.take(self._moment_source) * self._moment_sign
        if self._rotation is not None:
            rate = self._rotation.normal_rates(tree.frame_R, omega)
            wrench[self._rotation.at, 3:] = wrench[n + self._rotation.at, 3:] = rate
        at, column = self._entry_wrench, self._entry_column
        entries = np.einsum("ij,ij->i", wrench[at], tree.J[column])
        entries += np.einsum("ij,ij->i", self._wrenches()[at], tree.dJ[column])
        flat = np.bincount(self._entry_at, entries * self._entry_weight, minlength=n * tree.nv).astype(float)
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
        omega = _apply(self._turn, v[:, 3:])
        # a + ω × v of the cut points, in frame axes
        local = _apply(self._to_frame, a)
        local += _apply((omega @ _CROSS).reshape(-1, 3, 3), _apply(self._to_frame, v))
        world = _apply(tree.frame_R, local)
        apart = (world[loops:] - world[:loops]).ravel()
        if self._plain:
            return np.asarray(apart[self._take] * self._weight)
        k = np.empty(len(self.rows))
        k[self._position] = apart[self._take]
        if self._rotation is not None:
            turning = _apply(tree.frame_R, omega)
            speeding = _apply(tree.frame_R, _apply(self._turn, a[:, 3:]))
            k[self._rotation.at] = self._rotation.bias(tree.frame_R, turning, speeding)
        if self._coupling is not None:
            k[self._coupled] = self._coupling.bias(tree.q, tree.qdot)
        return k * self._weight


class _Layout:
    """Where the rows of the full constraint come from."""

    def __init__(
        self, model: pin.Model, closures: Sequence[Closure], couplings: Sequence[CouplingClosure]
    ) -> None:
        self.labels: list[str] = []
        self.closure: list[int] = []
        """−1 for the row of a coupling."""
        self.axis: list[int] = []
        """World axis of a position row; _ROTATION or _COUPLED for another."""
        self.is_length: list[bool] = []
        self.terms: list[tuple[int, int, Term]] = []
        """Full row, closure and term of each rotation term."""
        for i, closure in enumerate(closures):
            base = len(self.labels) + 3
            terms = closure.rotation_terms()
            count = 3 + len({term[0] for term in terms})
            self.labels += [f"{closure.frame1} – {closure.frame2}"] * count
            self.closure += [i] * count
            self.axis += [0, 1, 2] + [_ROTATION] * (count - 3)
            self.is_length += [True] * 3 + [False] * (count - 3)
            self.terms += [(base + term[0], i, term) for term in terms]
        for coupling in couplings:
            self.labels.append(f"{coupling.joint1} – {coupling.joint2}")
            self.closure.append(-1)
            self.axis.append(_COUPLED)
            first = model.joints[model.getJointId(coupling.joint1)]
            self.is_length.append("JointModelP" in first.shortname())


class _RotationRows:
    """Σ w (u · n) rows: u fixed in frame 1 and n in frame 2 of a closure."""

    def __init__(self, rows: Index, layout: _Layout, loops: int) -> None:
        position = {int(full): i for i, full in enumerate(rows)}
        terms = [(position[full], i, t) for full, i, t in layout.terms if full in position]
        self.at = np.unique([row for row, _, _ in terms])
        self._owner = np.searchsorted(self.at, [row for row, _, _ in terms])
        self._weight = np.array([t[1] for _, _, t in terms])
        self._first = np.array([i for _, i, _ in terms])
        self._second = self._first + loops
        self._u_local = np.array([t[2] for _, _, t in terms])[:, :, None]
        self._n_local = np.array([t[3] for _, _, t in terms])[:, :, None]

    def _placed(self, R: Array) -> tuple[Array, Array]:
        """u and n of each term in world axes; R (npoints, 3, 3) are the frames' orientations."""
        return (R[self._first] @ self._u_local)[:, :, 0], (R[self._second] @ self._n_local)[:, :, 0]

    def residual(self, R: Array) -> Array:
        """Σ w u · n of each row."""
        return self._sum(np.einsum("ij,ij->i", *self._placed(R)))

    def normals(self, R: Array) -> Array:
        """Σ w u × n of each row, (rows, 3): φ̇ = (ω₁ − ω₂) · Σ w u × n."""
        crossed = _cross(*self._placed(R)) * self._weight[:, None]
        normals = np.zeros((len(self.at), 3))
        np.add.at(normals, self._owner, crossed)
        return normals

    def normal_rates(self, R: Array, omega: Array) -> Array:
        """d/dt of `normals`, ω of all frames in world axes."""
        w1, w2 = omega[self._first], omega[self._second]
        u, n = self._placed(R)
        rates = np.zeros((len(self.at), 3))
        turned = _cross(_cross(w1, u), n) + _cross(u, _cross(w2, n))
        np.add.at(rates, self._owner, turned * self._weight[:, None])
        return rates

    def bias(self, R: Array, omega: Array, alpha: Array) -> Array:
        """−d/dt (φ̇) at zero joint acceleration; ω and α of all frames in world axes."""
        w1, w2 = omega[self._first], omega[self._second]
        u, n = self._placed(R)
        normal = _cross(u, n)
        rate = _cross(_cross(w1, u), n) + _cross(u, _cross(w2, n))
        turning = np.einsum("ij,ij->i", alpha[self._first] - alpha[self._second], normal)
        return -self._sum(turning + np.einsum("ij,ij->i", w1 - w2, rate))

    def _sum(self, terms: Array) -> Array:
        summed = np.bincount(self._owner, terms * self._weight, minlength=len(self.at))
        return np.asarray(summed, dtype=float)


def _skew(r: Array) -> Array:
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def _point_motion(frame: pin.Frame) -> Array:
    """(3, 6): linear motion of the frame's origin, in its own axes, from its joint's motion."""
    M = frame.placement
    return np.asarray(M.rotation.T @ np.hstack([np.eye(3), -_skew(M.translation)]))


def _apply(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector, (n, i, j) and (n, j) to (n, i).

    `matmul` has the smaller overhead, `einsum` the smaller cost per item.
    """
    if len(vectors) <= _FEW:
        return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
    return np.asarray(np.einsum("pij,pj->pi", matrices, vectors))


_ROTATION, _COUPLED = -1, -2
_FEW = 16
_CROSS = np.array([_skew(e).ravel() for e in np.eye(3)])
"""ω @ _CROSS is the matrix of ω ×, row by row."""
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: Array, b: Array) -> Array:
    """Row by row a × b, (n, 3); `np.cross` costs several times as much on few rows."""
    return np.asarray(a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT])
