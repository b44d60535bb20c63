"""Motions over time: q, v, a, constraint forces and errors in stacked panels, the crossings marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from ...checks import check_choice, hint, listed, names_given, path_given
from ...errors import OptionError
from ...mechanism.joints import Component, components_of
from ...mechanism.tree import Array
from ...simulation.reactions import row_names
from .moments import Eventful, mark_moments
from .style import BLACK, CYCLE, YELLOW, new_figure, require_file, save, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...mechanism.mechanism import Mechanism

PANELS = ("q", "v", "a", "multipliers", "energy", "closure")
"""What can be drawn, from above."""

PER_SECOND = {"q": "", "v": "/s", "a": "/s²"}

NAMED = 10
"""Most lines of a panel that have a style each; of more, colours run from the first to the last."""

MANY = 20
"""Numbers of a mechanism beyond which only the independent ones are drawn, unless joints are named."""

FEW = 7
"""Names in the legend of more lines than that."""

COLORS = (*CYCLE, YELLOW, "#882255", "#999933")
"""Of so many lines; the last two are Tol's wine and olive, "Colour Schemes" (2021)."""

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

PANEL_HEIGHT = 1.35
"""in."""


class Motion(Eventful, Protocol):
    """What is drawn of a `Trajectory`."""

    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array | None
    energy: Array | None
    multipliers: Array | None

    def closure_error(self) -> Array:
        """max |φ| at each time."""
        ...

    def energy_error(self) -> Array:
        """Energy less its start and the work done, J."""
        ...


class Line(NamedTuple):
    """One number of every run: its name, and where it is in q, or in v and a, or in λ."""

    name: str
    at: int


class Panel(NamedTuple):
    """One quantity in one unit; no lines: one error over time."""

    quantity: str
    unit: str
    lines: tuple[Line, ...] = ()


Runs = Mapping[str, Motion]
"""By label; the first one decides what is drawn."""


