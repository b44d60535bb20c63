"""The configuration space as a picture: its modes as curves, where they meet, and what they look like."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...analysis.configuration_space import ConfigurationSpace
from ...analysis.space import trace_modes
from ...checks import names_given, path_given
from ...errors import OptionError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import Component
from .axes import TorusAxis
from .mode_curves import MOST_DRAWN, apart, draw_plane, draw_space, shares
from .mode_poses import caption_lines, draw_poses, pieces_of
from .style import new_figure, require_file, save, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABREAST = 4
"""Small pictures side by side."""

LINE = 0.2
"""Of a caption, in."""

SMALL = 1.75
"""Height of a line of them, in."""

ROWS = 80
"""Rows of a curve that its distance from others is taken at."""

SEPARATED = 0.8
"""Share of the best separation of the modes with which the first joints are taken."""


def plot_modes(
    mechanism: Mechanism | ConfigurationSpace,
    path: str | Path | None = None,
    coordinates: Sequence[str] | None = None,
) -> Figure:
    """Draw the configuration space of a mechanism with one degree of freedom; needs the extra `viz`.

    Above: the modes as curves over joint coordinates, on the torus cut open where nothing happens;
    full turns come back on the other side. Singular points carry the tangents of the modes that meet
    there (the tangent cone), in three dimensions within the plane ker K (the tangent space). Curves that
    lie on each other over the joints of a panel show as stripes. Below: the mechanism on each mode, and
    how far the search for modes went.

    Parameters
    ----------
    mechanism : Mechanism or ConfigurationSpace
        A mechanism is traced by `trace_modes` first.
    path : str or Path, optional
        Also write this .png or .pdf file.
    coordinates : sequence of str, optional
        Two or three joints to draw over, one number in q each; when left out, the independent one and
        two others over which the modes look different.

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
        require_file(path_given("path", path))
    with style():
        space = mechanism if isinstance(mechanism, ConfigurationSpace) else trace_modes(mechanism)
        axes: list[TorusAxis] = []
        for entry in chosen_coordinates(
            space.mechanism, _telling_apart(space) if coordinates is None else coordinates
        ):
            axes.append(TorusAxis(space, entry, axes))
        drawn = space.modes[:MOST_DRAWN]
        pieces = [(mode, rows) for mode in drawn for rows in pieces_of(mode)]
        lines = -(-len(pieces) // ABREAST)
        height = lines * (SMALL + LINE * (caption_lines(space, drawn) - 1))
        figure = new_figure(3.7 + height)
        upper, lower = np.asarray(figure.subfigures(2, 1, height_ratios=(3.7, height)))
        if len(axes) == 3:
            left, right = np.asarray(upper.subfigures(1, 2, width_ratios=(1.35, 1.0)))
            draw_space(left.add_subplot(projection="3d"), space, axes)
            panels = right.subplots(2, 1, sharex=True)
            for ax, other in zip(panels, axes[1:], strict=True):
                draw_plane(ax, space, axes[0], other)
            panels[0].set_xlabel("")
            right.align_ylabels(panels)
        else:
            draw_plane(upper.subplots(), space, axes[0], axes[1])
        columns = min(max(len(pieces), 3), ABREAST)
        small = list(lower.subplots(lines, columns, squeeze=False).flat)
        for ax in small[len(pieces) :]:
            ax.set_axis_off()
        draw_poses(small[: len(pieces)], space, pieces)
        more = f" (the first {MOST_DRAWN} in colour)" if len(space.modes) > MOST_DRAWN else ""
        title = f"{space.mechanism.name}: {space.summary}{more}"
        figure.suptitle(title, x=0.01, ha="left", fontsize=9)
        lower.supxlabel(space.search, x=0.01, ha="left", fontsize=7, color="0.4")
        if path is not None:
            save(figure, Path(path))
    return figure


def chosen_coordinates(mechanism: Mechanism, names: Sequence[str] | None) -> list[Component]:
    """The two or three joints to draw over, or an OptionError that lists those that will do.

    When none are named: the independent one and the first others.
    """
    single = {joint.name: joint.components[0] for joint in mechanism.joints if joint.single}
    if names is None:
        first = mechanism.independent[0]
        names = [first, *(name for name in single if name != first)][:3]
    names = names_given("coordinates", names)
    unknown = [name for name in names if name not in single]
    if unknown or len(names) not in (2, 3) or len(set(names)) < len(names):
        raise OptionError(
            f"coordinates = {names!r} must be two or three different joints with one number in q; "
            f"those of {mechanism.name!r} are {', '.join(single)}"
        )
    return [single[name] for name in names]


def _telling_apart(space: ConfigurationSpace) -> list[str] | None:
    """The independent joint and the first two others over which no two modes look alike; None: the first."""
    first = chosen_coordinates(space.mechanism, None)[0]
    others = [j.components[0] for j in space.mechanism.joints if j.single and j.name != first.name]
    couples = list(combinations(range(len(space.modes[:MOST_DRAWN])), 2))
    if len(others) < 3 or not couples:
        return None
    x = TorusAxis(space, first, [])
    distance = []
    for other in others:
        axes = (x, TorusAxis(space, other, [x]))
        curves = [shares(mode.q[:: max(1, len(mode.q) // ROWS)], axes) for mode in space.modes]
        distance.append([max(apart(curves[i], curves[k]), apart(curves[k], curves[i])) for i, k in couples])
    pairs = list(combinations(range(len(others)), 2))
    # two modes are told apart by whichever joint does it better; what counts is the couple told worst
    worst = [float(np.maximum(distance[i], distance[k]).min()) for i, k in pairs]
    i, k = next(p for p, w in zip(pairs, worst, strict=True) if w >= SEPARATED * max(worst))
    return [first.name, others[i].name, others[k].name]
