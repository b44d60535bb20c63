"""Drawing for all studies: one style, sizes in print, and how motions and mechanisms are drawn.

Matplotlib is imported when something is drawn; the installation without it stays complete.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MissingExtraError, OptionError
from ..four_bar_map import Drawing
from ..simulate import Method
from ..trajectory import Trajectory
from ..tree import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY = "#999999"
CYCLE = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY, BLACK)
"""Okabe and Ito, Color Universal Design (2008), strongest on white first."""

WIDTH = 6.3
"""Width of a printed column, in: A4 less margins of 25 mm. Fonts below are at this size."""

FORMATS = (".png", ".pdf")
DPI = 300

STYLE: dict[str, Any] = {
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "0.88",
    "axes.axisbelow": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "figure.constrained_layout.use": True,
    "pdf.fonttype": 42,
}


EXACT: dict[str, Any] = {"color": "0.78", "linewidth": 4.0, "label": "exact"}
LOOKS: dict[Method, dict[str, Any]] = {
    "projection": {"color": BLUE, "linewidth": 1.1, "label": "robust GCP, Eq. (7)"},
    "classical": {
        "color": VERMILLION,
        "linestyle": (0, (3.5, 1.6)),
        "linewidth": 1.1,
        "label": "classical GCP",
    },
}
BRIDGE: dict[str, Any] = {
    "color": BLACK,
    "marker": "o",
    "markersize": 2.6,
    "markerfacecolor": "white",
    "markeredgewidth": 0.6,
    "linestyle": "none",
    "label": "robust GCP, bridge",
}
"""How the methods look: told apart without colour by width, dashes and markers."""


def require_matplotlib() -> Any:
    """Return the module matplotlib, or raise a MissingExtraError that says how to get it."""
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError(
            'figures need matplotlib, which is not installed: pip install "robust-gcp[viz]"'
        ) from error
    return matplotlib


def require_file(path: Path) -> None:
    """Refuse, before anything is computed, a file that could not be drawn."""
    require_matplotlib()
    if path.suffix not in FORMATS:
        raise OptionError(f"{path}: a figure is a {' or a '.join(FORMATS)} file")


@contextmanager
def style() -> Iterator[None]:
    """Set the style of every figure, for drawing and saving inside this context."""
    with require_matplotlib().rc_context(STYLE):
        yield


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Make an empty figure of the given size, in."""
    require_matplotlib()
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height))


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG or PDF, the same bytes every time; returns the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    dated = {".pdf": {"CreationDate": None}}.get(path.suffix, {})
    figure.savefig(path, dpi=DPI, metadata=dated)
    return path


def mark_time(axes: Sequence[Axes], t: float, label: str = "") -> None:
    """Draw a dotted vertical line through stacked panels, named above the first one."""
    for ax in axes:
        ax.axvline(t, color=GREY, linestyle=(0, (1, 1.5)), linewidth=1.0, zorder=0.9)
    if label:
        axes[0].annotate(
            label, (0.0, 1.0), (0, 3), xycoords="axes fraction",
            textcoords="offset points", va="bottom", fontsize=8,
        )  # fmt: skip


# --------------------------------------------------------------------------- a motion


