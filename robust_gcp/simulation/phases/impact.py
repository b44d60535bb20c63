"""Impulses: v⁺ = v⁻ + G M_r⁻¹ Gᵀ Eᵀ P where stops are met or locks close.

Newton's restitution for stops, 0 ≤ P ⊥ E v⁺ + e ∘ min(E v⁻, 0) ≥ 0, and E v⁺ = 0 for locks. Dry friction is
bounded, so that it has no impulse: sticking joints do not hold against impacts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import SimulationError
from ...maps.classical import SingularityWarning
from ...maps.start_check import require_compatible
from ...mechanism.tolerances import NEARLY_CLOSED
from ...mechanism.tree import Array
from ...warning import warn
from .box import box
from .frame import Frame, Seen
from .parts import parts_given
from .rows import Kind, Rows

REST = 1e-6
"""m/s or rad/s: below, an impact is plastic. What is dropped is v²/2a of height and 2v/a of time."""

DEAD = 1e-3
"""Share of the most that a stop's row can be moved below which its joint is at a dead point."""

MOST = 20
"""Impacts after each other at one instant."""

Tell = Callable[[str, Sequence[int], float], None]
"""kind, rows, loss."""


class Impact(NamedTuple):
    """What an impulse does.

    Attributes
    ----------
    v : ndarray (nv,)
        Velocity after it.
    impulses : dict of str to float
        N s or N m s, by "stop.q1" or "lock.q2".
    loss : float
        Energy lost, J.
    """

    v: Array
    impulses: dict[str, float]
    loss: float


def struck(
    rows: Rows, q: Array, v: Array, stops: Sequence[int], locks: Sequence[int], seen: Seen | None
) -> tuple[Array, Array, float, float] | None:
    """One impulse of closed stops and of locks: v⁺, P by row, the loss, the least share that moves a stop.

    None where nothing has to change.
    """
    struck_rows, n = [*stops, *locks], len(stops)
    E = rows.side[struck_rows][:, None] * rows.E[struck_rows]
    w, size = E @ v, float(np.abs(v).max(initial=0.0))
    tiny = 1e-13 + 1e-12 * size
    if not (np.any(w[:n] < -tiny) or np.any(np.abs(w[n:]) > tiny)):
        return None
    frame = Frame(rows.mechanism, q, v, None, seen)
    B = frame.rows(E)
    e = np.array([rows.rows[i].restitution for i in struck_rows])
    e[w >= -REST] = 0.0
    lower = np.where(np.arange(len(w)) < n, 0.0, -np.inf)
    P, _ = box(B, w + e * np.minimum(w, 0.0), lower, np.full(len(w), np.inf), size)
    after = v + frame.kick(B @ P)
    loss = 0.5 * float(v @ frame.M @ v - after @ frame.M @ after)
    impulses = np.zeros(len(rows.rows))
    impulses[struck_rows] = rows.side[struck_rows] * P
    shares = frame.shares(E, B)[:n][(P[:n] > 0.0) & (w[:n] < -REST)]
    return after, impulses, loss, float(shares.min(initial=1.0))


def settled_impacts(rows: Rows, t: float, q: Array, v: Array, seen: Seen | None, tell: Tell) -> Array:
    """v⁺ where no closed stop is approached any more and locks rest.

    Raises
    ------
    SimulationError
    """
    locks, stops = rows.locked(t), rows.closed(q)
    if not (locks or stops):
        return v
    for _ in range(MOST):
        found = struck(rows, q, v, stops, locks, seen)
        if found is None:
            return v
        w = rows.side * (rows.E @ v)
        met = [i for i in stops if w[i] < -REST] or [i for i in locks if abs(w[i]) > REST]
        v, _, loss, share = found
        if met:
            kind = "lock" if rows.rows[met[0]].kind is Kind.LOCK else "impact"
            if kind == "impact" and share < DEAD:
                kind = "grazing"
                warn(
                    f"at t = {t:.6g} s the stop of {', '.join(rows.names(met))} is met beside a dead point "
                    "of its joint: what follows depends on the stop's place without bound",
                    SingularityWarning,
                )
            tell(kind, met, loss)
    raise SimulationError(f"at t = {t:.6g} s impacts of {', '.join(rows.names(stops))} do not come to an end")


def impact(mechanism: Any, q: ArrayLike, v: ArrayLike, joints: Sequence[Any]) -> Impact:
    """`Mechanism.impact`."""
    at, before = mechanism.configuration(q), mechanism.velocity(v)
    mechanism.require_closed(at, NEARLY_CLOSED, "impact: q")
    require_compatible(mechanism, at, before)
    rows = Rows(mechanism, parts_given(joints))
    rows.require_within(at)
    locks, stops = rows.of(Kind.LOCK), rows.closed(at)
    found = struck(rows, at, before, stops, locks, Seen(before, np.zeros_like(before), before))
    forces = np.zeros(len(rows.rows)) if found is None else found[1]
    impulses = {name: float(values[0]) for name, values in rows.by_column(forces[None]).items()}
    impulses = {name: value for name, value in impulses.items() if not name.startswith("friction.")}
    return Impact(before.copy(), impulses, 0.0) if found is None else Impact(found[0], impulses, found[2])
