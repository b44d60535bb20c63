"""One evaluation of the regular path and of ÿ, written out for one mechanism.

From a predicted q: two Newton steps with the K_d there, then G, g, γ'', Gᵀ M G and ÿ at the end (METHOD.md §3;
the paper's equations (2) to (4)). The kernel's own description of the mechanism is evaluated with names in place
of numbers: what is zero or one by construction folds away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..loop_arrays import NotNativeError
from ..path_arrays import MUSCLE, SPRING
from ..structures import Arrays
from .tracing import Tape, Traced, Vector, cross, dot, plus, times

HINGE, SLIDE = 0, 1
"""As in joints.h."""

LARGEST_BLOCK = 3
"""Rows that are solved by cofactors."""

MOST = 40
"""Velocities above which the code would take longer to compile than it saves."""

LOST, DEFINITE = 1e-13, 1e-9
"""Inertia that rounding leaves, as in motion.h; pivots of Gᵀ M G below which the kernel looks."""

Twists = tuple[list[Vector], list[Vector], list[Vector], list[Vector]]


@dataclass(frozen=True)
class Numbers:
    """The kernel's description of a mechanism, by name."""

    structure: Any
    arrays: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.arrays[name]


def described(arrays: Arrays) -> Numbers:
    """What can be written out.

    Raises
    ------
    NotNativeError
        Where it has what these lines do not know.
    """
    d, kept = arrays.structure, arrays._kept
    sound = {
        "joints other than hinges and slides": all(kind in (HINGE, SLIDE) for kind in kept["kind"]),
        "rows of φ other than of positions along axes": all(axis >= 0 for axis in kept["row_axis"]),
        "couplings": d.couplings == 0,
        "point springs or tendons in space": d.lines == 0 and len(kept["stretch_at"]) == 0,
        "muscles, or actuators that share a range": _plain_pulls(kept["pull_at"].reshape(-1, 4)),
        "rows of φ to spare": not d.redundant,
        "prescribed joints": d.driven == 0,
        "too many joints": d.nv <= MOST and d.m > 0,
        "loops that are solved at once": bool(np.all(np.diff(kept["block_start"]) <= LARGEST_BLOCK)),
    }
    for what, good in sound.items():
        if not good:
            raise NotNativeError(what)
    return Numbers(d, kept)


