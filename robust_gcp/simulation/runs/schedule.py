"""When a run steps, which times it tells of, and which outputs stay in memory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_number, check_positive, check_whole, real_array, shown
from ...errors import OptionError
from ...mechanism.tree.tree import Array


@dataclass(frozen=True)
class Keep:
    """Each `every`-th output since the start, none with 0; and the last one, if `last`."""

    every: int
    last: bool = True

    @classmethod
    def of(cls, given: Any) -> Keep:
        """What the argument `keep` of `Simulation` asks for.

        Raises
        ------
        OptionError
            For anything but "all", "last", "none" or a whole number from 1 on.
        """
        words = {"all": ALL, "last": cls(0), "none": cls(0, last=False)}
        if isinstance(given, str):
            if given not in words:
                known = ", ".join(words)
                raise OptionError(
                    f"keep = {shown(given)} is unknown; use one of {known}, or n to keep each n-th step"
                )
            return words[given]
        check_whole("keep", given, 1)
        return cls(int(given))

    @property
    def all(self) -> bool:
        """Whether nothing is ever let go."""
        return self.every == 1

    def among(self, first: int, n: int) -> NDArray[np.int64]:
        """Which of n outputs stay, the first of which has the number `first`."""
        return np.arange(-first % self.every, n, self.every) if self.every else np.arange(0)

    def shown(self, first: int, n: int) -> NDArray[np.int64] | slice:
        """The same, with the last one where that is told of."""
        if self.all:
            return slice(0, n)
        chosen = self.among(first, n)
        if self.last and n and n - 1 not in chosen:
            return np.append(chosen, n - 1)
        return chosen


ALL = Keep(1)


MAX_OUTPUTS = 100_000_000
"""Most steps of a run: q and v of a four-bar alone then take 5 GB."""

SAME = 1e-9
"""Share of a step within which an output is at the end of one."""


@dataclass(frozen=True)
class Schedule:
    """Steps and outputs of a run.

    Attributes
    ----------
    times : ndarray (N + 1,)
        The start and the ends of the steps, s.
    outputs : ndarray (n,)
        Increasing, within the steps, s.
    row : ndarray of int (N + 1,)
        Which output each of `times` is, -1 where it is none.
    first : ndarray of int (N + 1,)
        How many outputs come before each of `times`.
    """

    times: Array
    outputs: Array
    row: NDArray[np.int64]
    first: NDArray[np.int64]

    @classmethod
    def every(cls, times: Array) -> Schedule:
        """An output at the end of each step, and at the start."""
        all_rows = np.arange(len(times))
        return cls(times, times, all_rows, all_rows)

    @classmethod
    def numbered(cls, t0: float, step: float, first: int, count: int) -> Schedule:
        """The same of steps of one length from t0 on, from the one numbered `first`."""
        return cls.every(t0 + step * np.arange(first, first + count))

    @classmethod
    def at(cls, times: Array, outputs: Array) -> Schedule:
        """These outputs, each at the end of a step or within one."""
        width = SAME * np.diff(times, prepend=2.0 * times[0] - times[1])  # of the step that ends there
        # looked up by output, of which there may be few to millions of steps
        reached = np.searchsorted(times + width, outputs)
        passed = np.searchsorted(times - width, outputs, side="right")
        first = np.cumsum(np.bincount(passed, minlength=len(times) + 1)[:-1])
        row = np.full(len(times), -1)
        for k in np.flatnonzero(passed > reached + 1):  # at the ends of several steps
            row[reached[k] : passed[k]] = k
        at_ends = np.flatnonzero(passed > reached)[::-1]  # of several outputs at one end the first counts
        row[reached[at_ends]] = at_ends
        return cls(times, outputs, row, first)

    @property
    def plain(self) -> bool:
        """Whether the outputs are the ends of the steps."""
        return self.outputs is self.times

    @cached_property
    def _inside(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The outputs within steps, and how many of them come before each of `times`."""
        aside = np.ones(len(self.outputs), dtype=bool)
        aside[self.row[self.row >= 0]] = False
        rows = np.flatnonzero(aside)
        return rows, np.searchsorted(rows, self.first)

    def rows_within(self, i: int, last: int) -> NDArray[np.int64]:
        """The outputs within the steps between these ends."""
        rows, before = self._inside
        return rows[before[i] : before[last]]

    def between(self, i: int, last: int) -> tuple[Array, NDArray[np.int64]] | None:
        """Their times, and how many of them come before each of these ends; None where there are none."""
        rows, before = self._inside
        if before[i] == before[last]:
            return None
        return self.outputs[rows[before[i] : before[last]]], before[i : last + 1] - before[i]

    def within(self, i: int) -> list[int]:
        """The outputs between the step's ends i − 1 and i."""
        return [] if self.plain else self.rows_within(i - 1, i).tolist()


