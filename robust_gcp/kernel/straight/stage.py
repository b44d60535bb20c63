"""One evaluation of the regular path and of ÿ, written out for one mechanism.

From a predicted q: two Newton steps with the K_d there, then G, g, γ'', Gᵀ M G and ÿ at the end, by the
paper's equations (2) to (4). The kernel's own description of the mechanism is evaluated with names in place
of numbers: what is zero or one by construction folds away.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..path_arrays import SPRING
from .blocks import Blocks
from .kinematics import Arms, Kinematics
from .tracing import Traced, Vector, cross, dot, plus, times, total, within

LOST, DEFINITE = 1e-13, 1e-9
"""Inertia that rounding leaves, as in motion.h; pivots of Gᵀ M G below which the kernel looks."""


class Stage(Kinematics):
    """The stage of one mechanism."""

    def text(self) -> str:
        """The lines of the stage; places of outputs are those of `Point` in steps.cc."""
        d, scale = self.d, self.k["scale"]
        out: dict[str, Traced] = {}
        largest: list[Traced] = []
        solver: Blocks | None = None
        for _ in range(2):
            arms = self.place_all()
            if solver is None:  # kept for both steps: steps.cc tests what that leaves
                solver = Blocks(self.tape, self.k, self.jacobian(arms))
            step = solver.solve(self.residual(arms))
            size = self.tape.constant(0.0)
            for j, change in step.items():
                size = size.or_larger(change.absolute()) if size.value is None else change.absolute()
                self.correct(j, change * -float(scale[j]))
            largest.append(size)
        arms = self.place_all()
        K = self.jacobian(arms)
        last = Blocks(self.tape, self.k, K)
        G = self._velocities(last, K)  # with K at the corrected q, not at the predicted one
        v = [total([G[a][j] * self.u[a] for a in range(d.m)]) for j in range(d.nv)]
        still = [self.tape.constant(0.0)] * d.nv
        if d.m == 1:
            bend = self._bent(last, arms, G[0], still)  # g = γ'' ẏ²: for one coordinate γ'' serves all speeds
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

    def _velocities(self, solver: Blocks, K: list[list[Traced]]) -> list[list[Traced]]:
        """Columns of G = [I; −K_d⁻¹ K_i]."""
        columns, scale = [], self.k["scale"]
        for i in self.k["independent"].tolist():
            x = solver.solve([-row[i] for row in K])
            one = [self.tape.constant(float(j == i)) for j in range(self.d.nv)]
            columns.append([x[j] * float(scale[j]) if j in x else one[j] for j in range(self.d.nv)])
        return columns

    def _bent(self, solver: Blocks, arms: Arms, v: list[Traced], still: list[Traced]) -> list[Traced]:
        """[0; K_d⁻¹ k] for velocities v."""
        W, _, A, B = self.move(v, still)
        k = []
        for row, (pair, arm) in enumerate(zip(self.ends, arms, strict=True)):
            pulls = []
            for (j, _, x), lever in zip(pair, arm, strict=True):
                pulls.append(B[j][x] + cross(A[j], lever)[x] + cross(W[j], cross(W[j], lever))[x])
            k.append((pulls[1] - pulls[0]) * float(self.k["row_weight"][row]))  # k = −K̇ v
        found, scale = solver.solve(k), self.k["scale"]
        return [
            found[j] * float(scale[j]) if j in found else self.tape.constant(0.0) for j in range(self.d.nv)
        ]

    # --------------------------------------------------------------------- dynamics

    def _dynamics(self, G: list[list[Traced]], g: list[Traced], v: list[Traced]) -> dict[str, Traced]:
        """ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), and whether Gᵀ M G is sound."""
        d, kept, m = self.d, self.k, self.d.m
        W, _, A, B = self.move(v, g)
        still = [self.tape.constant(0.0)] * d.nv
        units = [self.move(column, still)[:2] for column in G]  # Kane's partial velocities: all at ẏ_a = 1
        M = [[self.tape.constant(0.0)] * m for _ in range(m)]  # Gᵀ M G, its lower triangle
        f = [self.tape.constant(0.0)] * m
        gravity = [self.tape.constant(-float(x)) for x in kept["gravity"]]  # as if the ground rose
        for j in range(1, d.joints + 1):
            numbers = self.inertia[j - 1]
            if not numbers.any():  # a massless body
                continue
            mass, lever = float(numbers[0]), self.turned(j, numbers[1:4])
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
            f[a] = f[a] + total([G[a][j] * (act[j] - g[j] * float(armature[j])) for j in range(d.nv)])
            for b in range(a + 1):
                own = [G[a][j] * G[b][j] * float(armature[j]) for j in range(d.nv)]
                M[a][b] = M[a][b] + total(own)
        return self._solved(M, f, G)

    def _moment(self, j: int, w: Vector) -> Vector:
        """A body's inertia times w."""
        xx, xy, yy, xz, yz, zz = (float(x) for x in self.inertia[j - 1][4:])
        own = [dot(w, self.R[j][i]) for i in range(3)]
        rows = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        inner = [total([own[i] * row[i] for i in range(3)]) for row in rows]
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
        sums: list[Any] = [0.0] * self.d.nv
        for (path, law, control, _), c in zip(
            self.k["pull_at"].reshape(-1, 4).tolist(), self.k["pull"].reshape(-1, 15).tolist(), strict=True
        ):
            first, count = self.k["path_at"].reshape(-1, 4)[path][:2].tolist()
            arms = zip(self.k["arm_at"].reshape(-1, 2)[first : first + count].tolist(),
                       self.k["arm"][first : first + count].tolist(), strict=True)  # fmt: skip
            along = [(at, i, c[0] * arm) for (at, i), arm in arms]
            length = total([self.q[at] * arm for at, _, arm in along])
            rate = total([v[i] * arm for _, i, arm in along])
            if law == SPRING:
                stretch = length - within(length, c[2], c[3])
                force = stretch * -c[1] - rate * c[4]
                for _, i, arm in along:
                    found[i] = found[i] + force * arm
                continue
            gain, bias = length * c[2] + rate * c[3] + c[1], length * c[5] + rate * c[6] + c[4]
            force = within(gain * self.ctrl[control] + bias, c[11], c[12])
            for _, i, arm in along:
                sums[i] = force * arm + sums[i]
        for i, (low, high) in enumerate(self.k["effort"].reshape(-1, 2).tolist()):
            if isinstance(sums[i], Traced):
                found[i] = found[i] + within(sums[i], low, high) * self.power  # 0 where no control is given
        return found

    def _solved(self, M: list[list[Traced]], f: list[Traced], G: list[list[Traced]]) -> dict[str, Traced]:
        """L D Lᵀ ÿ = f."""
        m, f = self.d.m, list(f)
        D, L = [M[0][0]] * m, [[self.tape.constant(0.0)] * m for _ in range(m)]
        sound = self.tape.constant(np.inf)  # the least of all pivots' margins: one number to test
        for a in range(m):
            for b in range(a):
                L[a][b] = (M[a][b] - total([L[a][n] * L[b][n] * D[n] for n in range(b)])) / D[b]
            D[a] = M[a][a] - total([L[a][n] * L[a][n] * D[n] for n in range(a)])
            paces = [(G[a][j] * float(self.k["size"][j])).absolute() for j in range(self.d.nv)]
            pace = paces[0]
            for other in paces[1:]:
                pace = pace.or_larger(other)
            least = pace * pace * (LOST * float(self.k["own"][0]))
            left = D[a] - (least.or_larger(M[a][a] * DEFINITE) if m > 1 else least)
            sound = left if sound.value is not None else sound.or_smaller(left)
        for a in range(m):
            f[a] = f[a] - total([L[a][n] * f[n] for n in range(a)])
        f = [x / y for x, y in zip(f, D, strict=True)]
        for a in reversed(range(m)):
            f[a] = f[a] - total([L[n][a] * f[n] for n in range(a + 1, m)])
        return {f"out.a[{a}]": f[a] for a in range(m)} | {"out.sound": sound}
