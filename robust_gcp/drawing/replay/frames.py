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
    # 1e-12: a whole number of pictures that rounding made a little more is not one more
    count = math.ceil((end - start) * FPS / speed * (1 - 1e-12)) + 1
    if count > MOST_FRAMES:
        enough = (end - start) * FPS / (MOST_FRAMES - 1)
        raise OptionError(
            f"speed = {speed:g}: {end - start:g} s would play for {(end - start) / speed:.0f} s, {count} "
            f"pictures, more than the {MOST_FRAMES} of one page; give speed={enough:.2g} or faster"
        )
    return np.linspace(start, end, max(count, 1))


def pictures(trajectory: Trajectory, speed: float) -> Array:
    """Configurations (n, nq) at the even times of a motion, between its outputs by `Trajectory.at`.

    Raises
    ------
    StateError
        For a motion that has no output or is not finite.
    OptionError
        As `frame_times`.
    """
    if len(trajectory.t) == 0:
        raise StateError("the trajectory is empty: there is nothing to play")
    if not (np.isfinite(trajectory.q).all() and np.isfinite(trajectory.v).all()):
        raise StateError("the trajectory holds numbers that are not finite, which cannot be played")
    times = frame_times(float(trajectory.t[0]), float(trajectory.t[-1]), speed)
    q: Array = trajectory.at(times).q
    return q
