"""Timed calls: the least time of several counts, which other work on the machine disturbs least."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from .contender import clock


def seconds(call: Callable[[], object], now: Callable[[], float] = clock) -> float:
    """Of one call, by the processor's time unless another clock is given."""
    begun = now()
    call()
    return now() - begun


def least(call: Callable[[], object], rounds: int, now: Callable[[], float] = clock) -> float:
    """The least time of some calls, s."""
    return min(seconds(call, now) for _ in range(rounds))


def in_turn(works: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """The least of what each returns, called in turn so that other work on the machine meets all alike."""
    found = [{name: work() for name, work in works.items()} for _ in range(rounds)]
    return {name: min(times[name] for times in found) for name in works}


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """p of time ~ size^p."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])
