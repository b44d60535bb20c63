"""Scenes as Exudyn's models: planar ones as rigid bodies, others as a kinematic tree with closing joints.

Exudyn's packages are untyped here: its stubs do not describe how its functions are called.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ... import PointSpring, RevoluteClosure
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..contender import Scene
from .parts import Place, closure_places, constant_torques, frame_place

exu: Any = importlib.import_module("exudyn")
items: Any = importlib.import_module("exudyn.itemInterface")

ROUNDING = 1e-12
SPARSE_FROM = 8
"""Bodies beyond which Exudyn's sparse solver is the faster one."""

ROWS = {"3d": [1, 1, 1, 0, 0, 0], "6d": [1, 1, 1, 1, 1, 1], "revolute": [1, 1, 1, 1, 1, 0]}
"""Displacements and rotations that a joint of Exudyn takes away; its free axis is z."""

BY_HAND = {"bricard": {"revolute": [1, 1, 0, 1, 1, 0]}, "bricard_square": {"revolute": [1, 1, 0, 1, 1, 0]}}
"""Rows left out by hand, as Exudyn's examples advise, where a closure has one too many. The choice matters
to velocity constraints: these four keep their smallest singular value of 0.62 all the way, while others
come down to 0.003."""


class ExudynModel(ABC):
    """A scene as Exudyn sees it; a model adds its bodies and joints, then calls `finish`.

    Attributes
    ----------
    container, mbs
        Exudyn's, assembled.
    linear_solver : (str, bool)
        Exudyn's name, and whether singular Jacobians are solved all the same.
    sensors : list of list of int
        Positions, velocities and accelerations of the nodes.
    """

    linear_solver: tuple[str, bool]

    def __init__(self, scene: Scene) -> None:
        self.container = exu.SystemContainer()
        self.mbs: Any = self.container.AddSystem()
        self.sensors: list[list[int]] = []
        self.mechanism, self.model = scene.mechanism, scene.mechanism.own_model
        self.parents = [int(parent) for parent in self.model.parents]
        self.bodies = [self.mbs.AddObject(items.ObjectGround())]

    @abstractmethod
    def tree_coordinates(self, stored: list[list[Array]]) -> tuple[Array, Array, Array]:
        """q, v and a of the spanning tree, (n, nq), from what each sensor stored after the time."""

    @abstractmethod
    def marker(self, place: Place) -> int:
        """A new marker at a place."""

    def finish(self, nodes: Sequence[int]) -> None:
        """Add point springs between markers, and sensors of the nodes; assemble."""
        for spring in self.mechanism.forces:
            if isinstance(spring, PointSpring):
                ends = [self.marker(frame_place(self.mechanism, f)) for f in (spring.frame1, spring.frame2)]
                self.mbs.AddObject(
                    items.ObjectConnectorSpringDamper(
                        markerNumbers=ends, referenceLength=spring.rest_length,
                        stiffness=spring.stiffness, damping=spring.damping,
                    )
                )  # fmt: skip
        kinds = exu.OutputVariableType
        for kind in (kinds.Coordinates, kinds.Coordinates_t, kinds.Coordinates_tt):
            options = {"storeInternal": True, "writeToFile": False, "outputVariableType": kind}
            made = [self.mbs.AddSensor(items.SensorNode(nodeNumber=node, **options)) for node in nodes]
            self.sensors.append(made)
        self.mbs.Assemble()


def is_planar(scene: Scene) -> bool:
    """Whether all joints are revolute joints about the world's +x, and gravity lies in the plane."""
    axis, model = np.array([1.0, 0.0, 0.0]), scene.mechanism.own_model
    return abs(model.gravity.linear[0]) < ROUNDING and all(
        joint.kind is JointKind.REVOLUTE
        and np.abs(joint.axis - axis).max() < ROUNDING
        and np.abs(model.jointPlacements[joint.index].rotation @ axis - axis).max() < ROUNDING
        for joint in scene.mechanism.joints
    )


