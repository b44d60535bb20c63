"""Rows of the implicit constraint: what they are, and φ, K and k of those that turn with the bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..tree.joints import Array
from ..tree.vectors import apply, cross
from .closures import Closure, Direction, Index

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


class RotationRows:
    """Σ w (u · n) rows: u fixed in frame 1 and n in frame 2 of a closure."""

    def __init__(self, rows: Index, layout: Sequence[Row], loops: int) -> None:
        chosen = _chosen(rows, layout, ROTATION)
        terms = [(i, row.closure, term) for i, row in chosen for term in row.terms]
        self.at = np.array([i for i, _ in chosen])
        self._owner = np.searchsorted(self.at, [row for row, _, _ in terms])
        self._weight = np.array([t[0] for _, _, t in terms])
        self._first = np.array([i for _, i, _ in terms])
        self._second = self._first + loops
        self._u_local = np.array([t[1] for _, _, t in terms])[:, :, None]
        self._n_local = np.array([t[2] for _, _, t in terms])[:, :, None]

    def _placed(self, R: Array) -> tuple[Array, Array]:
        """u and n of each term in world axes; R (npoints, 3, 3) are the frames' orientations."""
        return (R[self._first] @ self._u_local)[:, :, 0], (R[self._second] @ self._n_local)[:, :, 0]

    def residual(self, R: Array) -> Array:
        """Σ w u · n of each row."""
        return self._sum(np.einsum("ij,ij->i", *self._placed(R)))

    def normals(self, R: Array) -> Array:
        """Σ w u × n of each row, (rows, 3): φ̇ = (ω₁ − ω₂) · Σ w u × n."""
        crossed = cross(*self._placed(R)) * self._weight[:, None]
        normals = np.zeros((len(self.at), 3))
        np.add.at(normals, self._owner, crossed)
        return normals

    def normal_rates(self, R: Array, omega: Array) -> Array:
        """d/dt of `normals`, ω of all frames in world axes."""
        w1, w2 = omega[self._first], omega[self._second]
        u, n = self._placed(R)
        rates = np.zeros((len(self.at), 3))
        turned = cross(cross(w1, u), n) + cross(u, cross(w2, n))
        np.add.at(rates, self._owner, turned * self._weight[:, None])
        return rates

    def bias(self, R: Array, omega: Array, alpha: Array) -> Array:
        """−d/dt (φ̇) at zero joint acceleration; ω and α of all frames in world axes."""
        w1, w2 = omega[self._first], omega[self._second]
        u, n = self._placed(R)
        normal = cross(u, n)  # of the term alone: weights come with the sum
        rate = cross(cross(w1, u), n) + cross(u, cross(w2, n))
        turning = np.einsum("ij,ij->i", alpha[self._first] - alpha[self._second], normal)
        return -self._sum(turning + np.einsum("ij,ij->i", w1 - w2, rate))

    def _sum(self, terms: Array) -> Array:
        summed = np.bincount(self._owner, terms * self._weight, minlength=len(self.at))
        return np.asarray(summed, dtype=float)


class RowsAlong:
    """n · (p₁ − p₂) rows: n fixed in frame 2 of a closure, d = p₁ − p₂."""

    def __init__(self, rows: Index, layout: Sequence[Row], loops: int) -> None:
        chosen = _chosen(rows, layout, ALONG)
        self.at = np.array([i for i, _ in chosen])
        self._first = np.array([row.closure for _, row in chosen])
        self._second = self._first + loops
        self._n_local = np.array([row.terms[0][2] for _, row in chosen])

    def residual(self, p: Array, R: Array) -> Array:
        """n · d of each row; the frames' places p (npoints, 3), m, and orientations R (npoints, 3, 3)."""
        return np.asarray(np.einsum("ij,ij->i", self._n(R), p[self._first] - p[self._second]))

    def wrenches(self, p: Array, R: Array) -> Array:
        """(n, p₁ × n), (rows, 6): φ̇ = n · (ṗ₁ − ṗ₂ − ω₂ × d), the first point moved by either body."""
        n = self._n(R)
        return np.hstack([n, cross(p[self._first], n)])

    def wrench_rates(self, p: Array, R: Array, speed: Array, omega: Array) -> Array:
        """d/dt of `wrenches`; velocities of all frames' origins and ω in world axes."""
        n = self._n(R)
        turned = cross(omega[self._second], n)
        return np.hstack([turned, cross(speed[self._first], n) + cross(p[self._first], turned)])

    def bias(self, p: Array, R: Array, speed: Array, pull: Array, omega: Array, alpha: Array) -> Array:
        """−d/dt (φ̇) at zero joint acceleration, from velocities and accelerations of all frames."""
        first, second, n = self._first, self._second, self._n(R)
        w = omega[second]
        rate = cross(w, n)
        bend = cross(alpha[second], n) + cross(w, rate)
        changes = n * (pull[first] - pull[second]) + 2.0 * rate * (speed[first] - speed[second])
        return np.asarray(-(changes + bend * (p[first] - p[second])).sum(axis=1))

    def _n(self, R: Array) -> Array:
        return apply(R[self._second], self._n_local)


def _chosen(rows: Index, layout: Sequence[Row], axis: int) -> list[tuple[int, Row]]:
    """The chosen rows of one sort, with their places among all that are chosen."""
    return [
        (i, layout[full]) for i, full in enumerate(rows) if full < len(layout) and layout[full].axis == axis
    ]