def planned(
    t0: float, duration: float, step: float, outputs: ArrayLike | None, fixed: bool
) -> tuple[Schedule, float]:
    """The schedule that `simulate` was asked for, and the step.

    Parameters
    ----------
    fixed : bool
        Whether steps have this length; else a solver chooses its own, and only outputs matter.

    Raises
    ------
    OptionError
    """
    check_number("t0", t0)
    if not math.isfinite(t0):
        raise OptionError(f"t0 = {t0} must be finite")
    check_positive("duration", duration)
    check_positive("step", step)
    if step > duration * (1.0 + 1e-12):
        raise OptionError(f"step = {step} s is longer than the duration = {duration} s")
    if duration / step > MAX_OUTPUTS:
        raise OptionError(
            f"step = {step} s and duration = {duration} s make {duration / step:.3g} outputs, more than "
            f"{MAX_OUTPUTS:.0e}; use a larger step, or several runs one after the other"
        )
    end = t0 + duration
    if not t0 + step > t0 or not end - step < end:
        raise OptionError(f"t0 = {t0} s is so large that a step of {step} s after it is lost in rounding")
    # 2.1 / 0.7 is 3 and its rounding: no fourth step of 1e-16 s; the last one is shorter where it has to be
    count = max(1, math.ceil(duration / step - 1e-9))
    times = t0 + step * np.arange(count + 1)  # not summed up, which would drift by ε t a step
    times[-1] = end
    if outputs is None:
        return Schedule.every(times), step
    asked = _checked(outputs, t0, end)
    if not fixed:  # a change of coordinates goes back to the last of the times: not too far
        k, last = np.searchsorted(asked, times), len(asked) - 1
        before, after = asked[np.clip(k - 1, 0, last)], asked[np.clip(k, 0, last)]
        gap = np.minimum(np.abs(times - before), np.abs(times - after))
        # of two times that are one, the output's: it is told to the last bit as it was asked for
        times = np.unique(np.concatenate([times[gap > SAME * step], asked]))
    return Schedule.at(times, asked), step


def last_output(outputs: ArrayLike | None, t0: float) -> float | None:
    """The duration that outputs ask for, s; None where they say nothing."""
    if outputs is None:
        return None
    last = float(_times(outputs)[-1]) - t0
    return last if last > 0.0 else None


def _times(outputs: ArrayLike) -> Array:
    try:
        times = real_array(outputs)
    except TypeError:
        times = np.full(1, np.nan)
    increasing = times.ndim == 1 and len(times) > 0 and np.all(np.isfinite(times))
    if not increasing or not np.all(np.diff(times) > 0.0):
        raise OptionError(f"outputs = {shown(outputs)}: give increasing times, s, at least one")
    return times


def _checked(outputs: ArrayLike, t0: float, end: float) -> Array:
    times = _times(outputs)
    slack = SAME * (end - t0)
    if times[0] < t0 - slack or times[-1] > end + slack:
        raise OptionError(
            f"outputs from {times[0]:g} to {times[-1]:g} s lie outside the run, from {t0:g} to {end:g} s"
        )
    return np.clip(times, t0, end)  # 3 · 0.1 lies beyond 0.3 by rounding
