"""The explicit map of trees of four-bars in closed form, loop by loop: what bridges are judged by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robust_gcp.examples.families import Lengths
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.explicit import Point, Unaware
from robust_gcp.maps.regular_path import RegularPath
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array

PARTS = ("crank", "coupler", "rocker")

VIEWS = (
    ((0, 1, 2, 3), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0)),
    ((1, 2, 3, 0), ((0.0, 1.0, 0.0), (-1.0, -1.0, 1.0), (-1.0, 0.0, 0.0)), (-np.pi, np.pi, -np.pi)),
    ((0, 3, 2, 1), ((0.0, 0.0, -1.0), (-1.0, -1.0, 1.0), (-1.0, 0.0, 0.0)), (np.pi, -np.pi, np.pi)),
)
"""The loop seen with the crank, coupler or rocker as its input link: which of its links are the ground,
input, coupler and output there, and A and b of the angles A q + b there. From the coupler the crank is the
ground; from the rocker the loop is seen in a mirror."""


class LoopsInClosedForm(Unaware):
    """q = γ(y), G and g of a tree of four-bars, each loop in closed form; y is any joint of each.

    Parameters
    ----------
    path : RegularPath
        For the counters.
    start : Point
        A point of the mode, at no crossing.
    lengths : sequence of (l0, l1, l2, l3)
        m, of each loop.
    mechanism : Mechanism
        In the coordinates y.
    """

    def __init__(
        self, path: RegularPath, start: Point, lengths: Sequence[Lengths], mechanism: Mechanism
    ) -> None:
        self.path, self.anchor, self._mechanism = path, start, mechanism
        joints = [[f"{part}{i}" for part in PARTS] for i in range(len(lengths))]
        names = mechanism.independent
        self._at = [[mechanism.joint(name).idx_q for name in own] for own in joints]
        self._input = [next(k for k, name in enumerate(names) if name in own) for own in joints]
        parts = [own.index(names[k]) for own, k in zip(joints, self._input, strict=True)]
        loops = zip(lengths, parts, self._at, strict=True)
        self._loops = [Loop(each, part, start.q[at]) for each, part, at in loops]

    def point_at(self, y: Array, ydot: Array) -> Point:
        """The point at y, on all loops."""
        mechanism = self._mechanism
        q, g = np.zeros(mechanism.nq), np.zeros(mechanism.nv)
        G = np.zeros((mechanism.nv, mechanism.m))
        for loop, at, k in zip(self._loops, self._at, self._input, strict=True):
            q[at], G[at, k], second = loop.evaluate(float(y[k]))
            g[at] = second * float(ydot[k]) ** 2
        none = np.ones(1)
        self.anchor = Point(y.copy(), ydot.copy(), q, G, g, None, none, none)
        return self.anchor


class Loop:
    """A mode of a four-bar in closed form by the angle of any of its joints.

    Parameters
    ----------
    lengths : (l0, l1, l2, l3)
        m.
    part : int
        Of `PARTS`: whose angle is the input.
    q : ndarray (3,)
        A configuration of the mode, rad.
    """

    def __init__(self, lengths: Lengths, part: int, q: Array) -> None:
        links, *more = VIEWS[part]
        turned, offset = map(np.array, more)
        self._back = np.linalg.inv(turned)
        self._sign = float(turned[0, part])
        self._constant = float(offset[0])
        seen = turned @ q + offset
        l0, l1, l2, l3 = (lengths[i] for i in links)
        self._bar = FourBar.assembly_of(l0, l1, l2, l3, seen)
        apart = seen - self._bar.evaluate(float(seen[0]))[0]
        self._offset = offset - 2.0 * np.pi * np.round(apart / (2.0 * np.pi))

    def evaluate(self, y: float) -> tuple[Array, Array, Array]:
        """The angles of crank, coupler and rocker at the input y, rad, and their derivatives by y."""
        seen, rate, second = self._bar.evaluate(self._sign * y + self._constant)
        return self._back @ (seen - self._offset), self._sign * (self._back @ rate), self._back @ second
