"""Python source for the regular path of one mechanism: φ, K, Newton, G and g over plain floats.

The formulas are the general ones in three dimensions, with hinges and slides about any axes. What the
structure makes constant is folded on the way, so that a planar linkage is left with what one would
write for it by hand.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import atan2

import numpy as np
import pinocchio as pin

from .kernel import CONVERGED, MAX_NEWTON, STAGNANT, RegularPath
from .scalar_code import Lines, Scalar, Vector, negative, nested, signed, text
from .tree import Array

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


@dataclass(frozen=True)
class _Block:
    """A diagonal block of K_d: rows, velocities, entries row by row, determinant and 1 / that."""

    rows: list[int]
    columns: list[int]
    entries: list[Scalar]
    det: Scalar
    inverse: Scalar


class Generator:
    """Writes the source for one mechanism."""

    def __init__(self, path: RegularPath) -> None:
        self.path, self.model = path, path.tree.model
        self.out = Lines()
        mechanism, model = path.mechanism, self.model
        self.unit = 1.0 / mechanism.length
        axes = [joint_axis(model, j) for j in range(1, model.njoints)]
        self.hinge = [True, *(bool(axis is not None and axis[0]) for axis in axes)]
        self.turns = [np.eye(3), *(_with_x_along(axis[1]) for axis in axes if axis is not None)]
        self.scale = np.ones(path.tree.nv)
        self.scale[path.dependent] = path._column_scale
        loops = len(mechanism.closures)
        full = mechanism.implicit.rows[path.rows]
        self.rows = [(int(row) // 3, int(row) % 3) for row in full]  # closure, world axis
        frames = [model.frames[i] for i in range(model.nframes - 2 * loops, model.nframes)]
        self.ends = [(frames[i], frames[loops + i]) for i in range(loops)]
        identity: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        self.bodies = {0: _Body(identity, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None)}

    def source(self) -> str:
        """Both functions."""
        return "\n".join([*self._predict(), *nested(self._solve()), ""])

    def _predict(self) -> list[str]:
        """q + G Δy + w c with the new y put in exactly, and the size of that step; see `predict`."""
        path, m = self.path, self.path.m
        nv, scale = path.tree.nv, path._length_scale.tolist()
        new = {int(v): f"y{j}" for j, v in enumerate(path.independent)}
        counts = {"q": nv, "G": nv * m, "c": nv, "y": m, "a": m, "s": m}
        lines = [f"def predict({', '.join(counts)}):"]
        lines += [f" {_names(name, count)} = {name}" for name, count in counts.items()]
        lines += [f" d{j} = y{j} - a{j}" for j in range(m)]
        if m == 1:
            lines.append(" w = 0.5 * d0 * d0")
        else:
            lines.append(f" speed = {_sum(f's{j} * s{j}' for j in range(m))}")
            lines.append(f" along = ({_sum(f'd{j} * s{j}' for j in range(m))}) / speed if speed else 0.0")
            lines.append(" w = 0.5 * along * along")
        lines += [f" v{i} = {_sum(f'G{i * m + j} * d{j}' for j in range(m))} + w * c{i}" for i in range(nv)]
        moved = ", ".join(new.get(i, f"q{i} + v{i}") for i in range(nv))
        size = ", ".join(f"abs(v{i})" if scale[i] == 1.0 else f"abs(v{i} * {scale[i]!r})" for i in range(nv))
        return [*lines, f" return [{moved}], max({size})"]

    def _solve(self) -> list[str]:
        """Newton's method, then G, g and the conditioning: what `close` and `derivatives` do."""
        path, out = self.path, self.out
        nv, m = path.tree.nv, path.m
        dependent = path.dependent.tolist()
        phi, K = self._place(), {}
        for row in range(len(self.rows)):
            K.update(self._row_of_K(row))
        self._measure(K)
        closing, known = out.lines, dict(out.names)
        out.lines = []
        u = self._substitute(K, phi)
        moves = [f"q{v} -= {text(out.product(float(self.scale[v]), u[v]))}" for v in dependent]
        newton, out.lines = out.lines, []
        out.names = known  # what a Newton step computed is stale after it

        G: list[list[Scalar]] = [[0.0] * m for _ in range(nv)]
        for j, independent in enumerate(path.independent.tolist()):
            G[independent][j] = 1.0
            column = self._substitute(K, [K.get((row, independent), 0.0) for row in range(len(phi))])
            for v in dependent:
                G[v][j] = negative(out.product(float(self.scale[v]), column[v]))
        rates: list[Scalar] = [f"s{j}" for j in range(m)]
        v = [row[0] if m == 1 else out.dot(row, rates) for row in G]
        k = self._bias(v)
        g: list[Scalar] = [0.0] * nv
        for i, e in self._substitute(K, k).items():
            g[i] = out.product(float(self.scale[i]), e)
        bend: list[Scalar] = []
        if m == 1:
            square = out.product("s0", "s0")
            g, bend = [out.product(e, square) for e in g], g
        dets, rconds = self._conditioning()
        result = [f"q{i}" for i in range(nv)]
        result += map(text, [*(e for row in G for e in row), *g, *bend, *dets, *rconds])
        worst = f"min({', '.join(map(text, rconds))}, 1.0)"

        steps = [signed(e)[1] for e in u.values()]
        sizes = [f"abs({signed(e)[1]})" for e in phi]
        return [
            "def solve(q, ydot, contracting):",
            f" {_names('q', nv)} = q",
            f" {_names('s', m)} = ydot",
            f" if not isfinite({_sum(f'q{i}' for i in range(nv))}): raise FloatingPointError",
            " last_size = last_step = inf",
            " correction = 0.0",
            f" for i in range({MAX_NEWTON}):",
            *(f"  {line}" for line in closing),
            f"  size = max({', '.join(sizes)}, 0.0)",
            f"  if size <= {CONVERGED!r} or (size <= {STAGNANT!r} and size >= 0.25 * last_size): break",
            *(f"  {line}" for line in newton),
            f"  if not isfinite({_sum(steps)}): raise FloatingPointError",
            f"  step = max({', '.join(f'abs({e})' for e in steps)}, 0.0)",
            "  if i == 0: correction = step",
            f"  elif contracting and step > 0.5 * last_step and size > {STAGNANT!r}:",
            "   return None, 0.0, 0.0, i",
            "  last_size, last_step = size, step",
            *(f"  {line}" for line in moves),
            f" else: return None, 0.0, 0.0, {MAX_NEWTON}",
            *(f" {line}" for line in out.lines),
            f" return [{', '.join(result)}], {worst}, correction, i",
        ]

    # --------------------------------------------------------------------- kinematics

    def _place(self) -> list[Scalar]:
        """Frames of the joints that carry cut points, those points, and φ / length."""
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

    def _row_of_K(self, row: int) -> dict[tuple[int, int], Scalar]:
        """The entries of a row that are not always zero, scaled."""
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

    def _bias(self, v: list[Scalar]) -> list[Scalar]:
        """k of each row for joint velocities v, after `_place`."""
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

    # --------------------------------------------------------------------- K_d

    def _measure(self, K: Entries) -> None:
        """Entries, determinant and its inverse of each block of K_d."""
        out, dependent = self.out, self.path.dependent.tolist()
        self.blocks: list[_Block] = []
        for block in self.path.blocks:
            rows, columns = block.rows.tolist(), [dependent[c] for c in block.columns.tolist()]
            entries = [K.get((row, v), 0.0) for row in rows for v in columns]
            det = entries[0]
            if len(rows) == 2:
                a, b, c, d = entries
                det = out.total([out.product(a, d), negative(out.product(b, c))])
            inverse = 1.0 / det if isinstance(det, float) else out.let(f"1.0 / {det}")
            self.blocks.append(_Block(rows, columns, entries, det, inverse))

    def _substitute(self, K: Entries, rhs: list[Scalar]) -> dict[int, Scalar]:
        """K_d⁻¹ rhs by blocks: dimensionless dependent velocities."""
        out, u = self.out, dict[int, Scalar]()
        for block in self.blocks:
            left = [
                out.total([rhs[row], *(negative(out.product(K.get((row, v), 0.0), u[v])) for v in u)])
                for row in block.rows
            ]
            if len(left) == 1:
                u[block.columns[0]] = out.product(left[0], block.inverse)
                continue
            a, b, c, d = block.entries
            x = out.total([out.product(d, left[0]), negative(out.product(b, left[1]))])
            y = out.total([out.product(a, left[1]), negative(out.product(c, left[0]))])
            u[block.columns[0]], u[block.columns[1]] = (out.product(e, block.inverse) for e in (x, y))
        return u

    def _conditioning(self) -> tuple[list[Scalar], list[Scalar]]:
        """det and rcond of each block as in `BlockFactor`."""
        out, rconds = self.out, list[Scalar]()
        for block in self.blocks:
            size = f"abs({text(block.det)})"
            if len(block.rows) == 1:
                rconds.append(out.let(f"min({size}, 1.0)"))
                continue
            s = text(out.dot(block.entries, block.entries))
            root = out.let(f"sqrt(max({s} * {s} - 4.0 * {text(block.det)} * {text(block.det)}, 0.0))")
            rconds.append(out.let(f"2.0 * {size} / ({s} + {root})"))
        return [block.det for block in self.blocks], rconds


def joint_axis(model: pin.Model, joint: int) -> tuple[bool, Array] | None:
    """Whether the joint is a hinge, and its axis in its own frame; None where it is no hinge or slide."""
    kind = model.joints[joint]
    if (kind.nq, kind.nv) != (1, 1):
        return None
    data = kind.createData()
    kind.calc(data, pin.neutral(model))
    linear, angular = np.split(np.asarray(data.S).ravel(), 2)
    if np.any(linear) and np.any(angular):
        return None  # a screw
    return (True, angular) if np.any(angular) else (False, linear)


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


def _names(letter: str, count: int) -> str:
    """Target of an unpacking assignment."""
    return "".join(f"{letter}{i}, " for i in range(count))


def _sum(names: Iterable[str]) -> str:
    return " + ".join(names)
