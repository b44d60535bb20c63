"""The regular path with coordinates in charts: spherical joints in loops, some velocities independent.

A chart about the origin q_o holds, for these joints, q = q_o ⊕ w, w = S y + N z, with S and N the columns of
the independent and the dependent velocities. Newton's method closes the loops by z at the y that is asked
for; G and g are those of the velocities u = Sᵀ v in the joints' own axes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..mechanism.coordinates.joint_charts import loop_charts
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .explicit import Counters, Point
from .regular_path import Closed, RegularPath


class ChartedPath(RegularPath):
    """A `RegularPath` for mechanisms with `Coordinates.chart_joints`; the rest is inherited."""

    def __init__(
        self, mechanism: Mechanism, rows: NDArray[np.int64], counters: Counters | None = None
    ) -> None:
        super().__init__(mechanism, rows, counters)
        charts = loop_charts(mechanism)
        assert charts is not None
        self.charts = charts

    def derivatives(self, closed: Closed, y: Array, ydot: Array, origin: Array | None = None) -> Point:
        """See `RegularPath.derivatives`; the chart is about the configuration itself where none is given."""
        point = super().derivatives(closed, y, ydot)
        point.origin = closed.q[self.charts.iq] if origin is None else origin
        return point

    def settle(
        self, q: Array, y: Array, ydot: Array, contracting: bool = True, origin: Array | None = None
    ) -> Point | None:
        """See `RegularPath.settle`; y is in the chart about the origin."""
        charts = self.charts
        origin = q[charts.iq].copy() if origin is None else origin
        q[self.iq] = y[self.numbers]
        w = charts.apart(origin, q[charts.iq])
        w[charts.own] = y[charts.inputs]  # Newton moves the others alone
        q[charts.iq] = charts.place(origin, w)
        closed = self.close(q, contracting, origin)
        return None if closed is None else self.derivatives(closed, y, ydot, origin)

    def predict(self, anchor: Point, y: Array) -> tuple[Array, Array]:
        """See `RegularPath.predict`; G Δy is turned into the chart to the first order in w."""
        charts = self.charts
        assert anchor.origin is not None
        w = charts.apart(anchor.origin, anchor.q[charts.iq])
        delta = (y - anchor.y)[charts.inputs]
        # y holds w and G maps velocities: without dexp⁻¹(w) the prediction errs by |w| of the step itself
        led = charts.rate(anchor.origin, w, anchor.G[charts.iv] @ (y - anchor.y))[charts.own]
        aim = y.copy()
        aim[charts.inputs] += delta - led
        return super().predict(anchor, aim)

    def rate(self, point: Point) -> Array:
        """ẏ at a point: u for numbers in q, dexp⁻¹(w) v of the joints in charts."""
        charts, rate = self.charts, point.ydot.copy()
        assert point.origin is not None
        w = charts.apart(point.origin, point.q[charts.iq])
        v = point.G[charts.iv] @ point.ydot
        rate[charts.inputs] = charts.rate(point.origin, w, v)[charts.own]
        return rate

    def renewed(self, point: Point) -> Point:
        """The same point as the origin of a new chart."""
        y = point.y.copy()
        y[self.charts.inputs] = 0.0
        return replace(point, y=y, origin=point.q[self.charts.iq].copy())

    def away(self, point: Point) -> float:
        """Largest entry of w at a point, rad or m: how far it is from the origin of its chart."""
        charts = self.charts
        assert point.origin is not None
        return float(np.abs(charts.apart(point.origin, point.q[charts.iq])).max(initial=0.0))

    def y_of(self, point: Point, q: Array) -> Array:
        """y of another configuration in the chart of a point."""
        charts, y = self.charts, np.empty(self.m)
        assert point.origin is not None
        y[self.numbers] = q[self.iq]
        y[charts.inputs] = charts.apart(point.origin, q[charts.iq])[charts.own]
        return y

    def _turned(self, q: Array, K: Array, origin: Array | None) -> Array:
        """K D: columns of joints in charts by w instead of their own axes."""
        assert origin is not None
        charts, turned = self.charts, K.copy()
        D = charts.turn(origin, charts.apart(origin, q[charts.iq]))  # velocities by ẇ: Newton moves w
        scale = self._scale[charts.iv]
        turned[:, charts.iv] = (K[:, charts.iv] / scale) @ D * scale
        return turned

    def _move(self, q: Array, dv_dependent: Array, origin: Array | None) -> Array:
        assert origin is not None
        charts, dv = self.charts, np.zeros(self.tree.nv)
        dv[self.dependent] = dv_dependent
        w = charts.apart(origin, q[charts.iq]) + dv[charts.iv]
        dv[charts.iv] = 0.0
        q = self.tree.integrate(q, dv)
        q[charts.iq] = charts.place(origin, w)
        return q


def regular_path(
    mechanism: Mechanism, rows: NDArray[np.int64], counters: Counters | None = None
) -> RegularPath:
    """The regular path for this mechanism: in charts where coordinates of it are kept in them."""
    return (ChartedPath if mechanism.chart_joints else RegularPath)(mechanism, rows, counters)
