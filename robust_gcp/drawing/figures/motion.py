"""A motion over time: q, v, a, energy and closure error in stacked panels, the crossings marked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...checks import check_choice
from ...errors import OptionError
from ...mechanism.joints import components_of
from ...mechanism.tree import Array
from .style import CYCLE, GREY, new_figure, require_file, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...maps.explicit import Crossing
    from ...mechanism.mechanism import Mechanism

PANELS = ("q", "v", "a", "energy", "closure")
"""What can be drawn, from above."""

PER_SECOND = {"q": "", "v": "/s", "a": "/s²"}

NAMED = 10
"""Most joints that have a line style each; of more, colours run from the first to the last."""

FEW = 7
"""Names in the legend of a mechanism with more joints than that."""

SMALLEST = 1e-17
"""Where a closure error of exactly 0 is drawn, m or rad: a tenth of a rounding."""

HIGHEST = 1e-13
"""Least upper end of that panel: rounding should look like rounding, m or rad."""

PANEL_HEIGHT = 1.35
"""in."""


class Motion(Protocol):
    """What is drawn of a `Trajectory`."""

    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array | None
    energy: Array | None
    crossings: list[Crossing]

    def closure_error(self) -> Array:
        """max |φ| at each time."""
        ...

    def energy_error(self) -> Array:
        """Energy less its start and the work done, J."""
        ...


def plot_motion(
    trajectory: Motion, what: Sequence[str] | str | None = None, path: str | Path | None = None
) -> Figure:
    """Draw a trajectory; see `Trajectory.plot`."""
    chosen = _chosen(trajectory, what)
    if path is not None:
        require_file(Path(path))
    panels: list[tuple[str, str, list[int]]] = []
    for quantity in chosen:
        if quantity in PER_SECOND:
            panels += [(quantity, unit, lines) for unit, lines in _by_unit(trajectory, quantity).items()]
        else:
            panels.append((quantity, "", []))
    with style():
        figure = new_figure(0.5 + PANEL_HEIGHT * len(panels))
        axes = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False).flat)
        for ax, (quantity, unit, lines) in zip(axes, panels, strict=True):
            if lines:
                _draw_joints(ax, trajectory, quantity, unit, lines)
            else:
                _draw_error(ax, trajectory, quantity)
        for i, crossing in enumerate(trajectory.crossings):
            for ax in axes:
                ax.axvline(
                    crossing.time, color=GREY, linestyle=(0, (1, 1.5)), linewidth=1.0, zorder=0.9,
                    label="crossing" if i == 0 else None,
                )  # fmt: skip
        for ax in axes:
            ax.margins(x=0.0)
        axes[-1].set_xlabel("t [s]")
        axes[0].set_title(trajectory.mechanism.name, loc="left")
        _legend(figure, axes, len(trajectory.mechanism.joints))
        figure.align_ylabels()
        if path is not None:
            save(figure, Path(path))
    return figure


def _chosen(trajectory: Motion, what: Sequence[str] | str | None) -> list[str]:
    """The panels asked for, or those for which there is something to see."""
    have = {
        "q": True,
        "v": True,
        "a": trajectory.a is not None,
        "energy": trajectory.energy is not None,
        "closure": trajectory.mechanism.nc > 0,
    }
    if what is None:
        return [name for name in PANELS if have[name]]
    asked = [what] if isinstance(what, str) else list(what)
    for name in asked:
        check_choice("what", name, PANELS)
    if not asked:
        raise OptionError(f"what is empty; use some of {', '.join(PANELS)}")
    if "a" in asked and not have["a"]:
        raise OptionError('what = "a": accelerations were not recorded; simulate with record=("a",)')
    return [name for name in PANELS if name in asked]


def _by_unit(trajectory: Motion, quantity: str) -> dict[str, list[int]]:
    """The joints' entries of one quantity, by number, those with the same unit together."""
    groups: dict[str, list[int]] = {}
    for i, entry in enumerate(components_of(trajectory.mechanism.joints)):
        if (entry.iq if quantity == "q" else entry.iv) >= 0:
            groups.setdefault(entry.unit, []).append(i)
    return groups


def _draw_joints(ax: Axes, trajectory: Motion, quantity: str, unit: str, lines: list[int]) -> None:
    values: Array = getattr(trajectory, quantity)
    joints = components_of(trajectory.mechanism.joints)
    for i in lines:
        column = values[:, joints[i].iq if quantity == "q" else joints[i].iv]
        ax.plot(trajectory.t, column, label=joints[i].name, **_looks(i, len(joints)))
    ax.set_ylabel(f"{quantity} [{unit}{PER_SECOND[quantity]}]" if unit else quantity)


def _looks(i: int, count: int) -> dict[str, Any]:
    """Colour, dashes and width of a joint's line."""
    if count > NAMED:
        from matplotlib import colormaps

        return {"color": colormaps["viridis"](0.95 * i / (count - 1)), "linewidth": 0.9}
    return {
        "color": CYCLE[i % len(CYCLE)],
        "linestyle": ("-", "--")[i // len(CYCLE) % 2],
        "linewidth": max(1.0, 2.8 - 0.8 * i),  # joints that move alike stay visible
    }


def _draw_error(ax: Axes, trajectory: Motion, quantity: str) -> None:
    if quantity == "energy":
        ax.plot(trajectory.t, trajectory.energy_error(), color=CYCLE[0])
        ax.set_ylabel("energy error [J]")
        return
    is_length = trajectory.mechanism.implicit.is_length
    units = [unit for unit, there in (("m", is_length.any()), ("rad", (~is_length).any())) if there]
    error = np.maximum(trajectory.closure_error(), SMALLEST)
    ax.semilogy(trajectory.t, error, color=CYCLE[0], linewidth=0.8)
    ax.set_ylim(0.5 * SMALLEST, max(2.0 * error.max(), HIGHEST))
    ax.set_ylabel(f"max |φ| [{' or '.join(units) or 'm'}]")


def _legend(figure: Figure, axes: Sequence[Axes], joints: int) -> None:
    """Name the lines once, to the right: all of few, some of many."""
    named: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        named |= {label: handle for handle, label in zip(handles, labels, strict=True) if label not in named}
    crossing = named.pop("crossing", None)
    labels = list(named)
    if len(labels) > 2 * NAMED:
        kept = np.unique(np.linspace(0, len(labels) - 1, FEW).round().astype(int))
        shown = {labels[i]: named[labels[i]] for i in kept}
        title: str | None = f"{joints} joints, such as"
    else:
        shown, title = dict(named), None
    if crossing is not None:
        shown["crossing"] = crossing
    if shown:
        figure.legend(shown.values(), shown.keys(), loc="outside right upper", title=title)
