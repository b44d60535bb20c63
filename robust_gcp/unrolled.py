"""The regular path of small mechanisms as straight-line Python, generated from their structure.

With three joints each NumPy call costs more than the arithmetic it does. So φ, the entries of K that
are not always zero, the solves with the small blocks of K_d, G and k are written out as Python source
over plain floats, once per mechanism. Constants are folded on the way: of the general formulas in
three dimensions, what is left for a planar linkage is what one would write by hand.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import atan2, cos, inf, isfinite, sin, sqrt
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .closure import PointClosure
from .kernel import CONVERGED, MAX_NEWTON, STAGNANT, Counters, Point, RegularPath
from .mechanism import Mechanism
from .tree import Array

MAX_JOINTS = 100
"""Joints up to which plain floats beat arrays; the source also grows by some 40 lines a joint."""

MAX_BLOCK = 2
"""Largest block of K_d that is solved by Cramer's rule."""

LONGEST = 80
"""Characters up to which an expression is nested into another one."""

EXACT = 1e-15
"""Entries of constant rotations this near to 0 or ±1 are taken for what they are rounded from."""

Scalar = float | str
"""A constant, or the name of a variable, with a minus sign in front or not."""

_TEMPORARY = re.compile(r"\bt\d+\b")

Vector = tuple[Scalar, Scalar, Scalar]

Solver = Callable[[list[float], list[float], bool], tuple[list[float] | None, float, float, int]]
Predictor = Callable[
    [list[float], list[float], list[float], list[float], list[float], list[float]], tuple[list[float], float]
]


class UnrolledPath(RegularPath):
    """A `RegularPath` whose `step` and `settle` run as generated code; the rest is inherited.

    Parameters
    ----------
    path : RegularPath
        One that `can_unroll` accepts; it shares its workspace with this object.
    """

    def __init__(self, path: RegularPath) -> None:
        vars(self).update(vars(path))  # the same path, factorised and scaled already
        self._predictor, self._solver = _compiled(path)
        nv, m, blocks = self.tree.nv, self.m, len(self.blocks)
        bounds = np.cumsum([0, nv, nv * m, nv, nv if m == 1 else 0, blocks, blocks]).tolist()
        self._q, self._G, self._g, self._bend, self._det, self._rcond = (
            slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)
        )

    def step(self, anchor: Point, y: Array, ydot: Array) -> Point | None:
        """See `RegularPath.step`."""
        bend = anchor.g if anchor.curvature is None else anchor.curvature
        q, distance = self._predictor(
            anchor.q.tolist(),
            anchor.G.reshape(-1).tolist(),
            bend.tolist(),
            y.tolist(),
            anchor.y.tolist(),
            anchor.ydot.tolist(),
        )
        point = self._solved(q, y, ydot, True)
        if point is not None and point.correction > 0.0:
            point.distance = distance
        return point

    def settle(self, q: Array, y: Array, ydot: Array, contracting: bool = True) -> Point | None:
        """See `RegularPath.settle`."""
        q[self.iq] = y
        return self._solved(q.tolist(), y, ydot, contracting)

    def _solved(self, q: list[float], y: Array, ydot: Array, contracting: bool) -> Point | None:
        try:
            values, worst, correction, iterations = self._solver(q, ydot.tolist(), contracting)
        except (ArithmeticError, ValueError):  # not finite, or a block exactly singular: rare
            return super().settle(np.array(q), y, ydot, contracting)
        self.counters.newton_iterations += iterations
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
    path = RegularPath(mechanism, rows, counters)
    return UnrolledPath(path) if can_unroll(path) else path


def can_unroll(path: RegularPath) -> bool:
    """Few joints, all hinges or slides, cut points only, small blocks of K_d."""
    model = path.tree.model
    return (
        0 < path.nd <= path.tree.nv <= MAX_JOINTS
        and path.m > 0
        and all(isinstance(closure, PointClosure) for closure in path.mechanism.closures)
        and all(len(block.rows) <= MAX_BLOCK for block in path.blocks)
        and all(_axis(model, j) is not None for j in range(1, model.njoints))
    )


_cache: WeakKeyDictionary[Mechanism, dict[tuple[int, ...], tuple[Predictor, Solver]]] = WeakKeyDictionary()


def _compiled(path: RegularPath) -> tuple[Predictor, Solver]:
    """The generated functions, compiled once for each mechanism and choice of rows."""
    known = _cache.setdefault(path.mechanism, {})
    key = tuple(path.rows.tolist())
    if key not in known:
        namespace: dict[str, Any] = {"sin": sin, "cos": cos, "sqrt": sqrt, "isfinite": isfinite, "inf": inf}
        exec(compile(_Generator(path).source(), f"<{path.mechanism.name} unrolled>", "exec"), namespace)
        known[key] = namespace["predict"], namespace["solve"]
    return known[key]


# ------------------------------------------------------------------------- symbolic scalars


