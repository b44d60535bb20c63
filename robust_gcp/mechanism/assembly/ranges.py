"""Ranges of joints: they choose among assemblies of the loops, and a pose outside them is told.

Nothing keeps a motion inside them; see `left_out`.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...errors import ClosureError, ModelWarning
from ...warning import warn
from ..loops import ClosedLoops
from ..tree.joints import Array, Index, Joint
from .assembly import FEW_STARTS, assembled, free_velocities

log = logging.getLogger(__name__)

WIDE = 1e3
"""rad or m: bounds at least that wide are written for joints without any."""

SLACK = 1e-4
"""rad or characteristic lengths outside a range that are rounding of a file's numbers."""

STARTS = 8
"""Poses inside the ranges from which the loops are closed where the nearest assembly leaves them."""

NEAR = 0.3
"""rad or characteristic lengths: an assembly as near as that to a guess is the one that was meant."""

MOST = 8
"""Joints that a message lists."""


class Ranges(NamedTuple):
    """Joints with one number in q that have a range, rad or m; an open end is infinite.

    Attributes
    ----------
    names : tuple of str
    iq, iv : ndarray of int
        Where they are in q and in v.
    low, high : ndarray
    units : ndarray
        What counts as one, rad or characteristic lengths.
    """

    names: tuple[str, ...]
    iq: Index
    iv: Index
    low: Array
    high: Array
    units: Array

    def clipped(self, q: Array) -> Array:
        """The numbers of the joints at q, those outside at the nearest end."""
        return np.clip(q[self.iq], self.low, self.high)

    def beyond(self, q: Array) -> Array:
        """How far each joint is outside, signed, dimensionless."""
        return np.asarray((q[self.iq] - self.clipped(q)) / self.units)

    def outside(self, q: Array) -> list[int]:
        """Which of them are outside by more than rounding."""
        return [int(i) for i in np.flatnonzero(np.abs(self.beyond(q)) > SLACK)]

    def of(self, iv: Index) -> Ranges:
        """Those of these velocities."""
        at = np.flatnonzero(np.isin(self.iv, iv))
        names = tuple(self.names[i] for i in at)
        return Ranges(names, self.iq[at], self.iv[at], self.low[at], self.high[at], self.units[at])

    def rows(self, nv: int, q: Array) -> tuple[Array, Array]:
        """Residual and Jacobian that draw the joints inside, as `assembly` takes them."""
        away = self.beyond(q)
        by_v = np.zeros((len(away), nv))
        # nothing draws a joint that is inside
        by_v[np.arange(len(away)), self.iv] = (away != 0.0) / self.units
        return away, by_v


def ranged(model: pin.Model, joints: Sequence[Joint]) -> list[Joint]:
    """Joints with one number whose lower position limit is below the upper."""
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    return [joint for joint in joints if joint.single and low[joint.idx_q] < high[joint.idx_q]]


def ranges_of(loops: ClosedLoops) -> Ranges:
    """The ranges of the model's position limits, where the lower is below the upper."""
    model = loops.own_model
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    low, high = np.where(lower > -WIDE, lower, -np.inf), np.where(upper < WIDE, upper, np.inf)
    kept = [
        joint
        for joint in ranged(model, loops.joints)
        if np.isfinite(low[joint.idx_q]) or np.isfinite(high[joint.idx_q])
    ]
    iq = np.array([joint.idx_q for joint in kept], dtype=np.int64)
    iv = np.array([joint.idx_v for joint in kept], dtype=np.int64)
    return Ranges(tuple(joint.name for joint in kept), iq, iv, low[iq], high[iq], loops.units[iv])


def assembled_within(
    loops: ClosedLoops, guess: Array, free: Index, what: str, spreads: tuple[float, ...] = FEW_STARTS
) -> Array:
    """`assembled`, by an assembly inside the ranges of the joints where one is found.

    The nearest one is taken where it is inside them; else the loops are closed with the joints drawn inside.

    Raises
    ------
    ClosureError
        As `assembled`.
    """
    ranges = ranges_of(loops).of(free)  # joints that are held stay, wherever they are
    failure: ClosureError | None = None
    try:
        first = assembled(loops, guess, free, what, spreads)
    except ClosureError as error:
        failure, first = error, guess
    if len(ranges.names) and (failure is not None or ranges.outside(first)):
        within = _drawn_inside(loops, guess, free, ranges)
        if within is not None:
            return within
    if failure is not None:
        raise failure
    return first


