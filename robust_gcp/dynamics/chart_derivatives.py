"""How configurations and rates in the chart of a step depend on its start and on y.

Of a joint in a chart about the start, q = q_n ⊕ w, w = S y + N z, S and N the columns of its independent and
dependent velocities. Where the start moves by δη_n and y by δy, it moves by

    δq = D₀ G_n δη_n + D₁ (S δy + N δz),

along its own axes, and δz is what keeps the loops closed: δq lies in the range of G. ẇ = dexp⁻¹(w) v changes
with w, and with v = G u. Of a number in q, D₀ = D₁ = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..maps.explicit import Point
from ..maps.grouped import GroupPoint
from ..mechanism.coordinates.groups import groups_of
from ..mechanism.coordinates.joint_charts import JointCharts, loop_charts
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array


@dataclass(frozen=True)
class ChartSlopes:
    """Linear maps at one point of a step, (m, m) each.

    Attributes
    ----------
    by_start, by_y : ndarray
        δη along the velocities G e_j at the point, by δη_n along those at the start, and by δy.
    rate_by_start, rate_by_y, rate_by_u : ndarray
        δẏ by these and by δu.
    """

    by_start: Array
    by_y: Array
    rate_by_start: Array
    rate_by_y: Array
    rate_by_u: Array


def chart_derivatives(mechanism: Mechanism, start: Point, here: Point, v_y: Array) -> ChartSlopes:
    """At a point whose chart is about the start; v_y (nv, m) is ∂v/∂y there."""
    m = mechanism.m
    by_start, by_y = np.eye(m), np.eye(m)
    by_u = np.eye(m)
    rate_start, rate_y = np.zeros((m, m)), np.zeros((m, m))
    for charts, own, inputs, origin in _charts(mechanism, here):
        size = len(charts.iv)
        rest = np.setdiff1d(np.arange(size), own)
        w = charts.apart(origin, here.q[charts.iq])
        D0, D1 = charts.place_slopes(origin, w)
        G = here.G[charts.iv]
        S = np.zeros((size, m))
        S[own, inputs] = 1.0
        # what is known of δq, by (δη_n, δy); numbers in q move with both
        known = np.hstack([D0 @ start.G[charts.iv], D1 @ S])
        numbers = np.hstack([np.eye(m), np.eye(m)])
        numbers[inputs] = 0.0
        across = np.zeros((len(rest), size))  # δq is in the range of G where this leaves `numbers` alone
        across[:, rest] = np.eye(len(rest))
        across[:, own] -= G[np.ix_(rest, inputs)]
        z = np.linalg.solve(across @ D1[:, rest], G[rest] @ numbers - across @ known) if len(rest) else None
        dw = np.hstack([np.zeros((size, m)), S])
        if z is not None:
            dw[rest] += z
            known = known + D1[:, rest] @ z
        by_start[inputs], by_y[inputs] = known[own, :m], known[own, m:]
        rate_w, rate_v = charts.rate_slopes(w, G @ here.ydot)
        moved = numbers.copy()
        moved[inputs] = known[own]
        rate = rate_w @ dw + rate_v @ v_y[charts.iv] @ moved
        rate_start[inputs], rate_y[inputs] = rate[own, :m], rate[own, m:]
        by_u[inputs] = (rate_v @ G)[own]
    return ChartSlopes(by_start, by_y, rate_start, rate_y, by_u)


def _charts(
    mechanism: Mechanism, point: Point
) -> list[tuple[JointCharts, NDArray[np.int64], NDArray[np.int64], Array]]:
    """Charts with the positions of their independent velocities in w and in y, and their origins."""
    found: list[tuple[JointCharts, NDArray[np.int64], NDArray[np.int64], Array]] = []
    groups, loops, rest = groups_of(mechanism), loop_charts(mechanism), point
    if groups is not None:
        assert isinstance(point, GroupPoint)
        assert point.origin is not None
        found.append((groups, np.arange(len(groups.iv)), groups.inputs, point.origin))
        rest = point.rest
    if loops is not None:
        assert rest.origin is not None
        found.append((loops, loops.own, loops.inputs, rest.origin))
    return found
