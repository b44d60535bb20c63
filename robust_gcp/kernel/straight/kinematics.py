"""Where the joints and the cut points of a mechanism are and how they move, written out; φ and K."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .blocks import REVOLUTE, Numbers
from .tracing import Tape, Traced, Vector, cross, plus, times

Twists = tuple[list[Vector], list[Vector], list[Vector], list[Vector]]

Arms = list[tuple[Vector, Vector]]
"""Of each row: from the joints' frames to the cut points."""


class Kinematics:
    """A mechanism's joints at q, by name.

    Parameters
    ----------
    numbers : Numbers
    """

    def __init__(self, numbers: Numbers) -> None:
        self.tape, self.k, self.d = Tape(), numbers, numbers.structure
        d = self.d
        self.place, self.inertia = numbers["placement"].reshape(-1, 12), numbers["inertia"].reshape(-1, 10)
        self.zero = [self.tape.constant(0.0)] * 3
        given = self.tape.given
        self.q, self.c, self.s = ([given(f"{x}[{i}]") for i in range(d.nv)] for x in ("q", "c", "s"))
        self.u, self.tau = [given(f"u[{i}]") for i in range(d.m)], [given(f"tau[{i}]") for i in range(d.nv)]
        controls = int(numbers["pull_at"].reshape(-1, 4)[:, 2].max(initial=-1)) + 1
        self.ctrl, self.power = [given(f"ctrl[{i}]") for i in range(controls)], given("power")
        self.ends = self._ends()

    def correct(self, j: int, x: Traced) -> None:
        """Move a dependent joint, and its sine and cosine by the first terms of their series."""
        self.q[j] = self.q[j] + x
        if self.k["kind"][j] != REVOLUTE:
            return
        c, s, square = self.c[j], self.s[j], x * x
        # up to x = 1e-3, beyond which steps.cc leaves the step, these err below rounding
        sine = x * (self.tape.constant(1.0) - square * (1.0 / 6.0))
        versine = square * (self.tape.constant(0.5) - square * (1.0 / 24.0))
        # by 1 − cos x, which is small with x, so that nothing cancels
        self.c[j], self.s[j] = c - (c * versine + s * sine), s - (s * versine - c * sine)

    def place_all(self) -> Arms:
        """Place all joints' frames, whose axes are columns; where the ends of rows are from their joints."""
        one = [[self.tape.constant(float(i == j)) for i in range(3)] for j in range(3)]
        self.R, self.p, self.r = [one], [self.zero], [self.zero]
        for j in range(1, self.d.joints + 1):
            place, parent = self.place[j - 1], int(self.k["parent"][j - 1])
            x, y, z = (self.turned(parent, place[[i, 3 + i, 6 + i]]) for i in range(3))
            r = self.turned(parent, place[9:12])
            if self.k["kind"][j - 1] == REVOLUTE:
                c, s = self.c[j - 1], self.s[j - 1]
                x, y = plus(times(c, x), times(s, y)), plus(times(c, y), times(-s, x))
            else:
                r = plus(r, times(self.q[j - 1], z))
            self.R.append([x, y, z])
            self.r.append(r)
            self.p.append(plus(self.p[parent], r))
        found = []
        for pair in self.ends:
            first, second = (self.turned(joint, point) for joint, point, _ in pair)
            found.append((first, second))
        return found

    def turned(self, j: int, v: Sequence[float]) -> Vector:
        """A vector of a joint's frame, in the world's axes."""
        return plus(*(times(float(v[i]), self.R[j][i]) for i in range(3)))

    def move(self, v: Sequence[Traced], rate: Sequence[Traced]) -> Twists:
        """ω, velocity and, at joint accelerations `rate`, α and acceleration of each joint's frame."""
        W, U, A, B = ([self.zero] for _ in range(4))
        for j in range(1, self.d.joints + 1):
            i, z, r = int(self.k["parent"][j - 1]), self.R[j][2], self.r[j]
            vz, az = times(v[j - 1], z), times(rate[j - 1], z)
            w, u = W[i], plus(U[i], cross(W[i], r))
            a, b = A[i], plus(B[i], cross(A[i], r), cross(w, cross(w, r)))
            turns = self.k["kind"][j - 1] == REVOLUTE
            W.append(plus(w, vz) if turns else w)
            U.append(u if turns else plus(u, vz))
            A.append(plus(a, az, cross(w, vz)) if turns else a)
            B.append(b if turns else plus(b, az, times(2.0, cross(w, vz))))  # a slide's Coriolis acceleration
        return W, U, A, B

    # --------------------------------------------------------------------- constraint

    def _ends(self) -> list[list[tuple[int, Any, int]]]:
        """Of each row: joint, point in its frame and world axis, on either side."""
        joint, point = self.k["closure_joint"].reshape(-1, 2), self.k["closure_point"].reshape(-1, 6)
        rows = zip(self.k["row_closure"].tolist(), self.k["row_axis"].tolist(), strict=True)
        return [[(int(joint[c, i]), point[c, 3 * i : 3 * i + 3], axis) for i in (0, 1)] for c, axis in rows]

    def residual(self, arms: Arms) -> list[Traced]:
        """φ, scaled as the kernel's."""
        found = []
        for row, (pair, arm) in enumerate(zip(self.ends, arms, strict=True)):
            (a, _, x), (b, _, _) = pair
            found.append(
                (self.p[a][x] + arm[0][x] - (self.p[b][x] + arm[1][x])) * float(self.k["row_weight"][row])
            )
        return found

    def jacobian(self, arms: Arms) -> list[list[Traced]]:
        """K, scaled as the kernel's, (rows, nv)."""
        K = [[self.tape.constant(0.0)] * self.d.nv for _ in self.ends]
        for row, (pair, arm) in enumerate(zip(self.ends, arms, strict=True)):
            chains = [self.carriers(end[0]) for end in pair]
            for side, sign in ((0, 1.0), (1, -1.0)):
                end, axis = pair[side][0], pair[side][2]
                at = plus(self.p[end], arm[side])
                for j in chains[side]:
                    if j in chains[1 - side]:
                        continue  # it moves the loop as a whole
                    z = self.R[j][2]
                    turns = self.k["kind"][j - 1] == REVOLUTE
                    way = cross(z, [a - b for a, b in zip(at, self.p[j], strict=True)]) if turns else z
                    weight = sign * float(self.k["row_weight"][row]) * float(self.k["scale"][j - 1])
                    K[row][j - 1] = K[row][j - 1] + way[axis] * weight
        return K

    def carriers(self, joint: int) -> list[int]:
        """The joints that carry a body, its own first."""
        found = []
        while joint > 0:
            found.append(joint)
            joint = int(self.k["parent"][joint - 1])
        return found
