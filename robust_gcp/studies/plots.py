"""How the studies' figures look: the package's style, and one look for each method."""

from __future__ import annotations

from typing import Any

from ..drawing.figures.style import (
    BLACK,
    BLUE,
    CYCLE,
    DPI,
    FORMATS,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    STYLE,
    VERMILLION,
    WIDTH,
    YELLOW,
    mark_time,
    new_figure,
    require_file,
    require_matplotlib,
    save,
    style,
)
from ..simulation.simulate import Method

__all__ = [
    "BLACK",
    "BLUE",
    "BRIDGE",
    "CYCLE",
    "DPI",
    "EXACT",
    "FORMATS",
    "GREEN",
    "GREY",
    "LOOKS",
    "ORANGE",
    "PURPLE",
    "SKY",
    "STYLE",
    "VERMILLION",
    "WIDTH",
    "YELLOW",
    "mark_time",
    "new_figure",
    "require_file",
    "require_matplotlib",
    "save",
    "style",
]

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
