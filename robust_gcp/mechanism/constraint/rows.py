"""Rows of the implicit constraint: what they are, and φ, K and k of those that turn with the bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..tree.joints import Array
from ..tree.vectors import apply, cross
from .closures import AXES, Closure, Direction

ROTATION, ALONG = -1, -2
"""What `Row.axis` says of rows that are no world axis."""


@dataclass(frozen=True)
class Row:
    """One row of the full constraint.

    Attributes
    ----------
    closure : int
        Its position in the list of closures.
    name : str
        x, y, z along the world's axes, n1, n2, … along directions of frame 2; rx, ry, rz where there are
        three rotation rows, r1, r2 else.
    axis : int
        World axis of a position row, `ALONG` for one along a direction of frame 2, else `ROTATION`.
    terms : tuple of (float, direction, direction)
        Weight, u in frame 1, n in frame 2; of a row along a direction, that is n.
    """

    closure: int
    name: str
    axis: int
    terms: tuple[tuple[float, Direction, Direction], ...] = ()


def rows_of(closures: Sequence[Closure]) -> list[Row]:
    """All rows of the closures, closure by closure, position before rotation."""
    rows: list[Row] = []
    for number, closure in enumerate(closures):
        directions = 0
        for along in closure.position_rows():
            if isinstance(along, int):
                rows.append(Row(number, "xyz"[along], along))
                continue
            directions += 1
            rows.append(Row(number, f"n{directions}", ALONG, ((1.0, (0.0, 0.0, 0.0), along),)))
        terms = closure.rotation_terms()
        about = sorted({term[0] for term in terms})
        for row in about:
            name = f"r{'xyz'[row]}" if len(about) == 3 else f"r{row + 1}"
            rows.append(Row(number, name, ROTATION, tuple(t[1:] for t in terms if t[0] == row)))
    return rows


class LoopRows:
    """Rows of closures, all at once: sums of w (a · n).

    a is p₁ − p₂ of a position row, and a direction u fixed in frame 1 of a rotation row; n is fixed in frame
    2, or in the world where the row is along one of its axes. Frames are all firsts, then all seconds.

    Parameters
    ----------
    rows : sequence of Row
    loops : int
        How many closures there are.

    Attributes
    ----------
    turning : bool
        Whether some n turn with their frames.
    """

    def __init__(self, rows: Sequence[Row], loops: int) -> None:
        terms = [(i, row, *term) for i, row in enumerate(rows) for term in row.terms or _along_axis(row)]
        self._first = np.array([row.closure for _, row, *_ in terms], dtype=np.int64)
        self._second, self._loops = self._first + loops, loops
        self._ends = np.array([self._first, self._second])
        self._weight = np.array([weight for _, _, weight, _, _ in terms])[:, None]
        self._u = np.array([u for *_, u, _ in terms]).reshape(-1, 3)
        self._n = np.array([n for *_, n in terms]).reshape(-1, 3)
        axis = np.array([row.axis for _, row, *_ in terms], dtype=np.int64)[:, None]
        self._point, self._turns = axis != ROTATION, axis < 0  # n of both other sorts turns with frame 2
        self.turning = bool(self._turns.any())
        self._entry = (3 * self._first[:, None] + axis).ravel()  # of p₁ − p₂, of rows along the world's axes
        self._starts = np.searchsorted([i for i, *_ in terms], np.arange(len(rows)))

    def residual(self, p: Array, R: Array) -> Array:
        """φ; the frames' places p (npoints, 3), m, and orientations R (npoints, 3, 3)."""
        if not self.turning:  # then a row is one entry of p₁ − p₂, and no sum rounds
            return self._apart(p).take(self._entry)
        return self._sums(self._a(p, R) * self._normals(R)).sum(axis=1)

    def wrenches(self, p: Array, R: Array) -> Array:
        """Force and moment at the world's origin that each row is on body 1, and on body 2, (2, rows, 6).

        (n, p₁ × n) and (n, p₂ × n) where n is fixed in the world. Where n turns with body 2, its ω₂ moves a
        as well: both get the same wrench, (n, p₁ × n) of a position row and (0, u × n) of a rotation row.
        """
        n = self._normals(R)
        return self._wrenches(n, cross(self._arms(p, R), n))

    def wrench_rates(self, p: Array, R: Array, speed: Array, omega: Array) -> Array:
        """d/dt of `wrenches`; velocities of all frames' origins, and ω, in world axes."""
        n, arms, moved = self._normals(R), self._arms(p, R), speed.take(self._ends, 0)
        if not self.turning:
            return self._wrenches(np.zeros_like(n), cross(moved, n))
        turned = self._turns * cross(omega[self._second], n)
        own = np.where(self._point, moved[0], cross(omega[self._first], arms[0]))  # p₁ moves, u turns
        moved = np.where(self._turns, own, moved)
        return self._wrenches(turned, cross(moved, n) + cross(arms, turned))

    def bias(self, p: Array, R: Array, pull: Array, rates: tuple[Array, Array, Array] | None) -> Array:
        """−φ̈ at zero joint acceleration, from the frames' accelerations and, if `turning`, their ṗ, ω and ω̇.

        φ̈ is the sum of w (a″ · n), a seen from where n is fixed, which turns with ω and ω̇: of a point
        d = p₁ − p₂, d′ = ḋ − ω × d and d″ = d̈ − ω̇ × d − ω × (ω × d) − 2 ω × d′; of a direction, with
        w = ω₁ − ω, u′ = w × u and u″ = (ω̇₁ − ω̇ − ω × ω₁) × u + w × u′.
        """
        if rates is None:
            return -self._apart(pull).take(self._entry)
        (speed, omega, alpha), one, two = rates, self._first, self._second
        a, w, dw = self._a(p, R), self._turns * omega[two], self._turns * alpha[two]
        rate = speed[one] - speed[two] - cross(w, a)
        straight = pull[one] - pull[two] - cross(dw, a) - cross(w, cross(w, a)) - 2.0 * cross(w, rate)
        apart = omega[one] - w
        turned = cross(alpha[one] - dw - cross(w, omega[one]), a) + cross(apart, cross(apart, a))
        return -self._sums(np.where(self._point, straight, turned) * self._normals(R)).sum(axis=1)

    def _apart(self, p: Array) -> Array:
        return p[: self._loops] - p[self._loops :]

    def _normals(self, R: Array) -> Array:
        """n of each term in world axes."""
        return np.where(self._turns, apply(R[self._second], self._n), self._n) if self.turning else self._n

    def _arms(self, p: Array, R: Array) -> Array:
        """What n acts at on either body, (2, terms, 3): p₁ or u, and p₂ where n is fixed in the world."""
        ends = p.take(self._ends, 0)
        if not self.turning:
            return ends
        return np.where(self._turns, np.where(self._point, ends[0], apply(R[self._first], self._u)), ends)

    def _a(self, p: Array, R: Array) -> Array:
        return np.where(self._point, self._apart(p)[self._first], apply(R[self._first], self._u))

    def _wrenches(self, n: Array, moments: Array) -> Array:
        """Those of the rows, from forces n of the terms that are positions and all moments, (2, terms, 3)."""
        terms = np.empty((2, len(n), 6))
        # a row of directions is a pure moment
        terms[:, :, :3], terms[:, :, 3:] = self._point * n if self.turning else n, moments
        return self._sums(terms)

    def _sums(self, terms: Array) -> Array:
        """Σ w over the terms of each row, (…, rows, k) from (…, terms, k)."""
        if not self.turning:
            return terms
        # `reduceat` needs a term in each row, which `rows_of` makes sure of
        found: Array = np.add.reduceat(self._weight * terms, self._starts, axis=-2)
        return found


def _along_axis(row: Row) -> tuple[tuple[float, Direction, Direction]]:
    """The one term of a row along an axis of the world."""
    return ((1.0, (0.0, 0.0, 0.0), AXES[row.axis]),)
