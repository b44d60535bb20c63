"""Rows r(q) of stops, friction and locks in one mechanism: what is watched, held, or acts.

A stop with two limits is two rows. E (n, nv) holds ∂r/∂q of each; a force f on a row is the generalised
force Eᵀ f, and its gap is c = side (r − at).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from ...dynamics.prescribed.drive import Drive
from ...errors import StateError
from ...mechanism.constraint.couplings import MovingCoupling
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import JointFriction, Lock, Part, Stop
from ...mechanism.tree.joints import single_joint
from ...mechanism.tree.tree import Array
from .driven import Driven

GAP = 1e-12
"""m or rad: stops nearer than this at an event are closed, so that impacts at once are solved together."""

BEYOND = 1e-9
"""m or rad by which a start may be beyond its stop, as rounded input."""


class Kind(IntEnum):
    """What a row does."""

    STOP = 0
    SPRING = 1
    FRICTION = 2
    LOCK = 3


@dataclass(frozen=True)
class Row:
    """One row: its kind, its numbers, and the column of the record that its force counts in.

    `at`, `side`, `restitution`, `stiffness` and `damping` are those of stops, `start`, `end` and `when` those
    of locks; `bound` is the largest force of dry friction but for its share of a reaction, the `coefficient`.
    """

    kind: Kind
    part: Part
    column: str
    at: float = 0.0
    side: float = 1.0
    restitution: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    start: float = -np.inf
    end: float = np.inf
    when: Callable[..., Any] | None = None
    bound: float = np.inf
    coefficient: float = 0.0

    @property
    def rubs(self) -> bool:
        """Whether it has dry friction."""
        return self.kind is Kind.FRICTION and (self.bound > 0.0 or self.coefficient > 0.0)

    def closure(self) -> MovingCoupling:
        """r = r* as a closure, r* yet to be told."""
        part = self.part
        second, ratio, more = part.other, part.ratio, tuple(part.more)
        if second is None and more:
            (second, ratio), more = more[0], more[1:]
        return MovingCoupling(part.joint, second, ratio, 0.0, (), more)


class Rows:
    """All rows of some parts in a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    parts : sequence of Stop, JointFriction, Lock
    drive : Drive, optional
        Joints of the mechanism that move as prescribed.

    Attributes
    ----------
    rows : list of Row
    E : ndarray (n, nv)
    places : list of (numbers in q, numbers in v, weights)
        The joints of each.

    Raises
    ------
    ModelError
        For a joint that there is not, or one with several numbers.
    """

    def __init__(self, mechanism: Mechanism, parts: Sequence[Part], drive: Drive | None = None) -> None:
        self.mechanism, self.drive = mechanism, drive
        named = zip(parts, columns_of(parts), strict=True)
        self.rows = [row for part, column in named for row in _rows_of(part, column)]
        n = len(self.rows)
        self._of = {kind: [i for i, row in enumerate(self.rows) if row.kind is kind] for kind in Kind}
        self.places: list[tuple[tuple[int, ...], tuple[int, ...], tuple[float, ...]]] = []
        self.E, self._in_q = np.zeros((n, mechanism.nv)), np.zeros((n, mechanism.nq))
        for i, row in enumerate(self.rows):
            label, weights = f"{type(row.part).__name__} {row.part.joint!r}", row.part.weights
            joints = [single_joint(mechanism.joints, x, label, "choose another") for x in row.part.joints]
            in_q, in_v = tuple(x.idx_q for x in joints), tuple(x.idx_v for x in joints)
            self.E[i, in_v] += weights
            self._in_q[i, in_q] += weights
            self.places.append((in_q, in_v, weights))
        self.at = np.array([row.at for row in self.rows])
        self.side = np.array([row.side for row in self.rows])
        self.bounds = np.array([row.bound for row in self.rows])
        self.rubs = np.array([row.rubs for row in self.rows], dtype=bool)
        self.columns = tuple(dict.fromkeys(row.column for row in self.rows))

    @property
    def signature(self) -> tuple[tuple[object, ...], ...]:
        """What tells these rows from others."""
        return tuple(
            (int(row.kind), row.part.joints, row.part.weights, row.at, row.side) for row in self.rows
        )

    def of(self, kind: Kind) -> list[int]:
        """The rows of a kind."""
        return self._of[kind]

    def driven(self, t: float | None = None) -> Driven | None:
        """What is driven, with its accelerations at a time; with none where only velocities matter."""
        if self.drive is None:
            return None
        iv = self.mechanism.iv_independent[self.drive.driven]
        return Driven(iv, np.zeros(len(iv)) if t is None else self.drive.motion_at(t)[2])

    def values(self, q: Array) -> Array:
        """r, (..., n) for q (..., nq), rad or m."""
        return np.asarray(q @ self._in_q.T)

    def sizes(self, q: Array) -> Array:
        """Σ |weight q|, (..., n): what r is rounded at."""
        return np.asarray(np.abs(q) @ np.abs(self._in_q.T))

    def gaps(self, q: Array) -> Array:
        """c = side (r − at), (..., n); without meaning for rows that are no stops."""
        return self.side * (self.values(q) - self.at)

    def locked(self, t: float, latched: Collection[int] = ()) -> list[int]:
        """Locks that hold at the time t; `latched` are those whose event was."""
        locks = [(i, self.rows[i]) for i in self.of(Kind.LOCK)]
        # open at `end`, as the phase that begins there has it
        return [i for i, x in locks if x.start <= t < x.end and (x.when is None or i in latched)]

    def touched(self, q: Array, v: Array) -> list[int]:
        """Springy stops that are touched at a start, or are about to be at once."""
        gaps, rates = self.gaps(q), self.side * (self.E @ v)
        inner = np.where(rates < 0.0, gaps <= GAP, gaps < -GAP)
        return [i for i in self.of(Kind.SPRING) if inner[i]]

    def closed(self, q: Array) -> list[int]:
        """Rigid stops that are closed at q."""
        gaps = self.gaps(q)
        return [i for i in self.of(Kind.STOP) if gaps[i] <= GAP]

    def names(self, rows: Sequence[int]) -> tuple[str, ...]:
        """Their joints."""
        return tuple(dict.fromkeys(self.rows[i].part.joint for i in rows))

    def require_within(self, q: Array) -> None:
        """Refuse a start beyond a rigid stop by more than rounding."""
        gaps = self.gaps(q)
        for i in self.of(Kind.STOP):
            if gaps[i] < -BEYOND:
                row = self.rows[i]
                which = "lower" if row.side > 0.0 else "upper"
                raise StateError(
                    f"the start is {-gaps[i]:.3g} beyond Stop {row.part.joint!r}, {which} = {row.at}: "
                    f"its row is {float(self.values(q)[i]):.9g} there; start within it"
                )

    def by_column(self, forces: Array) -> dict[str, Array]:
        """Forces (N, n) of the rows, added up by the columns of the record."""
        totals: dict[str, Array] = {name: np.zeros(len(forces)) for name in self.columns}
        for i, row in enumerate(self.rows):
            totals[row.column] += forces[:, i]
        return totals


def _rows_of(part: Part, column: str) -> list[Row]:
    if isinstance(part, Stop):
        kind = Kind.STOP if part.stiffness is None else Kind.SPRING
        numbers = part.restitution, part.stiffness or 0.0, part.damping
        limits = ((part.lower, 1.0), (part.upper, -1.0))
        return [Row(kind, part, column, float(at), side, *numbers) for at, side in limits if at is not None]
    if isinstance(part, Lock):
        end = np.inf if part.end is None else float(part.end)
        return [Row(Kind.LOCK, part, column, start=float(part.start), end=end, when=part.when)]
    return [Row(Kind.FRICTION, part, column, bound=part.bound, coefficient=part.coefficient or 0.0)]


def columns_of(parts: Sequence[Part]) -> list[str]:
    """The column of each part: its kind and joint, with the others of its row where that is not enough."""
    kinds = {Stop: "stop", JointFriction: "friction", Lock: "lock"}
    words = [next(word for kind, word in kinds.items() if isinstance(part, kind)) for part in parts]
    named: dict[tuple[str, str], set[tuple[object, ...]]] = {}
    for word, part in zip(words, parts, strict=True):
        named.setdefault((word, part.joint), set()).add((part.joints, part.weights))
    return [
        f"{word}.{'-'.join(part.joints) if len(named[word, part.joint]) > 1 else part.joint}"
        for word, part in zip(words, parts, strict=True)
    ]
