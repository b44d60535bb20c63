"""A planar mechanism as Exudyn's rigid bodies in the plane, joined by revolute joints.

Three coordinates a body, about its centre of mass, so that the mass matrix is constant and diagonal. The
plane is the world's y–z plane, Exudyn's x–y plane; x becomes its z, a rotation about +x one about its +z.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...mechanism.tree import Array
from ..contender import Scene
from .exudyn_model import ExudynModel, items
from .parts import Joint, Place, closure_places, constant_torques, joints

ROUNDING = 1e-12


def is_planar(scene: Scene) -> bool:
    """Whether all joints are hinges about the world's +x, and gravity lies in the plane."""
    mechanism = scene.mechanism
    axis = np.array([1.0, 0.0, 0.0])
    return abs(mechanism.model.gravity.linear[0]) < ROUNDING and all(
        joint.hinge
        and np.abs(joint.axis - axis).max() < ROUNDING
        and np.abs(joint.placement.rotation @ axis - axis).max() < ROUNDING
        for joint in joints(mechanism)
    )


class PlanarBodies(ExudynModel):
    """The scene in redundant coordinates; its nodes are the bodies in turn."""

    linear_solver = ("EXUdense", False)

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        mechanism, model = scene.mechanism, scene.mechanism.model
        self._parts = joints(mechanism)
        self._start = scene.q0
        self._parents = [joint.parent for joint in self._parts]
        if len(self._parts) > SPARSE_FROM:
            self.linear_solver = ("EigenSparse", False)
        data = model.createData()
        pin.forwardKinematics(model, data, scene.q0, scene.v0)
        self._bodies = [self.mbs.AddObject(items.ObjectGround())]
        nodes = [
            self._add_body(joint, data.oMi[i], data.v[i], model.gravity.linear)
            for i, joint in enumerate(self._parts, start=1)
        ]
        for i, joint in enumerate(self._parts, start=1):
            self._join((joint.parent, joint.placement), (i, pin.SE3.Identity()))
        for one, two in closure_places(mechanism):
            self._join(one, two)
        for i, torque in enumerate(constant_torques(mechanism), start=1):
            if torque != 0.0:  # on the body, and back on the one that carries it
                self._add_moment(nodes, i, torque)
                self._add_moment(nodes, self._parts[i - 1].parent, -torque)
        self.finish(mechanism, nodes)

    def tree_coordinates(self, stored: list[list[Array]]) -> tuple[Array, Array, Array]:
        """A joint turns by as much as its body turns more than the body that carries it."""
        turned, speed, gain = (
            np.column_stack([np.zeros(len(bodies[0])), *(body[:, 2] for body in bodies)]) for bodies in stored
        )
        q = self._relative(turned)
        return self._start + q - q[0], self._relative(speed), self._relative(gain)

    def _relative(self, absolute: Array) -> Array:
        return absolute[:, 1:] - absolute[:, self._parents]

    def _add_body(self, joint: Joint, place: pin.SE3, motion: pin.Motion, gravity: Array) -> int:
        """A body about its centre of mass; its node."""
        lever = joint.inertia.lever
        centre = place.act(lever)
        velocity = place.rotation @ (motion.linear + np.cross(motion.angular, lever))
        turn = float(pin.log3(place.rotation)[0])
        node = self.mbs.AddNode(
            items.NodeRigidBody2D(
                referenceCoordinates=[centre[1], centre[2], turn],
                initialVelocities=[velocity[1], velocity[2], motion.angular[0]],
            )
        )
        body = self.mbs.AddObject(
            items.ObjectRigidBody2D(
                mass=joint.inertia.mass, inertia=joint.inertia.inertia[0, 0], nodeNumber=node
            )
        )
        self._bodies.append(body)
        if np.any(gravity):
            marker = self.mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
            pull = [gravity[1], gravity[2], 0.0]
            self.mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=pull))
        return int(node)

    def marker(self, place: Place) -> int:
        """In the body's own axes, from its centre of mass."""
        joint, at = place
        centre = self._parts[joint - 1].inertia.lever if joint else np.zeros(3)
        x, y, z = at.translation - centre
        marker = items.MarkerBodyPosition(bodyNumber=self._bodies[joint], localPosition=[y, z, x])
        return int(self.mbs.AddMarker(marker))

    def _join(self, one: Place, two: Place) -> None:
        ends = [self.marker(one), self.marker(two)]
        self.mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends))

    def _add_moment(self, nodes: list[int], joint: int, moment: float) -> None:
        if joint:
            marker = self.mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[joint - 1], coordinate=2))
            self.mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=float(moment)))


SPARSE_FROM = 8
"""Bodies beyond which Exudyn's sparse solver is the faster one."""
