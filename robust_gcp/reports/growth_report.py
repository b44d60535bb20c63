"""What `growth` measured, as tables, a sentence and a figure."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..drawing.figures import style as plots
from . import pages

Row = dict[str, float | str]
"""Of one mechanism: its family, size, name, nv and m, and µs of a step by contender."""

FITTED = 3
"""Largest sizes that an exponent is fitted to."""

SHOWN = {
    "bridge compiled, RK4": "compiled",
    "bridge, RK4": "Python",
    "Pinocchio, mu > 0": "Pinocchio C++",
    "Pinocchio, defaults": "Pinocchio C++",
    "MuJoCo connect, tuned": "MuJoCo RK4",
}
"""Contenders and their names here: all with RK4; Pinocchio's is `constraintDynamics`, or `aba` for a tree."""


def exponent(rows: Sequence[Row], name: str) -> float | None:
    """p of µs ~ size^p over the largest sizes."""
    known = [(float(row["size"]), float(row[name])) for row in rows if float(row.get(name, 0.0)) > 0.0]
    if len(known) < FITTED:
        return None
    logs = np.log(known[-FITTED:])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def tables(measured: Mapping[str, list[Row]], fixed: Mapping[str, float], foot: str) -> str:
    """Markdown: a table of each family with exponents in its last line, and the fixed costs."""
    parts = []
    for family, rows in measured.items():
        columns = [name for name in dict.fromkeys(SHOWN.values()) if any(name in row for row in rows)]
        head = "robot" if family == "robots" else family
        lines = [[head, "velocities", "m", *columns]]
        for row in rows:
            which = str(row["name" if family == "robots" else "size"])
            cells = [f"{row[name]:.3g}" if name in row else "–" for name in columns]
            lines.append([which, str(row["nv"]), str(row["m"]), *cells])
        powers = [] if family == "robots" else [exponent(rows, name) for name in columns]
        if any(power is not None for power in powers):
            grown = ["–" if power is None else f"N^{power:.2f}" for power in powers]
            lines.append([f"largest {FITTED}", "", "", *grown])
        parts.append(pages.table(lines, range(1, len(lines[0]))))
    told = (
        f"Once: the first run of a four-bar takes {fixed['first run']:.2g} ms, the start of each further one "
        f"{fixed['start']:.2g} ms, its first crossing {fixed['crossing']:.2g} ms; two threads do "
        f"{fixed['threads']:.2f} times the work of one.\n\n"
        "Of the delta robot derivatives by the Python reference take "
        f"{fixed['derivatives']:.2g} times as long as its forward dynamics, the Jacobians of a step "
        f"{fixed['jacobians']:.2g} times as long as a run of one step; compiled ones: "
        "[derivatives](derivatives.md#what-they-cost)."
    )
    return "\n\n".join([*parts, told, f"*µs of an RK4 step. Measured {foot}.*"])


def sentence(measured: Mapping[str, list[Row]], fixed: Mapping[str, float]) -> str:
    """What README tells of a step, and of an installation without the kernel."""
    ends = measured["loops"][0], measured["loops"][-1]
    first, last = (f"{row.get('compiled', row['Python']):.2g}" for row in ends)
    told = f"An RK4 step of a four-bar takes {first} µs, of {ends[1]['size']} four-bars in a row {last} µs."
    if any("compiled" not in row for row in ends):
        return told
    ratios = [float(row["Python"]) / float(row["compiled"]) for row in ends]
    few, many, fall = (f"{float(f'{ratio:.2g}'):g}" for ratio in (*ratios, fixed["fall in Python"]))
    return (
        f"{told}\nIn an installation without the kernel they take {few} and {many} times as long, a fall of "
        f"the rhombus\nthrough three crossings {fall} times."
    )


def draw(measured: dict[str, list[Row]], foot: str, path: Path) -> Path:
    """µs a step against size, one panel a family."""
    shown = {name: rows for name, rows in measured.items() if name != "robots"}
    with plots.style():
        figure = plots.new_figure(4.6)
        axes = figure.subplots(2, 2).ravel()
        for ax, (family, rows) in zip(axes, shown.items(), strict=True):
            for name, colour in zip(dict.fromkeys(SHOWN.values()), plots.CYCLE, strict=False):
                known = [(row["size"], row[name]) for row in rows if name in row]
                if known:
                    power = exponent(rows, name)
                    label = name if power is None else f"{name}, N^{power:.2f}"
                    ax.loglog(*zip(*known, strict=True), "o-", color=colour, markersize=3, label=label)
            ax.set(title=f"{family} N", ylabel="µs a step")
            sizes = [int(row["size"]) for row in rows]
            ax.set_xticks(sizes, map(str, sizes))
            ax.minorticks_off()
            low, high = ax.get_ylim()
            ax.set_ylim(low, high**1.5 / low**0.5)  # room for the legend above the curves
            ax.legend(fontsize=6, loc="upper left")
        figure.supxlabel(textwrap.fill(foot, 150), fontsize=5, x=0.01, ha="left")
        return plots.save(figure, path, 200)
