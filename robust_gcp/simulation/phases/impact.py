"""Impulses: v⁺ = v⁻ + G M_r⁻¹ Gᵀ Eᵀ P where stops are met or locks close.

Newton's restitution for stops, 0 ≤ P ⊥ E v⁺ + e ∘ min(E v⁻, 0) ≥ 0, and E v⁺ = 0 for locks. Dry friction is
bounded, so that it has no impulse: sticking joints do not hold against impacts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_mechanism
from ...dynamics.prescribed.drive import Drive
from ...errors import SimulationError
from ...maps.classical import SingularityWarning
from ...maps.start_check import require_compatible
from ...mechanism.mechanism import Mechanism
from ...mechanism.parts import parts_given
from ...mechanism.tolerances import NEARLY_CLOSED
from ...mechanism.tree.tree import Array
from ...warning import warn
from .admissible import Frame, Seen
from .quadratic_programs import box
from .rows import Kind, Rows

REST = 1e-6
"""m/s or rad/s: below, an impact is plastic. What is dropped is v²/2a of height and 2v/a of time."""

LEAST = 5e-14
"""Share of a row's size below which no bounce rises: off rounding it would come back as fast for ever."""

DEAD = 1e-3
"""Share of the most that a stop's row can be moved below which its joint is at a dead point."""

JAMMED = 1e-7
"""Share of the rates or accelerations at hand from which what is driven goes against a stop or a lock."""

MOST = 100
"""Impulses after each other at one instant, between stops that drive each other; then one is plastic, as
their limit is."""

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


class Impulse(NamedTuple):
    """One impulse: v⁺ (nv,), P (n,) by row, the energy lost, stops met or else locks, a stop's least share.

    A row's share is how much of the most that it could move this motion moves it: 0 at a dead point.
    """

    v: Array
    impulses: Array
    loss: float
    met: list[int]
    share: float


def require_way(rows: Rows, chosen: Sequence[int], B: Array, w: Array, size: float) -> None:
    """Refuse to drive a stop or a lock where nothing gives way.

    Parameters
    ----------
    chosen : sequence of int
        Rows at rest, or closed.
    B : ndarray (m, n)
        See `Frame.rows`: 0 for a row that what is not driven does not move.
    w : ndarray (n,)
        Their rates, or their accelerations, of which `size` is the largest at hand.
    """
    if rows.drive is None:
        return
    idle = ~B.any(axis=0)
    for k in np.flatnonzero(idle & (np.abs(w) > JAMMED * size)).tolist():
        kind = rows.rows[chosen[k]].kind
        if kind is Kind.LOCK or (kind is Kind.STOP and w[k] < 0.0):
            raise _jam(rows.drive, rows.names([chosen[k]]))


def _jam(drive: Drive, names: Sequence[str]) -> SimulationError:
    """That what is driven goes against these stops and locks, or against all but one of them."""
    driven, which = " and ".join(drive.names), "one of " if len(names) > 1 else ""
    return SimulationError(
        f"drive: {driven} would take {which}{', '.join(names)} through a closed stop or lock, and no "
        "other joint gives way; let the motion end before, or drive by a torque"
    )


def balanced(
    rows: Rows, chosen: Sequence[int], B: Array, b: Array, lower: Array, upper: Array, size: float
) -> tuple[Array, Array]:
    """`box`, with the names of what a drive leaves no way together."""
    try:
        return box(B, b, lower, upper, size)
    except SimulationError as error:
        closed = [i for i in chosen if rows.rows[i].kind is not Kind.FRICTION]
        if rows.drive is None or not closed:
            raise
        raise _jam(rows.drive, rows.names(closed)) from error


