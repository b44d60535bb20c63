"""A state in world axes: frames, momenta, what passes through a cut, and drives, as sensors ask for them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ..tree.tree import Array
from ..tree.vectors import cross
from ..tree.workspace import workspace

if TYPE_CHECKING:
    from ..actuation.paths import BoundPath
    from ..mechanism import Mechanism

GROUND = "universe"
"""What Pinocchio calls the joint that carries all that stands still."""

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

Push = tuple[str, int, Array, Array, Array]
"""Frame, number of the joint that carries it, point, force and moment about it, in world axes."""


@dataclass(frozen=True)
class Spot:
    """A frame on a joint's body: position, m, and quaternion (x, y, z, w) on the joint."""

    joint: str = GROUND
    place: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Branch:
    """A body with all that hangs on it, and on bodies fixed to it.

    Attributes
    ----------
    joint : str
        The joint that carries the body.
    inertia : tuple of float (13,), or ()
        Mass, centre (3,) and moments about it (9,) of the bodies fixed together there, on that joint.
    joints : tuple of str
        All that move with the body and hang on it.
    frames : tuple of str or None
        Frames on these bodies; None: all of the joint's.
    """

    joint: str
    inertia: tuple[float, ...]
    joints: tuple[str, ...]
    frames: tuple[str, ...] | None = None


class Instant:
    """Where all bodies of a mechanism are, and how they move, at the state that `move` was given last."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.model = mechanism, mechanism.own_model
        self._data, self.gravity = workspace(self.model), np.array(self.model.gravity.linear)
        self.t, self.q = 0.0, mechanism.home
        self.v: Array = np.zeros(mechanism.nv)
        self._pushes: tuple[Push, ...] = ()
        self.stop = 0.0
        self._u: Array | None = None
        self._tendons: dict[str, BoundPath] = {}

    def move(
        self,
        t: float,
        q: Array,
        v: Array,
        a: Array,
        pushes: Iterable[Push] = (),
        u: Array | None = None,
        stop: float = 0.0,
    ) -> None:
        """Go to a state.

        Parameters
        ----------
        t : float
        q, v, a : ndarray (nq,), (nv,), (nv,)
        pushes : iterable of Push
            What acts on bodies besides gravity and the tree's joints; for `wrench`.
        u : ndarray (n,) or None
            Controls and activations of the actuators; None without power.
        stop : float
            What the stop pushes with that a sensor asks for, N or N m.
        """
        self.t, self.q, self.v, self._pushes = t, q, v, tuple(pushes)
        self._u, self.stop = u, stop
        pin.forwardKinematics(self.model, self._data, q, v, a)

    def placed(self, spot: Spot) -> tuple[int, pin.SE3, pin.SE3]:
        """The joint's number, the frame's place on it, and in the world."""
        joint, place = self.index(spot.joint), pin.XYZQUATToSE3(np.array(spot.place))
        return joint, place, self._data.oMi[joint] * place

    def index(self, joint: str) -> int:
        """Number of a joint; the ground's is 0."""
        return int(self.model.getJointId(joint))

    def velocity(self, spot: Spot) -> tuple[Array, Array]:
        """v and ω of a frame, world axes."""
        joint, place, _ = self.placed(spot)
        found = pin.getFrameVelocity(self.model, self._data, joint, place, AXES)
        return found.linear, found.angular

    def acceleration(self, spot: Spot) -> tuple[Array, Array]:
        """v̇ − gravity, as an accelerometer has it, and ω̇ of a frame, world axes."""
        joint, place, _ = self.placed(spot)
        # a spatial acceleration lacks ω × v, which an accelerometer feels
        found = pin.getFrameClassicalAcceleration(self.model, self._data, joint, place, AXES)
        return found.linear - self.gravity, found.angular  # forward kinematics knows of no gravity

    def bodies(self, branch: Branch) -> Iterator[tuple[pin.SE3, pin.Inertia, pin.Motion, pin.Motion]]:
        """Where each body is, its inertia, velocity and acceleration on itself."""
        data = self._data
        if branch.inertia:
            mass, centre, moments = branch.inertia[0], branch.inertia[1:4], branch.inertia[4:]
            inertia = pin.Inertia(mass, np.array(centre), np.array(moments).reshape(3, 3))
            joint = self.index(branch.joint)
            yield data.oMi[joint], inertia, data.v[joint], data.a[joint]
        for joint in map(self.index, branch.joints):
            yield data.oMi[joint], self.model.inertias[joint], data.v[joint], data.a[joint]

    def centre(self, branch: Branch) -> tuple[float, Array]:
        """Mass and centre of a branch."""
        parts = [(inertia.mass, place.act(inertia.lever)) for place, inertia, _, _ in self.bodies(branch)]
        mass = float(sum(part for part, _ in parts))
        return mass, np.sum([part * at for part, at in parts], axis=0) / mass

    def momentum(self, branch: Branch) -> tuple[float, Array, pin.Force]:
        """Mass, centre, and the momentum about the world's origin."""
        total = pin.Force.Zero()
        for place, inertia, v, _ in self.bodies(branch):
            total += place.act(inertia * v)  # about the world's origin momenta add up
        return *self.centre(branch), total

    def wrench(self, branch: Branch) -> pin.Force:
        """What carries a branch gives to it, about the world's origin: ṗ less gravity and what acts on it."""
        total = pin.Force.Zero()
        for place, inertia, v, a in self.bodies(branch):
            weight = inertia.mass * self.gravity
            total += place.act(inertia * a + inertia.vxiv(v))  # Newton–Euler in the body's axes
            total -= pin.Force(weight, cross(place.act(inertia.lever), weight))
        own, others = self.index(branch.joint), {self.index(joint) for joint in branch.joints}
        for frame, joint, point, force, moment in self._pushes:
            # bodies welded together share a joint, and a cut between them has one side's frames
            if joint in others or (joint == own and (branch.frames is None or frame in branch.frames)):
                total -= pin.Force(force, moment + cross(point, force))
        return total

    def tendon(self, name: str) -> tuple[float, float]:
        """Length and rate of a tendon."""
        tree = self.mechanism.tree
        if name not in self._tendons:
            self._tendons[name] = self.mechanism.tendons[name].on(tree, f"tendon {name!r}")
        tree.jacobians(self.q)
        length, moment = self._tendons[name].length_at(self.q)
        return length, float(moment @ self.v)

    def actuator(self, name: str) -> tuple[float, float, float]:
        """Length, rate and force of an actuator; no force without power."""
        actuators = self.mechanism.actuators
        i = next(i for i, actuator in enumerate(actuators) if actuator.name == name)
        assert self.mechanism.actuation is not None
        forces = self._driven()[0]
        self.mechanism.tree.jacobians(self.q)
        # placed here: without power nobody has
        length, moment = self.mechanism.actuation.paths[i].length_at(self.q)
        gear = actuators[i].gear
        return gear * length, gear * float(moment @ self.v), float(forces[i])

    def driving(self, joint: str) -> float:
        """What all actuators together do on a joint with one number, N or N m."""
        return float(self._driven()[1][self.model.joints[self.index(joint)].idx_v])

    def _driven(self) -> tuple[Array, Array]:
        """Forces of the actuators (n,), and on the joints (nv,)."""
        actuation = self.mechanism.actuation
        if actuation is None or self._u is None:
            return np.zeros(len(self.mechanism.actuators)), np.zeros(self.model.nv)
        return actuation.forces_at(self.q, self.v, self._u)
