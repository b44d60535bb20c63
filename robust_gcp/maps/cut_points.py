"""φ, K and k of cut points as straight-line code, from the structure of the spanning tree.

The formulas are the general ones in three dimensions, with hinges and slides about any axes. What the
structure makes constant is folded on the way, so that a planar linkage is left with what one would
write for it by hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2

import numpy as np

from ..mechanism.joints import JointKind
from ..mechanism.tree import Array
from .regular_path import RegularPath
from .scalar_code import Lines, Scalar, Vector, negative, text

EXACT = 1e-15
"""Entries of constant rotations this near to 0 or ±1 are taken for what they are rounded from."""

_End = tuple[int, Vector, Vector]
"""A cut point: its joint, where it is, and where from the joint's origin."""

Entries = dict[tuple[int, int], Scalar]
"""Entries of K by row and velocity."""


@dataclass
class _Body:
    """A joint's frame, turned so that the joint's axis is its x axis; lengths in characteristic ones.

    Attributes
    ----------
    columns : tuple of three vectors
        Its axes in the world.
    p, r : vector
        Its origin, and that minus its parent's origin.
    planar : (ndarray (3, 3), str) or None
        A constant rotation and an angle about its x axis that make up the orientation, where all
        hinges since the ground are parallel: the angles add, and one sine and cosine are enough.
    omega, alpha, a : vector
        Angular velocity, angular and linear acceleration where all joints' accelerations are zero.
    """

    columns: tuple[Vector, Vector, Vector]
    p: Vector
    r: Vector
    planar: tuple[Array, Scalar] | None
    omega: Vector = (0.0, 0.0, 0.0)
    alpha: Vector = (0.0, 0.0, 0.0)
    a: Vector = (0.0, 0.0, 0.0)


