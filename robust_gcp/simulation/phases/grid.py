"""Ends of steps, on and on or up to the end of a run, and which of them are kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array
from ..runs.schedule import Keep

SAME = 1e-9
"""Share of a step within which times are the same."""


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

    def number(self, k: float) -> float:
        """Its k-th time, s; what lies between two for a part of a step, where times are not given."""
        return self.t0 + self.step * k if self.times is None else float(self.times[int(k)])

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
        times = self.t0 + self.step * np.arange(k, k + n + 2)  # one more at each end, as k is rounded
        return times[times > since][:n]


@dataclass(frozen=True)
class Chosen:
    """Ends of steps, or times that were asked for.

    Attributes
    ----------
    grid : Grid
        Where steps end.
    times : ndarray (n,) or None
        Those asked for.
    keep : Keep
        Which of all where none were.
    """

    grid: Grid
    times: Array | None
    keep: Keep

    @property
    def all(self) -> bool:
        """Whether all are kept, those beside events too."""
        return self.times is None and self.keep.all

    def among(self, t: Array) -> NDArray[np.bool_]:
        """Which of these times are kept."""
        if self.all:
            return np.ones(len(t), dtype=bool)
        if self.times is not None:
            return np.asarray(np.abs(self.nearest(t) - t) <= self.grid.slack)
        t0, step = self.grid.t0, self.grid.step
        k = np.round((t - t0) / step).astype(np.int64)
        on_grid = np.abs(t0 + step * k - t) <= self.grid.slack
        every = self.keep.every
        return np.asarray(on_grid & (k % every == 0)) if every else np.zeros(len(t), dtype=bool)

    def nearest(self, t: Array) -> Array:
        """The times asked for that are next to these."""
        assert self.times is not None
        after = np.clip(np.searchsorted(self.times, t), 0, len(self.times) - 1)
        before = np.maximum(after - 1, 0)
        nearer = np.abs(self.times[before] - t) < np.abs(self.times[after] - t)
        return np.asarray(np.where(nearer, self.times[before], self.times[after]))

    def between(self, begin: float, end: float) -> Array:
        """The times asked for that lie within a step, or the part of one, and at neither end."""
        if self.times is None:
            return np.zeros(0)
        slack = self.grid.slack
        first, last = np.searchsorted(self.times, [begin + slack, end - slack], side="right")
        return self.times[first:last]
