"""Small pictures of a mechanism on each of its modes."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...analysis.configuration_space import ConfigurationSpace, ModeCurve
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import in_v
from .mechanism import draw_pose, face_on, poses
from .mode_curves import mode_color

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Index = NDArray[np.int64]

POSES, LEAST = 7, 3
"""Most and fewest configurations of each mode in its small picture, one of them in full."""

BARS = 24
"""Bodies in a small picture, all configurations together, that it stays readable with."""

FADED = 0.16
"""Opacity of the others."""

CAPTION = 26
"""Letters in a line below a small picture."""


def pieces_of(mode: ModeCurve) -> list[Index]:
    """Rows of the mode between the points where it crosses itself; all rows where it does not."""
    seen: dict[int, set[int]] = {}
    for visit in mode.visits:
        seen.setdefault(visit.point, set()).add(visit.tangent)
    cuts = sorted({v.row for v in mode.visits if len(seen[v.point]) > 1} - {0, len(mode.q) - 1})
    pieces = np.split(np.arange(len(mode.q)), cuts)
    if cuts and mode.closed and not any(v.row == 0 and len(seen[v.point]) > 1 for v in mode.visits):
        pieces = [*pieces[1:-1], np.concatenate([pieces[-1], pieces[0]])]  # its first row is none of them
    return pieces


def draw_poses(
    axes: Sequence[Axes], space: ConfigurationSpace, pieces: Sequence[tuple[ModeCurve, Index]]
) -> None:
    """The mechanism at a few configurations of each piece, all to one scale."""
    mechanism = space.mechanism
    view = face_on(mechanism)
    count = max(LEAST, min(POSES, BARS // len(mechanism.joints)))
    seen = [poses(mechanism, mode.q[_spread(mode, rows, count)], view) for mode, rows in pieces]
    room = np.vstack([p.points for some in seen for p in some])
    low, high = room.min(axis=0), room.max(axis=0)
    margin = 0.08 * float((high - low).max())
    for ax, (mode, rows), some in zip(axes, pieces, seen, strict=True):
        color = mode_color(space, mode.name)
        for p in some[1:]:
            draw_pose(ax, p, FADED, pins=False, scale=0.7, color=color)
        draw_pose(ax, some[0], scale=0.7, color=color)
        ax.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        ax.set(aspect="equal", xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
        whole = len(rows) == len(mode.q)
        ax.set_title(f"mode {mode.name}" if whole else f"mode {mode.name}, in part", color=color, pad=9)
        ax.set_xlabel(_turns(mechanism, mode), fontsize=8, labelpad=2)


def caption_lines(space: ConfigurationSpace, modes: Sequence[ModeCurve]) -> int:
    """How many lines the longest caption has."""
    return max((_turns(space.mechanism, mode).count("\n") + 1 for mode in modes), default=1)


def _turns(mechanism: Mechanism, mode: ModeCurve) -> str:
    """Which joints turn fully on one way around a mode, in lines of a caption's width."""
    if not mode.closed:
        return "open"
    names = (component.name for component in in_v(mechanism.joints))
    full = [f"{name}\N{NO-BREAK SPACE}{n:+d}" for name, n in zip(names, mode.turns, strict=True) if n]
    text = f"turns: {', '.join(full)}".replace("-", "−") if full else "no full turn"
    return fill(text, CAPTION)


def _spread(mode: ModeCurve, rows: Index, count: int) -> list[int]:
    """Some of the rows, at equal ways; the first is in the middle between singular points."""
    steps = np.linalg.norm(np.diff(mode.q[rows], axis=0), axis=1)
    steps = np.where(np.diff(rows) == 1, steps, 0.0)  # a piece over a closed mode's end jumps back by turns
    way = np.concatenate([[0.0], np.cumsum(steps)])
    marks = way[np.isin(rows, [v.row for v in mode.visits])]
    if len(rows) < len(mode.q):
        marks = way[[0, -1]]
    begin = 0.15 * way[-1]
    if len(marks):
        away = np.abs((way[:, None] - marks + 0.5 * way[-1]) % way[-1] - 0.5 * way[-1]).min(axis=1)
        begin = float(way[int(np.argmax(away[: len(away) // 2 + 1]))])
    ways = (begin + way[-1] * np.arange(count) / count) % way[-1]
    return [int(rows[np.argmin(np.abs(way - w))]) for w in ways]
