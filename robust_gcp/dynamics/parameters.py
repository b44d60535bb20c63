"""Named parameters of a mechanism, and how u̇ changes with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ..checks import hint, listed, shown
from ..errors import OptionError
from ..mechanism.forces.forces import JointDamper, JointSpring, PointSpring
from ..mechanism.forces.lifted_weights import GravityCompensation
from ..mechanism.forces.point_springs import Lines
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import OF_MOMENTS, in_v
from ..mechanism.tree.tree import Array
from ..mechanism.tree.workspace import workspace
from .derivatives import Derivatives
from .equations import Evaluation
from .regressor import OF_A_BODY, torque_regressor

AXES = ("x", "y", "z")

OWN = ("mass", *(f"com.{axis}" for axis in AXES))
"""Of a body by itself: its mass, kg, about its own centre; where that is, m."""


Numbered = JointSpring | JointDamper | PointSpring

NUMBERS: dict[type, tuple[str, ...]] = {
    JointSpring: ("stiffness", "rest"),
    JointDamper: ("damping",),
    PointSpring: ("stiffness", "rest_length", "damping"),
}
"""Of forces, by name."""


class Parameters:
    """Some parameters of a mechanism by name.

    `joint.m`, `joint.mx`, …, `joint.Izz` and `joint.armature` as in `Regressor`: one changes, the others of
    the ten are held. `joint.mass`: of the body on a joint, its centre and its moments about that held;
    `joint.com.x`, `.y`, `.z`: its centre in the joint's frame, its mass and moments about it held.
    `gravity.x`, `.y`, `.z`, m/s². `joint.stiffness` and `joint.rest` of a joint's spring, `joint.damping` of
    its damper; `frame1-frame2.stiffness`, `.rest_length` and `.damping` of a spring between points.

    Parameters
    ----------
    mechanism : Mechanism
    names : sequence of str

    Attributes
    ----------
    bodies : list of (int, int, ndarray (10,))
        Which parameter it is, whose body, and how that one's ten change with it.
    armature, gravity : list of (int, int)
        Which parameter it is, of which velocity or along which axis.
    forces : list of (int, (str, force))

    Raises
    ------
    OptionError
        For a name that is none, with near ones.
    """

    def __init__(self, mechanism: Mechanism, names: Sequence[str]) -> None:
        self._mechanism = mechanism
        self.names = tuple(listed(names, "parameters", "names such as 'q1.m'", OptionError))
        bodies = {
            f"{joint.name}.{short}": (i, short)
            for i, joint in enumerate(mechanism.joints)
            for short in (*OF_A_BODY, *OWN)
        }
        armature = {f"{component.name}.armature": k for k, component in enumerate(in_v(mechanism.joints))}
        gravity = {f"gravity.{axis}": k for k, axis in enumerate(AXES)}
        forces = _forces(mechanism)
        for name in self.names:
            if not isinstance(name, str) or not any(name in of for of in (bodies, armature, gravity, forces)):
                known = [*bodies, *armature, *gravity, *forces]
                raise OptionError(
                    f"parameters: {shown(name)} is none{hint(str(name), known)}; they are called joint.mass, "
                    "joint.com.x, joint.m, joint.mx, …, joint.Izz, joint.armature, joint.stiffness, "
                    "joint.rest, joint.damping, frame1-frame2.stiffness, gravity.x, joint.placement.x"
                )
        placed = list(enumerate(self.names))
        self.bodies = [(i, bodies[n][0], self._share(*bodies[n])) for i, n in placed if n in bodies]
        self.armature = [(i, armature[n]) for i, n in placed if n in armature]
        self.gravity = [(i, gravity[n]) for i, n in placed if n in gravity]
        self.forces = [(i, forces[n]) for i, n in placed if n in forces]

    def _share(self, joint: int, short: str) -> Array:
        """How a body's ten parameters change with one that is named, (10,)."""
        if short in OF_A_BODY:
            return np.eye(10)[OF_A_BODY.index(short)]
        inertia = self._mechanism.own_model.inertias[self._mechanism.joints[joint].index]
        at, mass = np.asarray(inertia.lever), inertia.mass
        if short == "mass":
            change, moments = at, at @ at * np.eye(3) - np.outer(at, at)  # Steiner's
            return np.concatenate([[1.0], change, _six(moments)])
        move = np.eye(3)[AXES.index(short[-1])]
        moments = mass * (2.0 * at @ move * np.eye(3) - np.outer(at, move) - np.outer(move, at))
        return np.concatenate([[0.0], mass * move, _six(moments)])

    def slopes(self, now: Evaluation, found: Derivatives) -> Array:
        """∂u̇/∂p, (m, parameters), of a stage: `torques` lifted by (Gᵀ M G)⁻¹ Gᵀ."""
        G, point = found.G, now.point
        return found.da_dtau @ self.torques(point.q, G @ point.ydot, G @ now.ydd + point.g)

    def torques(self, q: Array, v: Array, a: Array) -> Array:
        """∂(τ − M a − C)/∂p at a state and its accelerations, (nv, parameters)."""
        mechanism = self._mechanism
        moved = np.zeros((mechanism.nv, len(self.names)))
        if self.bodies:
            Y = torque_regressor(mechanism).matrix_at(q, v, a)
            for i, joint, share in self.bodies:
                moved[:, i] = -Y[:, 10 * joint : 10 * joint + 10] @ share
        for i, k in self.armature:
            moved[k, i] = -a[k]
        for i, k in self.gravity:
            lifts = (lift.along(mechanism, q, k) for lift in lifts_of(mechanism))
            moved[:, i] = sum(lifts, -_weight(mechanism, q, k))
        for i, (what, force) in self.forces:
            at, by = torques_by(mechanism, what, force, q[None], v[None])
            moved[at, i] = by[0]
        return moved


