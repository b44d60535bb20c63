"""All forces of a mechanism at once: τ(q, v), potential energy, and power that no potential accounts for."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from ...checks import shown
from ...errors import ModelError, NonFiniteError
from ..actuation.tendon_springs import TendonSpring
from ..tree.tree import Array
from .ball_springs import BallSpring
from .forces import (
    Force,
    JointDamper,
    JointSpring,
    JointTorque,
    PointSpring,
    checked_derivatives,
    checked_energy,
    checked_tau,
    has_energy,
)
from .lifted_weights import GravityCompensation
from .point_springs import Lines

if TYPE_CHECKING:
    from ..mechanism import Mechanism


KINDS: tuple[type[Force], ...] = (JointSpring, JointDamper, JointTorque, PointSpring, TendonSpring)
"""What is known by its numbers."""

STORED: tuple[type[Force], ...] = (*KINDS, BallSpring, GravityCompensation)
"""What files hold: these two are asked, as forces of a user's own are."""


def is_known(force: Force) -> bool:
    """Whether its numbers say all: one of `KINDS`, derived from or not, that does what its kind does."""
    made = type(force)
    kind = next((kind for kind in KINDS if isinstance(force, kind)), None)
    if isinstance(force, TendonSpring) and not force.path.in_kernel:
        return False
    return kind is not None and made.tau is kind.tau and made.energy is kind.energy


def checked_force(force: Any) -> Force:
    """A force, or a ModelError."""
    if isinstance(force, Force):
        return force
    kinds = ", ".join(kind.__name__ for kind in KINDS)
    raise ModelError(f"forces: {shown(force)} is not a {kinds} or another rg.Force")