def plot_motion(
    runs: Runs,
    what: Sequence[str] | str | None = None,
    path: str | Path | None = None,
    joints: Sequence[str] | str | None = None,
) -> Figure:
    """Draw trajectories of one mechanism; see `Trajectory.plot`."""
    first = next(iter(runs.values()))
    chosen = _chosen(runs, what)
    if path is not None:
        require_file(path_given("path", path))
    components, title = _components(first.mechanism, joints)
    for label, run in runs.items():
        if [c.name for c in components_of(run.mechanism.joints)] != [
            c.name for c in components_of(first.mechanism.joints)
        ]:
            raise OptionError(f"overlay: {label!r} is the motion of a mechanism with other joints")
    panels = [panel for quantity in chosen for panel in _panels(first, quantity, components)]
    looks = _styles([component.name for component in components], first, panels)
    with style():
        figure = new_figure(0.5 + PANEL_HEIGHT * len(panels))
        axes = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False).flat)
        for dashes, run in zip(cycle(DASHES), runs.values(), strict=False):
            for ax, panel in zip(axes, panels, strict=True):
                if not panel.lines:
                    _draw_error(ax, run, panel.quantity, dashes)
                elif panel.quantity == "multipliers":
                    forces = _styles([line.name for line in panel.lines], first, [panel])
                    _draw_lines(ax, run, panel, forces, dashes)
                else:
                    _draw_lines(ax, run, panel, looks, dashes)
        moments = mark_moments(axes, runs.values())
        for ax, panel in zip(axes, panels, strict=True):
            ax.margins(x=0.0)
            if panel.quantity == "multipliers" and len(panel.lines) <= NAMED:
                handles = ax.lines[: len(panel.lines)]
                ax.legend(handles=handles, fontsize=6.5, loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
        axes[-1].set_xlabel("t [s]")
        axes[0].set_title(first.mechanism.name, loc="left")
        rows = [ax for ax, panel in zip(axes, panels, strict=True) if panel.quantity != "multipliers"]
        _legend(figure, rows or axes[:0], title, list(runs) if len(runs) > 1 else [], moments)
        figure.align_ylabels()
        if path is not None:
            save(figure, Path(path))
    return figure


def _chosen(runs: Runs, what: Sequence[str] | str | None) -> list[str]:
    """The panels asked for, or those for which there is something to see."""
    first = next(iter(runs.values()))
    recorded = {
        name: all(getattr(run, name) is not None for run in runs.values()) for name in ("a", "multipliers")
    }
    have = {
        "q": True,
        "v": True,
        "a": recorded["a"],
        "multipliers": False,  # for the asking: their labels are long
        "energy": all(run.energy is not None for run in runs.values()),
        "closure": first.mechanism.nc > 0,
    }
    if what is None:
        return [name for name in PANELS if have[name]]
    asked = [what] if isinstance(what, str) else listed(what, "what", "quantities", OptionError)
    for name in asked:
        check_choice("what", name, PANELS)
    if not asked:
        raise OptionError(f"what is empty; use some of {', '.join(PANELS)}")
    for name, word in (("a", "accelerations"), ("multipliers", "constraint forces")):
        if name in asked and not recorded[name]:
            raise OptionError(f'what = "{name}": {word} were not recorded; simulate with record=("{name}",)')
    if "multipliers" in asked and first.mechanism.nc == 0:
        raise OptionError('what = "multipliers": a mechanism without loops has no constraint forces')
    return [name for name in PANELS if name in asked]


def _components(mechanism: Mechanism, joints: Sequence[str] | str | None) -> tuple[list[Component], str]:
    """The numbers to draw, and what the legend says where they are some of many."""
    every = components_of(mechanism.joints)
    if (isinstance(joints, str) and joints == "all") or (joints is None and len(every) <= MANY):
        return every, ""
    if joints is None:
        asked = list(mechanism.independent)
        title = f"independent of {len(mechanism.joints)} joints"
    else:
        asked, title = [joints] if isinstance(joints, str) else names_given("joints", joints), ""
    owned = {joint.name: joint.components for joint in mechanism.joints}
    owned |= {component.name: (component,) for component in every if component.name not in owned}
    unknown = [name for name in asked if name not in owned]
    if unknown or not asked:
        names = [joint.name for joint in mechanism.joints]
        raise OptionError(
            f"joints = {asked!r}: {'name some of' if not asked else f'no {unknown[0]!r} among'} the joints "
            f'{", ".join(names)}{hint(unknown[0], owned) if unknown else ""}, or "all"'
        )
    wanted = {component for name in asked for component in owned[name]}
    return [component for component in every if component in wanted], title


def _panels(run: Motion, quantity: str, components: Sequence[Component]) -> list[Panel]:
    """One panel for each unit."""
    groups: dict[str, list[Line]] = {}
    if quantity in PER_SECOND:
        for c in components:
            at = c.iq if quantity == "q" else c.iv
            if at >= 0:
                groups.setdefault(f"{c.unit or 1}{PER_SECOND[quantity]}", []).append(Line(c.name, at))
    elif quantity == "multipliers":
        lengths = run.mechanism.implicit.is_length
        for i, name in enumerate(row_names(run.mechanism)):
            groups.setdefault("N" if lengths[i] else "N m", []).append(Line(name, i))
    else:
        return [Panel(quantity, "")]
    return [Panel(quantity, unit, tuple(lines)) for unit, lines in groups.items()]


def _draw_lines(ax: Axes, run: Motion, panel: Panel, looks: Mapping[str, Any], dashes: Any) -> None:
    values: Array = getattr(run, panel.quantity)
    for line in panel.lines:
        ax.plot(run.t, values[:, line.at], label=line.name, **{**looks[line.name], "linestyle": dashes})
    ax.set_ylabel(f"{'λ' if panel.quantity == 'multipliers' else panel.quantity} [{panel.unit}]")


def _styles(names: Sequence[str], run: Motion, panels: Sequence[Panel]) -> dict[str, dict[str, Any]]:
    """Colour and width of each line: wider below others that look like it, so that it stays visible."""
    if len(names) > NAMED:
        from matplotlib import colormaps

        shade = colormaps["viridis"]
        share = 0.95 / (len(names) - 1)
        return {name: {"color": shade(share * i), "linewidth": 0.9} for i, name in enumerate(names)}
    covered = dict.fromkeys(names, 0)
    for panel in panels:
        for k, line in enumerate(panel.lines):
            values: Array = getattr(run, panel.quantity)
            later = [values[:, other.at] for other in panel.lines[k + 1 :]]
            near = ALIKE * float(np.ptp(values[:, [each.at for each in panel.lines]]))
            over = sum(float(np.abs(values[:, line.at] - other).max()) <= near for other in later)
            covered[line.name] = max(covered.get(line.name, 0), over)
    return {
        name: {"color": COLORS[i], "linewidth": min(1.2 + 0.9 * covered[name], WIDEST)}
        for i, name in enumerate(names)
    }


def _draw_error(ax: Axes, trajectory: Motion, quantity: str, dashes: Any) -> None:
    if quantity == "energy":
        ax.plot(trajectory.t, trajectory.energy_error(), color=CYCLE[0], linestyle=dashes)
        ax.set_ylabel("energy error [J]")
        return
    is_length = trajectory.mechanism.implicit.is_length
    units = [unit for unit, there in (("m", is_length.any()), ("rad", (~is_length).any())) if there]
    error = np.maximum(trajectory.closure_error(), SMALLEST)
    ax.semilogy(trajectory.t, error, color=CYCLE[0], linewidth=0.8, linestyle=dashes)
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
        shown = {labels[i]: named[labels[i]] for i in kept}
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
