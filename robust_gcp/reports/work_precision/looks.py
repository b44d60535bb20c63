"""How contenders look in the figures, and labels that keep clear of each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...drawing.figures.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION
from ...mechanism.tree.tree import Array
from .ours import FLOOR
from .verdicts import OURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.transforms import Bbox

COLORS = {
    OURS: BLACK,
    "closed form": SKY,
    "published": BLUE,
    "implicit": ORANGE,
    "Pinocchio": GREEN,
    "MuJoCo": VERMILLION,
    "Exudyn": PURPLE,
}
MARKERS = "os^DvPX<>hd"
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1.2, 1.2)), (0, (5, 1, 1, 1)), (0, (2, 1)), (0, (7, 2)))
TINY = 5.4
"""Type size of labels at markers, pt."""

Look = dict[str, Any]


def looks(contenders: Sequence[tuple[str, str]]) -> dict[str, Look]:
    """Line and marker of each contender, given as (name, family): a colour a family, dashes within it.

    The bridge is strong, the rest thin.
    """
    found: dict[str, Look] = {}
    counts: dict[str, int] = {}
    for name, family in contenders:
        if family == FLOOR:
            continue
        k = counts[family] = counts.get(family, -1) + 1
        strong, color = family == OURS, COLORS[family]
        found[name] = {
            "color": color,
            "linestyle": DASHES[k % len(DASHES)],
            "linewidth": 1.7 if strong else 0.9,
            "marker": MARKERS[k % len(MARKERS)],
            "markersize": 4.2 if strong else 3.4,
            "markerfacecolor": color if strong else "white",
            "markeredgewidth": 0.7,
            "zorder": 4 if strong else 3,
        }
    return found


class Labels:
    """Text at points of an axes, left out where it would cover what is there already.

    The axes have their final limits and scales, and the figure is laid out.
    """

    def __init__(self, ax: Axes) -> None:
        self.ax, self._per_point = ax, ax.figure.dpi / 72.0
        self._boxes: list[Bbox] = []

    def block(self, x: float, y: float, size: float = 2.2) -> None:
        """Keep labels off a marker of this half size, pt."""
        self._block(self.ax.transData.transform((x, y)), size)

    def block_line(self, one: tuple[float, float], other: tuple[float, float]) -> None:
        """Keep labels off the line between two points."""
        ends = self.ax.transData.transform([one, other])
        for share in np.linspace(0.0, 1.0, 25):
            self._block((1.0 - share) * ends[0] + share * ends[1], 0.6)

    def _block(self, place: Array, size: float) -> None:
        from matplotlib.transforms import Bbox

        (a, b), r = place, size * self._per_point
        self._boxes.append(Bbox.from_extents(a - r, b - r, a + r, b + r))

    def put(self, x: float, y: float, text: str, color: str, bold: bool = False, size: float = TINY) -> bool:
        """Write beside (x, y) where there is room: right below, right above, left; whether there was any."""
        from matplotlib.transforms import Bbox

        a, b = self.ax.transData.transform((x, y))
        width, height = 0.56 * size * len(text) * self._per_point, 1.05 * size * self._per_point
        gap = 3.0 * self._per_point
        frame = self.ax.get_window_extent()
        for dx, dy, align in ((1, 0.0, "left"), (1, 0.9, "left"), (1, -0.9, "left"), (-1, 0.0, "right"),
                              (-1, -0.9, "right"), (-1, 0.9, "right")):  # fmt: skip
            left = a + gap if dx > 0 else a - gap - width
            low = b + dy * height - 0.5 * height
            box = Bbox.from_bounds(left, low, width, height)
            inside = frame.contains(*box.p0) and frame.contains(*box.p1)
            if inside and not any(box.fully_overlaps(other) for other in self._boxes):
                self._boxes.append(box)
                self.ax.annotate(
                    text, (x, y), (dx * 3.0, dy * 1.05 * size), textcoords="offset points", ha=align,
                    va="center", fontsize=size, color=color, zorder=6,
                    fontweight="bold" if bold else "normal",
                )  # fmt: skip
                return True
        return False


def setting_text(kind: str, setting: float) -> str:
    """The setting as written at a marker: a step with its unit, or a tolerance."""
    if kind == "adaptive":
        return f"{setting:.0e}".replace("e-0", "e-")
    if setting >= 1e-3:
        return f"{1e3 * setting:.3g} ms"
    return f"{1e6 * setting:.3g} µs"
