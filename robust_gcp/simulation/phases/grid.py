"""Ends of steps, on and on or up to the end of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...mechanism.tree import Array
from .chosen import SAME


@dataclass(frozen=True)
class Grid:
    """t0 + k step for all k, or the times that are given.

    Attributes
    ----------
    t0, step : float
        s.
    times : ndarray (N + 1,) or None
    """

    t0: float
    step: float
    times: Array | None = None

    def number(self, k: int) -> float:
        """Its k-th time, s."""
        return self.t0 + self.step * k if self.times is None else float(self.times[k])

    @property
    def end(self) -> float:
        """The last one, s."""
        return np.inf if self.times is None else float(self.times[-1])

    @property
    def slack(self) -> float:
        """s within which times are the same: a step of the grid is left out beside an event."""
        return SAME * self.step

    def after(self, t: float, n: int) -> Array:
        """The next n times after t, or as many as there are."""
        since = t + self.slack
        if self.times is not None:
            first = int(np.searchsorted(self.times, since, side="right"))
            return self.times[first : first + n]
        k = int(np.floor((since - self.t0) / self.step))
        times = self.t0 + self.step * np.arange(k, k + n + 2)
        return times[times > since][:n]
