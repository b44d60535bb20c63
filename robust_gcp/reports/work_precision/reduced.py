"""Exact reduced equations by hand: what references and floors are integrated from.

Nothing here uses Pinocchio, a loop closure solved by the package, or K: lengths, masses and γ(y) alone.
Several coordinates have two formulations, which share positions and γ alone: Lagrange's equation
Gᵀ M G ÿ = −Gᵀ (h + M g + ∂V/∂q), and Hamilton's with p = Gᵀ M G ẏ, ṗ = ∂(T − V)/∂y at constant ẏ. The first
differentiates the bodies' velocities by time, the second their energy by y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...maps.closed_form import FourBar
from ...mechanism.tree.tree import Array

GRAVITY = 9.81
"""m/s²"""

Shape = Callable[[float], tuple[Array, Array, Array]]
"""y ↦ q = γ(y), G = γ'(y), γ''(y), (nv,) each."""


@dataclass(frozen=True)
class Reduced:
    """A motion as a small system of its own, ẋ = f(t, x)."""

    x0: Array
    rate: Callable[[float, Array], Array]  # (t, x) -> ẋ
    read: Callable[[Array], tuple[Array, Array]]  # x -> (q, v): in the joints of the scene


class Weights(NamedTuple):
    """m(y), ½ m'(y), V(y) and V'(y) of one degree of freedom."""

    inertia: float
    half_slope: float
    potential: float
    moment: float


@dataclass(frozen=True)
class Planar:
    """Bodies in the plane whose centres are sums of phasors, c = c₀ + A e^{iθ}, θ = S q."""

    S: Array  # (na, nv): which joints make up each phasor's angle
    A: np.ndarray  # (nb, na): arms of the bodies' centres, m
    spin: NDArray[np.int64]  # the angle that each body turns with
    # mass, moment: (nb,): kg, and kg m² about the centre
    mass: Array
    moment: Array
    up: complex = 1j * GRAVITY  # against gravity in the plane, as long as its acceleration, m/s²

    def weigh(self, q: Array, G: Array, Gp: Array) -> Weights:
        """m = Σ mass |c'|² + moment θ'², ½ m' = Σ mass c'·c'' + moment θ' θ'', V = Σ mass up · c."""
        rate, bend = self.S @ G, self.S @ Gp
        e = np.exp(1j * (self.S @ q))
        dc = self.A @ (1j * rate * e)
        ddc = self.A @ ((1j * bend - rate**2) * e)
        turn, turning = rate[self.spin], bend[self.spin]
        weight = np.conj(self.up) * self.mass
        return Weights(
            float(self.mass @ (dc.real**2 + dc.imag**2) + self.moment @ turn**2),
            float(self.mass @ (dc.conj() * ddc).real + self.moment @ (turn * turning)),
            float((weight @ (self.A @ e)).real),
            float((weight @ dc).real),
        )

    def inertia(self, q: Array, v: Array) -> tuple[Array, Array]:
        """M(q), (nv, nv), and the velocity terms h with M a + h = forces, (nv,); no gravity."""
        e = np.exp(1j * (self.S @ q))
        J = (self.A * (1j * e)) @ self.S
        bias = -self.A @ ((self.S @ v) ** 2 * e)
        turn = self.S[self.spin]
        M = (J.conj().T * self.mass) @ J
        h = (J.conj().T @ (self.mass * bias)).real
        return M.real + (turn.T * self.moment) @ turn, h


@dataclass(frozen=True)
class OneDof:
    """½ m(y) ẏ² + V(y) = E, so that ÿ = −(½ m' ẏ² + V')/m."""

    shape: Shape  # the exact γ and its derivatives
    weigh: Callable[[Array, Array, Array], Weights]  # by q, γ' and γ''

    def start(self, y: float, ydot: float) -> Reduced:
        """The motion from (y, ẏ)."""
        return Reduced(np.array([y, ydot]), self.rate, self.read)

    def rate(self, t: float, x: Array) -> Array:
        """(ẏ, ÿ)."""
        w = self.weigh(*self.shape(float(x[0])))
        return np.array([x[1], -(w.half_slope * x[1] ** 2 + w.moment) / w.inertia])

    def read(self, x: Array) -> tuple[Array, Array]:
        """q and v."""
        q, G, _ = self.shape(float(x[0]))
        return q, G * x[1]

    def weights(self, y: float) -> Weights:
        """m, ½ m', V and V' at y."""
        return self.weigh(*self.shape(y))


def four_bar(lengths: tuple[float, float, float, float], assembly: int, up: complex = 1j * GRAVITY) -> OneDof:
    """The paper's four-bar with uniform slender rods of 1 kg, γ in closed form."""
    _, l1, l2, l3 = lengths
    S = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    A = np.array([[0.5 * l1, 0.0, 0.0], [l1, 0.5 * l2, 0.0], [0.0, 0.0, 0.5 * l3]], dtype=complex)
    moment = np.array([l1, l2, l3]) ** 2 / 12.0
    bodies = Planar(S, A, np.arange(3), np.ones(3), moment, up)
    return OneDof(FourBar(*lengths, assembly).evaluate, bodies.weigh)


def cranks(A: float, B: float, turns: Array) -> OneDof:
    """A pendulum A ÿ = −B cos y that carries joints turning in step, q = turns · y."""
    still = np.zeros_like(turns)

    def shape(y: float) -> tuple[Array, Array, Array]:
        return turns * y, turns, still

    def weigh(q: Array, G: Array, Gp: Array) -> Weights:
        y = q[0] / turns[0]
        return Weights(A, 0.0, float(B * np.sin(y)), float(B * np.cos(y)))

    return OneDof(shape, weigh)


# --------------------------------------------------------------------------- several coordinates


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

        def inertia(y: Array) -> Array:
            _, J, turn = self._moving(*self.curves(y)[:2])
            return self._inertia(J, turn)

        def velocity(x: Array) -> Array:
            y, p = np.split(x, 2)
            return np.linalg.solve(inertia(y), p)

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

        start = np.concatenate([y, inertia(y) @ ydot])
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
