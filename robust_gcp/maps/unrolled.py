"""The regular path of small mechanisms as straight-line Python, generated from their structure.

With three joints each NumPy call costs more than the arithmetic it does. So φ, the entries of K that
are not always zero, the solves with the small blocks of K_d, G and k are written out as Python source
over plain floats, once per mechanism.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import cos, inf, isfinite, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mechanism.closures import PointClosure
from ..mechanism.joints import JointKind
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .charted_path import ChartedPath
from .point import Counters, Point
from .regular_path import RegularPath
from .unrolled_source import Generator

MAX_JOINTS = 100
"""Joints up to which plain floats pay: eight times as fast as arrays with three joints, twice with 80,
equal with 250; compiling costs 1.5 ms a joint."""

MAX_BLOCK = 2
"""Largest block of K_d that is solved by Cramer's rule."""

Solver = Callable[[list[float], list[float], bool], tuple[list[float] | None, float, float, int]]
Predictor = Callable[
    [list[float], list[float], list[float], list[float], list[float], list[float]],
    tuple[list[float], float, float],
]


class UnrolledPath(RegularPath):
    """A `RegularPath` whose `step` and `settle` run as generated code; the rest is inherited.

    Its parameters are those of `RegularPath`, for a mechanism and rows that `can_unroll` accepts.
    """

    def __init__(
        self, mechanism: Mechanism, rows: NDArray[np.int64], counters: Counters | None = None
    ) -> None:
        super().__init__(mechanism, rows, counters)
        key = ("unrolled path", *rows.tolist())
        self._predictor, self._solver = mechanism.memo.once(key, lambda: _compiled(self))
        nv, m, blocks = self.tree.nv, self.m, len(self.blocks)
        bounds = np.cumsum([0, nv, nv * m, nv, nv if m == 1 else 0, blocks, blocks]).tolist()
        self._q, self._G, self._g, self._bend, self._det, self._rcond = (
            slice(a, b) for a, b in pairwise(bounds)
        )

    def step(self, anchor: Point, y: Array, ydot: Array) -> Point | None:
        """See `RegularPath.step`."""
        bend = anchor.g if anchor.curvature is None else anchor.curvature
        q, distance, turn = self._predictor(
            anchor.q.tolist(),
            anchor.G.reshape(-1).tolist(),
            bend.tolist(),
            y.tolist(),
            anchor.y.tolist(),
            anchor.ydot.tolist(),
        )
        point = self._solved(q, y, ydot, True)
        if point is not None and point.correction > 0.0:
            point.distance, point.turn = distance, turn
        return point

    def settle(
        self, q: Array, y: Array, ydot: Array, contracting: bool = True, origin: Array | None = None
    ) -> Point | None:
        """See `RegularPath.settle`."""
        q[self.iq] = y
        return self._solved(q.tolist(), y, ydot, contracting)

    def _solved(self, q: list[float], y: Array, ydot: Array, contracting: bool) -> Point | None:
        try:
            values, worst, correction, iterations = self._solver(q, ydot.tolist(), contracting)
        except (ArithmeticError, ValueError):  # not finite, or a block exactly singular: rare
            return super().settle(np.array(q), y, ydot, contracting)
        self.counters.newton_iterations += iterations
        self.counters.constraint_evaluations += iterations + 1
        if values is None:
            return None
        flat = np.array(values)
        G = flat[self._G].reshape(-1, self.m)
        bend = flat[self._bend] if self.m == 1 else None
        det, rcond = flat[self._det], flat[self._rcond]
        return Point(y, ydot, flat[self._q], G, flat[self._g], bend, det, rcond, worst, correction)


def regular_path(
    mechanism: Mechanism, rows: NDArray[np.int64], counters: Counters | None = None
) -> RegularPath:
    """The fastest regular path for this mechanism: unrolled where it is small and simple enough."""
    if mechanism.chart_joints:
        return ChartedPath(mechanism, rows, counters)
    key = ("can be unrolled", *rows.tolist())
    simple = mechanism.memo.once(key, lambda: can_unroll(RegularPath(mechanism, rows)))
    return (UnrolledPath if simple else RegularPath)(mechanism, rows, counters)


def can_unroll(path: RegularPath) -> bool:
    """Few joints, all hinges or slides, cut points only, small blocks of K_d."""
    return (
        0 < path.nd <= path.tree.nv <= MAX_JOINTS
        and path.m > 0
        and all(isinstance(closure, PointClosure) for closure in path.mechanism.closures)
        and all(len(block.rows) <= MAX_BLOCK for block in path.blocks)
        and all(joint.kind in (JointKind.HINGE, JointKind.SLIDE) for joint in path.tree.joints)
    )


def _compiled(path: RegularPath) -> tuple[Predictor, Solver]:
    """The generated functions."""
    namespace: dict[str, Any] = {"sin": sin, "cos": cos, "sqrt": sqrt, "isfinite": isfinite, "inf": inf}
    exec(compile(Generator(path).source(), f"<{path.mechanism.name} unrolled>", "exec"), namespace)
    return namespace["predict"], namespace["solve"]
