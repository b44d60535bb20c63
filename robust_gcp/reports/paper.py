"""Figures 4 to 7 of the paper, *Minimal Coordinate Dynamic Simulation Through Singularities*.

Rhombus and parallelogram fall through their singularities. Both start at rest at q = (0.2, −0.2, 0.2) rad
and swing in the parallelogram mode, whose exact motion is a pendulum's. Classical GCP, Newton started from
the previous q_d as published, loses that mode at q1 = −π: the rhombus locks folded, the parallelogram goes
over to the antiparallelogram. The projection of Eq. (7) and the bridge stay on the mode.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import Mechanism, SimulationError, SingularityWarning, Trajectory, load, simulate
from ..arguments import DEFAULT, Arguments, folder
from ..drawing.figures import style as plots
from ..drawing.figures.draw import draw_faded
from ..drawing.figures.mechanism import body_legend, face_on, poses
from ..maps.choice import Method
from ..maps.four_bar import draw_four_bar
from ..maps.pendulum import parallelogram_pendulum, pendulum
from ..mechanism.tree.tree import Array
from ..printing import progress_bar, table, write_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

START = (0.2, -0.2, 0.2)
"""q at t = 0, rad; at rest."""

MODE = np.array([1.0, -1.0, 1.0])
"""G of the parallelogram mode: q = MODE · y."""

METHODS: tuple[Method, ...] = ("classical", "projection", "bridge")
FIGURES = {"rhombus": (4, 5), "parallelogram": (6, 7)}
"""Numbers of the joint figure and the strobe figure of each model."""

FULL, QUICK = (5.0, 1e-3), (1.8, 2e-3)
"""Duration and step of the command and of its short variant, s."""

LOCKED = 1e-3
"""Distance from the exact motion at which a method counts as locked on another mode, rad."""

STROBE_BEFORE = (0.0, 0.4, 0.65, 0.85, 1.0)
STROBE_AFTER = (0.3, 0.6, 0.8, 1.0, 1.3)
"""Instants of the strobe figures, in lock times: until the lock, and after it."""

GHOSTS = {0.12: 0.12, 0.08: 0.2, 0.04: 0.3, 0.0: 1.0}
"""Each strobe picture also shows where the mechanism was this long before, s: with this opacity."""

MARGIN = 0.25
"""Room around a strobe picture, m."""

LEGEND_HEIGHT = 0.25
"""Room for the names of the links below the strobe pictures, in."""

STROBE_ROWS: dict[Method, str] = {"classical": "classical\nGCP", "projection": "robust\nGCP"}

EXACT: dict[str, Any] = {"color": "0.78", "linewidth": 4.0, "label": "exact"}
LOOKS: dict[Method, dict[str, Any]] = {
    "projection": {"color": plots.BLUE, "linewidth": 1.1, "label": "robust GCP, Eq. (7)"},
    "classical": {
        "color": plots.VERMILLION,
        "linestyle": (0, (3.5, 1.6)),
        "linewidth": 1.1,
        "label": "classical GCP",
    },
}
BRIDGE: dict[str, Any] = {
    "color": plots.BLACK,
    "marker": "o",
    "markersize": 2.6,
    "markerfacecolor": "white",
    "markeredgewidth": 0.6,
    "linestyle": "none",
    "label": "robust GCP, bridge",
}
"""How the methods look: told apart without colour by width, dashes and markers."""


@dataclass
class Case:
    """One mechanism's fall by all methods."""

    mechanism: Mechanism
    t: Array  # (N + 1,): s
    exact: dict[str, Array]  # (N + 1, 3): "q", "v", "a" of the joints from Jacobi elliptic functions; rad, s
    runs: dict[Method, Trajectory]  # by method; classical GCP's is shorter than t if it had to stop
    stop: str = ""  # why classical GCP stopped; empty if it reached the end

    def deviation(self, method: Method) -> Array:
        """Return max |q − exact| over the joints at each time the run reached, (≤ N + 1,), rad."""
        q = self.runs[method].q
        return np.asarray(np.abs(q - self.exact["q"][: len(q)]).max(axis=1))

    @property
    def lock_time(self) -> float | None:
        """Tell when classical GCP left the exact motion, or stopped, s; None if it did neither."""
        off = np.flatnonzero(self.deviation("classical") > LOCKED)
        if len(off):
            return float(self.t[off[0]])
        return float(self.runs["classical"].t[-1]) if self.stop else None

    @property
    def fate(self) -> str:
        """Tell what classical GCP does at `lock_time`, in words."""
        off = np.flatnonzero(self.deviation("classical") > LOCKED)
        if len(off) == 0:
            return "stops" if self.stop else "stays on the mode"
        run = self.runs["classical"]
        later = run.q[(off[0] + len(run.q)) // 2 :, run.mechanism.iv_dependent]
        return "locks" if np.all(np.ptp(later, axis=0) < LOCKED) else "changes mode"

    def summary(self) -> dict[str, Any]:
        """List the figures of this case, ready for JSON."""
        return {
            "duration_s": float(self.t[-1]),
            "step_s": float(self.t[1]),
            "classical": {"fate": self.fate, "time_s": self.lock_time, "error": self.stop or None},
            "max_error_rad": {m: float(self.deviation(m).max()) for m in METHODS},
            "max_closure_error_m": {m: float(run.closure_error().max()) for m, run in self.runs.items()},
            "crossings": {m: len(run.crossings) for m, run in self.runs.items()},
            "wall_seconds": {m: run.stats.wall_seconds for m, run in self.runs.items()},
        }


def run_case(
    name: str, duration: float = 5.0, step: float = 1e-3, progress: Callable[[float], None] | None = None
) -> Case:
    """Simulate "rhombus" or "parallelogram" by every method, RK4, beside the exact motion.

    `duration` and `step` are in s; `progress` is told the fraction that is done as the runs go on.
    """
    mechanism, stop = load(name), ""
    runs: dict[Method, Trajectory] = {}
    options: dict[str, Any] = {"newton_start": "previous", "record": ("a",)}
    for i, method in enumerate(METHODS):
        if progress is not None:
            options["progress"] = lambda fraction, i=i: progress((i + fraction) / len(METHODS))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SingularityWarning)  # classical GCP's, expected
                runs[method] = simulate(mechanism, START, None, duration, step, method, **options)
        except SimulationError as error:
            if method != "classical" or error.trajectory is None:
                raise
            runs[method], stop = error.trajectory, str(error)
    t = runs["bridge"].t
    _, l1, _, l3 = draw_four_bar(mechanism).lengths
    m1, m2, m3 = (float(inertia.mass) for inertia in list(mechanism.own_model.inertias)[1:])
    gravity = float(np.linalg.norm(mechanism.own_model.gravity.linear))
    A, B = parallelogram_pendulum(l1, l3, m1, m2, m3, gravity)
    motion = pendulum(t, START[0], 0.0, A, B)
    exact = {what: np.outer(y, MODE) for what, y in zip("qva", motion, strict=True)}
    return Case(mechanism, t, exact, runs, stop)