def assembled_near(loops: ClosedLoops, guess: Array, free: Index, what: str) -> Array:
    """`assembled`; far from the guess an assembly inside the ranges is preferred, and one outside is logged.

    An assembly near the guess is the one that was meant, and a joint that the guess has outside its range
    may stay there.

    Raises
    ------
    ClosureError
        As `assembled`.
    """
    q = assembled(loops, guess, free, what)
    # a joint in no loop stays where the guess has it, inside its range or not
    ranges = ranges_of(loops).of(np.setdiff1d(free, free_velocities(loops)))
    if not _strays(loops, ranges, guess, q):
        return q
    within = _drawn_inside(loops, guess, free, ranges)
    if within is not None:
        return within
    log.info("%s: the configuration %s", what, outside_words(loops, q))
    return q


def _strays(loops: ClosedLoops, ranges: Ranges, guess: Array, q: Array) -> bool:
    """Whether q is far from the guess, with joints outside their ranges that the guess has inside."""
    left = set(ranges.outside(q)) - set(ranges.outside(guess))  # what the guess has outside is meant
    return bool(left) and np.abs(loops.tree.difference(guess, q) / loops.units).max() > NEAR


def assembled_all(loops: ClosedLoops, guesses: Array, free: Index, what: str) -> Array:
    """`assembled_near` from each of many guesses (N, nq): together in the kernel where that leads there.

    Raises
    ------
    ClosureError
        Naming the guesses that no configuration is found for: `failed` has their numbers, `nearest` (N, nq)
        the others' configurations.
    """
    from ...kernel.constraint.assembling import closed  # it stands above what it is made of

    q, done = closed(loops, guesses, free)
    ranges = ranges_of(loops).of(np.setdiff1d(free, free_velocities(loops)))
    if len(ranges.names):
        pairs = zip(guesses, q, strict=True)
        done &= ~np.array([_strays(loops, ranges, *pair) for pair in pairs], dtype=bool)
    errors: dict[int, ClosureError] = {}
    for i in np.flatnonzero(~done):
        try:
            q[i] = assembled_near(loops, guesses[i], free, f"{what}, number {i}")
        except ClosureError as error:
            errors[int(i)], q[i] = error, np.nan
    if errors:
        first = next(iter(errors.values()))
        refusal = ClosureError(
            f"{len(errors)} of {len(q)} guesses: {first.args[0]}", first.residual, first.loop
        )
        refusal.nearest, refusal.failed = q, tuple(errors)
        raise refusal
    return q


def _drawn_inside(loops: ClosedLoops, guess: Array, free: Index, ranges: Ranges) -> Array | None:
    """The loops closed inside the ranges: from the guess moved there, then from poses at random."""
    tied = np.setdiff1d(free, free_velocities(loops))
    among = ranges.of(tied)
    bounded = np.isfinite(among.low) & np.isfinite(among.high)
    iq, low, width = among.iq[bounded], among.low[bounded], (among.high - among.low)[bounded]
    rng = np.random.default_rng(2)
    for number in range(STARTS):
        step = np.zeros(loops.nv)
        # number 0 is the guess itself
        step[tied] = min(number, 1) * rng.uniform(-1.0, 1.0, len(tied)) * loops.units[tied]
        start = loops.tree.integrate(guess, step)
        if number:
            start[iq] = low + rng.uniform(size=len(iq)) * width
        start[ranges.iq] = ranges.clipped(start)
        try:
            q = assembled(loops, start, free, "", (0.0,), lambda q: ranges.rows(loops.nv, q))
        except ClosureError:
            continue
        if not ranges.outside(q):  # closing φ alone, at the end, may lead out again
            return q
    return None


def outside_words(loops: ClosedLoops, q: Array) -> str:
    """Which joints q has outside their ranges, with value and range; empty where none is."""
    ranges = ranges_of(loops)
    told = [
        f"{ranges.names[i]} at {q[ranges.iq[i]]:.4g} {'rad' if loops.tree.rotates[ranges.iv[i]] else 'm'} "
        f"({ranges.low[i]:.4g} to {ranges.high[i]:.4g})"
        for i in ranges.outside(q)
    ]
    more = f" and {len(told) - MOST} more" if len(told) > MOST else ""
    return f"is outside the ranges of joints: {', '.join(told[:MOST])}{more}" if told else ""


def tell_outside(loops: ClosedLoops, q: Array, what: str) -> None:
    """Warn of the joints that q, which is `what`, has outside their ranges."""
    words = outside_words(loops, q)
    if words:
        warn(f"{what} {words}", ModelWarning)
