"""Moments of a motion, marked in its panels: crossings and events."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

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

MARKERS: tuple[dict[str, Any], ...] = tuple(
    {"color": color, "marker": marker, "linestyle": "none", "markersize": 4.5, "markerfacecolor": "white"}
    for marker, color in zip("osD^", (BLACK, BLACK, VERMILLION, PURPLE), strict=True)
)
"""Places of crossings, of the first, the second and further events on a curve that is not over time."""


class Eventful(Protocol):
    """What is marked of a `Trajectory`."""

    t: Array
    crossings: list[Crossing]
    t_events: list[Array]


def moment_names(runs: Iterable[Eventful]) -> list[str]:
    """Labels that the marks of all runs may have: crossings, then each event."""
    count = max((len(run.t_events) for run in runs), default=0)
    return [CROSSING, *([EVENT] if count == 1 else [f"{EVENT} {k}" for k in range(count)])]


def mark_moments(axes: Sequence[Axes], run: Eventful, names: Sequence[str]) -> None:
    """Mark crossings and events by lines through panels over time."""
    for crossing in run.crossings:
        mark_time(axes, crossing.time, label=names[0])
    for k, times in enumerate(run.t_events):
        for t in times:
            mark_time(axes, float(t), label=names[k + 1], **LOOKS[min(k, len(LOOKS) - 1)])


def mark_places(ax: Axes, run: Eventful, x: Array, y: Array, names: Sequence[str]) -> None:
    """Mark them on a curve y (N + 1,) over x (N + 1,), which may pass a value of x several times."""
    moments = [np.array([crossing.time for crossing in run.crossings]), *run.t_events]
    for k, times in enumerate(moments):
        if len(times):
            place = np.interp(times, run.t, x), np.interp(times, run.t, y)
            ax.plot(*place, label=names[k], **MARKERS[min(k, len(MARKERS) - 1)])
