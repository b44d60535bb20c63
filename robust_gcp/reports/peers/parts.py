"""A mechanism's spanning tree as plain parts, for tools that build their own models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...mechanism.constraint.closures import RevoluteClosure, closure_frames, frame_of
from ...mechanism.forces.forces import JointTorque
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array

Place = tuple[int, pin.SE3]
"""A joint's index (0: the ground) and a placement on its body."""


@dataclass(frozen=True)
class Joint:
    """A revolute joint, a prismatic joint or a free-flyer with its body."""

    name: str
    parent: int  # index of the parent joint; 0 is the ground
    placement: pin.SE3  # on the parent's body
    kind: JointKind
    axis: Array  # (3,): unit vector in the joint's own axes; of no meaning for a free-flyer
    inertia: pin.Inertia  # of the body, in the joint's own axes

    @property
    def hinge(self) -> bool:
        """Whether it turns about its axis."""
        return self.kind is JointKind.REVOLUTE


def has_simple_joints(mechanism: Mechanism, floating: bool = False) -> bool:
    """Whether all joints are revolute and prismatic with one number in q; or free-flyers on the ground."""
    return all(
        joint.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)
        or (floating and joint.kind is JointKind.FREE_FLYER and mechanism.own_model.parents[joint.index] == 0)
        for joint in mechanism.joints
    )


def joints(mechanism: Mechanism) -> list[Joint]:
    """All joints in the order of q; the first one's index is 1."""
    model = mechanism.own_model
    found = []
    for joint in mechanism.joints:
        i = joint.index
        placement, inertia = model.jointPlacements[i], model.inertias[i]
        axis = np.zeros(3) if joint.axis is None else joint.axis
        found.append(Joint(joint.name, int(model.parents[i]), placement, joint.kind, axis, inertia))
    return found


def closure_places(mechanism: Mechanism) -> list[tuple[Place, Place]]:
    """Both places that each closure holds together."""
    places = closure_frames(mechanism.own_model, mechanism.loops)
    half = len(places) // 2
    return list(zip(places[:half], places[half:], strict=True))


def held_points(mechanism: Mechanism, closure: object) -> list[Array]:
    """Where on its frames a closure holds points together: the origin, of a revolute one its axis too."""
    if not isinstance(closure, RevoluteClosure):
        return [np.zeros(3)]
    axis = np.asarray(closure.axis, dtype=float)
    return [np.zeros(3), mechanism.length / float(np.linalg.norm(axis)) * axis]


def frame_place(mechanism: Mechanism, name: str) -> Place:
    """Where a frame is."""
    frame = frame_of(mechanism.own_model, name, mechanism.name)
    return int(frame.parentJoint), frame.placement


def constant_torques(mechanism: Mechanism) -> Array:
    """The constant drives on all joints, (nv,), N m and N."""
    torques = np.zeros(mechanism.nv)
    for force in mechanism.forces:
        if isinstance(force, JointTorque):
            torques[mechanism.velocity_slice(force.joint)] += force.torque
    return torques
