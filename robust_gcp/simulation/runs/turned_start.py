"""Starts where the coordinates of a mechanism turn back: set out in others."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.problem import Problem, set_out
from ...errors import PartitionError, SimulationError, ToggleError
from ...maps.choice import MapChoice
from ...maps.point import Counters
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from .coordinates import Coordinates


def set_out_well(
    mechanism: Mechanism,
    q0: ArrayLike | None,
    v0: ArrayLike | None,
    mode: ArrayLike | None,
    torque: Torque | ArrayLike | None,
    choice: MapChoice,
    counters: Counters,
) -> Problem:
    """`set_out`, in other coordinates where those of the mechanism turn back at the start.

    Raises
    ------
    ToggleError
        Where no others serve either.
    """
    try:
        return set_out(mechanism, q0, v0, mode, torque, choice, counters)
    except ToggleError as stop:
        q = mechanism.home if q0 is None else mechanism.configuration(q0, "q0")
        found = Coordinates(mechanism, mechanism.independent, counters).at_rest(q)
        for names in ([] if found is None else [found]) + _whole(mechanism, stop.choices):
            other = mechanism.with_independent(names)
            try:
                return set_out(other, q0, v0, mode, torque, choice, counters)
            except (SimulationError, PartitionError):
                continue
        raise


def _whole(mechanism: Mechanism, choices: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Choices of independent joints with those on groups, which are in all of them."""
    groups = groups_of(mechanism)
    kept = [] if groups is None else [n for n in mechanism.independent if n not in groups.rest.independent]
    return [(*kept, *names) for names in choices]
