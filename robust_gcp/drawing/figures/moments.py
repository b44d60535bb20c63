"""Moments of a motion, marked in its panels: crossings and events."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from .style import BLACK, PURPLE, VERMILLION, mark_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...maps.explicit import Crossing
    from ...mechanism.tree import Array

CROSSING = "crossing"
"""Label of their dotted lines."""

EVENT = "event"
"""Of theirs; with a number, as in `t_events`, where there are several."""

LOOKS: tuple[dict[str, Any], ...] = tuple(
    {"color": color, "linestyle": (0, (5, 1.5, *(1, 1.5) * dots)), "linewidth": 0.9}
    for dots, color in enumerate((BLACK, VERMILLION, PURPLE), start=1)
)
"""Lines of the first, the second and further events: a dash and as many dots."""


class Eventful(Protocol):
    """What is marked of a `Trajectory`."""

    crossings: list[Crossing]
    t_events: list[Array]


def mark_moments(axes: Sequence[Axes], runs: Iterable[Eventful]) -> list[str]:
    """Mark crossings and events of all runs in all panels; returns the labels that they may have."""
    runs = list(runs)
    count = max((len(run.t_events) for run in runs), default=0)
    events = [EVENT] if count == 1 else [f"{EVENT} {k}" for k in range(count)]
    for run in runs:
        for crossing in run.crossings:
            mark_time(axes, crossing.time, label=CROSSING)
        for k, times in enumerate(run.t_events):
            for t in times:
                mark_time(axes, float(t), label=events[k], **LOOKS[min(k, len(LOOKS) - 1)])
    return [CROSSING, *events]
