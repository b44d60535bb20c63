"""Drawing: one style, one size in print and one way to save, for all figures of the package.

Matplotlib is imported when something is drawn; the installation without it stays complete.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import OptionError, missing_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY = "#999999"
CYCLE = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY, BLACK)
"""Okabe and Ito, Color Universal Design (2008), strongest on white first."""

WIDTH = 6.3
"""Width of a printed column, in: A4 less margins of 25 mm. Fonts below are at this size."""

MOMENT: dict[str, Any] = {"color": GREY, "linestyle": (0, (1, 1.5)), "linewidth": 1.0, "zorder": 0.9}
"""Looks of a line that marks a time."""

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


def require_matplotlib() -> Any:
    """Return the module matplotlib, or raise a MissingExtraError that says how to get it."""
    try:
        import matplotlib
    except ImportError as error:
        raise missing_extra("figures need matplotlib", "matplotlib", "viz") from error
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
    from .figure import Picture

    return Picture(figsize=(width, height))


def save(figure: Figure, path: Path, dpi: int = DPI) -> Path:
    """Write a PNG or PDF, the same bytes every time; returns the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    dated = {".pdf": {"CreationDate": None}}.get(path.suffix, {})
    figure.savefig(path, dpi=dpi, metadata=dated)
    if path.suffix == ".png":
        _shrink(path)
    return path


def _shrink(path: Path) -> None:
    """Rewrite a PNG with a palette: line drawings have few colours, and a third of the bytes is left."""
    from PIL import Image

    with Image.open(path) as picture:
        palette = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    palette.save(path, optimize=True)


def mark_time(axes: Sequence[Axes], t: float, title: str = "", **look: Any) -> None:
    """Draw a vertical line through stacked panels, dotted or as it is to look; a title above the first."""
    for ax in axes:
        ax.axvline(t, **{**MOMENT, **look})
    if title:
        axes[0].annotate(
            title, (0.0, 1.0), (0, 3), xycoords="axes fraction",
            textcoords="offset points", va="bottom", fontsize=8,
        )  # fmt: skip
