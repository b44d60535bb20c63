"""The implicit constraint of all closures at once: φ(q) = 0, its Jacobian K and its bias k."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...errors import ModelError
from ..tolerances import CLOSED, STRUCTURAL
from ..tree.joints import Index, carrying, joint_named
from ..tree.tree import Array, Tree
from ..tree.vectors import apply, cross, skew
from .couplings import AnyClosure, CouplingClosure, Couplings
from .rows import ROTATION, LoopRows, rows_of


class ImplicitConstraint:
    """φ, K and k of all closures at once, evaluated at what the tree holds; it keeps no state of its own.

    Each row of K is a pair of wrenches, one on either body, applied to the joint Jacobian J; see
    `LoopRows.wrenches`. The rows of couplings hold an entry for each joint that they tie.

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
        Rows that were left out although they move, or stay open, by more than rounding, and by how much, rad
        or lengths.
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
        loops = [c for c in closures if not isinstance(c, CouplingClosure)]
        full = rows_of(loops)
        labels = [f"{loops[row.closure].frame1} – {loops[row.closure].frame2}" for row in full]
        # couplings come last, as in `ClosedLoops.closures`
        labels += [coupling.label for coupling in couplings]
        firsts = [joint_named(tree.joints, coupling.joint1).components[0] for coupling in couplings]
        lengths = [row.axis != ROTATION for row in full] + [first.unit == "m" for first in firsts]
        self.rows = np.arange(len(labels)) if rows is None else rows
        self.labels = [labels[row] for row in self.rows]
        self.is_length: NDArray[np.bool_] = np.array(lengths, dtype=bool)[self.rows]
        self._weight = 1.0 / (np.ones(len(self.rows)) if row_scale is None else row_scale)
        columns = np.ones(tree.nv) if column_scale is None else column_scale
        self._scale = np.multiply.outer(self._weight, columns)

        self._looped = np.flatnonzero(self.rows < len(full))
        own = [full[row] for row in self.rows[self._looped]]
        # the tree's model ends with these frames: all firsts, then all seconds
        self._loops, self._of_loops = len(loops), LoopRows(own, len(loops))
        self._read_motion(
            [tree.model.frames[i] for i in range(tree.model.nframes - 2 * len(loops), tree.model.nframes)]
        )
        closure = np.array([row.closure for row in own], dtype=np.int64)
        sides = self._carried.reshape(2, len(loops), tree.nv)[:, closure]
        self._carries = sides * np.array([1.0, -1.0])[:, None, None]  # φ is of p₁ − p₂
        self._coupled = np.flatnonzero(self.rows >= len(full))
        which = self.rows[self._coupled] - len(full)
        self._coupling = Couplings(tree.joints, [couplings[int(i)] for i in which]) if len(which) else None

    def _read_motion(self, frames: Sequence[pin.Frame]) -> None:
        """Which velocities carry the frames; their motions from those of their joints, in frame axes."""
        nv, model = self._tree.nv, self._tree.model
        self._joint = np.array([int(frame.parentJoint) for frame in frames], dtype=np.int64)
        carried = [carrying(model, joint) for joint in self._joint.tolist()]
        self._carried = np.array(carried).reshape(len(frames), nv)
        self._to_frame = np.array([_point_motion(frame) for frame in frames]).reshape(-1, 3, 6)
        self._turn = np.array([frame.placement.rotation.T for frame in frames]).reshape(-1, 3, 3)

    def residual(self) -> Array:
        """φ at the tree's present placements, (nc,), m and rad (or scaled); a new array."""
        phi = self._of_loops.residual(self._tree.frame_p, self._tree.frame_R)
        if self._coupling is not None:
            phi = self._joined(phi, self._coupling.residual(self._tree.q))
        return phi * self._weight

    def jacobian(self) -> Array:
        """K = ∂φ/∂q (nc, nv) at the tree's present placements; a new array."""
        tree = self._tree
        K = self._moved(self._of_loops.wrenches(tree.frame_p, tree.frame_R), tree.J)
        if self._coupling is not None:
            K = self._joined(K, self._coupling.jacobian(tree.q, tree.nv))
        return K * self._scale

    def jacobian_rate(self, v: Array) -> Array:
        """K̇ along v (nv,), (nc, nv), after the tree's `jacobian_rates` at q and v."""
        tree, rows = self._tree, self._of_loops
        twist = self._carried @ (tree.J * v[:, None])  # of the frames' bodies, at the world's origin
        omega = twist[:, 3:]
        speed = twist[:, :3] + cross(omega, tree.frame_p)
        frames = tree.frame_p, tree.frame_R
        rate = self._moved(rows.wrench_rates(*frames, speed, omega), tree.J)
        rate += self._moved(rows.wrenches(*frames), tree.dJ)
        if self._coupling is not None:
            rate = self._joined(rate, self._coupling.jacobian_rate(tree.q, v))
        return rate * self._scale

    def _moved(self, wrenches: Array, J: Array) -> Array:
        """Wrenches (2, rows, 6) on either body by the velocities that carry it, (rows, nv)."""
        both = np.einsum("srx,jx->srj", wrenches, J)  # without BLAS, whose last digits differ by machine
        # of a joint that carries both bodies (0, (p₁ − p₂) × n) is left: zero where the loop is closed
        both *= self._carries
        return np.asarray(both[0] + both[1])

    def _joined(self, of_loops: Array, of_couplings: Array) -> Array:
        """Rows of loops and of couplings in their order."""
        found = np.empty((len(self.rows), *of_loops.shape[1:]))
        found[self._looped], found[self._coupled] = of_loops, of_couplings
        return found

    def bias(self) -> Array:
        """k = −K̇ v (nc,) after the tree's `jacobians` at q and `rnea` at (q, v, 0).

        The joints' accelerations there include minus gravity, which cancels in every difference.
        """
        tree, rows = self._tree, self._of_loops
        v, a = tree.v[self._joint], tree.a[self._joint]
        omega, speed = apply(self._turn, v[:, 3:]), apply(self._to_frame, v)
        # a + ω × v of the cut points; these in frame axes, what rows are asked for in the world's
        pull = apply(tree.frame_R, apply(self._to_frame, a) + cross(omega, speed))
        rates = None  # of n fixed in the world, φ̈ is the difference of the points' accelerations
        if rows.turning:
            alpha = apply(self._turn, a[:, 3:])
            rates = apply(tree.frame_R, speed), apply(tree.frame_R, omega), apply(tree.frame_R, alpha)
        k = rows.bias(tree.frame_p, tree.frame_R, pull, rates)
        if self._coupling is not None:
            k = self._joined(k, self._coupling.bias(tree.q, tree.qdot))
        return k * self._weight


