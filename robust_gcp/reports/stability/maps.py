"""The maps: one picture a family, cases down, settings across, and a summary of all."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...drawing.figures import style as plots
from .case import Cell, Verdict
from .report import MEANING, MOST_ROWS, SHOWN, SYMBOLS, VERDICTS, axes, by_family, count, spelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Rectangle

COLOURS: dict[Verdict, str] = {
    "right": "#8FD3BC",
    "coarse": "#CFE8F3",
    "stopped": "#F2C14E",
    "wrong": "#D55E00",
}
"""Lightened bluish green, orange and vermillion of Okabe and Ito: black print is readable on all, and
the symbols tell them apart without colour."""

CELL_WIDTH, CELL_HEIGHT = 0.82, 0.36
"""in."""


FOOT = 0.13 * len(VERDICTS)
"""in: a line below a map for each verdict."""

MAP_DPI = 160
"""Enough for text on a screen, and some tens of kilobytes."""

NARROW = 0.04
"""Share of a bar below which its number reaches over what stands to the left."""

TILES = 40
"""Cells in a line of a mosaic, which a family of more than `MOST_ROWS` cases is drawn as."""


def slug(family: str) -> str:
    """A file name from a family's name."""
    return re.sub(r"[^a-z0-9]+", "_", family.lower()).strip("_")


def draw_family(cells: Sequence[Cell], path: Path) -> Path:
    """Draw the map of one family; returns the path."""
    names, labels = axes(cells)
    if len(names) > MOST_ROWS:
        return _draw_mosaic(cells, path)
    margin = 0.35 + 0.07 * max(map(len, names))
    head = 0.75 if max(map(len, labels)) > 11 else 0.5
    size = head + CELL_HEIGHT * len(names) + 0.3 + FOOT, max(4.9, margin + CELL_WIDTH * len(labels))
    with _grid(path, size, (len(labels), len(names)), cells[0].case.family, _told(cells)) as ax:
        for cell in cells:
            x, y = labels.index(cell.setting.label), names.index(cell.case.name)
            ax.add_patch(_box(x, y, cell.verdict))
            ax.text(x, y - 0.17, spelled(cell)[:24], **_CENTRED)
            ax.text(x, y + 0.24, _second(cell), **{**_CENTRED, "fontsize": 5.8})
        ax.set_yticks(range(len(names)), names)
        ax.set_xticks(range(len(labels)), [_broken(label) for label in labels])
    return path


def draw_summary(cells: Sequence[Cell], path: Path) -> Path:
    """Draw one bar a family, its cells by verdict; returns the path."""
    families = by_family(cells)
    title = f"{len(cells)} cells\n{_told(cells)}"
    height = 0.9 + 0.24 * len(families) + 0.14 * len(VERDICTS)
    with _grid(path, (height, plots.WIDTH), (1, len(families)), title, size=8) as ax:
        for y, mine in enumerate(families.values()):
            left = 0.0
            for verdict, number in count(mine).items():
                share = number / len(mine)
                ax.barh(y, share, left=left, color=COLOURS[verdict], edgecolor="white", height=0.8)
                left += share
                if number:
                    at, side = (left - share / 2.0, "center") if share > NARROW else (left, "right")
                    ax.text(at, y, f"{SYMBOLS[verdict]} {number}", **{**_CENTRED, "ha": side})
        ax.set_yticks(range(len(families)), families)
        ax.set_xlim(0.0, 1.0)
    return path


def _draw_mosaic(cells: Sequence[Cell], path: Path) -> Path:
    """One tile a cell, line by line, with its symbol and the power of ten of its error."""
    lines = -(-len(cells) // TILES)
    title = f"{cells[0].case.family}: a tile a case; in a right one the power of ten of its error"
    with _grid(path, (0.65 + 0.21 * lines + FOOT, 8.4), (TILES, lines), title, _told(cells)) as ax:
        for i, cell in enumerate(cells):
            y, x = divmod(i, TILES)
            ax.add_patch(_box(x, y, cell.verdict, 0.5))
            known = cell.verdict in SHOWN and cell.error > 0.0
            text = f"{math.floor(math.log10(cell.error))}" if known else SYMBOLS[cell.verdict]
            ax.text(x, y, text, **{**_CENTRED, "fontsize": 5.0})
    return path


@contextmanager
def _grid(
    path: Path,
    inches: tuple[float, float],
    cells: tuple[int, int],
    title: str,
    foot: str = "",
    size: float = 9.5,
) -> Iterator[Axes]:
    """A bare axes of cells, counted from the top left, on a figure of this height and width; then saved."""
    with plots.style():
        figure = plots.new_figure(*inches)
        ax = figure.subplots()
        ax.set(xlim=(-0.5, cells[0] - 0.5), ylim=(cells[1] - 0.5, -0.5), xticks=[], yticks=[])
        ax.grid(False)
        ax.tick_params(length=0)
        ax.spines[:].set_visible(False)
        yield ax
        figure.suptitle(title, fontsize=size, x=0.01, ha="left")
        if foot:
            figure.supxlabel(foot, fontsize=7, x=0.01, ha="left")
        plots.save(figure, path, MAP_DPI)


def _told(cells: Sequence[Cell]) -> str:
    counted = count(cells)
    return "\n".join(f"{SYMBOLS[v]} {counted[v]} {MEANING[v]}" for v in VERDICTS)


_CENTRED: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7.0, "family": "DejaVu Sans"}


def _box(x: float, y: float, verdict: Verdict, line: float = 1.5) -> Rectangle:
    from matplotlib.patches import Rectangle

    return Rectangle(
        (x - 0.5, y - 0.5), 1.0, 1.0, facecolor=COLOURS[verdict], edgecolor="white", linewidth=line
    )


def _second(cell: Cell) -> str:
    """Below a right cell's error its cost; below a reason the error until then, where there is one."""
    if cell.verdict in SHOWN:
        return f"{cell.rhs} rhs"
    return f"error {cell.error:.0e}" if 0.0 < cell.error < math.inf else ""


def _broken(label: str) -> str:
    """A heading in short lines, numbers kept with their units."""
    return textwrap.fill(label.replace(" s", "\N{NO-BREAK SPACE}s"), 9, break_long_words=False)