class _Lines:
    """Assignments over floats: folds constants, computes equal expressions once."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, str] = {}
        self._count = 0

    def let(self, expression: str) -> str:
        """The variable that holds the expression."""
        if expression not in self.names:
            self.names[expression] = f"t{self._count}"
            self._count += 1
            self.lines.append(f"{self.names[expression]} = {expression}")
        return self.names[expression]

    def product(self, a: Scalar, b: Scalar) -> Scalar:
        """a b."""
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if isinstance(b, float):
            a, b = b, a
        if isinstance(a, float) and abs(a) in (0.0, 1.0):
            return 0.0 if a == 0.0 else b if a == 1.0 else negative(b)
        (sign_a, size_a), (sign_b, size_b) = _signed(a), _signed(b)
        name = self.let(f"{size_a} * {size_b}")
        return name if sign_a == sign_b else f"-{name}"

    def total(self, terms: Sequence[Scalar]) -> Scalar:
        """The sum of the terms."""
        constant = sum(term for term in terms if isinstance(term, float))
        names = [term for term in terms if isinstance(term, str)]
        if not names:
            return constant
        if constant:
            names.append(repr(constant))
        names.sort(key=lambda name: name[0] == "-")  # begin with a positive term
        if len(names) == 1:
            return names[0]
        if names[0][0] == "-":
            return negative(self.total([negative(name) for name in names]))
        return self.let(names[0] + "".join(f" - {n[1:]}" if n[0] == "-" else f" + {n}" for n in names[1:]))

    def dot(self, a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
        """Σ a_i b_i."""
        return self.total([self.product(x, y) for x, y in zip(a, b, strict=True)])

    def add(self, *vectors: Vector) -> Vector:
        """The sum of the vectors."""
        x, y, z = (self.total(entries) for entries in zip(*vectors, strict=True))
        return x, y, z

    def times(self, s: Scalar, a: Vector) -> Vector:
        """s a."""
        return self.product(s, a[0]), self.product(s, a[1]), self.product(s, a[2])

    def cross(self, a: Vector, b: Vector) -> Vector:
        """a × b."""
        return self.cross_entry(a, b, 0), self.cross_entry(a, b, 1), self.cross_entry(a, b, 2)

    def cross_entry(self, a: Vector, b: Vector, r: int) -> Scalar:
        """One entry of a × b."""
        s, t = (r + 1) % 3, (r + 2) % 3
        return self.total([self.product(a[s], b[t]), negative(self.product(a[t], b[s]))])


def _nested(lines: list[str]) -> list[str]:
    """The lines without variables that nobody reads, and with those read once put where they are read."""
    kept: list[str] = []
    reads: Counter[str] = Counter()
    for line in reversed(lines):
        name, _, expression = line.strip().partition(" = ")
        if not _TEMPORARY.fullmatch(name) or reads[name]:
            reads.update(_TEMPORARY.findall(expression if _TEMPORARY.fullmatch(name) else line))
            kept.append(line)
    nested, inner = [], dict[str, str]()
    for line in reversed(kept):
        line = _TEMPORARY.sub(lambda match: inner.get(match[0], match[0]), line)
        name, _, expression = line.strip().partition(" = ")
        if reads[name] == 1 and len(expression) < LONGEST:
            inner[name] = f"({expression})"
        else:
            nested.append(line)
    return nested


def negative(a: Scalar) -> Scalar:
    """−a."""
    if isinstance(a, float):
        return -a
    return a[1:] if a[0] == "-" else f"-{a}"


def _signed(a: Scalar) -> tuple[bool, str]:
    """Whether a is negative by its sign, and what stands behind the sign."""
    text = repr(a) if isinstance(a, float) else a
    return (True, text[1:]) if text[0] == "-" else (False, text)


# ------------------------------------------------------------------------- the mechanism


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


class _Generator:
    """Writes the source for one mechanism."""

    def __init__(self, path: RegularPath) -> None:
        self.path, self.model = path, path.tree.model
        self.out = _Lines()
        mechanism, model = path.mechanism, self.model
        self.unit = 1.0 / mechanism.length
        axes = [_axis(model, j) for j in range(1, model.njoints)]
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
        return "\n".join([*self._predict(), *_nested(self._solve()), ""])

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
        moves = [f"q{v} -= {_text(out.product(float(self.scale[v]), u[v]))}" for v in dependent]
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
        result += map(_text, [*(e for row in G for e in row), *g, *bend, *dets, *rconds])
        worst = f"min({', '.join(map(_text, rconds))}, 1.0)"

        steps = [_signed(e)[1] for e in u.values()]
        sizes = [f"abs({_signed(e)[1]})" for e in phi]
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
                q = _text(planar[1])
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
            size = f"abs({_text(block.det)})"
            if len(block.rows) == 1:
                rconds.append(out.let(f"min({size}, 1.0)"))
                continue
            s = _text(out.dot(block.entries, block.entries))
            root = out.let(f"sqrt(max({s} * {s} - 4.0 * {_text(block.det)} * {_text(block.det)}, 0.0))")
            rconds.append(out.let(f"2.0 * {size} / ({s} + {root})"))
        return [block.det for block in self.blocks], rconds


_End = tuple[int, Vector, Vector]
"""A cut point: its joint, where it is, and where from the joint's origin."""

Entries = dict[tuple[int, int], Scalar]
"""Entries of K by row and velocity."""


@dataclass(frozen=True)
class _Block:
    """A diagonal block of K_d: rows, velocities, entries row by row, determinant and 1 / that."""

    rows: list[int]
    columns: list[int]
    entries: list[Scalar]
    det: Scalar
    inverse: Scalar


def _axis(model: pin.Model, joint: int) -> tuple[bool, Array] | None:
    """Whether the joint is a hinge, and its axis in its own frame; None for other joints than hinge and slide."""
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


def _text(a: Scalar) -> str:
    return repr(a) if isinstance(a, float) else a


def _names(letter: str, count: int) -> str:
    """Target of an unpacking assignment."""
    return "".join(f"{letter}{i}, " for i in range(count))


def _sum(names: Iterable[str]) -> str:
    return " + ".join(names)
