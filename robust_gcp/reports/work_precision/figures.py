"""The figures: error against seconds and against evaluations, closure, energy."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...drawing.figures import style as plots
from .looks import Labels, Look, looks, setting_text
from .measure import Point
from .ours import FLOOR, named
from .references import Reference
from .verdicts import OURS, Curves, order

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FLOOR_LINE: dict[str, Any] = {"color": "0.72", "linewidth": 5.0, "solid_capstyle": "round", "zorder": 2}
LOWEST, HIGHEST = 1e-17, 10.0
"""Edges of the error axes; failures stand at the upper one."""

Value = Callable[[Point], float]
PAGE_DPI = 200
"""Of the figure on a page, which is to stay small."""

LEAST_ORDER = 0.5
"""Below it, errors do not fall with the step."""

COLUMNS = 3
"""Of the legend."""

KINDS = {"fixed": "fixed steps", "adaptive": "error control"}
QUANTITIES = {"seconds": "run time [s]", "rhs": "evaluations of the equations"}
SPAN = 20.0
"""Least ratio of an axis' ends: fewer decades leave it without numbers."""

SMALL: dict[str, Any] = {
    "axes.labelsize": 7,
    "axes.titlesize": 8,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 5.3,
}


def draw(title: str, curves: Curves, reference: Reference, foot: str, path: Path, whole: bool = True) -> Path:
    """All panels of a scene, or for a page those of the error against seconds alone; returns the path."""
    rows, height, dpi = (4, 1.95, plots.DPI) if whole else (1, 3.2, PAGE_DPI)
    with plots.style(), plots.require_matplotlib().rc_context(SMALL):
        styles = looks([(n, curve[0].family) for n, curve in curves.items() if any(p.timed for p in curve)])
        figure, grid = _laid_out(rows, height, _handles(curves, styles, reference), foot)
        shown = grid[: len(QUANTITIES)]
        for row, quantity in zip(shown, QUANTITIES, strict=False):
            for ax, kind in zip(row, KINDS, strict=True):
                _trajectory_panel(ax, curves, styles, reference, kind, quantity)
        if whole:
            closure, velocity = "closure: max |φ|", "closure: max |K v|"
            _defect_panel(grid[2][0], curves, styles, lambda p: p.closure, closure, KINDS)
            _defect_panel(grid[2][1], curves, styles, lambda p: p.closure_velocity, velocity, KINDS)
            for ax, kind in zip(grid[3], KINDS, strict=True):
                label = f"energy error, {KINDS[kind]}"
                _defect_panel(ax, curves, styles, lambda p: p.energy, label, (kind,))
        else:
            grid[0][1].set_ylabel("")
        grid[0][0].set_title(f"{title}: {KINDS['fixed']}", loc="left", pad=9)
        grid[0][1].set_title(KINDS["adaptive"], loc="left", pad=9)
        _write_labels(figure, [ax for row in shown for ax in row], curves, styles, reference)
        return plots.save(figure, path, dpi)


# --------------------------------------------------------------------------- panels


def _trajectory_panel(
    ax: Axes, curves: Curves, styles: dict[str, Look], reference: Reference, kind: str, quantity: str
) -> None:
    """Path-wise error of one kind of contenders; failures at the top edge, within the range of the others."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    shown = {name: curve for name, curve in curves.items() if name in styles and curve[0].kind == kind}
    places = [getattr(p, quantity) for curve in shown.values() for p in curve if p.good]
    if places:
        low, high = min(places), max(places)
        room = max(1.3 * (high / low) ** 0.1, (SPAN * low / high) ** 0.5)
        ax.set_xlim(low / room, high * room)
    for name, curve in shown.items():
        good = [p for p in curve if p.good]
        ax.plot([getattr(p, quantity) for p in good], [p.error for p in good], **styles[name])
        edge = {**styles[name], "linestyle": "none", "clip_on": False}
        for p in curve:
            if p.timed and not p.good:
                ax.plot([_edge(ax, p, quantity)], [HIGHEST], **edge)
        if curve[0].family == OURS:
            _floor_line(ax, curve, curves, quantity)
    ax.set_ylim(0.3 * min(reference.accuracy, 1e-11), HIGHEST)
    ax.axhspan(1e-30, reference.accuracy, color="0.9", zorder=0.5)
    ax.set(xlabel=QUANTITIES[quantity], ylabel="path-wise error [rad]")
    ax.minorticks_off()


def _edge(ax: Axes, point: Point, quantity: str) -> float:
    """Where a failure stands: at its cost, or at the end of the axis beyond which that lies."""
    low, high = ax.get_xlim()
    return float(np.clip(getattr(point, quantity), low, high))


def _floor_line(ax: Axes, curve: Sequence[Point], curves: Curves, quantity: str) -> None:
    """The stepper's floor at the run times of ours."""
    floors = {p.setting: p.error for p in curves.get(named(FLOOR, curve[0].stepper), []) if p.good}
    line = [(getattr(p, quantity), floors[p.setting]) for p in curve if p.good and p.setting in floors]
    if line:
        ax.plot(*np.array(line).T, **FLOOR_LINE)


