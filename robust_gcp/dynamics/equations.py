"""Equations of motion: the projected form (3) in minimal coordinates and the implicit form (2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..checks import check_mechanism, require_finite
from ..maps.classical import SingularityWarning
from ..maps.explicit import ExplicitMap, Point
from ..mechanism.coordinates.partition import numerical_rank
from ..mechanism.mechanism import Mechanism
from ..mechanism.tolerances import STRUCTURAL
from ..mechanism.tree.tree import Array
from ..user_functions import returned
from ..warning import warn
from .reduced_inertia import ReducedInertia

Torque = Callable[[float, Array, Array], ArrayLike]
CheckedTorque = Callable[[float, Array, Array], Array]

UNBALANCED = 1e-6
"""Share of the joint forces that constraint forces may leave: more than rounding beside a singularity."""

UNBALANCED_WORDS = (
    "multipliers: at a singular configuration no constraint forces balance the motion; NaN is recorded there"
)


@dataclass(slots=True)
class Evaluation:
    """One evaluation of the equations of motion.

    Attributes
    ----------
    point : Point
        q, G and g.
    v, ydd : ndarray (nv,), (m,)
        Velocity and reduced acceleration ÿ.
    tau : ndarray (nv,) or None
        Applied torques, springs and dampers; None where there are none.
    power : float
        Of all in tau that no potential energy accounts for, W.
    drive : ndarray (nv,) or None
        What prescribed motions take, a part of tau; NaN where nothing is prescribed.
    """

    point: Point
    v: Array
    ydd: Array
    tau: Array | None
    power: float = 0.0
    drive: Array | None = None

    @property
    def a(self) -> Array:
        """a = G ÿ + g, (nv,)."""
        return self.point.G @ self.ydd + self.point.g


class EquationsOfMotion:
    """ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), Eq. (3).

    The state is x = (y, ẏ) or, where torques, dampers or drives do work, (y, ẏ, W). Of joints in
    charts y holds w, and velocities u in place of ẏ: ẇ = dexp⁻¹(w) u.

    Parameters
    ----------
    mechanism : Mechanism
    explicit : ExplicitMap
        Gives q, G and g.
    torque : callable (t, q, v) -> (nv,), array (nv,) or None
    """

    def __init__(
        self, mechanism: Mechanism, explicit: ExplicitMap, torque: Torque | ArrayLike | None = None
    ) -> None:
        self.mechanism, self.explicit = mechanism, explicit
        self.m = mechanism.m
        self._torque = torque_function(mechanism, torque)
        self._applied = mechanism.applied
        self._inertia = ReducedInertia(mechanism)
        self.works, self.driven = does_work(mechanism, torque), False
        self._y, self._ydot = slice(0, self.m), slice(self.m, 2 * self.m)

    def evaluate(self, t: float, x: Array) -> Evaluation:
        """Point, velocity and ÿ at state x."""
        return self.at_point(t, self.explicit.point_at(x[self._y], x[self._ydot]))

    def at_point(self, t: float, point: Point) -> Evaluation:
        """The same at a point that is known."""
        tree, q, G = self.mechanism.tree, point.q, point.G
        v = G.dot(point.ydot)  # the method costs half as much as @ on small arrays
        force = -tree.rnea(q, v, point.g)  # −(M g + C) in one call
        tau, power = self._act(t, q, v)
        if tau is not None:
            force += tau
        self.explicit.counters.rhs += 1
        return Evaluation(point, v, self._inertia.solve(q, G, G.T.dot(force)), tau, power)

    def acting(self, t: float, q: Array, v: Array) -> tuple[Array, float]:
        """What acts besides gravity, (nv,), and the power of its part without a potential."""
        tau, power = self._act(t, q, v)
        return np.zeros(self.mechanism.nv) if tau is None else tau, power

    def _act(self, t: float, q: Array, v: Array) -> tuple[Array | None, float]:
        """The same; None where nothing can act."""
        if self._applied is None and self._torque is None:
            return None, 0.0
        self.explicit.counters.force_evaluations += 1
        tau, power = (None, 0.0) if self._applied is None else self._applied.torque_at(q, v)
        if self._torque is not None:
            driven = self._torque(t, q, v)
            power += float(driven @ v)
            tau = driven if tau is None else tau + driven
        return tau, power

    def derivative(self, evaluation: Evaluation) -> Array:
        """ẋ from an evaluation."""
        rate = np.empty(2 * self.m + self.works)
        rate[self._y] = self.explicit.rate(evaluation.point)
        rate[self._ydot] = evaluation.ydd
        if self.works:  # W is integrated beside: energies are checked against it
            rate[-1] = evaluation.power
        return rate

    def __call__(self, t: float, x: Array) -> Array:
        """ẋ = f(t, x) for a stepper."""
        return self.derivative(self.evaluate(t, x))


def does_work(mechanism: Mechanism, torque: Torque | ArrayLike | None) -> bool:
    """Whether something acts whose work no potential energy accounts for."""
    return torque is not None or (mechanism.applied is not None and mechanism.applied.works)


def torque_function(mechanism: Mechanism, torque: Torque | ArrayLike | None) -> CheckedTorque | None:
    """A checked torque callable from what a user passes."""
    if torque is None:
        return None
    if not callable(torque):
        constant = mechanism.velocity(torque, "torque")
        return lambda t, q, v: constant
    return called_torque(mechanism, torque)


def called_torque(mechanism: Mechanism, torque: Any) -> TorqueFunction | None:
    """The same where it is called for each state; None for constants."""
    if not callable(torque):
        return None
    return torque if isinstance(torque, TorqueFunction) else TorqueFunction(torque, mechanism.nv)


def is_asked(torque: Torque | ArrayLike | None) -> TypeGuard[Torque]:
    """Whether a function of the user's has to be asked for a torque that is not held."""
    return torque.asks if isinstance(torque, TorqueFunction) else callable(torque)


