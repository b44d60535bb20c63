"""Constraint forces by name: what each row of λ is, and the force and moment in each joint.

λ belongs to the rows of φ, which acts on the joints as Kᵀ λ. With φ = p₁ − p₂ in world axes, the three
position rows of a closure are the force, in world axes, that the body of its first frame receives at the cut
point from the body of its second frame; the second body receives the opposite. A row n · (p₁ − p₂) gives
the force λ n at p₁ to the first body, the opposite there to the second. A rotation row
Σ w (u · n) gives the first body the moment λ Σ w (u × n), the second the opposite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...checks import shown
from ...dynamics.equations import UNBALANCED_WORDS, constraint_forces
from ...dynamics.loads import Wrench, wrench_of
from ...errors import OptionError
from ...kernel.dynamics.measures import reactions
from ...maps.classical import SingularityWarning
from ...mechanism.actuation.paths import BoundPath
from ...mechanism.actuation.tendon_springs import TendonSpring
from ...mechanism.constraint.closures import Closure
from ...mechanism.constraint.rows import ALONG, ROTATION, Row, rows_of
from ...mechanism.forces.forces import PointSpring
from ...mechanism.forces.lifted_weights import GravityCompensation
from ...mechanism.forces.point_springs import Lines
from ...mechanism.frames import place_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.sensing.instant import Push
from ...mechanism.tree.tree import Array
from ...mechanism.tree.workspace import workspace
from ...warning import warn


def multipliers_of(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None) -> Array:
    """λ (N, nc) of each state: by the kernel where it is there, else by `constraint_forces`.

    NaN, with a warning, where nothing balances the motion.
    """
    found = reactions(mechanism, q, v, a, tau)
    if found is None:
        every = [None] * len(q) if tau is None else tau
        states = zip(q, v, a, every, strict=True)
        found = np.array([constraint_forces(mechanism, *state) for state in states])
        return found.reshape(len(q), mechanism.nc)
    if np.isnan(found).any():
        warn(UNBALANCED_WORDS, SingularityWarning)
    return found


def row_names(mechanism: Mechanism) -> list[str]:
    """A name for each row of φ and each constraint force, (nc,): "frame1-frame2.y", "….rx", "….r1".

    x, y, z: position rows, along the world's axes; n1, n2: those of a `PrismaticClosure`, across its axis;
    rx, ry, rz: rotation rows of a `FrameClosure`, about the axes of its second frame where the loop is
    closed; r1, r2: the two of a `RevoluteClosure`. The second of
    two closures between the same frames is called "frame1-frame2#2". The row of a coupling is called by its
    joints, "joint1-joint2"; its λ is the torque or force on the first.
    """
    labels: list[str] = []
    for closure in mechanism.loops:
        label = f"{closure.frame1}-{closure.frame2}"
        again = sum(other.partition("#")[0] == label for other in labels)
        labels.append(f"{label}#{again + 1}" if again else label)
    names = [f"{labels[row.closure]}.{row.name}" for row in _rows(mechanism)]
    coupled = mechanism.implicit.labels[len(names) :]
    return [*names, *(label.replace(" – ", "-") for label in coupled)]


def _rows(mechanism: Mechanism) -> list[Row]:
    """Each row of φ that belongs to a loop; those of couplings come after."""
    full = rows_of(mechanism.loops)
    return [full[row] for row in mechanism.implicit.rows if row < len(full)]


@dataclass(frozen=True, eq=False)
class Reaction:
    """What a joint transmits, N times, or once (then without the first dimension).

    Attributes
    ----------
    joint : closure or str
        A closed loop's cut joint, or a joint of the tree by its name.
    force : ndarray (N, 3)
        World axes, N. In a cut joint: on the body of frame1, at that frame, from the body of frame2. In a
        joint of the tree: on the body that it moves, at the joint, from the body that carries it; what the
        joint's own springs, motors and friction do is part of it.
        Zero along axes whose row of φ is zero in every configuration, as across the plane of a planar
        mechanism: what acts there, rigid bodies do not determine.
    moment : ndarray (N, 3)
        Likewise, N m.
    """

    joint: Closure | str
    force: Array
    moment: Array

    @property
    def closure(self) -> Closure | None:
        """The closed loop's cut joint, where it is one."""
        return None if isinstance(self.joint, str) else self.joint

    def at(self, i: int) -> Reaction:
        """The i-th of them."""
        return Reaction(self.joint, self.force[i], self.moment[i])


