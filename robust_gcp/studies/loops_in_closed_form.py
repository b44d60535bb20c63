"""The explicit map of trees of four-bars in closed form, loop by loop: what bridges are judged by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..examples.families import Lengths
from ..maps.closed_form import FourBar
from ..maps.explicit import Unaware
from ..maps.point import Point
from ..maps.regular_path import RegularPath
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array


class LoopsInClosedForm(Unaware):
    """q = γ(y), G and g of a tree of four-bars, each loop in closed form; y is any joint of each.

    Parameters
    ----------
    path : RegularPath
        For the counters.
    start : Point
    lengths : sequence of (l0, l1, l2, l3)
        m, of each loop.
    assembly : int
        See `FourBar`.
    mechanism : Mechanism
        In the coordinates y.
    """

    def __init__(
        self, path: RegularPath, start: Point, lengths: Sequence[Lengths], assembly: int, mechanism: Mechanism
    ) -> None:
        self.path, self.anchor, self._mechanism = path, start, mechanism
        self._loops = [FourBar(*each, assembly) for each in lengths]
        joints = [[f"{part}{i}" for part in ("crank", "coupler", "rocker")] for i in range(len(self._loops))]
        self._at = [[mechanism.joint(name).idx_q for name in names] for names in joints]
        names = mechanism.independent
        self._input = [next(k for k, name in enumerate(names) if name in own) for own in joints]
        self._part = [own.index(names[k]) for own, k in zip(joints, self._input, strict=True)]
        self._crank = [float(start.q[at[0]]) for at in self._at]
        shapes = zip(self._loops, self._at, self._crank, strict=True)
        apart = [start.q[at] - loop.evaluate(crank)[0] for loop, at, crank in shapes]
        self._turns = [2.0 * np.pi * np.round(off / (2.0 * np.pi)) for off in apart]

    def at(self, y: Array, ydot: Array) -> Point:
        """The point at y, on all loops."""
        mechanism = self._mechanism
        q, g = np.zeros(mechanism.nq), np.zeros(mechanism.nv)
        G = np.zeros((mechanism.nv, mechanism.m))
        for i, at in enumerate(self._at):
            k, part = self._input[i], self._part[i]
            theta, rate, second = self._at_input(i, float(y[k]))
            q[at] = theta
            G[at, k] = rate / rate[part]
            g[at] = (second - rate * second[part] / rate[part]) * (float(ydot[k]) / rate[part]) ** 2
        none = np.ones(1)
        self.anchor = Point(y.copy(), ydot.copy(), q, G, g, None, none, none)
        return self.anchor

    def _at_input(self, i: int, y: float) -> tuple[Array, Array, Array]:
        """q of a loop and its derivatives by the crank's angle, where the loop's input is y: by Newton."""
        part = self._part[i]
        for _ in range(30):
            theta, rate, second = self._loops[i].evaluate(self._crank[i])
            theta = theta + self._turns[i]
            off = y - float(theta[part])
            if abs(off) < 1e-15 * (1.0 + abs(y)):
                break
            self._crank[i] += off / float(rate[part])
        return theta, rate, second