class Stage:
    """The stage of one mechanism.

    Parameters
    ----------
    numbers : Numbers
    """

    def __init__(self, numbers: Numbers) -> None:
        d, kept = numbers.structure, numbers
        self.tape, self.d, self.k = Tape(), d, kept
        self.place, self.inertia = kept["placement"].reshape(-1, 12), kept["inertia"].reshape(-1, 10)
        self.zero = [self.tape.constant(0.0)] * 3
        given = self.tape.given
        self.q, self.c, self.s = ([given(f"{x}[{i}]") for i in range(d.nv)] for x in ("q", "c", "s"))
        self.u, self.tau = [given(f"u[{i}]") for i in range(d.m)], [given(f"tau[{i}]") for i in range(d.nv)]
        controls = int(kept["pull_at"].reshape(-1, 4)[:, 2].max(initial=-1)) + 1
        self.ctrl, self.power = [given(f"ctrl[{i}]") for i in range(controls)], given("power")
        self.ends = self._ends()

    def text(self) -> str:
        """The lines of the stage; places of outputs are those of `Point` in steps.cc."""
        d, kept = self.d, self.k
        scale = kept["scale"]
        out: dict[str, Traced] = {}
        largest: list[Traced] = []
        solver: _Solver | None = None
        for _ in range(2):
            arms = self._put()
            if solver is None:
                solver = _Solver(self, self._jacobian(arms))
            step = solver.solve(self._residual(arms))
            size = self.tape.constant(0.0)
            for j, x in step.items():
                size = size.or_larger(x.absolute()) if size.value is None else x.absolute()
                self._correct(j, x * -float(scale[j]))
            largest.append(size)
        arms = self._put()
        K = self._jacobian(arms)
        last = _Solver(self, K)
        G = self._velocities(last, K)
        v = [_sum([G[a][j] * self.u[a] for a in range(d.m)]) for j in range(d.nv)]
        still = [self.tape.constant(0.0)] * d.nv
        if d.m == 1:
            bend = self._bent(last, arms, G[0], still)
            g = [x * (self.u[0] * self.u[0]) for x in bend]
            out |= {f"out.bend[{i}]": bend[i] for i in range(d.nv)}
        else:
            g = self._bent(last, arms, v, still)
        out |= self._dynamics(G, g, v)
        out |= {f"out.q[{i}]": self.q[i] for i in range(d.nv)} | {f"out.v[{i}]": v[i] for i in range(d.nv)}
        out |= {f"out.G[{i * d.m + a}]": G[a][i] for i in range(d.nv) for a in range(d.m)}
        out |= {f"out.g[{i}]": g[i] for i in range(d.nv)}
        out |= {f"out.det[{i}]": x for i, x in enumerate(last.dets)}
        out |= {f"out.rcond[{i}]": x for i, x in enumerate(last.rconds())}
        out |= {"out.first": largest[0], "out.second": largest[1]}
        return self.tape.written(out)

    # --------------------------------------------------------------------- kinematics

    def _correct(self, j: int, x: Traced) -> None:
        """Move a dependent joint, and its sine and cosine by the first terms of their series."""
        self.q[j] = self.q[j] + x
        if self.k["kind"][j] != HINGE:
            return
        c, s, square = self.c[j], self.s[j], x * x
        sine = x * (self.tape.constant(1.0) - square * (1.0 / 6.0))
        versine = square * (self.tape.constant(0.5) - square * (1.0 / 24.0))
        self.c[j], self.s[j] = c - (c * versine + s * sine), s - (s * versine - c * sine)

    def _put(self) -> list[tuple[Vector, Vector]]:
        """Place all joints' frames, whose axes are columns; returns where the ends of rows are from their joints."""
        one = [[self.tape.constant(float(i == j)) for i in range(3)] for j in range(3)]
        self.R, self.p, self.r = [one], [self.zero], [self.zero]
        for j in range(1, self.d.joints + 1):
            place, parent = self.place[j - 1], int(self.k["parent"][j - 1])
            x, y, z = (self._turned(parent, place[[i, 3 + i, 6 + i]]) for i in range(3))
            r = self._turned(parent, place[9:12])
            if self.k["kind"][j - 1] == HINGE:
                c, s = self.c[j - 1], self.s[j - 1]
                x, y = plus(times(c, x), times(s, y)), plus(times(c, y), times(-s, x))
            else:
                r = plus(r, times(self.q[j - 1], z))
            self.R.append([x, y, z])
            self.r.append(r)
            self.p.append(plus(self.p[parent], r))
        found = []
        for pair in self.ends:
            first, second = (self._turned(joint, point) for joint, point, _ in pair)
            found.append((first, second))
        return found

    def _turned(self, j: int, v: Sequence[float]) -> Vector:
        return plus(*(times(float(v[i]), self.R[j][i]) for i in range(3)))

    def _move(self, v: Sequence[Traced], rate: Sequence[Traced]) -> Twists:
        """ω, velocity and, at joint accelerations `rate`, α and acceleration of each joint's frame."""
        W, U, A, B = ([self.zero] for _ in range(4))
        for j in range(1, self.d.joints + 1):
            i, z, r = int(self.k["parent"][j - 1]), self.R[j][2], self.r[j]
            vz, az = times(v[j - 1], z), times(rate[j - 1], z)
            w, u = W[i], plus(U[i], cross(W[i], r))
            a, b = A[i], plus(B[i], cross(A[i], r), cross(w, cross(w, r)))
            turns = self.k["kind"][j - 1] == HINGE
            W.append(plus(w, vz) if turns else w)
            U.append(u if turns else plus(u, vz))
            A.append(plus(a, az, cross(w, vz)) if turns else a)
            B.append(b if turns else plus(b, az, times(2.0, cross(w, vz))))
        return W, U, A, B

    # --------------------------------------------------------------------- constraint

    def _ends(self) -> list[list[tuple[int, Any, int]]]:
        """Of each row: joint, point in its frame and world axis, on either side."""
        joint, point = self.k["closure_joint"].reshape(-1, 2), self.k["closure_point"].reshape(-1, 6)
        rows = zip(self.k["row_closure"].tolist(), self.k["row_axis"].tolist(), strict=True)
        return [[(int(joint[c, i]), point[c, 3 * i : 3 * i + 3], axis) for i in (0, 1)] for c, axis in rows]

    def _residual(self, arms: list[tuple[Vector, Vector]]) -> list[Traced]:
        found = []
        for row, (pair, arm) in enumerate(zip(self.ends, arms, strict=True)):
            (a, _, x), (b, _, _) = pair
            found.append(
                (self.p[a][x] + arm[0][x] - (self.p[b][x] + arm[1][x])) * float(self.k["row_weight"][row])
            )
        return found

    def _jacobian(self, arms: list[tuple[Vector, Vector]]) -> list[list[Traced]]:
        """K, scaled as the kernel's, (rows, nv)."""
        K = [[self.tape.constant(0.0)] * self.d.nv for _ in self.ends]
        for row, (pair, arm) in enumerate(zip(self.ends, arms, strict=True)):
            chains = [self._carriers(end[0]) for end in pair]
            for side, sign in ((0, 1.0), (1, -1.0)):
                end, axis = pair[side][0], pair[side][2]
                at = plus(self.p[end], arm[side])
                for j in chains[side]:
                    if j in chains[1 - side]:
                        continue  # it moves the loop as a whole
                    z = self.R[j][2]
                    turns = self.k["kind"][j - 1] == HINGE
                    way = cross(z, [a - b for a, b in zip(at, self.p[j], strict=True)]) if turns else z
                    weight = sign * float(self.k["row_weight"][row]) * float(self.k["scale"][j - 1])
                    K[row][j - 1] = K[row][j - 1] + way[axis] * weight
        return K

    def _carriers(self, joint: int) -> list[int]:
        found = []
        while joint > 0:
            found.append(joint)
            joint = int(self.k["parent"][joint - 1])
        return found

    def _velocities(self, solver: _Solver, K: list[list[Traced]]) -> list[list[Traced]]:
        """Columns of G = [I; −K_d⁻¹ K_i]."""
        columns, scale = [], self.k["scale"]
        for i in self.k["independent"].tolist():
            x = solver.solve([-row[i] for row in K])
            one = [self.tape.constant(float(j == i)) for j in range(self.d.nv)]
            columns.append([x[j] * float(scale[j]) if j in x else one[j] for j in range(self.d.nv)])
        return columns

    def _bent(
        self, solver: _Solver, arms: list[tuple[Vector, Vector]], v: list[Traced], still: list[Traced]
    ) -> list[Traced]:
        """[0; K_d⁻¹ k] for velocities v."""
        W, _, A, B = self._move(v, still)
        k = []
        for row, (pair, arm) in enumerate(zip(self.ends, arms, strict=True)):
            pulls = []
            for (j, _, x), lever in zip(pair, arm, strict=True):
                pulls.append(B[j][x] + cross(A[j], lever)[x] + cross(W[j], cross(W[j], lever))[x])
            k.append((pulls[1] - pulls[0]) * float(self.k["row_weight"][row]))
        x, scale = solver.solve(k), self.k["scale"]
        return [x[j] * float(scale[j]) if j in x else self.tape.constant(0.0) for j in range(self.d.nv)]

    # --------------------------------------------------------------------- dynamics

    def _dynamics(self, G: list[list[Traced]], g: list[Traced], v: list[Traced]) -> dict[str, Traced]:
        """ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), and whether Gᵀ M G is sound."""
        d, kept, m = self.d, self.k, self.d.m
        W, _, A, B = self._move(v, g)
        still = [self.tape.constant(0.0)] * d.nv
        units = [self._move(column, still)[:2] for column in G]
        M = [[self.tape.constant(0.0)] * m for _ in range(m)]
        f = [self.tape.constant(0.0)] * m
        gravity = [self.tape.constant(-float(x)) for x in kept["gravity"]]
        for j in range(1, d.joints + 1):
            numbers = self.inertia[j - 1]
            if not numbers.any():
                continue
            mass, lever = float(numbers[0]), self._turned(j, numbers[1:4])
            pull = plus(B[j], cross(A[j], lever), cross(W[j], cross(W[j], lever)), gravity)
            turning = plus(self._moment(j, A[j]), cross(W[j], self._moment(j, W[j])))
            ways = [(w[j], plus(p[j], cross(w[j], lever))) for w, p in units]
            for a, (w, p) in enumerate(ways):
                f[a] = f[a] - (dot(p, pull) * mass + dot(w, turning))
                moment = self._moment(j, w)
                for b, (other, way) in enumerate(ways[: a + 1]):
                    M[a][b] = M[a][b] + dot(p, way) * mass + dot(other, moment)
        act, armature = self._acting(v), kept["armature"]
        for a in range(m):
            f[a] = f[a] + _sum([G[a][j] * (act[j] - g[j] * float(armature[j])) for j in range(d.nv)])
            for b in range(a + 1):
                own = [G[a][j] * G[b][j] * float(armature[j]) for j in range(d.nv)]
                M[a][b] = M[a][b] + _sum(own)
        return self._solved(M, f, G)

    def _moment(self, j: int, w: Vector) -> Vector:
        """A body's inertia times w."""
        xx, xy, yy, xz, yz, zz = (float(x) for x in self.inertia[j - 1][4:])
        own = [dot(w, self.R[j][i]) for i in range(3)]
        rows = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        inner = [_sum([own[i] * row[i] for i in range(3)]) for row in rows]
        return plus(*(times(inner[i], self.R[j][i]) for i in range(3)))

    def _acting(self, v: list[Traced]) -> list[Traced]:
        """τ, with springs of joints, dampers and constant drives."""
        kept = self.k
        found = [
            self.tau[j] + float(kept["drive"][j]) - v[j] * float(kept["damping"][j]) for j in range(self.d.nv)
        ]
        pairs = zip(kept["spring_at"].reshape(-1, 2), kept["spring"].reshape(-1, 2), strict=True)
        for (at, i), (stiffness, rest) in pairs:
            found[i] = found[i] - (self.q[at] - float(rest)) * float(stiffness)
        return self._pulled(found, v)

    def _pulled(self, found: list[Traced], v: list[Traced]) -> list[Traced]:
        """The same with springs along tendons and actuators; see pulls.h."""
        total: list[Any] = [0.0] * self.d.nv
        for (path, law, control, _), c in zip(
            self.k["pull_at"].reshape(-1, 4).tolist(), self.k["pull"].reshape(-1, 15).tolist(), strict=True
        ):
            first, count = self.k["path_at"].reshape(-1, 4)[path][:2].tolist()
            arms = zip(self.k["arm_at"].reshape(-1, 2)[first : first + count].tolist(),
                       self.k["arm"][first : first + count].tolist(), strict=True)  # fmt: skip
            along = [(at, i, c[0] * arm) for (at, i), arm in arms]
            length = _sum([self.q[at] * arm for at, _, arm in along])
            rate = _sum([v[i] * arm for _, i, arm in along])
            if law == SPRING:
                stretch = length - _within(length, c[2], c[3])
                force = stretch * -c[1] - rate * c[4]
                for _, i, arm in along:
                    found[i] = found[i] + force * arm
                continue
            gain, bias = length * c[2] + rate * c[3] + c[1], length * c[5] + rate * c[6] + c[4]
            force = _within(gain * self.ctrl[control] + bias, c[11], c[12])
            for _, i, arm in along:
                total[i] = force * arm + total[i]
        for i, (low, high) in enumerate(self.k["effort"].reshape(-1, 2).tolist()):
            if isinstance(total[i], Traced):
                found[i] = found[i] + _within(total[i], low, high) * self.power
        return found

    def _solved(self, M: list[list[Traced]], f: list[Traced], G: list[list[Traced]]) -> dict[str, Traced]:
        """L D Lᵀ ÿ = f."""
        m, f = self.d.m, list(f)
        D, L = [M[0][0]] * m, [[self.tape.constant(0.0)] * m for _ in range(m)]
        sound = self.tape.constant(np.inf)
        for a in range(m):
            for b in range(a):
                L[a][b] = (M[a][b] - _sum([L[a][n] * L[b][n] * D[n] for n in range(b)])) / D[b]
            D[a] = M[a][a] - _sum([L[a][n] * L[a][n] * D[n] for n in range(a)])
            paces = [(G[a][j] * float(self.k["size"][j])).absolute() for j in range(self.d.nv)]
            pace = paces[0]
            for other in paces[1:]:
                pace = pace.or_larger(other)
            least = (pace * pace * (LOST * float(self.k["own"][0]))).or_larger(M[a][a] * DEFINITE)
            left = D[a] - least if m > 1 else D[a] - pace * pace * (LOST * float(self.k["own"][0]))
            sound = left if sound.value is not None else sound.or_smaller(left)
        for a in range(m):
            f[a] = f[a] - _sum([L[a][n] * f[n] for n in range(a)])
        f = [x / y for x, y in zip(f, D, strict=True)]
        for a in reversed(range(m)):
            f[a] = f[a] - _sum([L[n][a] * f[n] for n in range(a + 1, m)])
        return {f"out.a[{a}]": f[a] for a in range(m)} | {"out.sound": sound}


