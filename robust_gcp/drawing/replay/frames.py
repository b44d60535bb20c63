"""Pictures of a motion at an even rate, whatever the steps of its simulation."""

from __future__ import annotations

import math

import numpy as np

from ...errors import OptionError, StateError
from ...mechanism.tree.tree import Array
from ...simulation.trajectories.trajectory import Trajectory

FPS = 30
"""Pictures a second of play."""

SHORTEST, LONGEST = 2.0, 300.0
"""Seconds of play between which a motion's own speed is kept."""

MOST_FRAMES = 36_000
"""Pictures of one motion that a page still carries: twenty minutes of play."""


def playing_speed(duration: float) -> float:
    """Simulated seconds for one second of play: 1 where that plays well, else the nearest of 1, 2, 5 · 10ⁿ.

    Parameters
    ----------
    duration : float
        Of the motion, s.
    """
    if duration <= 0.0 or SHORTEST <= duration <= LONGEST:
        return 1.0
    wanted = duration / (SHORTEST if duration < SHORTEST else LONGEST)
    exponent = math.floor(math.log10(wanted))
    steps = [s * 10.0 ** (exponent + e) for e in (0, 1) for s in (1, 2, 5)]
    if duration < SHORTEST:
        return max(s for s in steps if s <= wanted * (1 + 1e-9))
    return min(s for s in steps if s >= wanted * (1 - 1e-9))


def frame_times(start: float, end: float, speed: float) -> Array:
    """Even times from start to end, both included, at most speed / FPS apart, s.

    Raises
    ------
    OptionError
        Where a page would have to carry more than `MOST_FRAMES` pictures.
    """
    count = math.ceil((end - start) * FPS / speed * (1 - 1e-12)) + 1
    if count > MOST_FRAMES:
        enough = (end - start) * FPS / (MOST_FRAMES - 1)
        raise OptionError(
            f"speed = {speed:g}: {end - start:g} s would play for {(end - start) / speed:.0f} s, {count} "
            f"pictures, more than the {MOST_FRAMES} of one page; give speed={enough:.2g} or faster"
        )
    return np.linspace(start, end, max(count, 1))


def resample(trajectory: Trajectory, times: Array) -> Array:
    """Configurations between the outputs of a motion, (len(times), nq).

    The cubic on the tangent space at the earlier output q₀, d(s) = q(s) ⊖ q₀, that has the right
    values and rates at both ends: ḋ(0) = v₀ and ḋ(1) = ∂(q₁ ⊖ q₀)/∂q₁ v₁. Fourth order in the spacing
    of the outputs, on joints of every kind.

    Raises
    ------
    StateError
        For a motion that has no output or is not finite.
    """
    t, q, v = trajectory.t, trajectory.q, trajectory.v
    if len(t) == 0:
        raise StateError("replay: the trajectory is empty")
    if not (np.isfinite(q).all() and np.isfinite(v).all()):
        raise StateError("replay: the trajectory holds numbers that are not finite")
    if len(t) == 1:
        return np.repeat(q, len(times), axis=0)
    tree = trajectory.mechanism.tree
    index = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    found = np.empty((len(times), q.shape[1]))
    for row, (i, time) in enumerate(zip(index, times, strict=True)):
        h = t[i + 1] - t[i]
        s = min(max((time - t[i]) / h, 0.0), 1.0)
        d = tree.difference(q[i], q[i + 1])
        end_rate = h * (tree.difference_rate(q[i], q[i + 1]) @ v[i + 1])
        start_rate = h * v[i]
        # Hermite's cubic from 0 to d
        cubic = s * s * (3 - 2 * s) * d + s * (1 - s) ** 2 * start_rate - s * s * (1 - s) * end_rate
        found[row] = tree.integrate(q[i], cubic)
    return found
