"""The configuration space as a picture: its modes as curves, where they meet, and what they look like."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...analysis.space import ConfigurationSpace, ModeCurve, trace_modes
from ...errors import OptionError
from ...mechanism.joints import Component
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .axes import TorusAxis, segments
from .mechanism import draw_pose, face_on, pose
from .style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    new_figure,
    require_file,
    save,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Index = NDArray[np.int64]

MODES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
"""Colours of modes a, b, c, …"""

POSES = 7
"""Configurations of each mode in its small picture, one of them in full."""

FADED = 0.16
"""Opacity of the others."""

MOST_DRAWN = 7
"""Modes with a colour and a small picture of their own."""


def plot_modes(
    mechanism: Mechanism | ConfigurationSpace,
    path: str | Path | None = None,
    coordinates: Sequence[str] | None = None,
) -> Figure:
    """Draw the configuration space of a mechanism with one degree of freedom; needs the extra `viz`.

    Above: the modes as curves over joint coordinates, on the torus cut open where nothing happens;
    full turns come back on the other side. Singular points carry the tangents of the modes that meet
    there (the tangent cone), in three dimensions within the plane ker K (the tangent space). Below:
    the mechanism on each mode.

    Parameters
    ----------
    mechanism : Mechanism or ConfigurationSpace
        A mechanism is traced by `trace_modes` first.
    path : str or Path, optional
        Also write this .png or .pdf file.
    coordinates : sequence of str, optional
        Two or three joints to draw over, one number in q each; the independent one and the first
        others when left out.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    OptionError
        For another number of degrees of freedom, joints that cannot be axes, another kind of file.
    MissingExtraError
        When Matplotlib is not installed.
    """
    if path is not None:
        require_file(Path(path))
    with style():
        space = mechanism if isinstance(mechanism, ConfigurationSpace) else trace_modes(mechanism)
        axes: list[TorusAxis] = []
        for entry in chosen_coordinates(space.mechanism, coordinates):
            axes.append(TorusAxis(space, entry, axes))
        figure = new_figure(5.4)
        drawn = space.modes[:MOST_DRAWN]
        upper, lower = np.asarray(figure.subfigures(2, 1, height_ratios=(3.6, 1.8)))
        if len(axes) == 3:
            left, right = np.asarray(upper.subfigures(1, 2, width_ratios=(1.35, 1.0)))
            _space(left.add_subplot(projection="3d"), space, axes)
            panels = right.subplots(2, 1, sharex=True)
            for ax, other in zip(panels, axes[1:], strict=True):
                _plane(ax, space, axes[0], other)
            panels[0].set_xlabel("")
            right.align_ylabels(panels)
        else:
            _plane(upper.subplots(), space, axes[0], axes[1])
        pieces = [(mode, rows) for mode in drawn for rows in _pieces(mode)]
        small = list(np.asarray(lower.subplots(1, max(len(pieces), 3))))
        for ax in small[len(pieces) :]:
            ax.set_axis_off()
        _thumbnails(small[: len(pieces)], space, pieces)
        figure.suptitle(_title(space), x=0.01, ha="left", fontsize=9)
        if path is not None:
            save(figure, Path(path))
    return figure


def _title(space: ConfigurationSpace) -> str:
    modes, points = len(space.modes), len(space.singular_points)
    counted = f"{modes} mode{'s' * (modes != 1)}, {points or 'no'} singular point{'s' * (points != 1)}"
    more = f" (the first {MOST_DRAWN} in colour)" if modes > MOST_DRAWN else ""
    return f"{space.mechanism.name}: {counted}{more}"


def chosen_coordinates(mechanism: Mechanism, names: Sequence[str] | None) -> list[Component]:
    """The two or three joints to draw over, or an OptionError that lists those that will do."""
    single = {joint.name: joint.components[0] for joint in mechanism.joints if joint.single}
    if names is None:
        first = mechanism.independent[0]
        names = [first, *(name for name in single if name != first)][:3]
    unknown = [name for name in names if name not in single]
    if unknown or len(names) not in (2, 3) or len(set(names)) < len(names):
        raise OptionError(
            f"coordinates = {list(names)!r} must be two or three different joints with one number in q; "
            f"those of {mechanism.name!r} are {', '.join(single)}"
        )
    return [single[name] for name in names]


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
        found.append((_color(space, name), place, way / size if size > 1e-9 else 0.0 * way))
    return found


def _color(space: ConfigurationSpace, name: str) -> str:
    number = next(i for i, mode in enumerate(space.modes) if mode.name == name)
    return MODES[number] if number < MOST_DRAWN else "0.6"


def _plane(ax: Axes, space: ConfigurationSpace, x: TorusAxis, y: TorusAxis) -> None:
    """The modes over two coordinates."""
    for mode in reversed(space.modes):
        for part in segments(mode, (x, y)):
            ax.plot(*part.T, color=_color(space, mode.name), linewidth=1.5, zorder=2)
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
    """Write each mode's letter on its curve, away from borders, singular points and other modes."""
    paper = {"boxstyle": "circle,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}

    def shares(q: Array) -> Array:
        """Places on the axes as shares of their ranges, (n, d)."""
        return np.array([(a.wrapped(q[:, a.iq]) - a.low) / (a.high - a.low) for a in axes]).T

    curves = [shares(mode.q) for mode in space.modes]
    points = [shares(p.q[None]) for p in space.singular_points]
    for i, mode in enumerate(space.modes[:MOST_DRAWN]):
        away = np.minimum(curves[i], 1.0 - curves[i]).min(axis=1)
        for other in [*curves[:i], *curves[i + 1 :], *points]:
            away = np.minimum(away, np.linalg.norm(curves[i][:, None] - other[None], axis=2).min(axis=1))
        at = mode.q[int(np.argmax(away))]
        ax.text(
            *(float(a.wrapped(at[a.iq])) for a in axes), mode.name, color=_color(space, mode.name),
            fontweight="bold", fontsize=8, bbox=paper, ha="center", va="center", zorder=5,
        )  # fmt: skip


def _space(ax: Any, space: ConfigurationSpace, axes: Sequence[TorusAxis]) -> None:
    """The modes over three coordinates, ker K as a plane at singular points."""
    for i in range(len(space.singular_points)):
        tangents = _tangents(space, i, axes)
        for color, place, way in tangents:
            ends = np.array([place - way, place + way]).T
            ax.plot(*ends, color=color, alpha=0.3, linewidth=5.0, solid_capstyle="butt")
        if len(tangents) == 2:
            (_, place, one), (_, _, two) = tangents
            corners = np.array([place + one, place + two, place - one, place - two])
            _patch(ax, corners)
        if tangents:
            place = tangents[0][1]
            ax.plot(*place[:, None], "o", color="white", markeredgecolor=BLACK, markersize=4.5, zorder=9)
    for mode in reversed(space.modes):
        for part in segments(mode, axes):
            inside = np.array([np.clip(c, a.low, a.high) for c, a in zip(part.T, axes, strict=True)])
            ax.plot(*inside, color=_color(space, mode.name), linewidth=1.8)
    _name(ax, space, axes)
    for axis, coordinate in zip((ax.xaxis, ax.yaxis, ax.zaxis), axes, strict=True):
        coordinate.dress(axis, ends=False)
        axis.pane.set_facecolor("white")
        axis.pane.set_edgecolor("0.85")
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=0.95)
    ax.tick_params(labelsize=7, pad=-1)
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90.0)
    ax.view_init(elev=20.0, azim=-120.0)