class AppliedForces:
    """All springs, dampers and drives of a mechanism at once.

    Parameters
    ----------
    mechanism : Mechanism
        On which they act.
    forces : sequence of Force
        At least one.

    Attributes
    ----------
    known : tuple of Force
        Those that are known by their numbers.
    own : OwnForces or None
        Those that say by themselves what they do.
    has_slopes : bool
        Whether the compiled kernel knows the derivatives of all of them.
    works : bool
        Whether something acts that no potential energy accounts for, as a damper or a drive does.

    Raises
    ------
    ModelError
        For a joint or frame that the model does not have, or a joint of the wrong kind.
    """

    def __init__(self, mechanism: Mechanism, forces: Sequence[Force]) -> None:
        self._tree = tree = mechanism.tree
        self._mechanism, nv = mechanism, tree.nv
        forces = [checked_force(f) for f in forces]
        self.known = tuple(f for f in forces if is_known(f))
        own = tuple(f for f in forces if not is_known(f))
        self.own = OwnForces(mechanism, own) if own else None
        springs = [f for f in self.known if isinstance(f, JointSpring)]
        lines = [f for f in self.known if isinstance(f, PointSpring)]

        joints = [f.place(tree.joints) for f in springs]
        self._spring_q = np.array([j.idx_q for j in joints], dtype=np.int64)
        self._spring_v = np.array([j.idx_v for j in joints], dtype=np.int64)
        self._stiffness = np.array([f.stiffness for f in springs])
        self._rest = np.array([f.rest for f in springs])
        self._damping, self._drive = np.zeros(nv), np.zeros(nv)
        for force in self.known:
            if isinstance(force, JointDamper):
                self._damping[force.place(tree.joints).v] += force.damping
            elif isinstance(force, JointTorque):
                self._drive[force.place(tree.joints).v] += force.torque
        self._lines = Lines(tree, lines) if lines else None
        self._tendons = [f for f in self.known if isinstance(f, TendonSpring)]
        for tendon in self._tendons:
            tendon.bound(mechanism)  # refuses what is not there
        self._joint_work = bool(np.any(self._damping) or np.any(self._drive))
        damped = self._lines is not None and self._lines.damped
        damped = damped or any(f.damping for f in self._tendons)
        self.has_slopes = self.own is None and not self._tendons
        self.works = self._joint_work or damped or self.own is not None

    def torque_at(self, q: Array, v: Array) -> tuple[Array, float]:
        """τ (nv,), N m and N, and the power of what no potential energy accounts for, W.

        Raises
        ------
        SimulationError
            Where a point spring has no length, so that its force has no direction.
        """
        tau = np.zeros(self._tree.nv)
        power = 0.0
        if self._joint_work:
            tau = self._drive - self._damping * v
            power = float(tau @ v)  # before springs are added, which have a potential
        if len(self._spring_q):
            pulls = -self._stiffness * (q[self._spring_q] - self._rest)
            tau = tau + np.bincount(self._spring_v, pulls, minlength=len(tau))  # several on a joint add up
        if self._lines is not None:
            line_tau, line_power = self._lines.torque_at(q, v)
            tau, power = tau + line_tau, power + line_power
        for tendon in self._tendons:
            pull, drag = tendon.pulls(self._mechanism, q, v)
            tau, power = tau + pull, power + drag
        if self.own is not None:
            own_tau, stored = self.own.torque_at(q, v)
            # what a potential gives is in the energy already
            tau, power = tau + own_tau, power + float(own_tau @ v) - stored
        return tau, power

    def tau(self, q: Array, v: Array) -> Array:
        """τ(q, v), (nv,), N m and N."""
        return self.torque_at(q, v)[0]

    def derivatives_at(self, q: Array, v: Array, G: Array) -> tuple[Array, Array]:
        """Gᵀ ∂τ/∂q and Gᵀ ∂τ/∂v, (m, nv) each, along the velocities' components.

        Raises
        ------
        ModelError, NonFiniteError
            That names a force whose derivatives are none.
        """
        by_q, by_v = np.zeros(G.T.shape), -(G.T * self._damping)
        for i, iv in enumerate(self._spring_v):
            by_q[:, iv] -= self._stiffness[i] * G[iv]
        if self._lines is not None:
            lines_q, lines_v = self._lines.derivatives_at(q, v, G)
            by_q, by_v = by_q + lines_q, by_v + lines_v
        for force in (*self._tendons, *(() if self.own is None else self.own.forces)):
            own_q, own_v = checked_derivatives(force, self._mechanism, q, v)
            by_q, by_v = by_q + G.T @ own_q, by_v + G.T @ own_v
        return by_q, by_v

    def energy(self, q: Array) -> float:
        """Potential energy, J."""
        energy = 0.0
        if len(self._spring_q):
            energy = 0.5 * float(self._stiffness @ (q[self._spring_q] - self._rest) ** 2)
        if self._lines is not None:
            energy += self._lines.energy(q)
        for tendon in self._tendons:
            energy += tendon.energy(self._mechanism, q)
        return energy if self.own is None else energy + self.own.energy(q)


class OwnForces:
    """Forces that say by themselves what they do, at least one.

    Parameters
    ----------
    mechanism : Mechanism
    forces : sequence of Force
    """

    def __init__(self, mechanism: Mechanism, forces: Sequence[Force]) -> None:
        self._mechanism, self.forces = mechanism, tuple(forces)
        self._still = np.zeros(mechanism.nv)

    def torque_at(self, q: Array, v: Array) -> tuple[Array, float]:
        """τ (nv,), and the power that potential energies give, −Ė, W: that of τ(q, 0) where there is one.

        Raises
        ------
        ModelError, NonFiniteError
            That names a force which returns something else.
        """
        tau, power = np.zeros(len(v)), 0.0
        for force in self.forces:
            tau += checked_tau(force, self._mechanism, q, v)
            if has_energy(force):
                power += float(checked_tau(force, self._mechanism, q, self._still) @ v)
        return tau, power

    def require_sound(self, q: Array) -> None:
        """Refuse what is no τ or energy of this mechanism, by a ModelError: each is asked once, at rest at q.

        Numbers that are not finite there are left to the motions, which may never come there.
        """
        for force in self.forces:
            with suppress(NonFiniteError), np.errstate(all="ignore"):  # home may be a place of no direction
                checked_tau(force, self._mechanism, q, self._still)
                checked_energy(force, self._mechanism, q)

    def energy(self, q: Array) -> float:
        """Potential energy, J."""
        return sum(checked_energy(force, self._mechanism, q) for force in self.forces if has_energy(force))
