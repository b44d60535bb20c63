"""Controls and activations of actuators as functions of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...mechanism.actuation.actuators import Actuator, clipped
from ...mechanism.actuation.muscle import TINY
from ...mechanism.tree.tree import Array

EXACT = 1e-12
"""Relative and absolute tolerance of activations that are computed ahead."""

Curve = Callable[[Array], Array]
"""u at many times at once, (N,)."""


@dataclass(frozen=True)
class Table:
    """A control over time: linear between the times, constant before and after them."""

    times: Array
    values: Array

    def __call__(self, t: Array) -> Array:
        """Its values at times, s."""
        return np.asarray(np.interp(t, self.times, self.values))


def curve_of(actuator: Actuator, control: float | Table, t0: float, t1: float) -> Curve:
    """u of an actuator as a function of time."""
    low, high = actuator.ctrl_range or (-np.inf, np.inf)
    if actuator.dynamics == "none":
        if isinstance(control, Table):
            return lambda t: np.clip(control(t), low, high)
        value = clipped(control, actuator.ctrl_range)
        return lambda t: np.full(len(t), value)
    start = clipped(actuator.activation, actuator.activation_range)
    table = control if isinstance(control, Table) else Table(np.array([t0, t1]), np.full(2, control))
    if actuator.dynamics == "filter":
        return _Filtered(actuator, table, start, t0, t1)
    return _Solved(actuator, table, start, t0, t1)


class _Filtered:
    """The activation of a filter in closed form, between the times where the control bends one by one."""

    def __init__(self, actuator: Actuator, table: Table, start: float, t0: float, t1: float) -> None:
        self._low, self._high = actuator.activation_range or (-np.inf, np.inf)
        self._tau = max(TINY, actuator.time[0])
        bends = [t0, t1, *table.times.tolist()]
        # pieces end where a clip begins: within one the control is a line, and w has a closed form
        for bound in (*(actuator.ctrl_range or ()), *(actuator.activation_range or ())):
            bends += _crossings(table, bound)
        begins = np.unique(np.clip(bends, t0, t1))
        u = np.clip(table(begins), *(actuator.ctrl_range or (-np.inf, np.inf)))
        self._begins, self._u, self._slope = begins, u, np.append(np.diff(u) / np.diff(begins), 0.0)
        self._w = np.full(len(begins), start)
        for k in range(len(begins) - 1):
            self._w[k + 1] = self._within(np.array([k]), begins[k + 1 : k + 2])[0]

    def _within(self, k: Array, t: Array) -> Array:
        """w in the pieces k, in each of which the control stays on one side of the activation's bounds."""
        passed = t - self._begins[k]
        share = -np.expm1(-passed / self._tau)  # of τ ẇ = u − w, u a line; 1 − e^x would cancel
        w = self._w[k] + share * (self._u[k] - self._w[k]) + self._slope[k] * (passed - self._tau * share)
        return np.clip(w, self._low, self._high)

    def __call__(self, t: Array) -> Array:
        """w at these times, (N,)."""
        return self._within(np.clip(np.searchsorted(self._begins, t, side="right") - 1, 0, None), t)


def _crossings(table: Table, bound: float) -> list[float]:
    """When a table meets a value between its times."""
    (t, u), gap = (table.times, table.values), table.values - bound
    (at,) = np.nonzero(gap[:-1] * gap[1:] < 0.0)
    return [float(t[i] - gap[i] * (t[i + 1] - t[i]) / (u[i + 1] - u[i])) for i in at]


class _Solved:
    """The activation by its differential equation, solved between the times of a table one by one."""

    def __init__(self, actuator: Actuator, table: Table, start: float, t0: float, t1: float) -> None:
        from scipy.integrate import solve_ivp  # a run without activations need not load it

        inner = table.times[(table.times > t0) & (table.times < t1)]
        self._ends = np.array([t0, *inner.tolist(), max(t1, np.nextafter(t0, np.inf))])
        self._low, self._high = actuator.activation_range or (-np.inf, np.inf)
        self._pieces, w = [], start

        def rate(t: float, w: Array) -> list[float]:
            found = actuator.activation_rate(float(table(np.array(t))), float(w[0]))
            stopped = (w[0] >= self._high and found > 0.0) or (w[0] <= self._low and found < 0.0)
            return [0.0 if stopped else found]

        for begin, end in pairwise(self._ends.tolist()):
            solved = solve_ivp(
                rate, (begin, end), [w], "DOP853", dense_output=True, rtol=EXACT, atol=EXACT,
                max_step=max((end - begin) / 8.0, 1e-12),
            )  # fmt: skip
            self._pieces.append(solved.sol)
            w = min(max(float(solved.y[0, -1]), self._low), self._high)
        self._last = w

    def __call__(self, t: Array) -> Array:
        """w at these times, (N,)."""
        found = np.full(len(t), self._last)
        which = np.searchsorted(self._ends, t, side="right") - 1
        for k in np.unique(which[t < self._ends[-1]]):
            chosen = (which == k) & (t < self._ends[-1])
            found[chosen] = self._pieces[max(int(k), 0)](t[chosen])[0]
        return np.clip(found, self._low, self._high)
