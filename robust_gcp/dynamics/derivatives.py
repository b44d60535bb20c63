"""First derivatives of the forward dynamics (3) by position, velocity and torques.

With a = G u̇ + g, f = RNEA(q, v, a) − τ and M_r = Gᵀ M G, the equation Gᵀ f = 0 is differentiated:

    ∂u̇/∂y = −M_r⁻¹ [fᵀ ∂G/∂y + Gᵀ ((RNEA_q − τ_q) G + (RNEA_v − τ_v) V_y + M A_y)],
    ∂u̇/∂u = −M_r⁻¹ Gᵀ [(RNEA_v − τ_v) G + M A_u],    ∂u̇/∂τ = M_r⁻¹ Gᵀ.

∂/∂y_j is along the velocity G e_j, so the same holds for floating bases.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_callable, require_finite
from ..errors import NonFiniteError
from ..maps.explicit import Point
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .equations import Evaluation, called_torque
from .loads import Torques, Wrench, one_torque
from .modes.map_rates import MapRates
from .modes.mode_rates import ModeRates
from .modes.taylor_series import Circles
from .problem import Problem, initial_value_problem
from .reduced_inertia import ReducedInertia
from .rnea_derivatives import RigidDerivatives
from .torque_feedback import TorqueSlopes, followed, slopes_of_all


@dataclass(frozen=True)
class Derivatives:
    """First derivatives of the independent accelerations u̇.

    Attributes
    ----------
    udot : ndarray (m,)
        Eq. (3).
    da_dy, da_dv : ndarray (m, m)
        By the independent positions, along the velocities G e_j, and by the independent velocities.
    da_dtau : ndarray (m, nv)
        By the torques on all joints.
    G : ndarray (nv, m)
        v = G u.
    dv_dy : ndarray (nv, m)
        How v changes with the positions while u is held.
    """

    udot: Array
    da_dy: Array
    da_dv: Array
    da_dtau: Array
    G: Array
    dv_dy: Array

    @classmethod
    def room(cls, n: int, m: int, nv: int) -> Derivatives:
        """Room for those at n states, the number of the state first."""
        square, tall = (n, m, m), (n, nv, m)
        shapes = ((n, m), square, square, (n, m, nv), tall, tall)
        return cls(*(np.full(shape, np.nan) for shape in shapes))


def forward_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    mode: ArrayLike | None = None,
    t: float = 0.0,
) -> Array:
    """The reference of `robust_gcp.forward_dynamics`, where its arguments are told and checked."""
    motion = initial_value_problem(mechanism, q, v, mode, one_torque(mechanism, tau))
    return require_finite(motion.equations.at_point(t, motion.start.point).ydd, "u̇")


def derivatives(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    mode: ArrayLike | None = None,
    t: float = 0.0,
    tau_slopes: TorqueSlopes | None = None,
    wrenches: Sequence[Wrench] = (),
    known: Circles | None = None,
) -> Derivatives:
    """The reference of `robust_gcp.derivatives`, where its arguments are told and checked.

    Parameters
    ----------
    known : Circles, optional
        Of other states of the mechanism; those made here are added.
    """
    check_callable("tau_slopes", tau_slopes, "(t, q, v)")
    applied = one_torque(mechanism, tau, wrenches)
    motion = initial_value_problem(mechanism, q, v, mode, applied)
    slopes = slopes_of_all(mechanism, tau_slopes, wrenches)
    return PointDerivatives(motion, applied, slopes, known).at_start(t)


@dataclass(frozen=True)
class Accelerations:
    """The accelerations of all joints, and how they change while u̇ is held.

    Attributes
    ----------
    a : ndarray (nv,)
    by_y, by_u : ndarray (nv, m)
    """

    a: Array
    by_y: Array
    by_u: Array


Compiled = Callable[[Array, Array, Array | None], tuple[Derivatives, Accelerations] | None]
"""Derivatives at q, v and τ besides the mechanism's own forces, τ held; None where there are none."""