# --------------------------------------------------------------------------- figures


def joint_figure(case: Case) -> Figure:
    """Draw q, v and a (rows) of the three joints (columns), all methods in the same panels."""
    figure = plots.new_figure(5.0)
    panels = figure.subplots(3, 3, sharex=True)
    rows = (("q", "q [rad]"), ("v", "v [rad/s]"), ("a", "a [rad/s²]"))
    marked = np.searchsorted(case.t, np.arange(0.1, case.t[-1], case.t[-1] / 25.0))
    for line, (what, label) in zip(panels, rows, strict=True):
        for j, ax in enumerate(line):
            ax.plot(case.t, case.exact[what][:, j], **EXACT)
            for method, looks in LOOKS.items():
                run = case.runs[method]
                ax.plot(run.t, getattr(run, what)[:, j], **looks)
            bridge = getattr(case.runs["bridge"], what)
            ax.plot(case.t[marked], bridge[marked, j], **BRIDGE)
            ax.locator_params(axis="y", nbins=5, steps=[1, 2, 5, 10])
        line[0].set_ylabel(label)
        line[0].yaxis.set_label_coords(-0.2, 0.5)
    for column, name in zip(panels.T, case.mechanism.joint_names, strict=True):
        column[0].set_title(f"joint {name}", pad=15)
        column[-1].set_xlabel("t [s]")
        if case.lock_time is not None:
            plots.mark_time(column, case.lock_time, f"GCP {case.fate}, {case.lock_time:.3f} s")
    exact, projection, classical, bridge = panels[0, 0].get_legend_handles_labels()[0]
    handles = [exact, classical, projection, bridge]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, handlelength=2.6)
    return figure


