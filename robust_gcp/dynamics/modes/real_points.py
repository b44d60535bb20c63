"""A mode's real points beside a place, followed from a start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import SimulationError
from ...maps.choice import MapChoice
from ...maps.cluster.obstacles import ObstacleError
from ...maps.explicit import ExplicitMap, Point
from ...maps.start import Start
from ...mechanism.tree.tree import Array

STRIDE = 0.1
"""Step in which a map walks to a circle, dimensionless joint units."""

FARTHEST = 1e3
"""Strides to a place beyond which no map walks: no step that can be trusted goes as far."""


class Walk:
    """The mode's real points to one side of a place, by a map of its own from the start.

    Parameters
    ----------
    start : Start
    place : ndarray (m,)
        y there, which it goes by.
    inputs : ndarray of int
        Those that change from there.
    """

    def __init__(self, start: Start, place: Array, inputs: NDArray[np.int64]) -> None:
        self._start, self._place, self._inputs = start, place, inputs
        self._choice = MapChoice()
        self._explicit: ExplicitMap | None = None

    def to(self, change: Array) -> Point:
        """The point where the inputs have changed by so much."""
        goal = self._place.copy()
        goal[self._inputs] += change
        try:
            return self._led(goal)
        except ObstacleError:  # no bridge, or coordinates that serve poorly: the true curve
            if self._choice.error_controlled:
                raise
            self._choice = MapChoice(error_controlled=True)
            return self._led(goal)

    def _led(self, goal: Array) -> Point:
        """The point at the goal, in small steps from where it was last."""
        explicit, self._explicit = self._explicit, None  # none after a failure
        goals = [goal] if explicit is not None else [self._place, goal]
        if explicit is None:
            explicit = self._choice.over(self._start)
        mechanism, here, found = self._start.mechanism, explicit.anchor.y, explicit.anchor
        unit = mechanism.units[mechanism.iv_independent]
        for there in goals:
            away = np.abs((there - here) / unit).max() / STRIDE
            if not away < FARTHEST:
                raise SimulationError(
                    f"the mode is not followed to a place {away:.3g} strides of {STRIDE:g} joint units away"
                )
            count = max(1, int(np.ceil(away)))
            for share in np.arange(1, count + 1) / count:
                found = explicit.point_at(here + share * (there - here), np.zeros(mechanism.m))
            here = there
        self._explicit = explicit
        return found
