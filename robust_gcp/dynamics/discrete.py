"""First derivatives of one step of RK4: by the state before it and by the torques held over it.

The four stages follow from one another by the chain rule; for joints in charts see `chart_derivatives`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import require_finite
from ..maps.explicit import Point
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .chart_derivatives import ChartSlopes, chart_derivatives
from .derivatives import Derivatives, PointDerivatives
from .equations import Evaluation
from .prescribed.constrained_derivatives import ByDrive
from .problem import initial_value_problem

STAGES = (0.0, 0.5, 0.5, 1.0)
"""When the stages of RK4 are, and how far along the slope before each is taken, in steps."""

WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


NOTHING: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Stage:
    """One stage of a step.

    Attributes
    ----------
    now : Evaluation
    slopes : Derivatives
        Of u̇ there.
    chart : ChartSlopes
    """

    now: Evaluation
    slopes: Derivatives
    chart: ChartSlopes


Parametric = Callable[[Stage], Array]


@dataclass(frozen=True)
class Step:
    """One step with all that its derivatives need.

    Attributes
    ----------
    h : float
        s.
    stages : list of Stage
    end : Point
        After it, in the chart of its start.
    chart : ChartSlopes
        At its end.
    """

    h: float
    stages: list[Stage]
    end: Point
    chart: ChartSlopes

    def jacobians(
        self, by_more: Parametric | None = None, driven: NDArray[np.int64] = NOTHING
    ) -> tuple[Array, Array, Array, Array]:
        """δ(η, u) after the step by δ(η, u) before it, (2m, 2m), and by torques held over it, (2m, nv).

        Then by parameters, (2m, k), and by prescribed motions, (2m, 15 driven).

        Parameters
        ----------
        by_more : callable (Stage) -> (m, k), optional
            ∂u̇ by parameters at a stage.
        driven : ndarray of int (driven,)
            Which of y are prescribed; slopes are those of `DrivenDerivatives`. The last columns are
            (5, 3, driven), by y, ẏ and ÿ at each stage and the end.
        """
        m, nv = self.stages[0].slopes.da_dtau.shape
        by_p = [x.slopes.da_dtau[:, :0] if by_more is None else by_more(x) for x in self.stages]
        k = 2 * m + nv + by_p[0].shape[1]
        inputs = np.eye(k + 15 * len(driven))
        eta, u, rest, told = inputs[:m], inputs[m : 2 * m], inputs[2 * m : k], inputs[k:]
        told = told.reshape(5, 3, len(driven), len(inputs))
        sum_y = sum_u = slope_y = slope_u = np.zeros_like(eta)
        stages = zip(self.stages, STAGES, WEIGHTS, by_p, told[:4], strict=True)
        for stage, share, weight, by, (at, fast, hard) in stages:
            dy, du = self.h * share * slope_y, u + self.h * share * slope_u
            d, chart = stage.slopes, stage.chart
            slope_y = chart.rate_by_start @ eta + chart.rate_by_y @ dy + chart.rate_by_u @ du
            moved = chart.by_start @ eta + chart.by_y @ dy
            moved[driven], du[driven] = at, fast  # told, whatever the stepper has made of them
            slope_u = d.da_dy @ moved + d.da_dv @ du + np.hstack([d.da_dtau, by]) @ rest
            if isinstance(d, ByDrive):
                slope_u += d.da_ddrive @ hard
            sum_y, sum_u = sum_y + weight * slope_y, sum_u + weight * slope_u
        end = self.chart.by_start @ eta + self.h * self.chart.by_y @ sum_y
        fast = u + self.h * sum_u
        end[driven], fast[driven] = told[4, :2]
        A, B, P, D = np.split(np.vstack([end, fast]), [2 * m, 2 * m + nv, k], axis=1)
        return A, B, P, D


def differentiated_step(slopes: PointDerivatives, t: float, x: Array, h: float) -> Step:
    """One step of RK4 from x = (y, u), on the explicit map's present mode, with its derivatives.

    Parameters
    ----------
    slopes : PointDerivatives
        Of the motion; its map is moved.
    x : ndarray (2m,)
        At the origin of the map's chart.
    """
    equations, mechanism = slopes.motion.equations, slopes.mechanism
    m, work = mechanism.m, np.zeros(int(equations.works))
    stages: list[Stage] = []
    rates: list[Array] = []
    for share in STAGES:
        state = x + h * share * rates[-1] if rates else x
        asked = equations.evaluate(t + share * h, np.concatenate([state, work]))
        now, found = slopes.stage(t + share * h, asked)
        rates.append(equations.derivative(now)[: 2 * m])
        first = stages[0].now.point if stages else now.point  # all are in its chart
        stages.append(Stage(now, found, chart_derivatives(mechanism, first, now.point, found.dv_dy)))
    after = x + h * np.einsum("s,sn->n", np.array(WEIGHTS), np.array(rates))
    if equations.driven:  # there it is told where
        end = equations.evaluate(t + h, np.concatenate([after, work])).point
    else:
        end = slopes.motion.explicit.point_at(after[:m], after[m:])
    none = np.zeros((mechanism.nv, m))  # of its rates nothing is asked
    return Step(h, stages, end, chart_derivatives(mechanism, stages[0].now.point, end, none))


def step_jacobians(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: ArrayLike | None,
    step: float,
    mode: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """The reference of `robust_gcp.step_jacobians`, where its arguments are told and checked."""
    held = None if tau is None else mechanism.velocity(tau, "tau")
    motion = initial_value_problem(mechanism, q, v, mode, held)
    x = motion.x[: 2 * mechanism.m]
    A, B = differentiated_step(PointDerivatives(motion, held), 0.0, x, float(step)).jacobians()[:2]
    return require_finite(A, "A"), require_finite(B, "B")
