"""Springs, dampers and constant drives: τ(q, v) and the potential energy of the springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ..checks import check_number, check_text, shown
from ..errors import ModelError, OptionError, SimulationError
from .closures import Closure, PrismaticClosure, frame_of
from .joints import joint_named, single_joint, support
from .tree import Array, Tree

INSTEAD = "or use a PointSpring"


@dataclass(frozen=True)
class JointSpring:
    """τ = −stiffness (q − rest) on a joint with one number in q.

    Parameters
    ----------
    joint : str
    stiffness : float
        N m/rad or N/m, not negative.
    rest : float
        Where the spring is relaxed, rad or m.
    """

    joint: str
    stiffness: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        check_text("JointSpring: joint", self.joint)
        label = f"JointSpring on {self.joint!r}"
        _require_number(label, "stiffness", self.stiffness, positive=True)
        _require_number(label, "rest", self.rest)


@dataclass(frozen=True)
class JointDamper:
    """τ = −damping v on every velocity of a joint, N m s/rad or N s/m."""

    joint: str
    damping: float

    def __post_init__(self) -> None:
        check_text("JointDamper: joint", self.joint)
        _require_number(f"JointDamper on {self.joint!r}", "damping", self.damping, positive=True)


@dataclass(frozen=True)
class JointTorque:
    """A constant drive on a joint with one velocity, N m or N."""

    joint: str
    torque: float

    def __post_init__(self) -> None:
        check_text("JointTorque: joint", self.joint)
        _require_number(f"JointTorque on {self.joint!r}", "torque", self.torque)


@dataclass(frozen=True)
class PointSpring:
    """A spring with a damper along the line between the origins of two frames.

    It pulls with stiffness (l − rest_length) + damping dl/dt at the distance l.

    Parameters
    ----------
    frame1, frame2 : str
        Frames of the spanning tree; "universe" is the ground.
    stiffness, rest_length, damping : float
        N/m, m, N s/m, none negative.
    """

    frame1: str
    frame2: str
    stiffness: float
    rest_length: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        for what in ("frame1", "frame2"):
            check_text(f"PointSpring: {what}", getattr(self, what))
        label = f"PointSpring {self.frame1} – {self.frame2}"
        for field in ("stiffness", "rest_length", "damping"):
            _require_number(label, field, getattr(self, field), positive=True)


Force = JointSpring | JointDamper | PointSpring | JointTorque


class AppliedForces:
    """All springs, dampers and drives of a mechanism at once.

    Parameters
    ----------
    tree : Tree
    forces : sequence of forces
        At least one.

    Attributes
    ----------
    works : bool
        Whether something acts that no potential energy accounts for: a damper or a drive.

    Raises
    ------
    ModelError
        For a joint or frame that the model does not have, or a joint of the wrong kind.
    """

    def __init__(self, tree: Tree, forces: Sequence[Force]) -> None:
        self._tree = tree
        nv = tree.nv
        forces = [_as_force(f) for f in forces]
        springs = [f for f in forces if isinstance(f, JointSpring)]
        dampers = [f for f in forces if isinstance(f, JointDamper)]
        drives = [f for f in forces if isinstance(f, JointTorque)]
        lines = [f for f in forces if isinstance(f, PointSpring)]

        joints = [single_joint(tree.joints, f.joint, "JointSpring", INSTEAD) for f in springs]
        self._spring_q = np.array([j.idx_q for j in joints], dtype=np.int64)
        self._stiffness = np.array([f.stiffness for f in springs])
        self._rest = np.array([f.rest for f in springs])
        self._spring_lift = np.zeros((nv, len(springs)))
        for i, joint in enumerate(joints):
            self._spring_lift[joint.idx_v, i] = -self._stiffness[i]

        self._damping = np.zeros(nv)
        for damper in dampers:
            joint = joint_named(tree.joints, damper.joint, "JointDamper")
            self._damping[joint.v] += damper.damping
        self._drive = np.zeros(nv)
        for drive in drives:
            self._drive[single_joint(tree.joints, drive.joint, "JointTorque", INSTEAD).idx_v] += drive.torque
        self._lines = _Lines(tree, lines) if lines else None
        self._joint_work = bool(np.any(self._damping) or np.any(self._drive))
        self.works = self._joint_work or (self._lines is not None and self._lines.damped)

    def at(self, q: Array, v: Array) -> tuple[Array, float]:
        """τ (nv,), N m and N, and the power of dampers and drives, W.

        Raises
        ------
        SimulationError
            Where a point spring has no length, so that its force has no direction.
        """
        tau = np.zeros(self._tree.nv)
        power = 0.0
        if self._joint_work:
            tau = self._drive - self._damping * v
            power = float(tau @ v)
        if len(self._spring_q):
            tau = tau + self._spring_lift @ (q[self._spring_q] - self._rest)
        if self._lines is not None:
            line_tau, line_power = self._lines.at(q, v)
            tau, power = tau + line_tau, power + line_power
        return tau, power

    def tau(self, q: Array, v: Array) -> Array:
        """τ(q, v), (nv,), N m and N."""
        return self.at(q, v)[0]

    def energy(self, q: Array) -> float:
        """Potential energy of the springs, J."""
        energy = 0.0
        if len(self._spring_q):
            energy = 0.5 * float(self._stiffness @ (q[self._spring_q] - self._rest) ** 2)
        if self._lines is not None:
            energy += self._lines.energy(q)
        return energy


class _Lines:
    """All point springs: the length l along the unit vector u from point 1 to point 2.

    dl = (u, p₁ × u) · (V₂ − V₁) with V the bodies' spatial velocities at the world's origin: one
    wrench serves both bodies, and the joints that carry both drop out.
    """

    def __init__(self, tree: Tree, springs: Sequence[PointSpring]) -> None:
        self._tree = tree
        ends = [
            [_frame(tree.model, s.frame1, s) for s in springs],
            [_frame(tree.model, s.frame2, s) for s in springs],
        ]
        self._labels = [f"{s.frame1} – {s.frame2}" for s in springs]
        self._joint = np.array([[int(f.parentJoint) for f in end] for end in ends], dtype=np.int64)
        self._offset = np.array([[f.placement.translation for f in end] for end in ends])
        self._stiffness = np.array([s.stiffness for s in springs])
        self._rest = np.array([s.rest_length for s in springs])
        self._damping = np.array([s.damping for s in springs])
        self.damped = bool(np.any(self._damping))
        self._sign = np.zeros((len(springs), tree.nv))
        for end, sign in ((0, -1.0), (1, 1.0)):
            for i, joint in enumerate(self._joint[end]):
                self._sign[i, support(tree.model, int(joint))] += sign

    def _ends(self, q: Array) -> tuple[Array, Array]:
        """Point 1 of each spring and the vector to its point 2, world axes."""
        tree = self._tree
        tree.jacobians(q)
        p = tree.p[self._joint] + (tree.R[self._joint] @ self._offset[..., None])[..., 0]
        return p[0], p[1] - p[0]

    def at(self, q: Array, v: Array) -> tuple[Array, float]:
        """τ (nv,) and the power of the dampers."""
        start, along = self._ends(q)
        length = np.linalg.norm(along, axis=1)
        if not length.all():
            self._require_direction(length)
            length = np.where(length > 0.0, length, 1.0)  # no rest length: the force vanishes
        u = along / length[:, None]
        wrench = np.hstack([u, np.cross(start, u)])
        rate = (wrench @ self._tree.J.T) * self._sign
        tension = self._stiffness * (np.linalg.norm(along, axis=1) - self._rest)
        power = 0.0
        if self.damped:
            speed = rate @ v
            drag = self._damping * speed
            tension = tension + drag
            power = -float(drag @ speed)
        return -tension @ rate, power

    def energy(self, q: Array) -> float:
        stretch = np.linalg.norm(self._ends(q)[1], axis=1) - self._rest
        return 0.5 * float(self._stiffness @ stretch**2)

    def _require_direction(self, length: Array) -> None:
        lost = np.flatnonzero((length == 0.0) & ((self._rest > 0.0) | (self._damping > 0.0)))
        if len(lost):
            raise SimulationError(
                f"the point spring {self._labels[lost[0]]} has shrunk to a point, where its force has "
                "no direction; move one of its frames off the other's path, or give it "
                "rest_length = 0 and damping = 0"
            )


def require_length(forces: Sequence[Force], closures: Sequence[Any]) -> None:
    """Refuse point springs between points that a closure holds together: their direction is rounding."""
    held = {
        frozenset((closure.frame1, closure.frame2))
        for closure in closures
        if isinstance(closure, Closure) and not isinstance(closure, PrismaticClosure)
    }
    for force in forces:
        if not isinstance(force, PointSpring) or not (force.rest_length or force.damping):
            continue
        if frozenset((force.frame1, force.frame2)) in held:
            raise ModelError(
                f"the point spring {force.frame1} – {force.frame2} is between points that a closure holds "
                "together, where it has no length and no direction; leave it out, or move one of its frames"
            )


def _as_force(force: Force) -> Force:
    if not isinstance(force, JointSpring | JointDamper | PointSpring | JointTorque):
        raise ModelError(
            f"forces: {shown(force)} is not a JointSpring, JointDamper, PointSpring or JointTorque"
        )
    return force


def _require_number(label: str, field: str, value: object, positive: bool = False) -> None:
    try:
        check_number(field, value)
    except OptionError as error:
        raise ModelError(f"{label}: {field} is {shown(value)}; give a number") from error
    assert isinstance(value, int | float | np.number)
    if not np.isfinite(float(value)):
        raise ModelError(f"{label}: {field} is {value}; give a finite number")
    if positive and value < 0.0:
        raise ModelError(f"{label}: {field} is {value}; give zero or a positive number")


def _frame(model: pin.Model, name: str, spring: PointSpring) -> pin.Frame:
    return frame_of(model, name, f"PointSpring {spring.frame1} – {spring.frame2}")
