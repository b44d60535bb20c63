"""What tools that build their own models ask of a mechanism: places of frames, closures, drives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ... import JointTorque, Mechanism
from ...mechanism.constraint.closures import RevoluteClosure, closure_frames, frame_of
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array

Place = tuple[int, pin.SE3]
"""A joint's index (0: the ground) and a placement on its body."""


def has_simple_joints(mechanism: Mechanism, floating: bool = False) -> bool:
    """Whether all joints are revolute and prismatic with one number in q; or free-flyers on the ground."""
    return all(
        joint.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)
        or (floating and joint.kind is JointKind.FREE_FLYER and mechanism.own_model.parents[joint.index] == 0)
        for joint in mechanism.joints
    )


def closure_places(mechanism: Mechanism) -> list[tuple[Place, Place]]:
    """Both places that each closure holds together."""
    places = closure_frames(mechanism.own_model, mechanism.loops)
    half = len(places) // 2
    return list(zip(places[:half], places[half:], strict=True))


def rigid_constraints(mechanism: Mechanism) -> tuple[pin.StdVec_RigidConstraintModel, Any]:
    """Points that Pinocchio's constrained dynamics hold together, and their data."""
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for pair in closure_places(mechanism):
        ends = (part for place in pair for part in place)
        kind = pin.ContactType.CONTACT_3D
        models.append(pin.RigidConstraintModel(kind, mechanism.own_model, *ends, pin.ReferenceFrame.LOCAL))
        datas.append(models[-1].createData())
    return models, datas


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