class _Solver:
    """K_d, block by block, by cofactors as small.h has them."""

    def __init__(self, stage: Stage, K: list[list[Traced]]) -> None:
        self.K, self._stage, d, kept = K, stage, stage.d, stage.k
        self.blocks: list[tuple[list[int], list[int], list[list[Traced]], list[list[Traced]], Traced]] = []
        self.dets: list[Traced] = []
        for b in range(d.blocks):
            at = slice(int(kept["block_start"][b]), int(kept["block_start"][b + 1]))
            rows, columns = kept["block_rows"][at].tolist(), kept["block_columns"][at].tolist()
            own = [[K[r][j] for j in columns] for r in rows]
            adjugate, det = _adjugate(stage.tape, own)
            self.dets.append(det)
            self.blocks.append((rows, columns, own, adjugate, stage.tape.constant(1.0) / det))

    def solve(self, right: list[Traced]) -> dict[int, Traced]:
        """x of the dependent velocities with K_d x = right, by velocity."""
        x: dict[int, Traced] = {}
        for rows, columns, _, adjugate, inverse in self.blocks:
            f = [right[r] - _sum([self.K[r][j] * x[j] for j in x]) for r in rows]
            found = [_sum([a * b for a, b in zip(row, f, strict=True)]) * inverse for row in adjugate]
            x |= dict(zip(columns, found, strict=True))
        return x

    def rconds(self) -> list[Traced]:
        """The conditioning of each block, as small.h has it."""
        tape, found = self._stage.tape, []
        pairs = zip(self.blocks, self.dets, self._stage.k["reference"].tolist(), strict=True)
        for (_, _, own, adjugate, inverse), det, reference in pairs:
            if len(own) == 1:
                found.append(det.absolute().or_smaller(tape.constant(1.0)))
            elif len(own) == 2:
                s = _sum([x * x for row in own for x in row])
                inner = (s * s - det * det * 4.0).or_larger(tape.constant(0.0))
                found.append(det.absolute() * 2.0 / (s + inner.root()).or_larger(tape.constant(1e-300)))
            else:
                stretch = _norm(own) * _norm(adjugate) * inverse.absolute() * float(reference)
                found.append((tape.constant(1.0) / stretch).or_smaller(tape.constant(1.0)))
        return found