def without_zero_rows(
    tree: Tree,
    closures: Sequence[AnyClosure],
    length: float,
    configurations: Sequence[Array],
    rounded: float = STRUCTURAL,
) -> ImplicitConstraint:
    """The constraint of the closures, less rows that vanish with their K at all of these configurations.

    Raises
    ------
    ModelError
        Where such a row of K leaves frames apart that no joint can bring together, by more than `rounded`.
    """
    full = ImplicitConstraint(tree, closures)
    scale = np.where(full.is_length, length, 1.0)
    moved = np.zeros(len(full.rows))
    constant = np.zeros(len(full.rows))
    for q in configurations:
        tree.jacobians(q)
        constant = full.residual() / scale  # the last serves: what no joint moves is the same at all
        moved = np.maximum(moved, np.max(np.abs(full.jacobian()), axis=1, initial=0.0) / scale)
    # a planar loop in space has such rows, which would leave K without its full rank everywhere
    used = moved > STRUCTURAL
    open_rows = np.flatnonzero(~used & (np.abs(constant) > rounded))
    if len(open_rows):
        row = int(open_rows[0])
        raise ModelError(
            f"closure {full.labels[row]}: its frames stay "
            f"{abs(constant[row] * scale[row]):.3g} {'m' if full.is_length[row] else 'rad'} "
            "apart in every configuration, along a direction that no joint moves; "
            "shift or turn one of the two frames"
        )
    kept = ImplicitConstraint(tree, closures, np.flatnonzero(used))
    left = np.maximum(moved, np.abs(constant))
    kept.vanishing = {
        full.labels[row]: float(left[row]) for row in np.flatnonzero(~used & (left > CLOSED)).tolist()
    }
    return kept


def _point_motion(frame: pin.Frame) -> Array:
    """(3, 6): linear motion of the frame's origin, in its own axes, from its joint's motion."""
    M = frame.placement
    return np.asarray(M.rotation.T @ np.hstack([np.eye(3), -skew(M.translation)]))
