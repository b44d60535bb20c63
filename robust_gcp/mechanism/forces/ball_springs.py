"""Springs of spherical joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ...checks import check_text, checked_vector, shown
from ...errors import ModelError
from ..tree.joints import Joint, JointKind, joint_named
from ..tree.tree import Array
from .forces import Force, Vector, require_number

if TYPE_CHECKING:
    from ..mechanism import Mechanism


@dataclass(frozen=True)
class BallSpring(Force):
    """τ = −stiffness θ on a spherical joint; θ is the rotation vector from rest, in the body's axes.

    exp(θ) = R(rest)ᵀ R(q), ‖θ‖ ≤ π; where it reaches half a turn, the torque jumps to the other side.

    Parameters
    ----------
    joint : str
        A spherical joint.
    stiffness : float
        N m/rad, not negative.
    rest : sequence of float (4,)
        Where the spring is relaxed, a quaternion (x, y, z, w).

    Raises
    ------
    ModelError
        For numbers that make no spring.
    """

    joint: str
    stiffness: float
    rest: Sequence[float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_text("BallSpring: joint", self.joint)
        label = f"BallSpring on {self.joint!r}"
        require_number(label, "stiffness", self.stiffness, positive=True)
        rest = checked_vector(self.rest, 4, f"{label}: rest", "4")
        if not 1e-3 < float(np.linalg.norm(rest)) < 1e3:
            raise ModelError(f"{label}: rest = {shown(self.rest)} must be a quaternion (x, y, z, w)")
        object.__setattr__(self, "rest", tuple(rest.tolist()))

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> Array:
        """τ(q), (nv,)."""
        joint, tau = self.place(mechanism.joints), np.zeros(mechanism.nv)
        # θ is the axis of the rotation, hence the same in the axes of both bodies
        tau[joint.v] = -self.stiffness * pin.log3(self._turned(joint, q))
        return tau

    def energy(self, mechanism: Mechanism, q: Vector) -> float:
        """½ stiffness ‖θ‖², J."""
        theta: Any = pin.log3(self._turned(self.place(mechanism.joints), q))
        return 0.5 * self.stiffness * float(theta @ theta)

    def derivatives(self, mechanism: Mechanism, q: Vector, v: Vector) -> tuple[Array, Array]:
        """∂τ/∂q and ∂τ/∂v, (nv, nv) each, exact."""
        joint, by_q = self.place(mechanism.joints), np.zeros((mechanism.nv, mechanism.nv))
        by_q[joint.v, joint.v] = -self.stiffness * pin.Jlog3(self._turned(joint, q))
        return by_q, np.zeros_like(by_q)

    def _turned(self, joint: Joint, q: Array) -> Array:
        rest = pin.Quaternion(np.array(self.rest)).normalized()
        now = pin.Quaternion(np.array(q[joint.idx_q : joint.idx_q + 4])).normalized()
        return np.asarray((rest.conjugate() * now).toRotationMatrix())

    def place(self, joints: Sequence[Joint]) -> Joint:
        """The joint that it acts on, or a ModelError."""
        joint = joint_named(joints, self.joint, "BallSpring")
        if joint.kind is not JointKind.SPHERICAL:
            raise ModelError(f"BallSpring: joint {self.joint!r} is not spherical; use a JointSpring")
        return joint
