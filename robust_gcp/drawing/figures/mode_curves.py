"""Modes as curves over two or three joints, with the tangents where they meet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.configuration_space import ConfigurationSpace
from ...mechanism.tree.tree import Array
from .axes import TorusAxis, segments
from .mechanism import fill
from .style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MODES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
"""Colours of modes a, b, c, …"""

MOST_DRAWN = len(MODES)
"""Modes with a colour and a small picture of their own."""

COINCIDENT = 0.012
"""Distance, as a share of the axes' ranges, within which two curves show as one."""

LETTER = 0.07
"""Size of a mode's letter as a share of the axes' ranges."""

STRIPE = 2.2
"""How much wider each further one of several curves in one place is drawn, pt."""


def _tangents(
    space: ConfigurationSpace, point: int, axes: Sequence[TorusAxis]
) -> list[tuple[str, Array, Array]]:
    """Colour, place (d,) and half tangent (d,) of each mode at a singular point."""
    picture = space.singular_points[point]
    place = np.array([a.wrapped(picture.q[a.iq]) for a in axes])
    limits = np.array([a.tangent for a in axes])
    found = []
    for name, tangent in zip(space.meeting(point), picture.modes, strict=True):
        way = tangent[[a.iv for a in axes]]
        size = np.abs(way / limits).max()
        found.append((mode_color(space, name), place, way / size if size > 1e-9 else 0.0 * way))
    return found


def mode_color(space: ConfigurationSpace, name: str) -> str:
    """Its colour; grey for modes beyond those that have one."""
    number = next(i for i, mode in enumerate(space.modes) if mode.name == name)
    return MODES[number] if number < MOST_DRAWN else "0.6"


def draw_plane(ax: Axes, space: ConfigurationSpace, x: TorusAxis, y: TorusAxis) -> None:
    """The modes over two coordinates."""
    widths = _widths(space, (x, y))
    for mode in reversed(space.modes):
        for part in segments(mode, (x, y)):
            ax.plot(*part.T, color=mode_color(space, mode.name), linewidth=widths[mode.name], zorder=2)
    for i in range(len(space.singular_points)):
        for color, place, way in _tangents(space, i, (x, y)):
            ends = np.array([place - way, place + way]).T
            ax.plot(*ends, color=color, alpha=0.25, linewidth=5.5, solid_capstyle="round", zorder=1)
            ax.plot(*place, "o", color="white", markeredgecolor=BLACK, markersize=4.5, zorder=4)
    _name(ax, space, (x, y))
    x.dress(ax.xaxis)
    y.dress(ax.yaxis)
    ax.set_box_aspect(1.0)


def _name(ax: Any, space: ConfigurationSpace, axes: Sequence[TorusAxis]) -> None:
    """Write each mode's letter on its curve, away from borders, singular points, other modes and letters.

    Curves that lie on each other are named together, in black.
    """
    paper = {"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    curves = [shares(mode.q, axes) for mode in space.modes]
    taken = [shares(p.q[None], axes) for p in space.singular_points]
    written: list[Array] = []
    for group in coincident(space, axes):
        named = [i for i in group if i < MOST_DRAWN]
        if not named:
            continue
        here = curves[named[0]]
        away = np.minimum(here, 1.0 - here).min(axis=1)
        for other in [*(c for i, c in enumerate(curves) if i not in group), *taken]:
            away = np.minimum(away, np.linalg.norm(here[:, None] - other[None], axis=2).min(axis=1))
        best = int(np.argmax(away))
        if any(np.linalg.norm(here[best] - other) < LETTER for other in written):
            continue  # its colour says which it is, a letter on a letter would not
        written.append(here[best])
        taken.append(here[best : best + 1])
        at = space.modes[named[0]].q[best]
        color = mode_color(space, space.modes[named[0]].name) if len(named) == 1 else BLACK
        ax.text(
            *(float(a.wrapped(at[a.iq])) for a in axes), ", ".join(space.modes[i].name for i in named),
            color=color, fontweight="bold", fontsize=8, bbox=paper, ha="center", va="center", zorder=5,
        )  # fmt: skip


def shares(q: Array, axes: Sequence[TorusAxis]) -> Array:
    """Places on the axes as shares of their ranges, (n, d)."""
    return np.array([(a.wrapped(q[:, a.iq]) - a.low) / (a.high - a.low) for a in axes]).T


def apart(one: Array, other: Array) -> float:
    """Largest distance of a row of one curve from the other curve."""
    return float(np.linalg.norm(one[:, None] - other[None], axis=2).min(axis=1).max())


def coincident(space: ConfigurationSpace, axes: Sequence[TorusAxis]) -> list[list[int]]:
    """The modes in groups that show as one curve over these axes."""
    curves = [shares(mode.q, axes) for mode in space.modes]
    groups: list[list[int]] = []
    for i, curve in enumerate(curves):
        for group in groups:
            if max(apart(curve, curves[group[0]]), apart(curves[group[0]], curve)) < COINCIDENT:
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _widths(space: ConfigurationSpace, axes: Sequence[TorusAxis]) -> dict[str, float]:
    """Line widths, pt: curves that lie on each other show as stripes."""
    widths = {}
    for group in coincident(space, axes):
        for k, i in enumerate(group):
            widths[space.modes[i].name] = 1.5 + STRIPE * k
    return widths


def draw_space(ax: Any, space: ConfigurationSpace, axes: Sequence[TorusAxis]) -> None:
    """The modes over three coordinates, ker K as a plane at singular points."""
    for i in range(len(space.singular_points)):
        tangents = _tangents(space, i, axes)
        for color, place, way in tangents:
            ends = np.array([place - way, place + way]).T
            ax.plot(*ends, color=color, alpha=0.3, linewidth=5.0, solid_capstyle="butt")
        if len(tangents) == 2:
            (_, place, one), (_, _, two) = tangents
            corners = np.array([place + one, place + two, place - one, place - two])
            fill(ax, corners, facecolor="0.5", alpha=0.12, edgecolor="none")  # a piece of the plane ker K
        if tangents:
            place = tangents[0][1]
            ax.plot(*place[:, None], "o", color="white", markeredgecolor=BLACK, markersize=4.5, zorder=9)
    widths = _widths(space, axes)
    for mode in reversed(space.modes):
        for part in segments(mode, axes):
            inside = np.array([np.clip(c, a.low, a.high) for c, a in zip(part.T, axes, strict=True)])
            ax.plot(*inside, color=mode_color(space, mode.name), linewidth=widths[mode.name] + 0.3)
    _name(ax, space, axes)
    for axis, coordinate in zip((ax.xaxis, ax.yaxis, ax.zaxis), axes, strict=True):
        coordinate.dress(axis, ends=False)
        axis.pane.set_facecolor("white")
        axis.pane.set_edgecolor("0.85")
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=0.95)
    ax.tick_params(labelsize=7, pad=-1)
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.labelpad = -1.5
    ax.zaxis.label.set_rotation(90.0)
    ax.view_init(elev=20.0, azim=-120.0)