def _defect_panel(
    ax: Axes, curves: Curves, styles: dict[str, Look], value: Value, label: str, kinds: Iterable[str]
) -> None:
    """A defect of the good runs against their time; what is below rounding stands at the lower edge."""
    for name, curve in curves.items():
        good = [p for p in curve if p.good]
        if name in styles and good and curve[0].kind in tuple(kinds):
            ax.loglog([p.seconds for p in good], [max(value(p), LOWEST) for p in good], **styles[name])
    if all(value(p) == 0.0 for curve in curves.values() for p in curve if p.good):
        ax.text(0.5, 0.5, "no loop", ha="center", transform=ax.transAxes)
    ax.set_ylim(LOWEST, HIGHEST)
    ax.set(xlabel=QUANTITIES["seconds"], ylabel=label)
    ax.minorticks_off()


# --------------------------------------------------------------------------- words


def _order_text(power: float) -> str:
    return f"order {power:.1f}" if power >= LEAST_ORDER else "no order"


def _handles(curves: Curves, styles: dict[str, Look], reference: Reference) -> list[Any]:
    """Legend entries, with the order and the number of failures."""
    from matplotlib.lines import Line2D

    handles = []
    for name, style in styles.items():
        power = order(curves[name], reference.accuracy)
        lost = sum(p.timed and not p.good for p in curves[name])
        text = name + ("" if power is None else f", {_order_text(power)}")
        if lost:
            text += f", {lost}/{sum(p.timed for p in curves[name])} lost"
        handles.append(Line2D([], [], label=text, **style))
    return [*handles, Line2D([], [], label="floor: same stepper, exact equation", **FLOOR_LINE)]


def _laid_out(rows: int, height: float, handles: Sequence[Any], foot: str) -> tuple[Figure, list[list[Axes]]]:
    """A figure with rows of two panels, a legend below them and the footer at the bottom."""
    legend, margin = 0.103 * -(-len(handles) // COLUMNS) + 0.1, 0.25
    whole = rows * height + legend + margin
    figure = plots.new_figure(whole)
    figure.set_layout_engine("constrained", rect=(0.0, margin / whole, 1.0, 1.0 - margin / whole))
    grid = figure.add_gridspec(rows + 1, 2, height_ratios=[height] * rows + [legend])
    panels = [[figure.add_subplot(grid[i, j]) for j in range(2)] for i in range(rows)]
    below = figure.add_subplot(grid[rows, :])
    below.axis("off")
    key = below.legend(
        handles=handles, loc="center", ncols=COLUMNS, handlelength=2.4, columnspacing=0.8,
        labelspacing=0.3, borderaxespad=0.0,
    )  # fmt: skip
    key.set_in_layout(False)
    figure.text(0.01, 0.05 / whole, textwrap.fill(foot, 160), fontsize=5.0, color="0.35", va="bottom")
    return figure, panels


def _write_labels(
    figure: Figure, axes: Sequence[Axes], curves: Curves, styles: dict[str, Look], reference: Reference
) -> None:
    """Settings at markers, orders beside fixed steps, times of failures: ours first, where there is room."""
    figure.draw_without_rendering()
    shown = sorted((c for n, c in curves.items() if n in styles), key=lambda c: c[0].family != OURS)
    for ax, (kind, quantity) in zip(axes, ((k, q) for q in ("seconds", "rhs") for k in KINDS), strict=False):
        labels = Labels(ax)
        here = [curve for curve in shown if curve[0].kind == kind]
        for curve in here:
            for p in curve:
                if p.timed:
                    where = (getattr(p, quantity), p.error) if p.good else (_edge(ax, p, quantity), HIGHEST)
                    labels.block(*where)
            for one, other in pairwise((getattr(p, quantity), p.error) for p in curve if p.good):
                labels.block_line(one, other)
        for curve in here:
            style, strong = styles[curve[0].contender], curve[0].family == OURS
            good, power = [p for p in curve if p.good], order(curve, reference.accuracy)
            if power is not None and len(good) > 2:
                middle = good[len(good) // 2]
                text = _order_text(power)
                labels.put(getattr(middle, quantity), middle.error, text, style["color"], strong, 6.0)
            for i, p in enumerate(good):
                if strong or i in (0, len(good) - 1):
                    labels.put(getattr(p, quantity), p.error, setting_text(kind, p.setting), style["color"])
            for p in (p for p in curve if p.timed and not p.good):
                if labels.put(_edge(ax, p, quantity), HIGHEST, f"lost at {p.lost:.2g} s", style["color"]):
                    break
