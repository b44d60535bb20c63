"""Exact reduced equations by hand: what references and floors are integrated from.

Nothing here uses Pinocchio, a loop closure solved by the package, or K: lengths, masses and γ(y) alone.
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
