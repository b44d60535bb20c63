"""A spatial mechanism as Exudyn's kinematic tree, with joints between its links for the closures."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...mechanism.closures import RevoluteClosure
from ...mechanism.tree import Array
from ..contender import Scene
from .exudyn_model import ExudynModel, exu, items
from .parts import Place, closure_places, constant_torques, joints


class KinematicTree(ExudynModel):
    """The scene in the joints' coordinates, one node; Exudyn's links have their axis along z."""

    linear_solver = ("EigenDense", True)  # closures may have a row too many

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        mechanism = scene.mechanism
        parts = joints(mechanism)
        self._turns = [pin.SE3.Identity(), *(_from_z(joint.axis) for joint in parts)]
        self._ground = self.mbs.AddObject(items.ObjectGround())
        node = self.mbs.AddNode(
            items.NodeGenericODE2(
                numberOfODE2Coordinates=len(parts),
                referenceCoordinates=[0.0] * len(parts),
                initialCoordinates=scene.q0.tolist(),
                initialCoordinates_t=scene.v0.tolist(),
            )
        )
        offsets = [
            self._turns[joint.parent].inverse() * joint.placement * self._turns[i]
            for i, joint in enumerate(parts, start=1)
        ]
        inertias = [joint.inertia.se3ActionInverse(self._turns[i]) for i, joint in enumerate(parts, start=1)]
        self._tree = self.mbs.AddObject(
            items.ObjectKinematicTree(
                nodeNumber=node,
                gravity=mechanism.model.gravity.linear.tolist(),
                jointTypes=[
                    exu.JointType.RevoluteZ if joint.hinge else exu.JointType.PrismaticZ for joint in parts
                ],
                linkParents=[joint.parent - 1 for joint in parts],
                jointTransformations=exu.Matrix3DList([offset.rotation for offset in offsets]),
                jointOffsets=exu.Vector3DList([offset.translation for offset in offsets]),
                linkInertiasCOM=exu.Matrix3DList([inertia.inertia for inertia in inertias]),
                linkCOMs=exu.Vector3DList([inertia.lever for inertia in inertias]),
                linkMasses=[inertia.mass for inertia in inertias],
                jointForceVector=constant_torques(mechanism).tolist(),
            )
        )
        rows = ROWS | BY_HAND.get(mechanism.name, {})
        for closure, ends in zip(mechanism.closures, closure_places(mechanism), strict=True):
            axis = closure.axis if isinstance(closure, RevoluteClosure) else (0.0, 0.0, 1.0)
            turn = _from_z(np.asarray(axis, dtype=float))
            (one, turn1), (two, turn2) = (self._turned_marker((joint, at * turn)) for joint, at in ends)
            self.mbs.AddObject(
                items.GenericJoint(
                    markerNumbers=[one, two],
                    constrainedAxes=rows[closure.kind],
                    rotationMarker0=turn1,
                    rotationMarker1=turn2,
                )
            )
        self.finish(mechanism, [node])

    def tree_coordinates(self, stored: list[list[Array]]) -> tuple[Array, Array, Array]:
        """q, v and a as they are."""
        (q,), (v,), (a,) = stored
        return q, v, a

    def marker(self, place: Place) -> int:
        """In the link's axes."""
        return self._turned_marker(place)[0]

    def _turned_marker(self, place: Place) -> tuple[int, Array]:
        """A marker at the place, in the link's axes, and how the place is turned there."""
        joint, at = place
        at = self._turns[joint].inverse() * at
        if joint == 0:
            marker = items.MarkerBodyRigid(bodyNumber=self._ground, localPosition=at.translation)
        else:
            marker = items.MarkerKinematicTreeRigid(
                objectNumber=self._tree, linkNumber=joint - 1, localPosition=at.translation
            )
        return int(self.mbs.AddMarker(marker)), at.rotation


ROWS = {"3d": [1, 1, 1, 0, 0, 0], "6d": [1, 1, 1, 1, 1, 1], "revolute": [1, 1, 1, 1, 1, 0]}
"""Displacements and rotations that a joint of Exudyn takes away; its free axis is z."""

BY_HAND = {"bricard": {"revolute": [1, 1, 0, 1, 1, 0]}, "bricard_square": {"revolute": [1, 1, 0, 1, 1, 0]}}
"""Rows left out by hand, as Exudyn's examples advise, where a closure has one too many. The choice matters
to velocity constraints: these four keep their smallest singular value of 0.62 all the way, while others
come down to 0.003."""


def _from_z(axis: Array) -> pin.SE3:
    """A rotation that turns z into the axis."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis)
    return pin.SE3(turn.toRotationMatrix(), np.zeros(3))
