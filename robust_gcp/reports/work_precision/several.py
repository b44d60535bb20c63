"""Exact reduced equations of several coordinates: planar bodies carried by loops whose γ is known.

Two formulations, which share positions and γ alone: Lagrange's equation Gᵀ M G ÿ = −Gᵀ (h + M g + ∂V/∂q),
and Hamilton's with p = Gᵀ M G ẏ, ṗ = ∂(T − V)/∂y at constant ẏ. The first differentiates the bodies'
velocities by time, the second their energy by y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...mechanism.tree.tree import Array
from .reduced import Planar, Reduced

Curves = Callable[[Array], tuple[Array, Array, Array]]
"""y (m,) ↦ q (n,), G (n, m), and D (n, m) with ∂G_ik/∂y_k: each q depends on one coordinate of its own loop
alone, so that g = D ẏ²."""


Read = Callable[[Array], tuple[Array, Array]]
"""A state ↦ q and v in the joints of a scene."""


def joints_reader(curves: Curves) -> Read:
    """Of (y, ẏ), where the curves are those of all joints."""

    def read(x: Array) -> tuple[Array, Array]:
        y, ydot = np.split(x, 2)
        q, G, _ = curves(y)
        return q, G @ ydot

    return read


@dataclass(frozen=True)
class SeveralDof:
    """Planar bodies in n numbers q that follow m coordinates y."""

    bodies: Planar
    curves: Curves
    carried: bool = False  # whether q begins with the place that carries all bodies, y and z, m

    def lagrange(self, y: Array, ydot: Array, read: Read) -> Reduced:
        """The motion from (y, ẏ); `read` takes that state to q and v."""

        def rate(t: float, x: Array) -> Array:
            y, ydot = np.split(x, 2)
            b, (q, G, D) = self.bodies, self.curves(y)
            e, J, turn = self._moving(q, G)
            bend = b.S @ (D @ ydot**2)
            spin = b.S @ (G @ ydot)
            bias = b.A @ ((1j * bend - spin**2) * e)
            force = -(J.conj().T @ (b.mass * (bias + b.up))).real
            force -= turn.T @ (b.moment * bend[b.spin])
            return np.concatenate([ydot, np.linalg.solve(self._inertia(J, turn), force)])

        return Reduced(np.concatenate([y, ydot]), rate, read)

    def hamilton(self, y: Array, ydot: Array, read: Read) -> Reduced:
        """The same motion in (y, p)."""

        def velocity(x: Array) -> Array:
            y, p = np.split(x, 2)
            q, G, _ = self.curves(y)
            _, J, turn = self._moving(q, G)
            return np.linalg.solve(self._inertia(J, turn), p)

        def rate(t: float, x: Array) -> Array:
            y, ydot = x[: len(x) // 2], velocity(x)
            b, (q, G, D) = self.bodies, self.curves(y)
            e, J, turn = self._moving(q, G)
            spin = b.S @ (G @ ydot)
            by_y, bending = b.S @ G, (b.S @ D) * ydot
            # ∂ċ/∂y_k of ċ = A (i spin e), and ∂θ̇/∂y_k
            slopes = b.A @ ((1j * bending - spin[:, None] * by_y) * e[:, None])
            kinetic = (slopes.conj().T @ (b.mass * (J @ ydot))).real
            kinetic += bending[b.spin].T @ (b.moment * (turn @ ydot))
            return np.concatenate([ydot, kinetic - ((np.conj(b.up) * b.mass) @ J).real])

        q, G, _ = self.curves(y)
        _, J, turn = self._moving(q, G)
        start = np.concatenate([y, self._inertia(J, turn) @ ydot])
        return Reduced(start, rate, lambda x: read(np.concatenate([x[: len(x) // 2], velocity(x)])))

    def _moving(self, q: Array, G: Array) -> tuple[np.ndarray, np.ndarray, Array]:
        """Phasors e (na,), ∂c/∂y (nb, m) and ∂θ/∂y (nb, m) of the bodies."""
        b = self.bodies
        e = np.exp(1j * (b.S @ q))
        J = (b.A * (1j * e)) @ (b.S @ G)
        if self.carried:
            J = J + G[0] + 1j * G[1]
        return e, J, (b.S @ G)[b.spin]

    def _inertia(self, J: np.ndarray, turn: Array) -> Array:
        b = self.bodies
        return (J.conj().T @ (b.mass[:, None] * J)).real + turn.T @ (b.moment[:, None] * turn)