class PlanarBodies(ExudynModel):
    """Rigid bodies in the plane, joined by revolute joints; its nodes are the bodies in turn.

    Three coordinates a body, about its centre of mass, so that the mass matrix is constant and diagonal. The
    plane is the world's y–z plane, Exudyn's x–y plane; x becomes its z, a rotation about +x one about its +z.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        model, self._start = self.model, scene.q0
        bodies = range(1, model.njoints)
        self.linear_solver = ("EigenSparse" if len(bodies) > SPARSE_FROM else "EXUdense", False)
        data = model.createData()
        pin.forwardKinematics(model, data, scene.q0, scene.v0)
        nodes = [self._add_body(i, data) for i in bodies]
        tree = [((self.parents[i], model.jointPlacements[i]), (i, pin.SE3.Identity())) for i in bodies]
        for pair in (*tree, *closure_places(self.mechanism)):
            ends = [self.marker(place) for place in pair]
            self.mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends))
        for i, torque in enumerate(constant_torques(self.mechanism), start=1):
            if torque != 0.0:  # on the body, and back on the one that carries it
                self._add_moment(nodes, i, torque)
                self._add_moment(nodes, self.parents[i], -torque)
        self.finish(nodes)

    def tree_coordinates(self, stored: list[list[Array]]) -> tuple[Array, Array, Array]:
        """A joint turns by as much as its body turns more than the body that carries it."""
        turned = (np.column_stack([0.0 * bodies[0][:, 2], *(b[:, 2] for b in bodies)]) for bodies in stored)
        q, v, a = (absolute[:, 1:] - absolute[:, self.parents[1:]] for absolute in turned)
        return self._start + q - q[0], v, a

    def _add_body(self, joint: int, data: pin.Data) -> int:
        """A body about its centre of mass; its node."""
        inertia, place, motion = self.model.inertias[joint], data.oMi[joint], data.v[joint]
        centre = place.act(inertia.lever)
        velocity = place.rotation @ (motion.linear + np.cross(motion.angular, inertia.lever))
        turn = float(pin.log3(place.rotation)[0])
        node = self.mbs.AddNode(
            items.NodeRigidBody2D(
                referenceCoordinates=[centre[1], centre[2], turn],
                initialVelocities=[velocity[1], velocity[2], motion.angular[0]],
            )
        )
        body = self.mbs.AddObject(
            items.ObjectRigidBody2D(mass=inertia.mass, inertia=inertia.inertia[0, 0], nodeNumber=node)
        )
        self.bodies.append(body)
        gravity = self.model.gravity.linear
        if np.any(gravity):
            marker = self.mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
            pull = [gravity[1], gravity[2], 0.0]
            self.mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=pull))
        return int(node)

    def marker(self, place: Place) -> int:
        """In the body's own axes, from its centre of mass."""
        joint, at = place
        x, y, z = at.translation - (self.model.inertias[joint].lever if joint else np.zeros(3))
        marker = items.MarkerBodyPosition(bodyNumber=self.bodies[joint], localPosition=[y, z, x])
        return int(self.mbs.AddMarker(marker))

    def _add_moment(self, nodes: list[int], joint: int, moment: float) -> None:
        if joint:
            marker = self.mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[joint - 1], coordinate=2))
            self.mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=float(moment)))


class KinematicTree(ExudynModel):
    """The scene in the joints' coordinates, one node; Exudyn's links have their axis along z."""

    linear_solver = ("EigenDense", True)  # closures may have a row too many

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        mechanism, model, count = self.mechanism, self.model, self.mechanism.nv
        axes = (np.asarray(joint.axis) for joint in mechanism.joints)
        self._turns = [pin.SE3.Identity(), *map(_from_z, axes)]
        node = self.mbs.AddNode(
            items.NodeGenericODE2(
                numberOfODE2Coordinates=count, referenceCoordinates=[0.0] * count,
                initialCoordinates=scene.q0.tolist(), initialCoordinates_t=scene.v0.tolist(),
            )
        )  # fmt: skip
        turned = list(enumerate(self._turns))[1:]
        carriers = [self._turns[parent].inverse() for parent in self.parents]
        offsets = [carriers[i] * model.jointPlacements[i] * turn for i, turn in turned]
        inertias = [model.inertias[i].se3ActionInverse(turn) for i, turn in turned]
        kinds = {True: exu.JointType.RevoluteZ, False: exu.JointType.PrismaticZ}
        self._tree = self.mbs.AddObject(
            items.ObjectKinematicTree(
                nodeNumber=node,
                gravity=model.gravity.linear.tolist(),
                jointTypes=[kinds[joint.kind is JointKind.REVOLUTE] for joint in mechanism.joints],
                linkParents=[parent - 1 for parent in self.parents[1:]],
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
                    markerNumbers=[one, two], constrainedAxes=rows[closure.kind],
                    rotationMarker0=turn1, rotationMarker1=turn2,
                )
            )  # fmt: skip
        self.finish([node])

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
            marker = items.MarkerBodyRigid(bodyNumber=self.bodies[0], localPosition=at.translation)
        else:
            marker = items.MarkerKinematicTreeRigid(
                objectNumber=self._tree, linkNumber=joint - 1, localPosition=at.translation
            )
        return int(self.mbs.AddMarker(marker)), at.rotation


def _from_z(axis: Array) -> pin.SE3:
    """A rotation that turns z into the axis."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis)
    return pin.SE3(turn.toRotationMatrix(), np.zeros(3))