def strobe_figure(case: Case) -> Figure:
    """Draw the motion at the same instants by classical and robust GCP, one above the other."""
    view = face_on(case.mechanism)
    times, y = strobe_instants(case).reshape(2, -1), case.exact["q"][:, 0]
    room = np.vstack([pose.points for pose in poses(case.mechanism, case.exact["q"][::10], view)])
    low, high = room.min(axis=0) - MARGIN, room.max(axis=0) + MARGIN
    panel = 0.94 * plots.WIDTH / times.shape[1] / (high - low)[0]
    block_height = 2.0 * panel * float((high - low)[1]) + 0.45
    figure = plots.new_figure(2.0 * block_height + LEGEND_HEIGHT)
    heights = [block_height, block_height, LEGEND_HEIGHT]
    parts = np.asarray(figure.subfigures(3, 1, height_ratios=heights))
    for block, instants in zip(parts[:2], times, strict=True):
        panels = block.subplots(2, len(instants))
        for line, (method, title) in zip(panels, STROBE_ROWS.items(), strict=True):
            for ax, t in zip(line, instants, strict=True):
                ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
                ax.set(xticks=[], yticks=[])
                ax.spines[:].set_visible(False)
                _strobe(ax, case.runs[method], view, float(t))
            line[0].set_ylabel(title)
        for ax, t in zip(panels[0], instants, strict=True):
            lost = t == case.lock_time and abs(np.interp(t, case.t, y) + np.pi) < 0.02
            ax.set_title(f"{t:.3f} s, q₁ = −π" if lost else f"{t:.2f} s", fontsize=8.5)
    body_legend(parts[2], case.mechanism)
    return figure


def strobe_instants(case: Case) -> Array:
    """Choose the times of the strobe pictures, s: up to the lock, and on from there."""
    end = float(case.t[-1])
    lock = case.lock_time or 0.4 * end
    after = min(1.0, (end - lock) / (STROBE_AFTER[-1] * lock))
    return lock * np.array([*STROBE_BEFORE, *(1.0 + after * x for x in STROBE_AFTER)])


def _strobe(ax: Axes, run: Trajectory, view: Array, t: float) -> None:
    """Draw the mechanism at t and, faded, a little earlier."""
    if t > run.t[-1]:
        ax.text(0.5, 0.0, "stopped", transform=ax.transAxes, ha="center", fontsize=8)
    before = [time for time in GHOSTS if t - time >= 0.0]
    rows = [min(int(np.searchsorted(run.t, t - time - 1e-9)), len(run.t) - 1) for time in before]
    draw_faded(ax, poses(run.mechanism, run.q[rows], view), [GHOSTS[time] for time in before])


# --------------------------------------------------------------------------- command


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.path("--out", folder, "DIR", f"folder; {DEFAULT}", default=Path("figures"))
    add_to.add("--pdf", action="store_true", help="also as PDF")
    add_to.add("--quick", action="store_true", help="1.8 s instead of 5 s, twice the step")


def run(args: argparse.Namespace) -> int:
    """Draw the figures, write the summary, print the errors."""
    plots.require_matplotlib()
    duration, step = QUICK if args.quick else FULL
    figures, rows = {}, []
    for name, (joints, strobe) in FIGURES.items():
        with progress_bar(duration, name) as progress:
            case = run_case(name, duration, step, progress)
        with plots.style():
            for stem, draw in (
                (f"figure{joints}_{name}_joints", joint_figure),
                (f"figure{strobe}_{name}_strobe", strobe_figure),
            ):
                figure = draw(case)
                for suffix in plots.FORMATS[: 1 + args.pdf]:
                    print(f"drew {plots.save(figure, args.out / (stem + suffix))}")
        figures[name] = case.summary()
        errors = figures[name]["max_error_rad"]
        when = "" if case.lock_time is None else f" at {case.lock_time:.3f} s"
        rows.append([name, *(f"{errors[m]:.1e}" for m in METHODS), case.fate + when])
    write_json(args.out / "summary.json", figures)
    print(f"\nmax |q − exact| [rad] over {duration:g} s, RK4, step {step:g} s")
    print(table(["", *(f" {m}" for m in METHODS), "classical GCP"], rows))
    return 0
