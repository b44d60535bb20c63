"""Planar linkages in seventy decimal digits: the reduced equations from nothing but geometry and energies.

Bodies move in the y-z plane on hinges about x and slides along y or z, closed by points. M is the sum over
bodies, forces are differences of the energies; differences lose half the digits, of which there are enough.
"""

from __future__ import annotations

from decimal import Decimal, getcontext
from functools import cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.mechanism.constraint.closures import closure_frames

Vector = list[Decimal]
Matrix = list[Vector]

DIGITS = 70
ZERO, ONE = Decimal(0), Decimal(1)
SMALL = Decimal("1e-20")
"""Step of central differences of smooth functions: errors of 1e-40 and 1e-50."""

NEAR = Decimal("1e-10")
"""How near to a singular place limits are taken: errors of 1e-20."""


@cache
def pi() -> Decimal:
    """By Machin's formula."""
    getcontext().prec = DIGITS

    def arctan(n: int) -> Decimal:
        term, total, k = ONE / n, ZERO, 0
        while abs(term) > Decimal(10) ** -DIGITS:
            total += (-1) ** k * term / (2 * k + 1)
            term, k = term / (n * n), k + 1
        return total

    return 4 * (4 * arctan(5) - arctan(239))


def turned(angle: Decimal) -> tuple[Decimal, Decimal]:
    """Cosine and sine."""
    angle = angle % (2 * pi())
    c, s, term, k = ZERO, ZERO, ONE, 0
    while k < 8 or abs(term) > Decimal(10) ** -DIGITS:
        if k % 2:
            s += (-1) ** (k // 2) * term
        else:
            c += (-1) ** (k // 2) * term
        k += 1
        term = term * angle / k
    return c, s


def solve(A: Matrix, B: Matrix) -> Matrix:
    """A⁻¹ B by elimination with pivots; of more rows than columns by their squares."""
    n = len(A[0])
    if len(A) > n:
        across = list(zip(*A, strict=True))
        A, B = ([[_dot(a, b) for b in zip(*other, strict=True)] for a in across] for other in (A, B))
    rows = [list(a) + list(b) for a, b in zip(A, B, strict=True)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(rows[r][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for r in range(n):
            if r != i:
                factor = rows[r][i]
                rows[r] = [x - factor * p for x, p in zip(rows[r], rows[i], strict=True)]
    return [row[n:] for row in rows]


class Exact:
    """A mechanism's reduced equations in `DIGITS` digits.

    Parameters
    ----------
    mech : Mechanism
        Planar, with point closures and couplings of two joints alone.
    """

    def __init__(self, mech: rg.Mechanism) -> None:
        getcontext().prec = DIGITS
        model = mech.model
        self.mech, self.nv, self.m = mech, mech.nv, mech.m
        self.slides = [
            model.joints[j].shortname().removeprefix("JointModel") for j in range(1, model.njoints)
        ]
        self.parent = [int(p) - 1 for p in list(model.parents)[1:]]
        self.i, self.d = (list(map(int, part)) for part in (mech.iv_independent, mech.iv_dependent))
        self._read(model, closure_frames(model, mech.loops))
        numbers = {str(model.names[j]): j - 1 for j in range(1, model.njoints)}
        self.couplings = [
            (numbers[c.joint1], numbers[str(c.joint2)], [Decimal(float(x)) for x in c.coefficients])
            for c in mech.closures
            if isinstance(c, rg.CouplingClosure)
        ]

    def _read(self, model: pin.Model, frames: list[tuple[int, pin.SE3]]) -> None:
        """Placements, bodies, the closures' ends and gravity."""
        assert set(self.slides) <= {"RX", "PY", "PZ"}
        self.place = [_plane(model.jointPlacements[j]) for j in range(1, model.njoints)]
        self.body = [
            (Decimal(b.mass), _point(b.lever), Decimal(float(b.inertia[0, 0])))
            for b in list(model.inertias)[1:]
        ]
        self.ends = [(joint - 1, _plane(place)) for joint, place in frames]
        self.gravity = Decimal(float(model.gravity.linear[2]))

    def places(self, q: Vector) -> list[tuple[Decimal, Decimal, Decimal, Decimal]]:
        """Origin, cosine and sine of each body."""
        found: list[tuple[Decimal, Decimal, Decimal, Decimal]] = []
        angles: list[Decimal] = []
        for kind, parent, (y, z), value in zip(self.slides, self.parent, self.place, q, strict=True):
            oy, oz, c, s = found[parent] if parent >= 0 else (ZERO, ZERO, ONE, ZERO)
            angle = angles[parent] if parent >= 0 else ZERO
            if kind == "RX":
                angle += value
            else:
                y, z = (y + value, z) if kind == "PY" else (y, z + value)
            angles.append(angle)
            found.append((oy + c * y - s * z, oz + s * y + c * z, *turned(angle)))
        return found

    def point(self, places: list[tuple[Decimal, ...]], body: int, at: tuple[Decimal, Decimal]) -> Matrix:
        """[y, z] of a point, and its Jacobian's two rows."""
        oy, oz, c, s = places[body] if body >= 0 else (ZERO, ZERO, ONE, ZERO)
        y, z = oy + c * at[0] - s * at[1], oz + s * at[0] + c * at[1]
        rows = [[y, z], [ZERO] * self.nv, [ZERO] * self.nv]
        while body >= 0:
            parent = self.parent[body]
            c, s = places[parent][2:] if parent >= 0 else (ONE, ZERO)
            if self.slides[body] == "RX":
                rows[1][body], rows[2][body] = places[body][1] - z, y - places[body][0]
            elif self.slides[body] == "PY":
                rows[1][body], rows[2][body] = c, s
            else:
                rows[1][body], rows[2][body] = -s, c
            body = parent
        return rows

    def loops(self, q: Vector) -> tuple[Vector, Matrix]:
        """φ and K."""
        places, half = self.places(q), len(self.ends) // 2
        phi, K = [], []
        for one, two in zip(self.ends[:half], self.ends[half:], strict=True):
            a, b = self.point(places, *one), self.point(places, *two)
            phi += [x - y for x, y in zip(a[0], b[0], strict=True)]
            K += [[x - y for x, y in zip(r, s, strict=True)] for r, s in zip(a[1:], b[1:], strict=True)]
        for one, two, numbers in self.couplings:
            row = [ZERO] * self.nv
            row[one], row[two] = ONE, -sum(k * c * q[two] ** (k - 1) for k, c in enumerate(numbers) if k)
            phi.append(q[one] - sum(c * q[two] ** k for k, c in enumerate(numbers)))
            K.append(row)
        return phi, K

    def inertia(self, q: Vector) -> tuple[Matrix, Decimal]:
        """M and the potential energy."""
        places, M, energy = self.places(q), [[ZERO] * self.nv for _ in range(self.nv)], ZERO
        for body, (mass, centre, about) in enumerate(self.body):
            at, *rows = self.point(places, body, centre)
            energy -= mass * self.gravity * at[1]
            turning = [ONE if self._turns(body, j) else ZERO for j in range(self.nv)]
            for i in range(self.nv):
                for j in range(self.nv):
                    M[i][j] += mass * (rows[0][i] * rows[0][j] + rows[1][i] * rows[1][j])
                    M[i][j] += about * turning[i] * turning[j]
        return M, energy

    def _turns(self, body: int, j: int) -> bool:
        while body >= 0 and body != j:
            body = self.parent[body]
        return body == j and self.slides[j] == "RX"

    def closed(self, guess: Vector, y: Vector) -> Vector:
        """Newton on the dependent joints."""
        q = list(guess)
        for k, value in zip(self.i, y, strict=True):
            q[k] = value
        for _ in range(30):
            phi, K = self.loops(q)
            step = solve([[row[k] for k in self.d] for row in K], [[x] for x in phi])
            for k, (change,) in zip(self.d, step, strict=True):
                q[k] -= change
            if max(abs(change) for (change,) in step) < Decimal(10) ** -(DIGITS // 2 + 5):
                return q
        raise AssertionError("no closed configuration near the guess")

    def forward(self, q: Vector, u: Vector) -> tuple[Vector, Matrix]:
        """u̇ and (Gᵀ M G)⁻¹ Gᵀ at a closed q."""
        _, K = self.loops(q)
        K_d = [[row[k] for k in self.d] for row in K]
        right = solve(K_d, [[-row[k] for k in self.i] for row in K])
        G = [[ZERO] * self.m for _ in range(self.nv)]
        for j, k in enumerate(self.i):
            G[k][j] = ONE
        for row, k in zip(right, self.d, strict=True):
            G[k] = row
        v = [_dot(row, u) for row in G]
        ahead, behind = ([x + s * SMALL * w for x, w in zip(q, v, strict=True)] for s in (1, -1))
        bias = [
            [-_dot([(x - y) / (2 * SMALL) for x, y in zip(a, b, strict=True)], v)]
            for a, b in zip(self.loops(ahead)[1], self.loops(behind)[1], strict=True)
        ]
        g = [ZERO] * self.nv
        for row, k in zip(solve(K_d, bias), self.d, strict=True):
            g[k] = row[0]
        M, _ = self.inertia(q)
        rate = zip(self.inertia(ahead)[0], self.inertia(behind)[0], strict=True)
        C = [_dot([(x - y) / (2 * SMALL) for x, y in zip(a, b, strict=True)], v) for a, b in rate]
        for k in range(self.nv):
            moved = []
            for sign in (1, -1):
                other = list(q)
                other[k] += sign * SMALL
                inertia, energy = self.inertia(other)
                moved.append(_dot(v, [_dot(row, v) for row in inertia]) / 2 - energy)
            C[k] -= (moved[0] - moved[1]) / (2 * SMALL)
        force = [-c - _dot(row, g) for c, row in zip(C, M, strict=True)]
        columns = [[row[j] for row in G] for j in range(self.m)]
        Mr = [[_dot(a, [_dot(row, b) for row in M]) for b in columns] for a in columns]
        lifted = solve(Mr, columns)
        return [_dot(row, force) for row in lifted], lifted

    def at_singularity(
        self, q: Vector, tangent: NDArray[np.float64], u: NDArray[np.float64], across: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """u̇, ∂u̇/∂y, ∂u̇/∂u and ∂u̇/∂τ on the mode with this tangent (nv, m), as limits from both sides.

        `across` (m,) leads out of the singular surface.
        """
        h, speed = NEAR, [Decimal(float(x)) for x in u]
        block = tangent[self.i]
        G = tangent @ np.linalg.inv(block)

        def limit(shift: Vector, rate: Vector) -> tuple[Vector, Matrix]:
            """Even part in the way across, of order 4 by Richardson's extrapolation."""
            found = []
            for size in (1, 2):
                for sign in (1, -1):
                    dy = [s + sign * size * h * Decimal(float(a)) for s, a in zip(shift, across, strict=True)]
                    guess = [
                        x + _dot([Decimal(float(e)) for e in row], dy) for x, row in zip(q, G, strict=True)
                    ]
                    at = self.closed(guess, [q[k] + s for k, s in zip(self.i, dy, strict=True)])
                    udot, lifted = self.forward(at, rate)
                    found.append([*udot, *(x for row in lifted for x in row)])
            near, far = ([(a + b) / 2 for a, b in zip(*found[k : k + 2], strict=True)] for k in (0, 2))
            flat = [(4 * a - b) / 3 for a, b in zip(near, far, strict=True)]
            rows = [flat[self.m + k * self.nv : self.m + (k + 1) * self.nv] for k in range(self.m)]
            return flat[: self.m], rows

        still = [ZERO] * self.m
        udot, lifted = limit(still, speed)
        by_y, by_u = [], []
        for j in range(self.m):
            pair = []
            for sign in (1, -1):
                shift = list(still)
                shift[j] += sign * 16 * h
                pair.append(limit(shift, speed)[0])
            by_y.append([(a - b) / (32 * h) for a, b in zip(*pair, strict=True)])
            pair = []
            for sign in (1, -1):
                rate = list(speed)
                rate[j] += sign
                pair.append(limit(still, rate)[0])
            by_u.append([(a - b) / 2 for a, b in zip(*pair, strict=True)])
        arrays = (udot, by_y, by_u, lifted)
        values = [np.array([[float(x) for x in row] for row in part]) for part in arrays[1:]]
        return np.array([float(x) for x in udot]), values[0].T, values[1].T, values[2]


def _dot(a: Vector, b: Vector) -> Decimal:
    return sum((x * y for x, y in zip(a, b, strict=True)), ZERO)


def _point(at: NDArray[np.float64]) -> tuple[Decimal, Decimal]:
    return Decimal(float(at[1])), Decimal(float(at[2]))


def _plane(place: pin.SE3) -> tuple[Decimal, Decimal]:
    assert np.array_equal(place.rotation, np.eye(3)), "links along y at q = 0 only"
    return _point(place.translation)