def draw_trajectory(trajectory: Trajectory, path: Path) -> Path:
    """Draw q and v of all joints over time, the crossings marked; returns the path."""
    with style():
        figure = new_figure(4.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        names = list(trajectory.mechanism.joint_names)
        kinds = {joint.shortname()[:11] for joint in list(trajectory.mechanism.model.joints)[1:]}
        units = {"JointModelR": "rad", "JointModelP": "m"}
        unit = units.get(kinds.pop(), "SI") if len(kinds) == 1 else "SI"
        for ax, values, quantity in ((upper, trajectory.q, "q"), (lower, trajectory.v, "v")):
            named = values.shape[1] == len(names)
            for i, column in enumerate(values.T):
                ax.plot(
                    trajectory.t,
                    column,
                    color=CYCLE[i % len(CYCLE)],
                    linestyle=("-", "--", "-.", ":")[i // len(CYCLE) % 4],
                    linewidth=max(1.0, 2.8 - 0.8 * i),  # joints that move alike stay visible
                    label=names[i] if named else f"entry {i}",
                )
            ax.set_ylabel(f"{quantity} [{unit}{'/s' if quantity == 'v' else ''}]")
        for i, crossing in enumerate(trajectory.crossings):
            for ax in (upper, lower):
                ax.axvline(
                    crossing.time, color=GREY, linestyle=(0, (1, 1.5)), linewidth=1.0, zorder=0.9,
                    label="crossing" if i == 0 else None,
                )  # fmt: skip
        lower.set_xlabel("t [s]")
        upper.set_title(trajectory.mechanism.name, loc="left")
        handles, labels = upper.get_legend_handles_labels()
        if len(handles) <= 28:
            columns = 1 + (len(handles) - 1) // 14
            figure.legend(handles, labels, loc="outside right upper", ncols=columns)
        return save(figure, path)


# --------------------------------------------------------------------------- a mechanism

LINKS = {
    "crank": ("OA", ORANGE, 5.0),
    "rocker": ("CD", GREEN, 3.2),
    "coupler": ("AB", BLUE, 1.5),
}
"""Ends, colour and width (pt) of the four-bar's links, drawn in this order."""

PIN: dict[str, Any] = {
    "marker": "o",
    "markersize": 3.2,
    "color": "white",
    "markeredgecolor": BLACK,
    "markeredgewidth": 0.7,
    "linestyle": "none",
}
PIVOT: dict[str, Any] = {
    "marker": [(-0.9, -1.5), (0.0, 0.0), (0.9, -1.5), (-0.9, -1.5)],
    "markersize": 11,
    "color": "0.55",
    "markeredgewidth": 0.0,
    "linestyle": "none",
}


def four_bar_pose(drawing: Drawing, q: Array) -> dict[str, Array]:
    """Place pivots and pins of the planar four-bar in its plane: O, A, B, C, D, (2,) each, m.

    O and C are the ground pivots, A the crank pin, B and D the tips of coupler and rocker, which
    are one point when the loop is closed.
    """
    l0, l1, l2, l3 = drawing.lengths
    theta = drawing.sign * q + drawing.offset

    def along(length: float, angle: float) -> Array:
        return length * np.array([np.cos(angle), np.sin(angle)])

    O, C = np.zeros(2), np.array([l0, 0.0])
    A = O + along(l1, theta[0])
    return {
        "O": O,
        "A": A,
        "B": A + along(l2, theta[0] + theta[1]),
        "C": C,
        "D": C + along(l3, theta[2]),
    }


def draw_four_bar_pose(ax: Axes, pose: dict[str, Array], alpha: float = 1.0, pins: bool = True) -> None:
    """Draw the links of `LINKS` as bars of falling width, so that folded ones stay visible."""
    for ends, color, width in LINKS.values():
        line = np.array([pose[end] for end in ends]).T
        ax.plot(*line, color=color, linewidth=width, alpha=alpha, zorder=2, clip_on=False)
    if not pins:
        return
    for pivot in "OC":
        x, z = pose[pivot]
        ax.plot(x, z - 0.02, zorder=1.5, clip_on=False, **PIVOT)
    for pin in "OABC":
        ax.plot(*pose[pin], zorder=3, clip_on=False, **PIN)


def link_legend(figure: Figure | SubFigure) -> None:
    """Name the links of `draw_four_bar_pose` in one line across the figure."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=color, linewidth=width, label=name) for name, (_, color, width) in LINKS.items()
    ]
    handles.append(Line2D([], [], label="pin", **PIN))
    handles.append(Line2D([], [], label="ground pivot", **{**PIVOT, "markersize": 8}))
    figure.legend(handles=handles, loc="center", ncols=len(handles))