def struck(
    rows: Rows, q: Array, v: Array, stops: Sequence[int], locks: Sequence[int], seen: Seen, plastic: bool
) -> Impulse | None:
    """One impulse of closed stops and of locks; None where nothing has to change.

    Stops that are left have no part in it: Newton's law with these could raise the energy. What they are
    driven into then is the next impulse.
    """
    size = float(np.abs(v).max(initial=0.0))
    tiny = 1e-13 + 1e-12 * size  # what rounding leaves of a rate after an impulse is not struck again
    rates = rows.side * (rows.E @ v)
    stops = [i for i in stops if plastic or rates[i] <= tiny]
    struck_rows, n = [*stops, *locks], len(stops)
    E, w = rows.side[struck_rows][:, None] * rows.E[struck_rows], rates[struck_rows]
    of_stop = np.arange(len(w)) < n
    wrong = np.where(of_stop, w < -tiny, np.abs(w) > tiny)
    if not wrong.any():
        return None
    frame = Frame(rows.mechanism, q, v, seen, None, rows.driven())
    B = frame.rows(E)
    require_way(rows, struck_rows, B, w, size)
    if not np.any(wrong & B.any(axis=0)):  # within 1e-9 of a dead point, where no impulse changes a rate
        return None
    share = np.minimum(frame.shares(E, B), 1.0)
    # back onto it: behind a dead point the joint goes by itself, and a lock throws nothing back
    falls = np.where(of_stop, np.maximum(-(E @ seen.a), 0.0), 0.0)
    # at a dead point the joint is slow, not what it is part of
    rest = np.maximum(REST * share, np.sqrt(2.0 * LEAST * falls * rows.sizes(q)[struck_rows]))
    fast = np.abs(w) > rest
    e = np.where(fast & (w < 0.0) & (not plastic), [rows.rows[i].restitution for i in struck_rows], 0.0)
    lower = np.where(of_stop, 0.0, -np.inf)
    asked, upper = w + e * np.minimum(w, 0.0), np.full(len(w), np.inf)
    P, _ = balanced(rows, struck_rows, B, asked, lower, upper, size)
    after = v + frame.kick(B @ P)
    by_row = np.zeros(len(rows.rows))
    by_row[struck_rows] = rows.side[struck_rows] * P
    loss = 0.5 * float(v @ frame.M @ v - after @ frame.M @ after)
    if rows.drive is not None:  # whose impulses do work too
        loss = -0.5 * float(P @ (w + E @ after))
    met = [i for k, i in enumerate(stops) if fast[k] and w[k] < 0.0]
    least = float(share[:n][(P[:n] > 0.0) & fast[:n]].min(initial=1.0))
    return Impulse(after, by_row, loss, met or [i for k, i in enumerate(locks, n) if fast[k]], least)


def impulses(
    rows: Rows, q: Array, v: Array, stops: Sequence[int], locks: Sequence[int], seen: Seen
) -> Iterator[Impulse]:
    """Impulses until no closed stop is approached and locks rest.

    Raises
    ------
    SimulationError
    """
    for count in range(2 * MOST if stops or locks else 0):
        try:
            found = struck(rows, q, v, stops, locks, seen, count >= MOST)
        except SimulationError:  # a stop does not throw back what a lock holds
            if not (stops and locks):
                raise
            found = struck(rows, q, v, stops, locks, seen, True)
        if found is None:
            return
        yield found
        v = found.v
    if stops or locks:
        raise SimulationError(f"impacts of {', '.join(rows.names([*stops, *locks]))} do not come to an end")


def settled_impacts(
    rows: Rows, t: float, q: Array, v: Array, locks: Sequence[int], seen: Seen, tell: Tell
) -> Array:
    """v⁺ where no closed stop is approached any more and locks rest.

    Raises
    ------
    SimulationError
    """
    stops = rows.closed(q)
    for found in impulses(rows, q, v, stops, locks, seen):
        v, met = found.v, found.met
        if not met:
            continue
        kind = "lock" if rows.rows[met[0]].kind is Kind.LOCK else "impact"
        if kind == "impact" and found.share < DEAD:
            kind = "grazing"
            warn(
                f"at t = {t:.6g} s the stop of {', '.join(rows.names(met))} is met beside a dead point of "
                "its joint: what follows depends on the stop's place without bound",
                SingularityWarning,
            )
        tell(kind, met, found.loss)
    return v


def impact(mechanism: Any, q: ArrayLike, v: ArrayLike, joints: Sequence[Any]) -> Impact:
    """`Mechanism.impact`."""
    check_mechanism(mechanism, Mechanism, "impact")
    at, after = mechanism.configuration(q), mechanism.velocity(v)
    mechanism.require_closed(at, NEARLY_CLOSED, "impact: q")
    require_compatible(mechanism, at, after)
    rows = Rows(mechanism, parts_given(joints))
    rows.require_within(at)
    total, loss = np.zeros(len(rows.rows)), 0.0
    seen = Seen(after, np.zeros_like(after), after)  # impulses need no curvature
    for found in impulses(rows, at, after, rows.closed(at), rows.of(Kind.LOCK), seen):
        after, total, loss = found.v, total + found.impulses, loss + found.loss
    by_name = rows.by_column(total[None]).items()
    return Impact(after, {n: float(p[0]) for n, p in by_name if not n.startswith("friction.")}, loss)
