"""Motions over time, or over another column, in stacked panels, the crossings marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...checks import path_given, shown
from ...errors import OptionError
from ...mechanism.tree.joints import components_of
from ...mechanism.tree.tree import Array
from ...simulation.trajectories.trajectory import Trajectory
from .moments import mark_moments, mark_places, moment_names
from .panels import LAMBDA, Asked, Line, Panel, Runs, lines_of_column, panels_of, units
from .style import BLACK, CYCLE, YELLOW, new_figure, require_file, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMED = 10
"""Half of the most names in the legend, and most in that of a panel of its own."""

FEW = 7
"""Names in the legend of more lines than that."""

COLORS = (
    *(*CYCLE, YELLOW, "#882255", "#999933"),
    *("#0000FF", "#00DD00", "#FF00DD", "#001188", "#FF0055"),
    *("#663311", "#AA77FF", "#FFAA88", "#224400", "#008800"),
)
"""Of so many lines; of more, colours run from the first to the last. Tol's wine and olive, "Colour Schemes"
(2021), end the first row, then comes each as far as can be from those before, white and `GREY` in CIELAB."""

DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (5, 1.5, 1, 1.5)))
"""Lines of the first and of further runs."""

ALIKE = 0.02
"""Share of a panel's height within which two lines look like one."""

WIDEST = 3.4
"""Points."""

SMALLEST = 1e-17
"""Where a closure error of exactly 0 is drawn, m or rad: a tenth of a rounding."""

HIGHEST = 1e-13
"""Least upper end of that panel: rounding should look like rounding, m or rad."""

ABREAST = 3
"""Names in a line of the legend of a panel of its own."""

OWN_LINE = 13.0
"""Its height, pt."""

LEGEND_LINE = 0.17
"""in."""

PANEL_HEIGHT = 1.35
"""in."""

LARGER = 1.7
"""Factor on it where a curve is drawn over another column than time."""