def _plain_pulls(pulls: Any) -> bool:
    """Whether all are springs and affine laws, each for itself."""
    return bool(np.all((pulls[:, 1] != MUSCLE) & (pulls[:, 3] < 0)))


def _within(x: Traced, low: float, high: float) -> Traced:
    """x, or the end of a range."""
    if low > -np.inf:
        x = x.or_larger(x.tape.constant(low))
    return x if high == np.inf else x.or_smaller(x.tape.constant(high))


def _norm(rows: list[list[Traced]]) -> Traced:
    """‖A‖₁."""
    sums = [_sum([row[j].absolute() for row in rows]) for j in range(len(rows))]
    most = sums[0]
    for other in sums[1:]:
        most = most.or_larger(other)
    return most


def _adjugate(tape: Tape, a: list[list[Traced]]) -> tuple[list[list[Traced]], Traced]:
    """adj A, with A⁻¹ = adj A / det A; and det A."""
    if len(a) == 1:
        return [[tape.constant(1.0)]], a[0][0]
    if len(a) == 2:
        adjugate = [[a[1][1], -a[0][1]], [-a[1][0], a[0][0]]]
        return adjugate, a[0][0] * a[1][1] - a[0][1] * a[1][0]
    adjugate = []
    for i in range(3):
        row = []
        for j in range(3):
            r, s, c, e = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            row.append(a[r][c] * a[s][e] - a[r][e] * a[s][c])
        adjugate.append(row)
    return adjugate, _sum([a[0][j] * adjugate[j][0] for j in range(3)])


def _sum(numbers: Sequence[Traced]) -> Traced | Any:
    """Their sum; 0.0 of none."""
    found: Any = 0.0
    for number in numbers:
        found = number + found
    return found
