"""Point springs all at once: τ(q, v) and its derivatives, the power of dampers, potential energy."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...errors import SimulationError
from ..frames import place_of
from ..tree.columns import Columns
from ..tree.joints import carrying
from ..tree.motions import Motions
from ..tree.tree import Array, Tree
from ..tree.vectors import cross

if TYPE_CHECKING:
    from .forces import PointSpring


class Lines:
    """All point springs: the length l along the unit vector u from point 1 to point 2.

    dl = (u, p₁ × u) · (V₂ − V₁) with V the bodies' spatial velocities at the world's origin: one
    wrench serves both bodies, and the joints that carry both drop out.
    """

    def __init__(self, tree: Tree, springs: Sequence[PointSpring]) -> None:
        self._tree = tree
        self._labels = [f"{s.frame1} – {s.frame2}" for s in springs]
        pairs = zip(self._labels, springs, strict=True)
        ends = [[place_of(tree.model, f, f"PointSpring {n}") for f in (s.frame1, s.frame2)] for n, s in pairs]
        self._joint = np.array([[joint for joint, _ in pair] for pair in ends], dtype=np.int64).T
        self._offset = np.array([[place.translation for _, place in pair] for pair in ends]).swapaxes(0, 1)
        self._stiffness = np.array([s.stiffness for s in springs])
        self._rest = np.array([s.rest_length for s in springs])
        self._damping = np.array([s.damping for s in springs])
        self.damped = bool(np.any(self._damping))
        ends_carried = [[carrying(tree.model, joint) for joint in end] for end in self._joint.tolist()]
        self._sign: Array = np.array(ends_carried[1]) - np.array(ends_carried[0])  # 0: carries both or none

    def _ends(self, q: Array) -> tuple[Array, Array]:
        """Point 1 of each spring and the vector to its point 2, world axes."""
        tree = self._tree
        tree.jacobians(q)
        p = tree.p[self._joint] + (tree.R[self._joint] @ self._offset[..., None])[..., 0]
        return p[0], p[1] - p[0]

    def torque_at(self, q: Array, v: Array) -> tuple[Array, float]:
        """τ (nv,) and the power of the dampers."""
        _, _, rate, tension, power = self._pulling(q, v)
        return -tension @ rate, power

    def pulls(self, q: Array, v: Array) -> list[tuple[int, Array, Array]]:
        """The forces on bodies: joint that carries it (0: the ground), point and force (3,) in world axes."""
        start, u, _, tension, _ = self._pulling(q, v)
        points = start, start + self._ends(q)[1]
        return [
            (int(self._joint[end, i]), points[end][i], sign * tension[i] * u[i])
            for i in range(len(tension))
            for end, sign in ((0, 1.0), (1, -1.0))
        ]

    def _pulling(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array, float]:
        """Point 1, u, ∂l/∂q (nv,) and tension of each, and the power of the dampers."""
        start, along = self._ends(q)
        length = np.linalg.norm(along, axis=1)
        if not length.all():
            self._require_direction(length)
            length = np.where(length > 0.0, length, 1.0)  # no rest length: the force vanishes
        u = along / length[:, None]
        wrench = np.hstack([u, cross(start, u)])
        rate = (wrench @ self._tree.J.T) * self._sign
        tension = self._stiffness * (np.linalg.norm(along, axis=1) - self._rest)  # not `length`: 1 for 0
        power = 0.0
        if self.damped:
            speed = rate @ v
            drag = self._damping * speed
            tension = tension + drag
            power = -float(drag @ speed)
        return start, u, rate, tension, power

    def derivatives_at(self, q: Array, v: Array, G: Array) -> tuple[Array, Array]:
        """Gᵀ ∂τ/∂q and Gᵀ ∂τ/∂v, (m, nv) each, along the velocities' components.

        A spring pulls with T = k (l − l₀) + c l̇ along ∂l/∂q, so
        ∂τ/∂q = −∂l/∂q (k ∂l/∂q + c ∂l̇/∂q)ᵀ − T ∂²l/∂q², and ∂²l/∂q² G_i is ∂l̇/∂q at v = G_i.
        """
        tree, k, c = self._tree, self._stiffness, self._damping
        start, apart = self._ends(q)
        p, J = np.array([start, start + apart]), tree.J.copy()
        length, speed, along, bend = self._lengths(J, p, v)
        tension = k * (length - self._rest) + c * speed
        by_q, by_v = np.empty((2, *G.T.shape))
        for i, direction in enumerate(G.T):
            shorter = along @ direction
            second = self._lengths(J, p, direction)[3]
            by_q[i] = -shorter @ (k[:, None] * along + c[:, None] * bend) - tension @ second
            by_v[i] = -(shorter * c) @ along
        return by_q, by_v

    @cached_property
    def _columns(self) -> Columns:
        return Columns(self._tree.model, self._tree.joints)

    def _lengths(self, J: Array, p: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """l, l̇ (springs,), ∂l/∂q and ∂l̇/∂q (springs, nv) at the velocity v."""
        motions, part = Motions(self._columns, J, v, np.zeros_like(v)), self._columns.of_joint[self._joint]
        apart = motions.points(part[1], p[1]) - motions.points(part[0], p[0])
        length = np.linalg.norm(apart.x, axis=1)
        size = np.where(length > 0.0, length, 1.0)
        u = apart.x / size[:, None]
        turning = (apart.d - u * np.einsum("nx,nx->n", u, apart.d)[:, None]) / size[:, None]  # u̇, across u
        along = np.einsum("njx,nx->nj", apart.x_q, u)
        bend = np.einsum("njx,nx->nj", apart.d_q, u) + np.einsum("njx,nx->nj", apart.x_q, turning)
        return length, np.einsum("nx,nx->n", u, apart.d), along, bend

    def energy(self, q: Array) -> float:
        """Potential energy, J."""
        stretch = np.linalg.norm(self._ends(q)[1], axis=1) - self._rest
        return 0.5 * float(self._stiffness @ stretch**2)

    def _require_direction(self, length: Array) -> None:
        lost = np.flatnonzero((length == 0.0) & ((self._rest > 0.0) | (self._damping > 0.0)))
        if len(lost):
            raise SimulationError(
                f"the point spring {self._labels[lost[0]]} has shrunk to a point, where its force has "
                "no direction; move one of its frames off the other's path, or give it "
                "rest_length = 0 and damping = 0"
            )
