"""Where a polynomial on [0, 1] falls through 0."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from ...mechanism.tree.tree import Array

MOST_NEWTON = 60
"""Halvings of a step with Newton's method, until nothing is left of it."""

NOTHING = 1e-30
"""Share of the largest coefficient."""


def falling_root(p: Array, tiny: float) -> tuple[float, float, float] | None:
    """The first x in [0, 1] where p falls through 0 to below −tiny; where it is lowest then, how deep."""
    if _bernstein(p).min() >= -tiny:
        return None
    once = _steady_fall(p, tiny)
    if once is not None:
        return once
    real = _real_roots(p)
    slope = np.polyder(p)
    for x in real[(real > -1e-9) & (real <= 1.0 + 1e-9)]:  # one that begins on its stop has 0, rounded
        if np.polyval(slope, x) > 0.0:
            continue
        end = min([*real[real > x + 1e-9].tolist(), 1.0])
        inner = _real_roots(slope)
        after = np.array([*inner[(inner > x) & (inner < end)], end])
        values = np.polyval(p, after)
        k = int(np.argmin(values))
        if values[k] < -tiny:
            return float(np.clip(x, 0.0, 1.0)), float(after[k]), -float(values[k])
    return None


@cache
def _to_bernstein(n: int) -> Array:
    return np.array([[math.comb(i, j) / math.comb(n, j) for j in range(n, -1, -1)] for i in range(n + 1)])


def _bernstein(p: Array) -> Array:
    """Bernstein coefficients on [0, 1], between which the polynomial's values lie."""
    return np.asarray(_to_bernstein(len(p) - 1) @ p)


def _steady_fall(p: Array, tiny: float) -> tuple[float, float, float] | None:
    """The same where p rises at first, if at all, and then falls from above 0 to below −tiny: by Newton.

    So it is where a stop is met, and where one bounces within a step.
    """
    # the slope changes its sign no more often than its coefficients do
    falls = _bernstein(np.polyder(p)) < 0.0
    if p[-1] < -tiny or p.sum() >= -tiny or not falls[int(falls.argmax()) :].all() or not falls[-1]:
        return None
    coefficients, x, low, high = p.tolist(), 1.0, 0.0, 1.0
    for _ in range(MOST_NEWTON):
        value = rate = 0.0
        for c in coefficients:
            value, rate = value * x + c, rate * x + value
        low, high = (x, high) if value > 0.0 else (low, x)
        then = x - value / rate if rate < 0.0 else low
        before, x = x, then if low < then < high else 0.5 * (low + high)
        if abs(x - before) <= 4e-16:
            return x, 1.0, -float(p.sum())
    return None


def _real_roots(p: Array) -> Array:
    # quotients by leading coefficients that small overflow, and within [0, 1] they are nothing
    first = int(np.argmax(np.abs(p) > NOTHING * np.abs(p).max()))
    roots = np.roots(p[first:])
    return np.sort(roots.real[np.abs(roots.imag) < 1e-7])  # double ones, of a touch, split by √ε
