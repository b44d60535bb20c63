"""What becomes of small changes of the state where one phase ends and another begins: saltation matrices.

With c(x) = 0 what ends the phase and x⁺ = R(x⁻), changes of x at a fixed time jump by

    δt = −∇c δx⁻ / ċ⁻,   δx⁺ = R_x (δx⁻ + ẋ⁻ δt) − ẋ⁺ δt,

so δx⁺ = Ξ δx⁻ with Ξ = R_x + (ẋ⁺ − R_x ẋ⁻) ∇c / ċ⁻. States are x = (q, v) along all velocities, so that a
phase with more or less mobility is no special case. A touch that only grazes, ċ⁻ → 0, has no Ξ. Where what is
held breaks loose, forces and so ẋ are continuous, and Ξ = I.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...dynamics.change_of_coordinates import Slope
from ...errors import NotDifferentiableError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..derivatives.accelerations import derivatives
from .admissible import Seen
from .impact import Impulse, impulses
from .rows import Kind, Rows
from .transitions import BREAK, START, Turn

GRAZING = 1e-9
"""m/s or rad/s: a stop that is met more slowly is grazed."""


@dataclass(frozen=True)
class Jump:
    """How changes of (q, v) at a fixed time, (2nv,), pass an instant.

    Attributes
    ----------
    reset : ndarray (2nv, 2nv)
        R_x.
    by_time : ndarray (2nv,)
        δt = by_time · δx⁻.
    before, after : ndarray (2nv,)
        ẋ⁻ and ẋ⁺.
    """

    reset: Array
    by_time: Array
    before: Array
    after: Array

    @property
    def matrix(self) -> Array:
        """Ξ (2nv, 2nv)."""
        return self.reset + np.outer(self.reset @ self.before - self.after, self.by_time)


def jump_of(
    rows: Rows,
    mechanism: Mechanism,
    turn: Turn,
    held: list[int],
    slope: Slope,
    a: tuple[Array, Array],
    by_time: Array,
) -> Jump:
    """The jump at a turn.

    Parameters
    ----------
    rows : Rows
    mechanism : Mechanism
        In coordinates that serve there.
    turn : Turn
    held : list of int
        Rows held before it.
    slope : Slope
        Just before it, in these coordinates.
    a : (ndarray (nv,), ndarray (nv,))
        Accelerations before and after.
    by_time : ndarray (2nv,)
        δt by δx⁻ where no row's function vanishes.

    Raises
    ------
    NotDifferentiableError
    """
    nv = mechanism.nv
    before, after = np.concatenate([turn.before, a[0]]), np.concatenate([turn.after, a[1]])
    if turn.why >= 0:
        by_time = np.zeros(2 * nv)
        E, side = rows.E[turn.why], rows.side[turn.why]
        at_rest = rows.rows[turn.why].kind is Kind.FRICTION
        along = side * E
        by_time[nv if at_rest else 0 :][:nv] = along
        rate = float(along @ (a[0] if at_rest else turn.before))
        _require_crossed(rows, turn, held, rate, at_rest)
        by_time /= -rate
    return Jump(_reset(rows, mechanism, turn, slope), by_time, before, after)


def _require_crossed(rows: Rows, turn: Turn, held: list[int], rate: float, at_rest: bool) -> None:
    """Refuse what is grazed, and stops that are met together."""
    name = ", ".join(rows.names([turn.why]))
    if rows.rows[turn.why].kind is Kind.LOCK:
        raise NotDifferentiableError(
            f"at t = {turn.t:.6g} s the lock of {name} stops it beside a dead point: what follows depends on "
            "the start without bound; lock it elsewhere"
        )
    if abs(rate) <= GRAZING:
        what = "comes to rest without deceleration" if at_rest else "grazes its stop"
        raise NotDifferentiableError(
            f"at t = {turn.t:.6g} s {name} {what}: what follows depends on the start without bound; start a "
            "little aside",
            rate=rate,
        )
    rates = rows.side * (rows.E @ turn.before)
    met = [i for i in rows.closed(turn.q) if i not in held and rates[i] < -GRAZING]
    if rows.rows[turn.why].kind is Kind.STOP and len(met) > 1:
        raise NotDifferentiableError(
            f"at t = {turn.t:.6g} s the stops of {', '.join(rows.names(met))} are met at once: which comes "
            "first changes with the start, and what follows with that; start a little aside"
        )


def _reset(rows: Rows, mechanism: Mechanism, turn: Turn, slope: Slope) -> Array:
    """R_x, with the rows that are struck as they are."""
    own, nv = mechanism.iv_independent, mechanism.nv
    reset = np.eye(2 * nv)
    stops, locks = rows.closed(turn.q), rows.locked(turn.t)
    if turn.why in (BREAK, START) or not (stops or locks):
        return reset
    v, by = turn.before, np.hstack([slope.dv_dy, slope.G])
    for found in impulses(rows, turn.q, v, stops, locks, Seen(v, np.zeros_like(v), v)):
        by, v = by + _struck(rows, mechanism, turn.q, v, found, by), found.v
    reset[nv:] = 0.0
    reset[nv:, own], reset[nv:, nv + own] = np.hsplit(by, 2)  # on the tangent no others are read
    return reset


def without_parts(mechanism: Mechanism) -> Mechanism:
    """The mechanism without stops and friction of its file, which the phases have."""
    if not mechanism.parts:
        return mechanism

    def made() -> Mechanism:
        other = mechanism.with_independent(mechanism.independent)
        other.parts = ()
        return other

    found: Mechanism = mechanism.memo.once("without parts", made)
    return found


def _struck(rows: Rows, mechanism: Mechanism, q: Array, v: Array, found: Impulse, by: Array) -> Array:
    """How what an impulse adds to v, G A P, changes with (η, u) (nv, 2m); `by` is how v does.

    A = M_r⁻¹ Gᵀ Eᵀ, and E G A P = −(1 + e) ∘ E v on the rows that have an impulse.
    """
    m = mechanism.m
    on = np.flatnonzero(found.impulses)
    E, P, none = rows.E[on], found.impulses[on], np.zeros(mechanism.nv)
    bounced = np.array([rows.rows[i].restitution for i in on])
    before, after = E @ v, E @ found.v
    bounced[np.abs(after + bounced * before) > np.abs(after)] = 0.0  # at rest before, or too slow to bounce
    still = derivatives(mechanism, q, none)
    pushed = derivatives(mechanism, q, none, E.T @ P)
    A = still.da_dtau @ E.T
    moved = derivatives(mechanism, q, still.G @ (A @ P)).dv_dy
    bent = np.zeros_like(by)
    bent[:, :m] = still.G @ (pushed.da_dy - still.da_dy) + moved  # gravity's part is in both
    rate = (1.0 + bounced)[:, None] * (E @ by) + E @ bent
    by_P = np.linalg.lstsq(E @ still.G @ A, -rate, rcond=1e-9)[0]  # rows that depend on each other share P
    return bent + still.G @ (A @ by_P)
