"""The states that a run hands back, and how its step fits the scene's output times."""

from __future__ import annotations

import numpy as np

from ...mechanism.tree import Array
from ..contender import Outcome, Scene

BOUND = 1e8
"""A coordinate or velocity beyond it, in SI units, has left every scene here: the run has blown up."""


def division(scene: Scene, step: float) -> tuple[int, float]:
    """How many equal steps lie between two outputs, and their length, s: the nearest to `step`."""
    spacing = float(scene.times[-1]) / (len(scene.times) - 1)
    count = max(1, round(spacing / step))
    return count, spacing / count


class Outputs:
    """q and v at the scene's times, filled while a tool steps.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: Scene) -> None:
        self._times = scene.times
        n = len(scene.times)
        self._q, self._v = np.empty((n, len(scene.q0))), np.empty((n, len(scene.v0)))
        self._q[0], self._v[0] = scene.q0, scene.v0
        self._filled = 1

    def put(self, q: Array, v: Array) -> bool:
        """Keep the next state; False, and nothing is kept, once the run has blown up."""
        if not (np.abs(q).max() < BOUND and np.abs(v).max() < BOUND):  # so written for NaN's sake
            return False
        self._q[self._filled], self._v[self._filled] = q, v
        self._filled += 1
        return True

    def outcome(self, seconds: float, rhs: int, why: str = "the state left the finite numbers") -> Outcome:
        """The states kept; where some are missing, `why` with the time at which the first is."""
        n = self._filled
        stopped = "" if n == len(self._times) else f"{why} before t = {self._times[n]:.6g} s"
        return Outcome(self._q[:n], self._v[:n], seconds, rhs, stopped)
