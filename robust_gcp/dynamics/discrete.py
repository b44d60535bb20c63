"""First derivatives of one step of RK4: by the state before it and by the torques held over it.

On a group the chart of a step is q = q_n ⊕ w, w = 0 at its start, and ẇ = dexp⁻¹(w) u. With D₀ and D₁ the
derivatives of q_n ⊕ w by q_n and by w, a stage's configuration changes by δη = D₀ δη_n + D₁ δw along its own
axes, and the four stages follow from one another by the chain rule. For a number in q, D₀ = D₁ = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_mechanism, check_positive, require_finite
from ..maps.grouped import GroupMap
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .derivatives import Derivatives, PointDerivatives
from .equations import Evaluation
from .problem import set_out

STAGES = (0.0, 0.5, 0.5, 1.0)
"""When the stages of RK4 are, and how far along the slope before each is taken, in steps."""

WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


@dataclass(frozen=True)
class Stage:
    """One stage of a step.

    Attributes
    ----------
    now : Evaluation
    slopes : Derivatives
        Of u̇ there.
    origin, chart : ndarray (m, m)
        D₀ and D₁.
    rate_w, rate_u : ndarray (m, m)
        ∂ẇ/∂w and ∂ẇ/∂u.
    """

    now: Evaluation
    slopes: Derivatives
    origin: Array
    chart: Array
    rate_w: Array
    rate_u: Array


@dataclass(frozen=True)
class Step:
    """One step with all that its derivatives need.

    Attributes
    ----------
    h : float
        s.
    stages : list of Stage
    x : ndarray (2 m,)
        (y, u) after it, in the chart of its start.
    origin, chart : ndarray (m, m)
        D₀ and D₁ at its end.
    """

    h: float
    stages: list[Stage]
    x: Array
    origin: Array
    chart: Array

    def jacobians(self) -> tuple[Array, Array]:
        """δ(η, u) after the step by δ(η, u) before it, (2m, 2m), and by the torques, (2m, nv)."""
        m, nv = self.stages[0].slopes.da_dtau.shape
        n = 2 * m + nv
        eta, u, tau = np.eye(n)[:m], np.eye(n)[m : 2 * m], np.eye(n)[2 * m :]
        sum_w, sum_u = np.zeros((m, n)), np.zeros((m, n))
        slope_w, slope_u = sum_w, sum_u
        for stage, share, weight in zip(self.stages, STAGES, WEIGHTS, strict=True):
            dw, du = self.h * share * slope_w, u + self.h * share * slope_u
            d = stage.slopes
            slope_w = stage.rate_w @ dw + stage.rate_u @ du
            moved = stage.origin @ eta + stage.chart @ dw
            slope_u = d.da_dy @ moved + d.da_dv @ du + d.da_dtau @ tau
            sum_w, sum_u = sum_w + weight * slope_w, sum_u + weight * slope_u
        end = self.origin @ eta + self.h * self.chart @ sum_w
        whole = np.vstack([end, u + self.h * sum_u])
        return whole[:, : 2 * m], whole[:, 2 * m :]


def differentiated_step(slopes: PointDerivatives, t: float, x: Array, h: float) -> Step:
    """One step of RK4 from x = (y, u), on the explicit map's present mode, with its derivatives.

    Parameters
    ----------
    slopes : PointDerivatives
        Of the motion; its map is moved.
    x : ndarray (2m,)
        At the origin of the map's chart.
    """
    equations = slopes.motion.equations
    m, work = slopes.mechanism.m, np.zeros(int(equations.works))
    stages: list[Stage] = []
    rates: list[Array] = []
    for share in STAGES:
        state = x + h * share * rates[-1] if rates else x
        now = equations.evaluate(t + share * h, np.concatenate([state, work]))
        rates.append(equations.derivative(now)[: 2 * m])
        charts = _charts(slopes, state[:m] - x[:m], state[m:])
        stages.append(Stage(now, slopes.at(t + share * h, now), *charts))
    after = x + h * np.einsum("s,sn->n", np.array(WEIGHTS), np.array(rates))
    origin, chart, _, _ = _charts(slopes, after[:m] - x[:m], after[m:])
    return Step(h, stages, after, origin, chart)


def _charts(slopes: PointDerivatives, w: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    """D₀, D₁, ∂ẇ/∂w and ∂ẇ/∂u, (m, m) each."""
    explicit, m = slopes.motion.explicit, slopes.mechanism.m
    origin, chart, rate_w, rate_u = np.eye(m), np.eye(m), np.zeros((m, m)), np.eye(m)
    if isinstance(explicit, GroupMap):
        groups, own = explicit.groups, explicit.groups.inputs
        here = np.ix_(own, own)
        origin[here], chart[here] = groups.place_slopes(explicit.origin, w[own])
        rate_w[here], rate_u[here] = groups.rate_slopes(w[own], u[own])
    return origin, chart, rate_w, rate_u


def step_jacobians(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: ArrayLike | None,
    step: float,
    mode: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Jacobians of one step of RK4, the torques held over it.

    δ(η, u) after the step = A δ(η, u) before it + B δτ, η along the velocities G e_j at either end and u the
    independent velocities.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,)
        Closed, and K v = 0; at rest where v is None.
    tau : array_like (nv,) or mapping {joint: torque}, optional
        N m and N, besides the mechanism's own forces; None: none.
    step : float
        s.
    mode : array_like, optional
        As in `simulate`, where q is singular.

    Returns
    -------
    A : ndarray (2m, 2m)
    B : ndarray (2m, nv)

    Raises
    ------
    StateError, SimulationError, ModelError
        As `derivatives` does.
    """
    check_mechanism(mechanism, Mechanism, "step_jacobians")
    check_positive("step", step)
    held = None if tau is None else mechanism.velocity(tau, "tau")
    motion = set_out(mechanism, q, v, mode, held)
    x = motion.x[: 2 * mechanism.m]
    A, B = differentiated_step(PointDerivatives(motion, held), 0.0, x, float(step)).jacobians()
    return require_finite(A, "A"), require_finite(B, "B")
