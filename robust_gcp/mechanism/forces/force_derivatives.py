"""How springs, dampers and drives change with q and v."""

from __future__ import annotations

import numpy as np

from ..actuation.tendon_springs import TendonSpring
from ..constraint.closures import frame_of
from ..mechanism import Mechanism
from ..tree.columns import Columns
from ..tree.motions import Motions
from ..tree.tree import Array
from .applied_forces import AppliedForces
from .forces import JointDamper, JointSpring, PointSpring, checked_derivatives


class ForceDerivatives:
    """Gᵀ ∂τ/∂q and Gᵀ ∂τ/∂v of all forces.

    Parameters
    ----------
    mechanism : Mechanism
        Whose forces they are.
    applied : AppliedForces
    """

    def __init__(self, mechanism: Mechanism, applied: AppliedForces) -> None:
        tree, forces = mechanism.tree, applied.known
        self._tree, self._own = tree, applied.own
        self._stiffness, self._damping = np.zeros(tree.nv), np.zeros(tree.nv)
        for force in forces:
            if isinstance(force, JointSpring):
                self._stiffness[force.place(mechanism.joints).idx_v] += force.stiffness
            elif isinstance(force, JointDamper):
                self._damping[force.place(mechanism.joints).v] += force.damping
        self._lines = [force for force in forces if isinstance(force, PointSpring)]
        self._mechanism = mechanism
        self._tendons = [force for force in forces if isinstance(force, TendonSpring)]
        if self._lines:
            self._columns = Columns(tree.model, tree.joints)
            frames = [
                [frame_of(tree.model, name, "PointSpring") for name in (line.frame1, line.frame2)]
                for line in self._lines
            ]
            self._joint = np.array([[frame.parentJoint for frame in pair] for pair in frames], dtype=np.int64)
            self._offset = np.array([[frame.placement.translation for frame in pair] for pair in frames])

    def derivatives_at(self, q: Array, v: Array, G: Array) -> tuple[Array, Array]:
        """Gᵀ ∂τ/∂q and Gᵀ ∂τ/∂v, (m, nv) each, along the velocities' components.

        A point spring pulls with T = k (l − l₀) + c l̇ along ∂l/∂q, so
        ∂τ/∂q = −∂l/∂q (k ∂l/∂q + c ∂l̇/∂q)ᵀ − T ∂²l/∂q², and ∂²l/∂q² G_i is ∂l̇/∂q at v = G_i.
        """
        by_q, by_v = -(G.T * self._stiffness), -(G.T * self._damping)
        if self._own is not None:
            own_q, own_v = self._own.derivatives(q, v)
            by_q, by_v = by_q + G.T @ own_q, by_v + G.T @ own_v
        for tendon in self._tendons:
            pulls_q, pulls_v = checked_derivatives(tendon, self._mechanism, q, v)
            by_q, by_v = by_q + G.T @ pulls_q, by_v + G.T @ pulls_v
        if self._lines:
            self._tree.jacobians(q)
            J = self._tree.J.copy()
            p = self._tree.p[self._joint] + np.einsum(
                "nsij,nsj->nsi", self._tree.R[self._joint], self._offset
            )
            k, c, rest = (np.array([getattr(line, name) for line in self._lines]) for name in _NUMBERS)
            length, speed, along, bend = self._lengths(J, p, v)
            tension = k * (length - rest) + c * speed
            for i, direction in enumerate(G.T):
                shorter = along @ direction
                second = self._lengths(J, p, direction)[3]
                by_q[i] -= shorter @ (k[:, None] * along + c[:, None] * bend) + tension @ second
                by_v[i] -= (shorter * c) @ along
        return by_q, by_v

    def _lengths(self, J: Array, p: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """l, l̇ (lines,), ∂l/∂q and ∂l̇/∂q (lines, nv) at the velocity v."""
        motions, part = Motions(self._columns, J, v, np.zeros_like(v)), self._columns.of_joint[self._joint]
        ends = [motions.points(part[:, side], p[:, side]) for side in (0, 1)]
        apart = ends[1] - ends[0]
        length = np.linalg.norm(apart.x, axis=1)
        size = np.where(length > 0.0, length, 1.0)
        u = apart.x / size[:, None]
        turning = (apart.d - u * np.einsum("nx,nx->n", u, apart.d)[:, None]) / size[:, None]
        along = np.einsum("njx,nx->nj", apart.x_q, u)
        bend = np.einsum("njx,nx->nj", apart.d_q, u) + np.einsum("njx,nx->nj", apart.x_q, turning)
        return length, np.einsum("nx,nx->n", u, apart.d), along, bend


_NUMBERS = ("stiffness", "damping", "rest_length")