class PointDerivatives:
    """`Derivatives` at points of a motion.

    Parameters
    ----------
    motion : Problem
    torque : callable, array_like (nv,) or None
        The user's; what it was set out with.
    tau_slopes : callable, optional
    known : Circles, optional
        See `derivatives`.
    sparing : bool
        See `ModeRates`.
    compiled : Compiled, optional
        What is asked first.
    """

    def __init__(
        self,
        motion: Problem,
        torque: object = None,
        tau_slopes: TorqueSlopes | None = None,
        known: Circles | None = None,
        sparing: bool = False,
        compiled: Compiled | None = None,
    ) -> None:
        self._compiled = compiled
        self._told: tuple[Point, tuple[Array, Array]] | None = None  # how torques follow the state there
        self.motion, self.mechanism = motion, motion.mechanism
        self._function, self._slopes = called_torque(self.mechanism, torque), tau_slopes
        self._inertia = ReducedInertia(self.mechanism)
        self._rigid: RigidDerivatives = self.mechanism.memo.once(
            "rigid derivatives", lambda: RigidDerivatives(self.mechanism)
        )
        self._mode = ModeRates(motion.start, known, sparing)

    def at_start(self, t: float) -> Derivatives:
        """At the start of the motion."""
        return self.derivatives_at(t, self._start(t))

    def whole_at_start(self, t: float) -> tuple[Derivatives, Accelerations]:
        """The same, with the accelerations of all joints."""
        return self.whole(t, self._start(t))

    def _start(self, t: float) -> Evaluation:
        return self.motion.equations.at_point(t, self.motion.start.point)

    def derivatives_at(self, t: float, now: Evaluation) -> Derivatives:
        """At an evaluated point."""
        return self.whole(t, now)[0]

    def stage(self, t: float, now: Evaluation) -> tuple[Evaluation, Derivatives]:
        """At a stage of a step, and the evaluation that the step goes on with."""
        return now, self.derivatives_at(t, now)

    def whole(self, t: float, now: Evaluation) -> tuple[Derivatives, Accelerations]:
        """The same, with the accelerations of all joints."""
        with np.errstate(all="ignore"):  # what is not finite ends in an error of ours
            found = None if self._compiled is None else self._by_compiled(self._compiled, t, now)
            return self._at(t, now) if found is None else found

    def _by_compiled(
        self, compiled: Compiled, t: float, now: Evaluation
    ) -> tuple[Derivatives, Accelerations] | None:
        """The same compiled, but for how the user's torques follow the state."""
        applied, tau, q, v = self.mechanism.applied, now.tau, now.point.q, now.v
        found = compiled(q, v, tau if tau is None or applied is None else tau - applied.torque_at(q, v)[0])
        if found is None or not self._follows:
            return found
        slopes, accelerations = found
        tau_y, tau_u = self._followed(t, now, slopes.G, slopes.dv_dy)
        by_y = slopes.da_dy + slopes.da_dtau @ tau_y
        by_u = slopes.da_dv + slopes.da_dtau @ tau_u
        if not (np.all(np.isfinite(by_y)) and np.all(np.isfinite(by_u))):
            return None  # the reference says so
        return replace(slopes, da_dy=by_y, da_dv=by_u), accelerations

    def _at(self, t: float, now: Evaluation) -> tuple[Derivatives, Accelerations]:
        mechanism, point = self.mechanism, now.point
        q, u = point.q, point.ydot
        rates = self._mode.rates_at(point)
        G = rates.G
        v = G @ u
        # beside a singular place G and g are from a circle, better than those the point has by K_d
        ydd = now.ydd if np.array_equal(G, point.G) else self._accelerations(q, v, now, rates)
        a, A_y = G @ ydd + rates.g, rates.A_y + np.einsum("i,inj->nj", ydd, rates.bend)
        force = mechanism.tree.rnea(q, v, a).copy()  # Pinocchio's own memory, which the next call writes to
        if now.tau is not None:
            force -= now.tau
        by_q, by_v, M = self._rigid.derivatives_at(q, v, a)
        pulled_q, pulled_v = G.T @ by_q, G.T @ by_v
        if mechanism.applied is not None:
            forces_q, forces_v = mechanism.applied.derivatives_at(q, v, G)
            pulled_q, pulled_v = pulled_q - forces_q, pulled_v - forces_v
        bent = np.einsum("n,inj->ij", force, rates.bend)  # f = Kᵀ λ does no work along G, but along ∂G
        by_y = bent + pulled_q @ G + pulled_v @ rates.V_y + G.T @ M @ A_y
        by_u = pulled_v @ G + G.T @ M @ rates.A_u
        if self._follows:
            tau_y, tau_u = self._followed(t, now, G, rates.V_y)
            by_y, by_u = by_y - G.T @ tau_y, by_u - G.T @ tau_u
        rest = np.hstack([-by_y, -by_u, G.T])
        m = mechanism.m
        found = self._inertia.solve(q, G, rest)
        if not np.all(np.isfinite(found)):
            raise NonFiniteError(f"the linearisation at y = {point.y} is not finite", point.y)
        slopes = Derivatives(ydd, found[:, :m], found[:, m : 2 * m], found[:, 2 * m :], G, rates.V_y)
        return slopes, Accelerations(a, A_y, rates.A_u)

    def _accelerations(self, q: Array, v: Array, now: Evaluation, rates: MapRates) -> Array:
        """u̇ by Eq. (3) with a G and g that were found otherwise than the point's own."""
        force = -self.mechanism.tree.rnea(q, v, rates.g)
        if now.tau is not None:
            force = force + now.tau
        return self._inertia.solve(q, rates.G, rates.G.T @ force)

    @property
    def _follows(self) -> bool:
        """Whether the user's torques follow the state."""
        return self._function is not None or self._slopes is not None

    def _followed(self, t: float, now: Evaluation, G: Array, dv_dy: Array) -> tuple[Array, Array]:
        """How they do, by y and by u, (nv, m) each."""
        if self._told is None or self._told[0] is not now.point:  # of one that is held it is asked twice
            states = np.array([t]), now.point.q[None], now.v[None]
            by = followed(self.mechanism, self._function, self._slopes, states, G[None], dv_dy[None])
            self._told = now.point, (by[0][0], by[1][0])
        return self._told[1]
