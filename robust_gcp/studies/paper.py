"""Figures 4 to 7 of the paper: rhombus and parallelogram fall through their singularities.

Both mechanisms start at rest at q = (0.2, −0.2, 0.2) rad and swing in the parallelogram mode, whose
exact motion is a pendulum's. Classical GCP, Newton started from the previous q_d as published, loses
that mode at q1 = −π; the projection of Eq. (7) and the bridge go on.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..closed_form import parallelogram_pendulum, pendulum
from ..errors import SimulationError
from ..four_bar_map import Drawing, draw_four_bar
from ..gcp import SingularityWarning
from ..loader import load
from ..mechanism import Mechanism
from ..simulate import Method, simulate
from ..trajectory import Trajectory
from ..tree import Array
from . import plots

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
"""Duration and step, s."""

LOOKS: dict[Method, dict[str, Any]] = {
    "classical": {
        "color": plots.VERMILLION,
        "linestyle": (0, (3.5, 1.6)),
        "linewidth": 1.1,
        "label": "classical GCP",
    },
    "projection": {
        "color": plots.BLUE,
        "linewidth": 1.1,
        "label": "robust GCP, Eq. (7)",
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

LOCKED = 1e-3
"""Distance from the exact motion at which a method counts as locked on another mode, rad."""

STROBE_BEFORE = (0.0, 0.5, 0.8, 1.0)
STROBE_AFTER = (0.3, 0.6, 0.95, 1.3)
"""Instants of the strobe figures, in lock times: until the lock, and after it."""

GHOSTS = (0.12, 0.08, 0.04)
"""How long before each instant the mechanism is drawn once more, faded, s."""


@dataclass
class Case:
    """One mechanism's fall by all methods.

    Attributes
    ----------
    mechanism : Mechanism
    t : ndarray (N + 1,)
        s.
    exact : dict of ndarray (N + 1, 3)
        "q", "v", "a" of the joints from Jacobi elliptic functions; rad, s.
    runs : dict of Trajectory
        By method; classical GCP's is shorter than t if it had to stop.
    stop : str
        Why classical GCP stopped; empty if it reached the end.
    """

    mechanism: Mechanism
    t: Array
    exact: dict[str, Array]
    runs: dict[Method, Trajectory]
    stop: str = ""

    def deviation(self, method: Method) -> Array:
        """max |q − exact| over the joints at each time the run reached, rad."""
        q = self.runs[method].q
        return np.asarray(np.abs(q - self.exact["q"][: len(q)]).max(axis=1))

    @property
    def lock_time(self) -> float | None:
        """When classical GCP left the exact motion, or stopped, s; None if it did neither."""
        off = np.flatnonzero(self.deviation("classical") > LOCKED)
        if len(off):
            return float(self.t[off[0]])
        return float(self.runs["classical"].t[-1]) if self.stop else None

    def summary(self) -> dict[str, Any]:
        """The figures of this case, ready for JSON."""
        return {
            "duration_s": float(self.t[-1]),
            "step_s": float(self.t[1]),
            "lock_time_s": self.lock_time,
            "classical_stopped": self.stop or None,
            "max_error_rad": {m: float(self.deviation(m).max()) for m in METHODS},
            "max_closure_error_m": {
                m: float(run.closure_error().max()) for m, run in self.runs.items()
            },
            "crossings": {m: len(run.crossings) for m, run in self.runs.items()},
            "wall_seconds": {m: run.stats.wall_seconds for m, run in self.runs.items()},
        }


def run_case(
    name: str,
    duration: float = 5.0,
    step: float = 1e-3,
    progress: Callable[[float], None] | None = None,
) -> Case:
    """Simulate "rhombus" or "parallelogram" by every method, RK4, beside the exact motion.

    Parameters
    ----------
    duration, step : float
        s.
    progress : callable (fraction), optional
        Called as the runs go on.
    """
    mechanism = load(name)
    runs: dict[Method, Trajectory] = {}
    stop = ""
    for i, method in enumerate(METHODS):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SingularityWarning)  # classical GCP's, expected
                runs[method] = simulate(
                    mechanism,
                    START,
                    duration=duration,
                    step=step,
                    method=method,
                    newton_start="previous",
                    record=("a",),
                    progress=progress and (lambda x, i=i: progress((i + x) / len(METHODS))),
                )
        except SimulationError as error:
            if method != "classical" or error.trajectory is None:
                raise
            runs[method], stop = error.trajectory, str(error)
    t = runs["bridge"].t
    _, l1, _, l3 = draw_four_bar(mechanism).lengths
    masses = [inertia.mass for inertia in list(mechanism.model.inertias)[1:]]
    gravity = float(np.linalg.norm(mechanism.model.gravity.linear))
    motion = pendulum(t, START[0], 0.0, *parallelogram_pendulum(l1, l3, *masses, gravity))
    exact = {what: np.outer(y, MODE) for what, y in zip("qva", motion, strict=True)}
    return Case(mechanism, t, exact, runs, stop)


# --------------------------------------------------------------------------- figures


def joint_figure(case: Case) -> Figure:
    """q, v and a (rows) of the three joints (columns); all methods in the same panels."""
    figure = plots.new_figure(5.2)
    panels = figure.subplots(3, 3, sharex=True)
    rows = (("q", "q [rad]"), ("v", "v [rad/s]"), ("a", "a [rad/s²]"))
    marks = np.arange(0.1, case.t[-1], 0.2)
    for line, (what, label) in zip(panels, rows, strict=True):
        for j, ax in enumerate(line):
            exact = case.exact[what][:, j]
            ax.plot(case.t, exact, color="0.75", linewidth=4.0, label="exact")
            for method, looks in LOOKS.items():
                run = case.runs[method]
                ax.plot(run.t, getattr(run, what)[:, j], **looks)
            at = np.searchsorted(case.t, marks)
            ax.plot(case.t[at], getattr(case.runs["bridge"], what)[at, j], **BRIDGE)
        line[0].set_ylabel(label)
    for j, name in enumerate(case.mechanism.joint_names):
        panels[0, j].set_title(f"joint {name}", pad=14)
        panels[-1, j].set_xlabel("t [s]")
        if case.lock_time is not None:
            plots.mark_time(panels[:, j], case.lock_time, f"GCP locks at {case.lock_time:.3f} s")
    figure.align_ylabels(panels[:, 0])
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, handlelength=2.6)
    return figure


def strobe_instants(case: Case) -> Array:
    """Times of the strobe pictures, s: up to the lock and as long again after it."""
    end = float(case.t[-1])
    lock = case.lock_time or 0.4 * end
    after = min(1.0, (end - lock) / (STROBE_AFTER[-1] * lock))
    return lock * np.array([*STROBE_BEFORE, *(1.0 + after * x for x in STROBE_AFTER)])


def strobe_figure(case: Case) -> Figure:
    """The motion at the same instants by classical GCP (upper row) and robust GCP (lower row)."""
    drawing = draw_four_bar(case.mechanism)
    times = strobe_instants(case)
    rows: tuple[tuple[str, Method], ...] = (
        ("classical GCP", "classical"),
        ("robust GCP", "projection"),
    )
    reach = [
        np.array(list(plots.four_bar_pose(drawing, q).values()))
        for run in case.runs.values()
        for q in run.q[::20]
    ]
    low, high = np.min(reach, axis=(0, 1)) - 0.2, np.max(reach, axis=(0, 1)) + 0.2
    panel = plots.WIDTH / len(times) * 0.93
    figure = plots.new_figure(2.0 * panel * float((high - low)[1] / (high - low)[0]) + 0.75)
    panels = figure.subplots(len(rows), len(times), sharex=True, sharey=True)
    for line, (title, method) in zip(panels, rows, strict=True):
        for ax, t in zip(line, times, strict=True):
            ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            ax.set(xticks=[], yticks=[])
            ax.spines[:].set_visible(False)
            _strobe(ax, case.runs[method], drawing, float(t))
        line[0].set_ylabel(title)
    for ax, t in zip(panels[0], times, strict=True):
        ax.set_title(f"{t:.2f} s", fontsize=8.5)
    return figure


def _strobe(ax: Axes, run: Trajectory, drawing: Drawing, t: float) -> None:
    """The mechanism at t and, faded, a little earlier."""
    for before, alpha in zip((*GHOSTS, 0.0), (0.12, 0.2, 0.3, 1.0), strict=True):
        if t - before < 0.0:
            continue
        q = run.q[min(int(np.searchsorted(run.t, t - before - 1e-9)), len(run.t) - 1)]
        plots.draw_four_bar_pose(ax, plots.four_bar_pose(drawing, q), alpha, pins=before == 0.0)


# --------------------------------------------------------------------------- command


def add_parser(subparsers: Any) -> None:
    """Register `paper`."""
    text = "draw Figures 4 to 7 of the paper, with the exact motion in the same panels"
    parser = subparsers.add_parser("paper", help=text, description=text)
    parser.add_argument(
        "--out", type=Path, default=Path("figures"), help="folder; default: %(default)s"
    )
    parser.add_argument("--pdf", action="store_true", help="also as PDF")
    parser.add_argument("--quick", action="store_true", help="1.8 s instead of 5 s, twice the step")
    parser.set_defaults(run=_paper)


def _paper(args: argparse.Namespace) -> int:
    from ..commands import progress_bar, table

    plots.require_matplotlib()
    duration, step = QUICK if args.quick else FULL
    args.out.mkdir(parents=True, exist_ok=True)
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
        lock = figures[name]["lock_time_s"]
        rows.append([name, *(f"{errors[m]:.1e}" for m in METHODS), f"{lock:.3f}" if lock else "–"])
    path = args.out / "summary.json"
    path.write_text(json.dumps(figures, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"wrote {path}\n\nmax |q − exact| [rad] over {duration:g} s, RK4, step {step:g} s")
    print(table(["", *METHODS, "GCP locks at [s]"], rows))
    return 0
