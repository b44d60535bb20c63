"""Point springs all at once: τ(q, v), the power of their dampers and their potential energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ...errors import SimulationError
from ..constraint.closures import frame_of
from ..tree.joints import support
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
        ends = [
            [_frame(tree.model, s.frame1, s) for s in springs],
            [_frame(tree.model, s.frame2, s) for s in springs],
        ]
        self._labels = [f"{s.frame1} – {s.frame2}" for s in springs]
        self._joint = np.array([[int(f.parentJoint) for f in end] for end in ends], dtype=np.int64)
        self._offset = np.array([[f.placement.translation for f in end] for end in ends])
        self._stiffness = np.array([s.stiffness for s in springs])
        self._rest = np.array([s.rest_length for s in springs])
        self._damping = np.array([s.damping for s in springs])
        self.damped = bool(np.any(self._damping))
        self._sign = np.zeros((len(springs), tree.nv))
        for end, sign in ((0, -1.0), (1, 1.0)):
            for i, joint in enumerate(self._joint[end]):
                self._sign[i, support(tree.model, int(joint))] += sign

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
        tension = self._stiffness * (np.linalg.norm(along, axis=1) - self._rest)
        power = 0.0
        if self.damped:
            speed = rate @ v
            drag = self._damping * speed
            tension = tension + drag
            power = -float(drag @ speed)
        return start, u, rate, tension, power

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


def _frame(model: pin.Model, name: str, spring: PointSpring) -> pin.Frame:
    return frame_of(model, name, f"PointSpring {spring.frame1} – {spring.frame2}")
