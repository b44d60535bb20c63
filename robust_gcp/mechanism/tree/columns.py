"""Which velocities carry which bodies, joint by joint and part by part.

A part has a motion subspace that is constant in its own frame: a revolute, prismatic, helical or spherical
joint, a free body. Joints whose subspace depends on q (universal, Euler angles, composite) are chains of
parts.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from .joints import Array, Joint


class Columns:
    """The columns of the joint Jacobian as a tree of parts; part 0 is the ground.

    Parameters
    ----------
    model : pin.Model
    joints : sequence of Joint
        All of the model.

    Attributes
    ----------
    part : ndarray (nv,) of int
        The part that a column moves.
    parent : ndarray (nv,) of int
        The part before that one.
    of_joint : ndarray (njoints,) of int
        The last part of each joint, which the joint's body is fixed to.
    carries : ndarray (nparts, nv)
        1 where a column moves a part.
    slices : list of slice
        The columns of each part but the ground, each after those that carry it.

    Raises
    ------
    ModelError
        For an ellipsoid joint, which is no chain of parts.
    """

    def __init__(self, model: pin.Model, joints: tuple[Joint, ...]) -> None:
        self.of_joint = np.zeros(model.njoints, dtype=np.int64)
        self.part = np.zeros(model.nv, dtype=np.int64)
        self.parent = np.zeros(model.nv, dtype=np.int64)
        carried = [np.zeros(model.nv)]
        self.slices: list[slice] = []
        for joint in joints:
            last, first = int(self.of_joint[model.parents[joint.index]]), joint.idx_v
            for simple, _ in _chain(model.joints[joint.index], joint):
                own = slice(first, first + simple.nv)
                row = carried[last].copy()
                row[own] = 1.0
                self.part[own], self.parent[own] = len(carried), last
                last, first = len(carried), own.stop
                carried.append(row)
                self.slices.append(own)
            self.of_joint[joint.index] = last
        self.carries: Array = np.array(carried)


def with_simple_joints(model: pin.Model, joints: tuple[Joint, ...]) -> pin.Model:
    """The same tree with joints of constant motion subspace only, same q and v; itself where it is one.

    Pinocchio's derivatives of RNEA are wrong for the others.

    Raises
    ------
    ModelError
        As `Columns` does.
    """
    if all(joint.constant_subspace for joint in joints):
        return model
    part, still = pin.Model(), pin.SE3.Identity()
    part.name, part.gravity = model.name, model.gravity
    at = [0]  # the joint of the new model that each old one's body is fixed to
    for joint in joints:
        last, place = at[model.parents[joint.index]], model.jointPlacements[joint.index]
        for number, (kind, offset) in enumerate(_chain(model.joints[joint.index], joint)):
            last = int(part.addJoint(last, kind, place * offset, f"{joint.name}/{number}"))
            place = still  # each further one sits where the one before ends
        part.appendBodyToJoint(last, model.inertias[joint.index], still)
        at.append(last)
    part.armature = np.array(model.armature)
    return part


def _chain(kind: pin.JointModel, joint: Joint) -> list[tuple[pin.JointModel, pin.SE3]]:
    """Simple joints, and where each sits on the one before, that move as a joint or a part of it does."""
    still, name = pin.SE3.Identity(), kind.shortname().removeprefix("JointModel")
    if name == "SphericalZYX":
        return [(pin.JointModelRZ(), still), (pin.JointModelRY(), still), (pin.JointModelRX(), still)]
    if name == "Universal":
        own = kind.extract()
        return [(pin.JointModelRevoluteUnaligned(a), still) for a in (own.axis1, own.axis2)]
    if name == "Composite":
        own = kind.extract()
        made = []
        for inner, place in zip(own.joints, own.jointPlacements, strict=True):
            chain = _chain(inner, joint)
            made += [(chain[0][0], place * chain[0][1]), *chain[1:]]
        return made
    if name == "Ellipsoid":
        raise ModelError(
            f"joint {joint.name!r} ({joint.type}): the motion of an ellipsoid joint is no chain of revolute "
            "and prismatic joints, and it has no derivatives here; replace it by such a chain"
        )
    return [(kind, still)]
