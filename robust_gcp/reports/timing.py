"""Timed calls: the least time of several counts, which other work on the machine disturbs least."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .contender import clock


def seconds(call: Callable[[], object], now: Callable[[], float]) -> float:
    """Of one call, by this clock."""
    begun = now()
    call()
    return now() - begun


def least(call: Callable[[], object], rounds: int) -> float:
    """The least of some calls, s of the processor's time."""
    return min(seconds(call, clock) for _ in range(rounds))


def in_turn(works: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """The least of what each returns, called in turn so that other work on the machine meets all alike."""
    found = [{name: work() for name, work in works.items()} for _ in range(rounds)]
    return {name: min(times[name] for times in found) for name in works}
