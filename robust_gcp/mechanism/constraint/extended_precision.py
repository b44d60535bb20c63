"""How far closures are open at a configuration, in extended precision.

In doubles φ says so to ε only, and where K_d is nearly singular, with σ its conditioning, q is then closed to
ε/σ, and derivatives to ε/σ². From φ in more digits q is closed to its own rounding. Where the machine has no
wider floating-point type this is what doubles give: `EPS` says which.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..tree.columns import with_simple_joints
from ..tree.joints import Joint, JointKind, joints_of
from ..tree.tree import Array
from .closure_rates import ClosureRates, Placement
from .closures import closure_frames

WIDE = np.longdouble

EPS = float(np.finfo(WIDE).eps)
"""Of what φ is computed in."""


class ExtendedClosures:
    """φ of closed loops, dimensionless by rows, in extended precision.

    Parameters
    ----------
    rates : ClosureRates
    """

    def __init__(self, rates: ClosureRates) -> None:
        self._rates, loops = rates, rates.loops
        # one part a joint, as `Columns` numbers them
        model = with_simple_joints(loops.near, loops.joints)
        self._joints = joints_of(model)
        self._screws = {
            joint.index: _pitch(model.joints[joint.index], model)
            for joint in self._joints
            if joint.kind is JointKind.SCREW
        }
        self._parent = [int(p) for p in model.parents]
        self._fixed = [_wide(place) for place in model.jointPlacements]
        self._ends = [_wide(place) for _, place in closure_frames(loops.near, loops.loops)]

    def residual(self, q: Array) -> Array:
        """φ at q (nq,), (rows,) in extended precision."""
        q = q.astype(WIDE)
        whole: list[tuple[Array, Array]] = [self._fixed[0]]
        for joint in self._joints:
            own = q[joint.idx_q : joint.idx_q + joint.nq]
            moved = _joint_motion(joint, own, self._screws.get(joint.index, 0.0))
            whole.append(_after(_after(whole[self._parent[joint.index]], self._fixed[joint.index]), moved))
        ends = [_after(whole[part], end) for part, end in zip(self._rates.part, self._ends, strict=True)]
        R = np.array([turn for turn, _ in ends], dtype=WIDE).reshape(-1, 3, 3)
        p = np.array([shift for _, shift in ends], dtype=WIDE).reshape(-1, 3)
        still = np.zeros(self._rates.loops.nv)  # φ alone is asked for, so no joint need move
        nowhere = np.zeros((len(still), 6))
        return self._rates.products_at(Placement(nowhere, p, R, q), still, still).x


def _joint_motion(joint: Joint, q: Array, pitch: float) -> tuple[Array, Array]:
    """Rotation and translation of a joint with a constant motion subspace."""
    turn, shift = np.eye(3, dtype=WIDE), np.zeros(3, dtype=WIDE)
    kind = joint.kind
    if joint.axis is not None:
        along = joint.axis.astype(WIDE)
        along = along / np.sqrt(along @ along)  # a unit vector in doubles is one to ε only
        if kind is JointKind.CONTINUOUS:
            turn = _turn(along, *q / np.hypot(*q))  # as above: (cos, sin) in q are doubles
        elif kind is not JointKind.PRISMATIC:
            turn = _turn(along, np.cos(q[0]), np.sin(q[0]))
        shift = along * q[0] if kind is JointKind.PRISMATIC else along * (pitch * q[0])
    elif kind is JointKind.PLANAR:
        shift[:2], (c, s) = q[:2], q[2:] / np.hypot(*q[2:])
        turn = _turn(np.array([0, 0, 1], dtype=WIDE), c, s)
    else:  # a spherical joint, a translation, or both
        if kind is not JointKind.SPHERICAL:
            shift = q[:3]
        if kind is not JointKind.TRANSLATION:
            x = q[-4:] / np.sqrt(q[-4:] @ q[-4:])
            W = _crossed(x[:3])
            turn = turn + 2 * x[3] * W + 2 * W @ W
    return turn, shift


def _turn(along: Array, c: Array, s: Array) -> Array:
    """Rotation about a unit vector."""
    W = _crossed(along)
    found: Array = np.eye(3, dtype=WIDE) + s * W + (1 - c) * W @ W
    return found


def _crossed(w: Array) -> Array:
    """W u = w × u."""
    found: Array = np.cross(w[None], -np.eye(3, dtype=WIDE))
    return found


def _pitch(joint: pin.JointModel, model: pin.Model) -> float:
    """Of a screw, m/rad."""
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    linear, angular = np.split(np.asarray(data.S, dtype=float).ravel(), 2)
    return float(linear @ angular)  # S = (pitch · axis, axis)


def _wide(place: pin.SE3) -> tuple[Array, Array]:
    return np.asarray(place.rotation, dtype=WIDE), np.asarray(place.translation, dtype=WIDE)


def _after(one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    """The motion of `other` in the axes of `one`, after it."""
    return one[0] @ other[0], one[0] @ other[1] + one[1]