class CutPoints:
    """Writes φ, K and k, scaled as in the path's `ImplicitConstraint`.

    Parameters
    ----------
    path : RegularPath
        All joints are hinges or slides, all closures `PointClosure`.
    out : Lines
        Where the code goes.
    """

    def __init__(self, path: RegularPath, out: Lines) -> None:
        self.out, self.model = out, path.tree.model
        mechanism, model = path.mechanism, self.model
        self.unit = 1.0 / mechanism.length
        joints = path.tree.joints
        self.hinge = [True, *(joint.kind is JointKind.HINGE for joint in joints)]
        self.turns = [np.eye(3), *(_with_x_along(joint.axis) for joint in joints if joint.axis is not None)]
        self.scale = np.ones(path.tree.nv)
        self.scale[path.dependent] = mechanism.column_scale[path.dependent]
        loops = len(mechanism.closures)
        full = mechanism.implicit.rows[path.rows]
        self.rows = [(int(row) // 3, int(row) % 3) for row in full]  # closure, world axis
        frames = [model.frames[i] for i in range(model.nframes - 2 * loops, model.nframes)]
        self.ends = [(frames[i], frames[loops + i]) for i in range(loops)]
        identity: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        self.bodies = {0: _Body(identity, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None)}

    def phi(self) -> list[Scalar]:
        """φ, after the frames of all joints that carry cut points."""
        out = self.out
        self.points = []
        for first, second in self.ends:
            sides = []
            for frame in (first, second):
                body = self._body(int(frame.parentJoint))
                r = self._reach(body, int(frame.parentJoint), frame.placement.translation)
                sides.append((int(frame.parentJoint), out.add(body.p, r), r))
            self.points.append(sides)
        return [out.total([a[1][e], negative(b[1][e])]) for (a, b), e in self._per_row()]

    def _per_row(self) -> list[tuple[tuple[_End, _End], int]]:
        return [((self.points[closure][0], self.points[closure][1]), axis) for closure, axis in self.rows]

    def _reach(self, body: _Body, joint: int, local: Array) -> Vector:
        """A translation in a joint's own axes as a vector in the world."""
        t = (self.turns[joint].T @ local * self.unit).tolist()
        return self.out.add(*(self.out.times(c, column) for c, column in zip(t, body.columns, strict=True)))

    def _body(self, joint: int) -> _Body:
        if joint in self.bodies:
            return self.bodies[joint]
        out, model = self.out, self.model
        before = int(model.parents[joint])
        parent, placement = self._body(before), model.jointPlacements[joint]
        turn = _snapped(self.turns[before].T @ placement.rotation @ self.turns[joint])
        x, y, z = (
            out.add(*(out.times(float(c), column) for c, column in zip(mixed, parent.columns, strict=True)))
            for mixed in turn.T
        )
        r = self._reach(parent, before, placement.translation)
        q = f"q{joint - 1}"
        planar: tuple[Array, Scalar] | None = None
        if not self.hinge[joint]:
            r = out.add(r, out.times(out.product(q, self.unit), x))
        else:
            if before == 0 or all(isinstance(e, float) for c in (x, y, z) for e in c):
                planar = np.array([x, y, z], dtype=float), q
            elif parent.planar is not None and turn[0, 0] == 1.0:
                constant, angle = parent.planar
                planar = constant, out.total([angle, q, atan2(turn[2, 1], turn[1, 1])])
            if planar is not None:
                y, z = _vector(planar[0][1]), _vector(planar[0][2])
                q = text(planar[1])
            c, s = out.let(f"cos({q})"), out.let(f"sin({q})")
            y = out.add(out.times(c, y), out.times(s, z))
            z = out.cross(x, y)
        body = self.bodies[joint] = _Body((x, y, z), out.add(parent.p, r), r, planar)
        return body

    def row_of_K(self, row: int) -> Entries:
        """The entries of a row of K that are not always zero, after `phi`."""
        out, nothing = self.out, (0.0, 0.0, 0.0)
        entries: Entries = {}
        (first, second), e = self._per_row()[row]
        one, two = self._levers(first), self._levers(second)
        for joint in sorted(one.keys() | two.keys()):
            axis = self.bodies[joint].columns[0]
            if self.hinge[joint]:
                ahead, behind = one.get(joint, nothing), out.times(-1.0, two.get(joint, nothing))
                entry = out.cross_entry(axis, out.add(ahead, behind), e)
            else:
                entry = out.product(((joint in one) - (joint in two)) * self.unit, axis[e])
            entry = out.product(entry, float(self.scale[joint - 1]))
            if entry != 0.0:
                entries[row, joint - 1] = entry
        return entries

    def _levers(self, end: _End) -> dict[int, Vector]:
        """The way to a cut point from each joint that moves it."""
        joint, _, lever = end
        levers: dict[int, Vector] = {}
        while joint:
            levers[joint] = lever
            lever = self.out.add(self.bodies[joint].r, lever)
            joint = int(self.model.parents[joint])
        return levers

    def bias(self, v: list[Scalar]) -> list[Scalar]:
        """k of each row for joint velocities v, after `phi`."""
        out = self.out
        for joint in sorted(self.bodies)[1:]:
            body, parent = self.bodies[joint], self.bodies[int(self.model.parents[joint])]
            motion = out.times(v[joint - 1], body.columns[0])
            turning = out.cross(parent.omega, motion)
            body.a = self._carried(parent, body.r)
            body.omega, body.alpha = parent.omega, parent.alpha
            if self.hinge[joint]:
                body.omega, body.alpha = out.add(parent.omega, motion), out.add(parent.alpha, turning)
            else:
                body.a = out.add(body.a, out.times(2.0 * self.unit, turning))
        pulled = [[self._carried(self.bodies[end[0]], end[2]) for end in ends] for ends in self.points]
        return [out.total([pulled[c][1][e], negative(pulled[c][0][e])]) for c, e in self.rows]

    def _carried(self, body: _Body, r: Vector) -> Vector:
        """Acceleration of the point at r from a body's origin: a + α × r + ω (ω · r) − ω² r."""
        out, omega = self.out, body.omega
        spin = out.times(negative(out.dot(omega, omega)), r)
        return out.add(body.a, out.cross(body.alpha, r), out.times(out.dot(omega, r), omega), spin)


def _with_x_along(axis: Array) -> Array:
    """A rotation matrix whose first column is the axis; exact for a coordinate axis."""
    first = int(np.argmax(np.abs(axis)))
    second = np.cross(axis, np.eye(3)[(first + 2) % 3]) * -1.0
    second /= np.linalg.norm(second)
    return np.column_stack([axis, second, np.cross(axis, second)])


def _snapped(R: Array) -> Array:
    """A constant rotation without the rounding of angles such as π / 2."""
    nearest = np.round(R)
    return np.where(np.abs(R - nearest) < EXACT, nearest, R)


def _vector(entries: Array) -> Vector:
    x, y, z = entries.tolist()
    return x, y, z