def _patch(ax: Any, corners: Array) -> None:
    """A piece of the plane ker K."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    ax.add_collection3d(Poly3DCollection([corners], facecolor="0.5", alpha=0.12, edgecolor="none"))


def _pieces(mode: ModeCurve) -> list[Index]:
    """Rows of the mode between the points where it crosses itself; all rows where it does not."""
    seen: dict[int, set[int]] = {}
    for visit in mode.visits:
        seen.setdefault(visit.point, set()).add(visit.tangent)
    cuts = sorted({v.row for v in mode.visits if len(seen[v.point]) > 1} - {0, len(mode.q) - 1})
    pieces = np.split(np.arange(len(mode.q)), cuts)
    if cuts and mode.closed and not any(v.row == 0 and len(seen[v.point]) > 1 for v in mode.visits):
        pieces = [*pieces[1:-1], np.concatenate([pieces[-1], pieces[0]])]  # its first row is none of them
    return pieces


def _thumbnails(
    axes: Sequence[Axes], space: ConfigurationSpace, pieces: Sequence[tuple[ModeCurve, Index]]
) -> None:
    """The mechanism at a few configurations of each piece, all to one scale."""
    mechanism = space.mechanism
    view = face_on(mechanism)
    poses = [[pose(mechanism, mode.q[r], view) for r in _spread(mode, rows)] for mode, rows in pieces]
    room = np.vstack([p.points for some in poses for p in some])
    low, high = room.min(axis=0), room.max(axis=0)
    margin = 0.08 * float((high - low).max())
    for ax, (mode, rows), some in zip(axes, pieces, poses, strict=True):
        color = _color(space, mode.name)
        for p in some[1:]:
            draw_pose(ax, p, FADED, pins=False, scale=0.7, color=color)
        draw_pose(ax, some[0], scale=0.7, color=color)
        ax.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        ax.set(aspect="equal", xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
        whole = len(rows) == len(mode.q)
        ax.set_title(f"mode {mode.name}" if whole else f"mode {mode.name}, in part", color=color, pad=4)
        turns = ", ".join(f"{n:d}".replace("-", "−") for n in mode.turns)
        ax.set_xlabel(f"turns ({turns})" if mode.closed else "open", fontsize=8, labelpad=2)


def _spread(mode: ModeCurve, rows: Index) -> list[int]:
    """Some of the rows, at equal ways; the first is in the middle between singular points."""
    steps = np.linalg.norm(np.diff(mode.q[rows], axis=0), axis=1)
    steps = np.where(np.diff(rows) == 1, steps, 0.0)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    marks = way[np.isin(rows, [v.row for v in mode.visits])]
    if len(rows) < len(mode.q):
        marks = way[[0, -1]]
    begin = 0.15 * way[-1]
    if len(marks):
        away = np.abs((way[:, None] - marks + 0.5 * way[-1]) % way[-1] - 0.5 * way[-1]).min(axis=1)
        begin = float(way[int(np.argmax(away[: len(away) // 2 + 1]))])
    ways = (begin + way[-1] * np.arange(POSES) / POSES) % way[-1]
    return [int(rows[np.argmin(np.abs(way - w))]) for w in ways]