class TorqueFunction:
    """A torque function of the user's, handed copies of the state and asked for (nv,) finite real numbers.

    Parameters
    ----------
    supplied : callable (t, q, v) -> (nv,)
    nv : int

    Attributes
    ----------
    asks : bool
        Whether a function of the user's has to be asked for it.
    """

    asks = True

    def __init__(self, supplied: Torque, nv: int) -> None:
        self._supplied, self._nv = supplied, nv

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """τ at (t, q, v), (nv,)."""
        given = self._supplied(t, q.copy(), v.copy())  # views of Pinocchio's own memory must not be kept
        return returned(given, (self._nv,), "torque(t, q, v)", named="(nv,) = ", t=t)

    def over(self, t: Array, q: Array, v: Array) -> Array:
        """τ at many states, (N, nv), whose rows may be written to."""
        states = list(zip(t.tolist(), q, v, strict=True))
        rows: list[Any] = [self._supplied(*state) for state in states]
        # checked one by one only where something is amiss: a gradient asks for thousands
        if all(type(row) is np.ndarray and row.dtype == float and row.shape == (self._nv,) for row in rows):
            tau = np.array(rows).reshape(-1, self._nv)
            if np.all(np.isfinite(tau)):
                return tau
        return np.array([self(*state) for state in states])


def constraint_forces(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None) -> Array:
    """λ (nc,) with Kᵀ λ = M a + C − τ: the cut joints' reactions, N and N m.

    Where rows of K are redundant, the λ of least norm, moments divided by the characteristic length. NaN,
    with a warning, at a singular configuration whose reactions K cannot balance: they are limits from both
    sides, which need not agree, and no λ there has their value.
    """
    found = balancing_forces(mechanism, q, v, a, tau, Split(mechanism, q))
    if found is None:
        warn(UNBALANCED_WORDS, SingularityWarning)
        return np.full(mechanism.nc, np.nan)
    return found


