"""Moments of a motion, marked in its panels: crossings, events, what happens at stops, friction, locks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, mark_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...mechanism.tree.tree import Array
    from ...simulation.trajectories.trajectory import Trajectory

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

HAPPENINGS = {
    "impact": (VERMILLION, "v"),
    "grazing": (VERMILLION, "1"),
    "hold": (BLACK, "s"),
    "release": (GREEN, "^"),
    "at rest": (SKY, "d"),
    "lock": (BLUE, "P"),
    "touch": (ORANGE, ">"),
    "leave": (PURPLE, "<"),
}
"""Colour and marker of each kind; of another one grey dots."""

THIN: dict[str, Any] = {"linestyle": "-", "linewidth": 0.6, "alpha": 0.75}
"""Their lines: there may be many."""

SMALL: dict[str, Any] = {"linestyle": "none", "markersize": 3.5, "markerfacecolor": "white"}
"""Their markers."""


class Moments(NamedTuple):
    """Times of one kind, s, and how they look: as lines over time, as markers on a curve over a column."""

    times: list[float]
    line: dict[str, Any]
    marker: dict[str, Any]


def moment_names(runs: Iterable[Trajectory]) -> list[str]:
    """Labels that the marks of all runs may have: crossings, each event, then kinds of happenings."""
    given = list(runs)
    count = max((len(run.t_events) for run in given), default=0)
    kinds = [h.kind for run in given for h in run.happenings]
    found = sorted(dict.fromkeys(kinds), key=lambda kind: [*HAPPENINGS, kind].index(kind))
    return [CROSSING, *([EVENT] if count == 1 else [f"{EVENT} {k}" for k in range(count)]), *found]


def mark_moments(axes: Sequence[Axes], run: Trajectory, names: Sequence[str]) -> None:
    """Mark them by lines through panels over time."""
    for name, moments in _moments(run, names).items():
        for t in moments.times:
            mark_time(axes, t, label=name, **moments.line)


def mark_places(ax: Axes, run: Trajectory, x: Array, y: Array, names: Sequence[str]) -> None:
    """Mark them on a curve y (N + 1,) over x (N + 1,), which may pass a value of x several times."""
    for name, moments in _moments(run, names).items():
        if moments.times:
            place = np.interp(moments.times, run.t, x), np.interp(moments.times, run.t, y)
            ax.plot(*place, label=name, **moments.marker)


def _moments(run: Trajectory, names: Sequence[str]) -> dict[str, Moments]:
    """Those of a run, by their labels."""
    found = {names[0]: Moments([crossing.time for crossing in run.crossings], {}, MARKERS[0])}
    for k, times in enumerate(run.t_events):
        look = LOOKS[min(k, len(LOOKS) - 1)], MARKERS[min(k + 1, len(MARKERS) - 1)]
        found[names[k + 1]] = Moments(np.asarray(times).tolist(), *look)
    for happening in run.happenings:
        color, marker = HAPPENINGS.get(happening.kind, (GREY, "."))
        look = {"color": color, **THIN}, {"color": color, "marker": marker, **SMALL}
        found.setdefault(happening.kind, Moments([], *look)).times.append(happening.time)
    return found
