"""Equations of motion: the projected form (3) in minimal coordinates and the implicit form (2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_mechanism, real_array, require_finite, shown
from ..errors import NonFiniteError, OptionError
from ..maps.explicit import ExplicitMap
from ..maps.point import Point
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .reduced_inertia import ReducedInertia

Torque = Callable[[float, Array, Array], ArrayLike]
CheckedTorque = Callable[[float, Array, Array], Array]

REDUNDANT = 1e-9
"""Relative singular value below which a constraint direction counts as redundant in (2)."""


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
    """

    point: Point
    v: Array
    ydd: Array
    tau: Array | None
    power: float = 0.0

    @property
    def a(self) -> Array:
        """a = G ÿ + g, (nv,)."""
        return self.point.G @ self.ydd + self.point.g


class EquationsOfMotion:
    """ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), Eq. (3).

    The state is x = (y, ẏ) or, where torques, dampers or drives do work, (y, ẏ, W).

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
        self.works = does_work(mechanism, torque)
        self.calls = 0
        self._y, self._ydot = slice(0, self.m), slice(self.m, 2 * self.m)

    def evaluate(self, t: float, x: Array) -> Evaluation:
        """Point, velocity and ÿ at state x."""
        tree, ydot = self.mechanism.tree, x[self._ydot]
        point = self.explicit.at(x[self._y], ydot)
        q, G = point.q, point.G
        v = G.dot(ydot)  # the method costs half as much as @ on small arrays
        force = -tree.rnea(q, v, point.g)
        tau, power = self._act(t, q, v)
        if tau is not None:
            force += tau
        self.calls += 1
        return Evaluation(point, v, self._inertia.solve(q, G, G.T.dot(force)), tau, power)

    def _act(self, t: float, q: Array, v: Array) -> tuple[Array | None, float]:
        """What acts besides gravity, (nv,), and the power of its part without a potential."""
        tau, power = None, 0.0
        if self._applied is None and self._torque is None:
            return tau, power
        self.explicit.counters.force_evaluations += 1
        if self._applied is not None:
            tau, power = self._applied.at(q, v)
        if self._torque is not None:
            driven = self._torque(t, q, v)
            power += float(driven @ v)
            tau = driven if tau is None else tau + driven
        return tau, power

    def derivative(self, evaluation: Evaluation) -> Array:
        """ẋ from an evaluation."""
        rate = np.empty(2 * self.m + self.works)
        rate[self._y] = evaluation.point.ydot
        rate[self._ydot] = evaluation.ydd
        if self.works:
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
    supplied: Torque = torque

    def checked(t: float, q: Array, v: Array) -> Array:
        given = supplied(t, q.copy(), v.copy())
        try:
            tau = real_array(given)  # a copy: the function may use its array again
        except TypeError as error:
            raise OptionError(
                f"torque(t, q, v) returned {shown(given)}, expected (nv,) = ({mechanism.nv},) real numbers, "
                "none of them masked"
            ) from error
        if tau.shape != (mechanism.nv,):
            raise OptionError(
                f"torque(t, q, v) returned shape {tau.shape}, expected (nv,) = ({mechanism.nv},)"
            )
        if not np.all(np.isfinite(tau)):
            raise NonFiniteError(f"torque(t, q, v) returned {tau} at t = {t:.6g} s")
        return tau

    return checked


def constraint_forces(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None) -> Array:
    """λ (nc,) of least norm with Kᵀ λ = M a + C − τ: the cut joints' reactions, N and N m."""
    residual = mechanism.tree.rnea(q, v, a).copy()
    if tau is not None:
        residual -= tau
    K = mechanism.K(q)
    if mechanism.nc == 0:
        return np.zeros(0)
    solution: Array = np.linalg.lstsq(K.T, residual, rcond=REDUNDANT)[0]
    return solution


def implicit_dynamics(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, tau: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Accelerations and constraint forces from the implicit system (2).

    [[M, Kᵀ], [K, 0]] [a; −λ] = [τ − C; k], solved in the least-norm sense, which survives redundant
    rows and singular configurations (where k must be attainable for a to be meaningful).

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
    K, k = mechanism.K(q), mechanism.k(q, v)
    bias = mechanism.tree.rnea(q, v, mechanism.tree.zero)
    force = -bias if tau is None else mechanism.velocity(tau, "tau") - bias
    if mechanism.applied is not None:
        force = force + mechanism.applied.tau(q, v)
    M = mechanism.tree.crba(q)
    n, c = mechanism.nv, mechanism.nc
    matrix = require_finite(np.block([[M, K.T], [K, np.zeros((c, c))]]), "M(q)")
    require_finite(force, "τ − C")
    solution = np.linalg.lstsq(matrix, np.concatenate([force, k]), rcond=REDUNDANT)[0]
    return solution[:n], -solution[n:]