def balancing_forces(
    mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None, split: Split,
    allowed: float = UNBALANCED,
) -> Array | None:  # fmt: skip
    """The same λ by K's split at q; None where they leave more than this share of the joint forces."""
    tree, acting = mechanism.tree, mechanism.tree.zero if tau is None else tau
    # judged by what cancels in it: at rest under gravity M a + C − τ itself may be rounding
    parts = np.array([tree.rnea(q, v, a).copy(), tree.rnea(q, v, tree.zero), acting])
    need = parts[0] - acting
    size = float(np.abs(mechanism.column_scale * parts).max(initial=0.0))
    left = np.abs(split.free.T @ need).max(initial=0.0)
    return None if left > allowed * size else split.multipliers(need)


class Split:
    """The dimensionless K at q as K = U s Nᵀ over its regular directions, and the motions that it leaves.

    Rank is decided here and nowhere else, on K without units: what M weighs, in whatever unit, has no
    part in it.

    Parameters
    ----------
    mechanism : Mechanism
    q : ndarray (nq,)

    Attributes
    ----------
    free : ndarray (nv, nv − rank)
        Velocities with K v = 0, orthonormal without units.
    """

    def __init__(self, mechanism: Mechanism, q: Array) -> None:
        self._rows, self._columns = mechanism.row_scale, mechanism.column_scale
        U, s, Nt = np.linalg.svd(mechanism.scaled(mechanism.K(q)))
        rank = numerical_rank(s, STRUCTURAL)
        self._U, self._s, self._N = U[:, :rank], s[:rank], Nt[:rank].T
        self.free: Array = self._columns[:, None] * Nt[rank:].T

    def acceleration(self, k: Array) -> Array:
        """The shortest a (nv,) with K a = k, as far as k can be attained."""
        a: Array = self._columns * (self._N @ (self._U.T @ (k / self._rows) / self._s))
        return a

    def multipliers(self, force: Array) -> Array:
        """The shortest λ (nc,) with Kᵀ λ = force, as far as it can be attained."""
        multipliers: Array = self._U @ (self._N.T @ (self._columns * force) / self._s) / self._rows
        return multipliers


def implicit_dynamics(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, tau: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Accelerations and constraint forces from the implicit system (2).

    `[[M, Kᵀ], [K, 0]] [a; −λ] = [τ − C; k]`, solved in the least-norm sense, which survives redundant
    rows and singular configurations (where k must be attainable for a to be meaningful): with K N = 0,
    a = a₀ + N z from K a₀ = k and Nᵀ M N z = Nᵀ (τ − C − M a₀), then Kᵀ λ = M a + C − τ. So beside a
    singular configuration a loses the digits that K's own conditioning costs, not its square.

    Parameters
    ----------
    q, v : array_like (nq,), (nv,)
    tau : array_like (nv,), optional
        Torques besides the mechanism's own springs, dampers and drives.

    Returns
    -------
    a : ndarray (nv,)
    λ : ndarray (nc,)
    """
    check_mechanism(mechanism, Mechanism, "implicit_dynamics")
    q, v = mechanism.configuration(q), mechanism.velocity(v)
    bias = mechanism.tree.rnea(q, v, mechanism.tree.zero)
    force = -bias if tau is None else mechanism.velocity(tau, "tau") - bias
    if mechanism.applied is not None:
        force = force + mechanism.applied.tau(q, v)
    require_finite(force, "τ − C")
    M = require_finite(mechanism.tree.crba(q), "M(q)")
    split = Split(mechanism, q)
    a, N = split.acceleration(mechanism.k(q, v)), split.free
    inertia = N.T @ M @ N
    size = np.sqrt(np.maximum(inertia.diagonal(), 0.0))  # light links beside heavy ones: unit diagonal
    size = 1.0 / np.where(size > 0.0, size, 1.0)
    # least squares, as motions without mass leave z to itself
    z = scipy.linalg.lstsq(inertia * size[:, None] * size, size * (N.T @ (force - M @ a)))[0]
    a = a + N @ (size * z)
    return a, split.multipliers(M @ a - force)
