"""Forces: what acts on a mechanism besides gravity and the torques of a simulation.

A kind of force is a class that says its torque, and its potential energy where it has one; see `Force`. Those
of `applied_forces.KINDS` are also known by their numbers to `AppliedForces` and to the compiled kernel, which
asks all others for their torque at each evaluation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_number, check_text, listed, shown
from ...errors import ModelError, OptionError
from ...user_functions import returned
from ..constraint.closures import Closure
from ..differences import torque_differences
from ..tree.joints import Joint, joint_named, single_joint
from ..tree.tree import Array
from .point_springs import Lines

if TYPE_CHECKING:
    from ..mechanism import Mechanism

Vector = NDArray[np.float64]

INSTEAD = "or use a PointSpring"


class Force(ABC):
    """What acts on a mechanism besides gravity: τ(q, v), from a potential or not.

    A force of your own is a class derived from this one, best a frozen dataclass, with `tau`, with `energy`
    where it has one, and with `derivatives` where differences of `tau` are not wanted. All three depend on
    their arguments alone: they are asked at any state, in any order.
    """

    @abstractmethod
    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> ArrayLike:
        """τ(q, v), (nv,), N m and N.

        Parameters
        ----------
        mechanism : Mechanism
            On which it acts: `mechanism.joint("q1")` has `idx_q`, `idx_v` and `v`, its places in q and v.
        q, v : ndarray (nq,), (nv,)
        """

    def energy(self, mechanism: Mechanism, q: Vector) -> float:
        """Potential energy, J.

        Where a class has one, tau at v = 0 is its negative gradient, and only what v adds to that does work.
        Where it has none, all that tau does is work: see `Trajectory.energy_error`.
        """
        return 0.0

    def derivatives(self, mechanism: Mechanism, q: Vector, v: Vector) -> tuple[ArrayLike, ArrayLike]:
        """∂τ/∂q and ∂τ/∂v, (nv, nv) each, q along the velocities' components; by central differences."""

        def tau(q: Array, v: Array) -> Array:
            return checked_tau(self, mechanism, q, v)

        return torque_differences(mechanism.tree, mechanism.units, tau, q, v)


@dataclass(frozen=True)
class JointSpring(Force):
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
        require_number(label, "stiffness", self.stiffness, positive=True)
        require_number(label, "rest", self.rest)

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> Array:
        """τ(q), (nv,)."""
        joint = self.place(mechanism.joints)
        return _only(mechanism.nv, joint, -self.stiffness * (q[joint.idx_q] - self.rest))

    def energy(self, mechanism: Mechanism, q: Vector) -> float:
        """½ stiffness (q − rest)², J."""
        return 0.5 * self.stiffness * float(q[self.place(mechanism.joints).idx_q] - self.rest) ** 2

    def place(self, joints: Sequence[Joint]) -> Joint:
        """The joint that it acts on, or a ModelError."""
        return single_joint(joints, self.joint, "JointSpring", INSTEAD)


@dataclass(frozen=True)
class JointDamper(Force):
    """τ = −damping v on every velocity of a joint, N m s/rad or N s/m."""

    joint: str
    damping: float

    def __post_init__(self) -> None:
        check_text("JointDamper: joint", self.joint)
        require_number(f"JointDamper on {self.joint!r}", "damping", self.damping, positive=True)

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> Array:
        """τ(v), (nv,)."""
        joint = self.place(mechanism.joints)
        return _only(mechanism.nv, joint, -self.damping * v[joint.v])

    def place(self, joints: Sequence[Joint]) -> Joint:
        """The joint that it acts on, or a ModelError."""
        return joint_named(joints, self.joint, "JointDamper")


@dataclass(frozen=True)
class JointTorque(Force):
    """A constant drive on a joint with one velocity, N m or N."""

    joint: str
    torque: float

    def __post_init__(self) -> None:
        check_text("JointTorque: joint", self.joint)
        require_number(f"JointTorque on {self.joint!r}", "torque", self.torque)

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> Array:
        """τ, (nv,)."""
        return _only(mechanism.nv, self.place(mechanism.joints), self.torque)

    def place(self, joints: Sequence[Joint]) -> Joint:
        """The joint that it acts on, or a ModelError."""
        return single_joint(joints, self.joint, "JointTorque", INSTEAD)


@dataclass(frozen=True)
class PointSpring(Force):
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
            require_number(label, field, getattr(self, field), positive=True)

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> Array:
        """τ(q, v), (nv,)."""
        return Lines(mechanism.tree, (self,)).torque_at(q, v)[0]

    def energy(self, mechanism: Mechanism, q: Vector) -> float:
        """½ stiffness (l − rest_length)², J."""
        return Lines(mechanism.tree, (self,)).energy(q)


def has_energy(force: Force) -> bool:
    """Whether its class says a potential energy."""
    return type(force).energy is not Force.energy


def forces_given(forces: Any) -> list[Any]:
    """A list of forces, or a ModelError."""
    return listed(forces, "forces", "forces, such as JointSpring(joint, stiffness)", kind=Force)


# What a user's force does to its arguments must not reach the state of the run.
def checked_tau(force: Force, mechanism: Mechanism, q: Array, v: Array) -> Array:
    """What a force says as its τ, (nv,), handed copies of the state."""
    return _checked(force.tau(mechanism, q.astype(float), v.astype(float)), (mechanism.nv,), force, "tau")


def checked_energy(force: Force, mechanism: Mechanism, q: Array) -> float:
    """What a force says as its energy, J."""
    return float(_checked(force.energy(mechanism, q.astype(float)), (), force, "energy"))


def checked_derivatives(force: Force, mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """What a force says as its derivatives, (nv, nv) each."""
    square = (2, mechanism.nv, mechanism.nv)
    by_q, by_v = _checked(
        force.derivatives(mechanism, q.astype(float), v.astype(float)), square, force, "derivatives"
    )
    return by_q, by_v


def _checked(given: Any, shape: tuple[int, ...], force: Force, what: str) -> Array:
    """A finite array of this shape, or an error that names the force."""
    return returned(given, shape, f"{shown(force)}: {what}", ModelError)


def _only(nv: int, joint: Joint, torque: Any) -> Array:
    """τ (nv,) that acts on one joint alone."""
    tau = np.zeros(nv)
    tau[joint.v] = torque
    return tau


def require_length(forces: Sequence[Force], closures: Sequence[Any]) -> None:
    """Refuse point springs between points that a closure holds together: their direction is rounding."""
    held = {
        frozenset((closure.frame1, closure.frame2))
        for closure in closures
        if isinstance(closure, Closure) and closure.joins
    }
    for force in forces:
        # without these the force is linear in the vector between the points and vanishes with it
        if not isinstance(force, PointSpring) or not (force.rest_length or force.damping):
            continue
        if frozenset((force.frame1, force.frame2)) in held:
            raise ModelError(
                f"the point spring {force.frame1} – {force.frame2} is between points that a closure holds "
                "together, where it has no length and no direction; leave it out, or move one of its frames"
            )


def require_number(label: str, field: str, value: object, positive: bool = False) -> None:
    """A finite number, not negative where `positive` says so, or a ModelError by `label`."""
    try:
        check_number(field, value)
    except OptionError as error:
        raise ModelError(f"{label}: {field} is {shown(value)}; give a number") from error
    assert isinstance(value, int | float | np.number)
    if not np.isfinite(float(value)):
        raise ModelError(f"{label}: {field} is {value}; give a finite number")
    if positive and value < 0.0:
        raise ModelError(f"{label}: {field} is {value}; give zero or a positive number")