def plot_motion(
    runs: Runs,
    what: Asked = None,
    path: str | Path | None = None,
    joints: Asked = None,
    x: str | None = None,
) -> Figure:
    """Draw trajectories of one mechanism; see `Trajectory.plot`."""
    first = next(iter(runs.values()))
    for label, run in runs.items():
        if components_of(run.mechanism.joints) != components_of(first.mechanism.joints):
            raise OptionError(f"overlay: {label!r} is the motion of a mechanism with other joints")
    panels, title = panels_of(runs, what, joints, x)
    over, *_ = [_over(run, x) for run in runs.values()]
    if path is not None:
        require_file(path_given("path", path))
    moments = moment_names(runs.values())
    long = [panel for panel in panels if panel.quantity == LAMBDA]
    looks = _styles(first, [panel for panel in panels if panel.quantity != LAMBDA])
    for panel in long:
        looks |= _styles(first, [panel])
    with style():
        figure = new_figure(0.5 + PANEL_HEIGHT * len(panels) * (1 if x is None else LARGER))
        axes = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False).flat)
        for dashes, run in zip(cycle(DASHES), runs.values(), strict=False):
            columns = run.columns()
            across = columns[over.column]
            for ax, panel in zip(axes, panels, strict=True):
                if panel.lines:
                    _draw_lines(ax, panel, columns, across, looks, dashes)
                    for line in panel.lines if x is not None else ():
                        mark_places(ax, run, across, columns[line.column], moments)
                else:
                    _draw_error(ax, run, panel.quantity, across, dashes)
            if x is None:
                mark_moments(axes, run, moments)
        for ax, panel in zip(axes, panels, strict=True):
            if x is None:
                ax.margins(x=0.0)
            if panel in long and len(panel.lines) <= NAMED:
                names = [line.name for line in panel.lines]
                handles = [next(drawn for drawn in ax.lines if drawn.get_label() == name) for name in names]
                ax.legend(
                    handles=handles, fontsize=6.5, loc="lower left", bbox_to_anchor=(0, 1), ncols=ABREAST
                )
        axes[-1].set_xlabel(f"{x or 't'} [{units(first.mechanism, first.part_names)[over.column][1]}]")
        own = -(-len(panels[0].lines) // ABREAST) if panels[0] in long else 0
        axes[0].set_title(first.mechanism.name, loc="left", pad=6.0 + OWN_LINE * own)
        rows = [ax for ax, panel in zip(axes, panels, strict=True) if panel not in long]
        _legend(figure, rows or axes[:0], title, list(runs) if len(runs) > 1 else [], moments)
        figure.align_ylabels()
        if path is not None:
            save(figure, Path(path))
    return figure


def _over(run: Trajectory, x: str | None) -> Line:
    """The column that is drawn over."""
    if x is None:
        return Line("t", "t")
    if not isinstance(x, str):
        raise OptionError(f"x = {shown(x)} must be the name of a column")
    found = lines_of_column(run, x, "x")
    if len(found) > 1:
        raise OptionError(
            f"x = {x!r} has several numbers; use one of {', '.join(line.column for line in found)}"
        )
    return found[0]


def _draw_lines(
    ax: Axes, panel: Panel, columns: Mapping[str, Array], across: Array, looks: Mapping[str, Any], dashes: Any
) -> None:
    for line in panel.lines:
        look = {**looks[line.name], "linestyle": dashes}
        ax.plot(across, columns[line.column], label=line.name, **look)
    ax.set_ylabel(f"{panel.quantity} [{panel.unit}]")


def _styles(run: Trajectory, panels: Sequence[Panel]) -> dict[str, dict[str, Any]]:
    """Colour and width of each line: wider below others that look like it, so that it stays visible."""
    names = list(dict.fromkeys(line.name for panel in panels for line in panel.lines))
    colors = _colors(run, names)
    if len(names) > len(COLORS):
        return {name: {"color": colors[name], "linewidth": 0.9} for name in names}
    covered = dict.fromkeys(names, 0)
    columns = run.columns()
    for panel in panels:
        values = [columns[line.column] for line in panel.lines]
        near = ALIKE * float(np.ptp(values)) if values else 0.0
        for k, line in enumerate(panel.lines):
            over = sum(float(np.abs(values[k] - later).max()) <= near for later in values[k + 1 :])
            covered[line.name] = max(covered[line.name], over)
    return {
        name: {"color": colors[name], "linewidth": min(1.2 + 0.9 * covered[name], WIDEST)} for name in names
    }


def _colors(run: Trajectory, names: Sequence[str]) -> dict[str, Any]:
    """A colour for each; of too many to tell apart for numbers of joints with several, the rest in shades."""
    if len(names) <= len(COLORS):
        return dict(zip(names, COLORS, strict=False))
    from matplotlib import colormaps

    several: list[str] = []
    for joint in sorted(run.mechanism.joints, key=lambda joint: -len(joint.components)):  # bases first
        own = [c.name for c in joint.components if c.name in names]
        if len(joint.components) > 1 and len(several) + len(own) <= len(COLORS):
            several += own
    rest = [name for name in names if name not in several]
    share = 0.95 / max(len(rest) - 1, 1)
    shades = {name: colormaps["viridis"](share * i) for i, name in enumerate(rest)}
    return shades | dict(zip(several, COLORS, strict=False))


def _draw_error(ax: Axes, trajectory: Trajectory, quantity: str, across: Array, dashes: Any) -> None:
    if quantity == "energy":
        ax.plot(across, trajectory.energy_error(), color=CYCLE[0], linestyle=dashes)
        ax.set_ylabel("energy error [J]")
        return
    is_length = trajectory.mechanism.implicit.is_length
    units = [unit for unit, there in (("m", is_length.any()), ("rad", (~is_length).any())) if there]
    error = np.maximum(trajectory.closure_error(), SMALLEST)
    ax.semilogy(across, error, color=CYCLE[0], linewidth=0.8, linestyle=dashes)
    highest = max(float(np.max(np.asarray(line.get_ydata()))) for line in ax.lines)
    ax.set_ylim(0.5 * SMALLEST, max(2.0 * highest, HIGHEST))
    ax.set_ylabel(f"max |φ| [{' or '.join(units) or 'm'}]")


def _legend(
    figure: Figure, axes: Sequence[Axes], title: str, runs: Sequence[str], moments: Sequence[str]
) -> None:
    """Name the lines once, to the right: all of few, some of many; runs by their dashes, then moments."""
    named: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            named.setdefault(label, handle)
    happened = {label: named.pop(label) for label in moments if label in named}
    labels = list(named)
    if len(labels) > 2 * NAMED:
        kept = np.unique(np.linspace(0, len(labels) - 1, FEW).round().astype(int))
        told = [label for label in labels if named[label].get_color() in COLORS]
        told = told if len(told) + FEW < figure.get_figheight() / LEGEND_LINE else []
        shown = {label: named[label] for label in dict.fromkeys([*told, *(labels[i] for i in kept)])}
        title = f"{len(labels)} numbers, such as"
    else:
        shown = dict(named)
    if runs:
        from matplotlib.lines import Line2D

        looks = zip(cycle(DASHES), runs, strict=False)
        shown |= {label: Line2D([], [], color=BLACK, linestyle=dashes) for dashes, label in looks}
    shown |= happened
    if shown:
        figure.legend(shown.values(), shown.keys(), loc="outside right upper", title=title or None)