@dataclass(frozen=True, eq=False)
class Loaded:
    """States, and what acts at them, from which the forces in joints follow.

    Attributes
    ----------
    mechanism : Mechanism
    t, q, v : ndarray (N,), (N, nq), (N, nv)
    accelerations : callable () -> ndarray (N, nv)
    multipliers : ndarray (N, nc) or None
    wrenches : sequence of Wrench or None
        None where they are not known any more.
    u : ndarray (N, n) or None
        Of the actuators; None without power.
    data : pin.Data or None
        Workspace; one of its own where it is left out.
    stops : mapping of str to ndarray (N,) or None
        What stops, friction and locks do, by the columns of a run; None where it is not known.
    """

    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    accelerations: Callable[[], Array]
    multipliers: Array | None
    wrenches: Sequence[Wrench] | None = ()
    u: Array | None = None
    data: pin.Data | None = None
    stops: Mapping[str, Array] | None = None

    def reaction(self, name: str | int) -> Reaction:
        """Force and moment in a joint of the tree, or in a cut joint; see `Trajectory.reaction`."""
        mechanism = self.mechanism
        cut = {frame for closure in mechanism.loops for frame in (closure.frame1, closure.frame2)}
        if isinstance(name, str) and name in mechanism.joint_names and name not in cut:
            return self._in_tree(name)
        return self._in_cut(closure_number(mechanism, name))

    def _in_cut(self, number: int) -> Reaction:
        mechanism, q = self.mechanism, self.q
        if self.multipliers is None:
            raise OptionError('constraint forces were not recorded; simulate with record=("multipliers",)')
        closure, tree, multipliers = mechanism.loops[number], mechanism.tree, self.multipliers
        force, moment = np.zeros((len(q), 3)), np.zeros((len(q), 3))
        own = [(i, row) for i, row in enumerate(_rows(mechanism)) if row.closure == number]
        for i, row in own:
            if row.axis >= 0:
                force[:, row.axis] = multipliers[:, i]
        turning = [(i, row) for i, row in own if row.axis < 0]
        for at in range(len(q) if turning else 0):
            tree.jacobians(q[at])  # of which frame_R is then
            first, second = tree.frame_R[number], tree.frame_R[len(mechanism.loops) + number]
            for i, row in turning:
                for weight, u, n in row.terms:
                    if row.axis == ALONG:
                        force[at] += multipliers[at, i] * (second @ n)
                    elif row.axis == ROTATION:
                        moment[at] += multipliers[at, i] * weight * np.cross(first @ u, second @ n)
        return Reaction(closure, force, moment)

    def _in_tree(self, name: str) -> Reaction:
        local, turned = self.in_joints([name])
        world = np.einsum("nij,nbj->nbi", turned[:, 0], local[:, 0].reshape(-1, 2, 3))
        return Reaction(name, world[:, 0], world[:, 1])

    def in_joints(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Force and moment (N, k, 6) in joints of the tree, each in its own frame, and its R (N, k, 3, 3).

        By the recursive Newton–Euler algorithm, with all that acts on bodies from elsewhere.
        """
        model = self.mechanism.own_model
        data, joints = self._workspace(), [model.getJointId(name) for name in names]
        local, turned = np.empty((len(self.q), len(names), 6)), np.empty((len(self.q), len(names), 3, 3))
        pushes = self.pushes()
        for i, (q, v, a) in enumerate(zip(self.q, self.v, self.accelerations(), strict=True)):
            pin.forwardKinematics(model, data, q)
            outer = [pin.Force.Zero() for _ in range(model.njoints)]
            # Pinocchio takes outer forces about the joint's origin, in its axes
            for _, carrier, point, own, about in pushes(i):
                outer[carrier] += data.oMi[carrier].actInv(pin.Force(own, about + pin.skew(point) @ own))
            pin.rnea(model, data, q, v, a, pin.StdVec_Force(outer))
            for k, joint in enumerate(joints):
                local[i, k], turned[i, k] = data.f[joint].vector, data.oMi[joint].rotation
        return local, turned

    def _workspace(self) -> pin.Data:
        return workspace(self.mechanism.own_model) if self.data is None else self.data

    def pushes(self) -> Callable[[int], list[Push]]:
        """What acts on bodies besides gravity and the tree's joints, by the number of the state.

        Raises
        ------
        OptionError
            Where constraint forces were not recorded, or wrenches are not known any more.
        """
        model, loops = self.mechanism.own_model, self.mechanism.loops
        data = self._workspace()
        cuts = [self._in_cut(i) for i in range(len(loops))]
        if self.wrenches is None:
            raise OptionError(
                "reaction: wrenches acted on this motion, and its file or pickle holds none; ask the "
                "trajectory that was simulated"
            )
        ends = [[(frame, *place_of(model, frame)) for frame in (c.frame1, c.frame2)] for c in loops]

        def at(i: int) -> list[Push]:
            pin.forwardKinematics(model, data, self.q[i])
            u = None if self.u is None else self.u[i]
            acting = [
                *self._acting(float(self.t[i]), self.q[i], self.v[i]),
                *self._pulling(self.q[i], self.v[i], u),
            ]
            for cut, both in zip(cuts, ends, strict=True):
                for (frame, carrier, place), sign in zip(both, (1.0, -1.0), strict=True):
                    point = (data.oMi[carrier] * place).translation
                    acting.append((frame, carrier, point, sign * cut.force[i], sign * cut.moment[i]))
            return acting

        return at

    def _acting(self, t: float, q: Array, v: Array) -> Iterator[Push]:
        """Wrenches and springs between points."""
        mechanism, none = self.mechanism, np.zeros(3)
        for wrench in self.wrenches or ():
            yield wrench.frame, *wrench_of(mechanism, wrench, t, q, v)
        springs = [force for force in mechanism.forces if isinstance(force, PointSpring)]
        if springs:
            ends = [frame for spring in springs for frame in (spring.frame1, spring.frame2)]
            pulls = Lines(mechanism.tree, springs).pulls(q, v)
            for frame, (carrier, point, pull) in zip(ends, pulls, strict=True):
                # the tree counts places from there, so that no distance of the mechanism costs digits
                yield frame, carrier, point + mechanism.standpoint, pull, none
        for force in mechanism.forces:
            if isinstance(force, GravityCompensation):
                for frame, carrier, point, lift in force.pulls(mechanism, self._workspace()):
                    yield frame, carrier, point, lift, none

    def _pulling(self, q: Array, v: Array, u: Array | None) -> Iterator[Push]:
        """Springs along tendons, and of actuators on tendons and sites."""
        mechanism, found = self.mechanism, list[tuple[float, BoundPath]]()
        for spring in mechanism.forces:
            if isinstance(spring, TendonSpring):
                found.append((spring.force(mechanism, q, v), spring.bound(mechanism)))
        if u is not None and mechanism.actuation is not None:
            actuation = mechanism.actuation
            forces = actuation.forces_at(q, v, u)[0]
            for actuator, path, force in zip(
                actuation.actuators, actuation.paths, forces.tolist(), strict=True
            ):
                found.append((actuator.gear * force, path))
        if found:
            mechanism.tree.jacobians(q)
        for force, path in found:
            for frame, carrier, point, push, moment in path.loads():
                yield frame, carrier, point + mechanism.standpoint, force * push, force * moment


def closure_number(mechanism: Mechanism, name: str | int) -> int:
    """Which closure is meant: its number, or a frame of it, or both as "frame1-frame2".

    Raises
    ------
    OptionError
        For none or several.
    """
    closures = mechanism.loops
    if isinstance(name, int | np.integer) and not isinstance(name, bool) and 0 <= name < len(closures):
        return int(name)
    names = [{c.frame1, c.frame2, f"{c.frame1}-{c.frame2}", f"{c.frame1} – {c.frame2}"} for c in closures]
    found = [i for i, known in enumerate(names) if isinstance(name, str) and name in known]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{i}: {c.frame1}-{c.frame2}" for i, c in enumerate(closures)) or "none"
    raise OptionError(
        f"closure {shown(name)} is {'not one' if found else 'none'} of this mechanism's, {listed}, nor a "
        f"joint of its tree, {', '.join(mechanism.joint_names)}"
    )
