"""Restitution of MuJoCo's limits, which are springs with dampers that push and never pull."""

from __future__ import annotations

import math
from collections.abc import Sequence

PLASTIC = 1e-6
"""A restitution that is none."""

TIME_CONSTANT = 0.02
"""MuJoCo's default, s."""


def restitution_of(solref: Sequence[float]) -> float:
    """What a limit's velocity comes back with as it is made stiffer and stiffer.

    MuJoCo makes the depth δ obey δ̈ = −k δ − b δ̇ until its force k δ + b δ̇ vanishes. With ζ = b/(2√k), the
    damping ratio, that is ln e = −ζ/√(1 − ζ²) (π − atan2(2ζ√(1 − ζ²), 1 − 2ζ²)), e^−2 at the default ζ = 1.

    Parameters
    ----------
    solref : (float, float)
        Time constant and damping ratio, or where negative −k, 1/s², and −b, 1/s.
    """
    first, second = (float(x) for x in solref)
    ratio = second
    if first <= 0.0:
        ratio = -second / (2.0 * math.sqrt(-first)) if first < 0.0 else math.inf
    found = _by_damping(ratio) if ratio > 0.0 else 1.0
    return found if found > PLASTIC else 0.0


def solref_of(restitution: float) -> tuple[float, float]:
    """MuJoCo's default time constant, s, and the damping ratio of that restitution."""
    if restitution <= PLASTIC:
        return TIME_CONSTANT, 1.0 / PLASTIC
    if restitution >= 1.0:
        return TIME_CONSTANT, 0.0
    from scipy.optimize import brentq  # files are seldom written

    ratio = brentq(lambda x: _by_damping(x) - restitution, 1e-9, 1.0 / PLASTIC, xtol=1e-15)
    return TIME_CONSTANT, float(ratio)


def _by_damping(ratio: float) -> float:
    if abs(ratio - 1.0) < 1e-9:  # both formulas are 0/0 there
        return math.exp(-2.0)
    if ratio < 1.0:
        root = math.sqrt(1.0 - ratio**2)
        return math.exp(-ratio / root * (math.pi - math.atan2(2.0 * ratio * root, 1.0 - 2.0 * ratio**2)))
    root = math.sqrt(ratio**2 - 1.0)
    return math.exp(-2.0 * ratio / root * math.log(ratio + root)) if math.isfinite(root) else 0.0