def _six(moments: Array) -> Array:
    """Second moments of their matrix."""
    return np.array([moments[at] for at in OF_MOMENTS])


def _weight(mechanism: Mechanism, q: Array, axis: int) -> Array:
    """∂C/∂g along an axis of the world, (nv,)."""

    def made() -> pin.Model:
        model = mechanism.near.copy()
        model.gravity.linear = np.eye(3)[axis]
        return model

    model: pin.Model = mechanism.memo.once(("gravity along", axis), made)
    return np.array(pin.computeGeneralizedGravity(model, workspace(model), q))


def lifts_of(mechanism: Mechanism) -> list[GravityCompensation]:
    """What of the forces changes with gravity."""
    return [force for force in mechanism.forces if isinstance(force, GravityCompensation)]


def torques_by(mechanism: Mechanism, what: str, force: Numbered, q: Array, v: Array) -> tuple[slice, Array]:
    """Which torques a force's number moves, and ∂τ/∂p of these at states, (N, …)."""
    if isinstance(force, PointSpring):
        parts = [(sign, Lines(mechanism.tree, [spring])) for sign, spring in _differences(force, what)]
        states = list(zip(q, v, strict=True))
        return slice(None), np.array(
            [sum(sign * lines.torque_at(*at)[0] for sign, lines in parts) for at in states]
        )
    joint = force.place(mechanism.joints)
    if isinstance(force, JointDamper):
        return joint.v, -v[:, joint.v]
    at = slice(joint.idx_v, joint.idx_v + 1)
    if what == "stiffness":
        return at, force.rest - q[:, joint.idx_q, None]
    return at, np.full((len(q), 1), force.stiffness)


def _differences(spring: PointSpring, what: str) -> list[tuple[float, PointSpring]]:
    """Springs whose sum is ∂τ/∂p of this one: τ is linear in each of its numbers."""
    ends, rest = (spring.frame1, spring.frame2), spring.rest_length
    if what == "stiffness":
        return [(1.0, PointSpring(*ends, 1.0, rest))]
    if what == "damping":
        return [(1.0, PointSpring(*ends, 0.0, 0.0, 1.0))]
    stiffness = spring.stiffness
    return [(1.0, PointSpring(*ends, stiffness, rest + 1.0)), (-1.0, PointSpring(*ends, stiffness, rest))]


def _forces(mechanism: Mechanism) -> dict[str, tuple[str, Numbered]]:
    """Springs and dampers by the names of their numbers; where there are several of a kind they have none."""
    found: dict[str, tuple[str, Numbered]] = {}
    twice: set[str] = set()
    for force in () if mechanism.applied is None else mechanism.applied.known:
        if not isinstance(force, Numbered):
            continue
        of = f"{force.frame1}-{force.frame2}" if isinstance(force, PointSpring) else force.joint
        for what in NUMBERS[type(force)]:
            name = f"{of}.{what}"
            twice |= {name} & set(found)
            found[name] = what, force
    return {name: entry for name, entry in found.items() if name not in twice}
