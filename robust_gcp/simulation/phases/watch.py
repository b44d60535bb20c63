"""Events on a stretch of steps: gaps that close, springs touched or left, slips that end, holds that break.

Gaps and rates are watched on the quintics through (r, ṙ, r̈) at both ends of each step: all their real roots,
so that several bounces in one step, and touches between two ends, are found. `first_event` locates them then,
on a partial step.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ...errors import NonFiniteError, SimulationError
from ...kernel.dynamics.measures import reactions
from ...kernel.simulation.guard import Bounds, Guard
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..runs.crossings import quintic
from .admissible import UNMOVED, Seen, admissible
from .bearings import ALIKE as SAME
from .bearings import MOST, REMEDY, FrictionBounds
from .decision import Phase
from .impact import REST
from .phase_run import Steps
from .polynomial_zeros import falling_root
from .quadratic_programs import Load
from .rows import Kind, Rows

BELOW = 1e-13
"""m, rad, or per second: how far a function has to fall below 0 after a root for an event."""

ROUNDING = 1e-14
"""Share of its size by which the change of a row over a step may err."""

MOVED = 2.0 * REST
"""m/s or rad/s at which a row at rest that nothing holds is moved: more than what counts as rest."""

DWELL = 1e-12
"""m/s or rad/s: what a drive at rest leaves of a rate by rounding, which is no change of its sign."""

ALIKE = 1e-7
"""Relative difference of forces that two ways to find them may have on regular ground."""


class Found(NamedTuple):
    """An event in a stretch.

    Attributes
    ----------
    step : int
        It begins at this output.
    share : float
        Of the step, in [0, 1].
    row : int
        −1: what is held breaks.
    lowest : float
        Share of the step at which its function is lowest after that.
    depth : float
        How far below 0 it is there.
    begun : float
        Value of its function that it falls through: 0, but for a stop that was left from a rounding below it.
    """

    step: int
    share: float
    row: int
    lowest: float = 1.0
    depth: float = np.inf
    begun: float = 0.0


class Signals:
    """The functions of a phase that must not fall below 0.

    Parameters
    ----------
    rows : Rows
    phase : Phase
    """

    def __init__(self, rows: Rows, phase: Phase) -> None:
        held = set(phase.held)
        stops = [i for i in rows.of(Kind.STOP) if i not in held]
        springs, slips, carried = rows.of(Kind.SPRING), list(phase.slip), phase.carried
        self.rows = np.array([*stops, *springs, *slips, *carried, *carried], dtype=np.int64)
        signs = [rows.side[i] for i in stops]
        signs += [-rows.side[i] if i in phase.touching else rows.side[i] for i in springs]
        signs += [phase.slip[i] for i in slips]
        signs += [1.0] * len(carried) + [-1.0] * len(carried)  # they may go either way
        self._sign, self._rows = np.array(signs), rows
        first = len(stops) + len(springs)
        self._rate = np.arange(len(self.rows)) >= first
        self._at = np.zeros(len(self.rows))  # of r, or of its rate
        self._at[:first] = rows.at[self.rows[:first]]
        # in place of 0: where a drive stands still a rate is rounding of either sign
        slack = [DWELL if rows.drive else 0.0] * len(slips) + [MOVED] * (2 * len(carried))
        self._at[first:] = -np.array(slack) * self._sign[first:]

    def series(self, q: Array, v: Array, a: Array) -> Array:
        """Value, rate and acceleration of each, (3, N, k)."""
        E, of_rate = self._rows.E[self.rows].T, np.where(self._rate, self._at, 0.0)
        r = self._rows.values(q)[:, self.rows] - (self._at - of_rate)
        return self._sign * np.array([r, v @ E - of_rate, a @ E])

    def signal_at(self, row: int, q: Array, v: Array, a: Array) -> tuple[float, float]:
        """The function of a row at a state, and its rate."""
        chosen = np.flatnonzero(self.rows == row)
        parts = self.series(q[None], v[None], a[None])[:, 0, chosen]
        first = int(self._rate[chosen[0]])
        k = int(np.argmin(parts[first]))  # of a carried row the way that it goes
        return float(parts[first, k]), float(parts[first + 1, k])

    def guard(self) -> Guard | None:
        """The cheap test of whether there may be an event in a step."""
        where, found = self._rows.places, list[Bounds]()
        for i, sign, at, of_rate in zip(self.rows.tolist(), self._sign, self._at, self._rate, strict=True):
            lower, upper = (float(at), np.inf) if sign > 0.0 else (-np.inf, float(at))
            in_q, in_v, weights = where[i]
            found.append(Bounds(in_q, in_v, weights, bool(of_rate), lower, upper))
        return Guard(found) if found else None

    def first(
        self, t: Array, q: Array, v: Array, a: Array, none: Collection[tuple[int, int]], since: int
    ) -> Found | None:
        """The first event on the steps between these times, but for steps and rows in which there is none.

        Steps are numbered from `since` on.
        """
        if not len(self.rows) or len(t) < 2:
            return None
        series, h = self.series(q, v, a), np.diff(t)
        value = np.where(self._rate, series[1], series[0])
        rate = np.where(self._rate, series[2], series[1])
        may = (value[1:] <= 0.0) | ((rate[:-1] < 0.0) & (rate[1:] > 0.0))  # at an end, or between them
        best: Found | None = None
        for step in np.flatnonzero(may.any(axis=1)):
            for k in np.flatnonzero(may[step]):
                ends, slip = series[:, step : step + 2, k], self._rate[k]
                if slip:
                    ends = self._steady(int(k), float(h[step]), ends, q[step : step + 2])
                p = np.array(quintic(h[step], *ends.T)[::-1])
                if not np.isfinite(p).all():  # roots of these are an error of NumPy's own
                    raise NonFiniteError(
                        f"the state left the finite numbers after t = {t[step]:.6g} s; use a smaller "
                        "step, and check v0 and torque"
                    )
                begun = 0.0
                if not slip and -BELOW <= p[-1] < 0.0 < p[-2]:  # left from as far below as an event may lie
                    begun, p[-1] = float(p[-1]), 0.0
                # p is over shares of the step: its slope is ṙ h
                root = falling_root(np.polyder(p) if slip else p, BELOW * (h[step] if slip else 1.0))
                where = int(step) + since, int(self.rows[k])
                if root is not None and where not in none and (best is None or root[0] < best.share):
                    best = Found(where[0], root[0], where[1], *root[1:], begun)
            if best is not None:
                break
        return best

    def _steady(self, k: int, h: float, ends: Array, q: Array) -> Array:
        """r, from 0 on, ṙ and r̈ at both ends; r by ṙ and r̈ where it says no more than its rounding.

        Over a short step h that rounding would be a rate ε |r|/h.
        """
        (r0, r1), (v0, v1), (a0, a1) = ends
        change = 0.5 * h * (v0 + v1) + h * h / 12.0 * (a0 - a1)
        told = r1 - r0 - h * self._sign[k] * self._at[k]
        if abs(told - change) > ROUNDING * float(self._rows.sizes(q)[:, self.rows[k]].sum()):
            change = told
        return np.array([[0.0, change], ends[1], ends[2]])


class Holding:
    """The forces of what a phase holds.

    Parameters
    ----------
    bounds : FrictionBounds
    phase : Phase
    """

    def __init__(self, bounds: FrictionBounds, phase: Phase) -> None:
        rows = self._rows = bounds.rows
        self._held, self._rank, self._bounds = phase.held, len(phase.basis), bounds
        self._E = rows.side[self._held][:, None] * rows.E[self._held]
        kinds = [rows.rows[i].kind for i in self._held]
        self._pushes = np.array([kind is Kind.STOP for kind in kinds], dtype=bool)
        self.limited = any(kind is not Kind.LOCK for kind in kinds)

    def __bool__(self) -> bool:
        """Whether anything is held."""
        return bool(self._held)

    def along(self, machine: Mechanism, steps: Steps) -> tuple[Array, Array] | None:
        """f (N, n) at the ends of many steps, and their margins (N,), as λ of the phase's mechanism.

        None where the rows depend on each other, or λ is not what `forces` gives at the first and the last.
        """
        held, n = self._held, len(steps.t)
        if len(held) > self._rank:
            return None
        found = reactions(machine, steps.q, steps.v, steps.a, steps.tau)
        if found is None:
            return None
        f = found[:, -len(held) :]  # closures of what is held come last, in the order of `held`
        for k in (0, n - 1):
            own = self.forces(steps.t[k], steps.q[k], steps.v[k], steps.a[k], steps.tau[k])[0][held]
            if not np.abs(f[k] - own).max() <= ALIKE * (1.0 + np.abs(own).max()):
                return None
        forces, dry = np.zeros((n, len(self._rows.rows))), np.isfinite(self._rows.bounds[held])
        forces[:, held] = f
        all_of_it = steps.tau + forces @ self._rows.E
        bounds = self._bounds(steps.t, steps.q, steps.v, steps.a, all_of_it)[:, held]
        bounds = np.where(dry, bounds, 1.0)
        limits = np.where(self._pushes, self._rows.side[held] * f, np.inf)
        limits = np.where(dry, 1.0 - np.abs(f) / bounds, limits)
        return forces, limits.min(axis=1, initial=np.inf)

    def _load(
        self, t: float, q: Array, v: Array, a: Array, tau: Array, seen: Seen | None
    ) -> tuple[Load, Array]:
        mechanism = self._rows.mechanism
        N, _ = admissible(mechanism, q, v, Seen.of(v, a) if seen is None else seen, self._rows.driven())
        A = self._E @ N  # rows that the mode does not move are none, as in `Frame.rows`
        A[np.linalg.norm(A, axis=1) <= UNMOVED * np.linalg.norm(N)] = 0.0
        need = N.T @ (mechanism.tree.rnea(q, v, a) - tau)
        F = self._bounds.constant[self._held]
        if not self._bounds.vary:
            return Load(A, self._rank, F, self._pushes), need
        dry, F = np.isfinite(F), np.maximum(F, 1.0)
        for _ in range(MOST):  # rows that depend on each other share the load by their F
            load, before = Load(A, self._rank, F, self._pushes), F
            F = self._bounds.bounds_at(t, q, v, a, tau + load.forces(need)[0] @ self._E)[self._held]
            if np.abs(F[dry] - before[dry]).max(initial=0.0) <= SAME * F[dry].max(initial=0.0):
                return load, need
        raise SimulationError(
            f"JointFriction(coefficient=): at t = {t:.6g} s the friction of "
            f"{', '.join(self._rows.names(self._held))}, which stick, is not determined (Painlevé's "
            f"paradox); {REMEDY}"
        )

    def margin(self, t: float, q: Array, v: Array, a: Array, tau: Array, seen: Seen | None = None) -> float:
        """By how much what is held is held; negative where it breaks."""
        load, need = self._load(t, q, v, a, tau, seen)
        return load.margin(need)

    def forces(
        self, t: float, q: Array, v: Array, a: Array, tau: Array, seen: Seen | None = None
    ) -> tuple[Array, float]:
        """f (n,) of all rows, and the sign of the margin."""
        load, need = self._load(t, q, v, a, tau, seen)
        f, margin = load.forces(need)
        all_rows = np.zeros(len(self._rows.rows))
        all_rows[self._held] = self._rows.side[self._held] * f
        return all_rows, margin
