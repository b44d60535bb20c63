"""Time of a step against loops, clusters, joints, mobility; ours, Pinocchio's, MuJoCo's; and fixed costs.

A step's time is the difference of two runs over that of their numbers of steps, so that what a run costs once
is not in it.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin

from .. import Mechanism, PointClosure, backends, load, simulate
from ..arguments import Arguments, existing_folder, folder
from ..drawing.figures import style as plots
from ..dynamics.derivatives import derivatives, forward_dynamics
from ..dynamics.discrete import step_jacobians
from ..examples.families import four_bars
from ..examples.linkages import add_link, n_four_bar
from ..printing import along, write, write_json
from . import pages
from .contender import Contender, Scene
from .machine import footer, least, machine
from .throughput import thread_gain
from .tools import tools

Row = dict[str, float | str]
"""Of one mechanism: its family, size, name, nv and m, and µs of a step by contender."""

SHOWN = {
    "bridge compiled, RK4": "compiled",
    "bridge, RK4": "Python",
    "Pinocchio, mu > 0": "Pinocchio C++",
    "Pinocchio, defaults": "Pinocchio C++",
    "MuJoCo connect, tuned": "MuJoCo RK4",
}
"""Contenders and their names here: all with RK4; Pinocchio's is `constraintDynamics`, or `aba` for a tree."""

ANGLE = 1.2
"""rad: cranks well away from flat, so that only the regular path is timed."""

STEP, OUTPUTS, MOST = 2e-5, 10, 256
"""s; outputs of a timed run; and steps between them of the shorter one at most: the motion stays regular."""

SPENT, ROUNDS = 6e-3, 9
"""s that the longer run should take more, and how often both are run; the smallest times count."""

QUICK = 2
"""Rounds of a smoke test."""


def polygon(m: int) -> Mechanism:
    """One loop of m + 3 joints: links between points on an arc, from the origin back to the ground."""
    turns = np.linspace(0.8 * np.pi, 0.1 * np.pi, m + 3)
    points = np.exp(1j * turns) - np.exp(1j * turns[0])
    bars = np.diff(points)
    model, joint, reach = pin.Model(), 0, 0.0
    for i, bar in enumerate(bars):
        joint, reach = add_link(model, joint, reach, f"q{i}", float(abs(bar))), float(abs(bar))
    end = pin.SE3(np.eye(3), np.array([0.0, points[-1].real, points[-1].imag]))
    model.addFrame(pin.Frame("ground_end", 0, end, pin.FrameType.OP_FRAME))
    home = np.diff(np.unwrap(np.angle(bars)), prepend=0.0)
    closures = [PointClosure(f"q{len(bars) - 1}_tip", "ground_end")]
    return Mechanism(model, closures, [f"q{i}" for i in range(m)], home=home)


def pendulums(n: int) -> Mechanism:
    """A chain of n revolute joints, which is a tree."""
    model, joint = pin.Model(), 0
    for i in range(n):
        joint = add_link(model, joint, 1.0 if i else 0.0, f"q{i}", 1.0)
    return Mechanism.from_pinocchio(model, home=[0.3] * n)


FAMILIES: dict[str, tuple[tuple[int, ...], Callable[[int], Mechanism]]] = {
    "loops": ((1, 2, 5, 10, 20, 40), partial(n_four_bar, angle=ANGLE)),
    "clusters": ((1, 2, 4, 8, 16), lambda n: four_bars([(4.0, 1.0, 3.5, 3.0)] * n, [1.0] * n, spacing=9.0)),
    "mobility": ((1, 2, 3, 4, 6), polygon),
    "joints": ((1, 2, 5, 10, 20, 40), pendulums),
    "robots": ((3, 4), lambda m: load("delta" if m == 3 else "walker")),
}
"""Sizes and mechanisms: four-bars in a row, in one cluster; side by side; m + 3 joints in one loop; a chain
of n; and robots, by their mobility."""


def step_seconds(
    contender: Contender, mechanism: Mechanism, rounds: int = ROUNDS, spent: float = SPENT
) -> float | None:
    """Of a step from home at rest; None where the contender does not run the mechanism.

    The longer run takes `spent` seconds more, if `MOST` allows.
    """

    def scene(steps: int) -> Scene:
        """So many steps between outputs."""
        times = STEP * steps * np.arange(OUTPUTS + 1)
        return Scene("", mechanism, mechanism.home, np.zeros(mechanism.nv), times)

    def seconds(steps: int) -> float:
        found = contender.run(scene(steps), STEP)
        return np.inf if found.stopped else found.seconds

    if contender.refuses(scene(1)):
        return None
    few = 1
    seconds(few)  # what is made once, as other coordinates at the start
    while few < (8 if rounds == QUICK else MOST) and seconds(3 * few) - seconds(few) < spent:
        few *= 2
    both = [(seconds(few), seconds(3 * few)) for _ in range(rounds)]
    less, more = (min(times) for times in zip(*both, strict=True))
    return (more - less) / (2 * few * OUTPUTS)


def measure(family: str, quick: bool) -> list[Row]:
    """Rows of size, velocities and µs a step by contender."""
    everyone = {c.name: c for c in tools(lambda scene: np.zeros(0))}
    rows, (sizes, make) = [], FAMILIES[family]
    for n in along(sizes[:2] if quick else sizes, family):
        mechanism = make(n)
        row: Row = {"family": family, "size": n, "name": mechanism.name}
        row |= {"nv": mechanism.nv, "m": mechanism.m}
        for name, shown in SHOWN.items():
            if name not in everyone or (name == "Pinocchio, defaults" and mechanism.closures):
                continue
            found = step_seconds(everyone[name], mechanism, QUICK if quick else ROUNDS)
            if found is not None:
                row[shown] = 1e6 * found
        rows.append(row)
    return rows


# --------------------------------------------------------------------------- what a run costs once


def once(quick: bool) -> dict[str, float]:
    """Milliseconds of a first run, of a start, and of a crossing; ratios of the rest."""
    rounds = 2 if quick else 9
    rhombus = load("rhombus")

    def milliseconds(call: Callable[[], object], many: int = rounds) -> float:
        return 1e3 * least(call, many)

    def fall(duration: float, backend: Literal["auto", "python"] = "auto") -> object:
        return simulate(rhombus.with_independent(["q1"]), duration=duration, step=1e-3, backend=backend)

    short, crank_rocker = partial(simulate, duration=1e-3, step=1e-3), load("crank_rocker")
    loading = milliseconds(lambda: load("crank_rocker"), 3)
    first = milliseconds(lambda: short(load("crank_rocker")), 3) - loading
    start = milliseconds(partial(short, crank_rocker))
    crossing = milliseconds(partial(fall, 0.3)) - milliseconds(partial(fall, 0.1))
    delta = load("delta")
    q, v = delta.home, np.asarray(delta.recommended.v0)
    accelerated = milliseconds(lambda: forward_dynamics(delta, q, v))
    zero = np.zeros(delta.nv)
    stepped = milliseconds(partial(short, delta, q, v, backend="python"))
    return {
        "derivatives": milliseconds(lambda: derivatives(delta, q, v)) / accelerated,
        "jacobians": milliseconds(lambda: step_jacobians(delta, q, v, zero, 1e-3)) / stepped,
        "first run": first,
        "start": start,
        "crossing": crossing,
        "fall in Python": milliseconds(partial(fall, 1.5, "python"), 2) / milliseconds(partial(fall, 1.5)),
        "threads": thread_gain(crank_rocker, quick),
    }


# --------------------------------------------------------------------------- what is told

FITTED = 3
"""Largest sizes that an exponent is fitted to."""


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


# --------------------------------------------------------------------------- command

PAGES = {"docs/kernel.md": ["growth"], "README.md": ["speed"]}
"""Where the table and the sentence stand."""


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.path("--out", folder, "DIR", "write growth.md, growth.json and growth.png there")
    add_to.path("--docs", existing_folder, "ROOT", "renew README.md and docs/ of this checkout")
    add_to.add("--quick", action="store_true", help="small sizes, short rounds: a smoke test")


def run(args: argparse.Namespace) -> int:
    """Print the tables, and write what was asked for."""
    if args.out is not None or args.docs is not None:
        plots.require_matplotlib()
    pages.require_pages(args.docs, PAGES)
    measured = {family: measure(family, args.quick) for family in FAMILIES}
    fixed, about = once(args.quick), machine()
    foot = footer(about)
    text = tables(measured, fixed, foot)
    print(text)
    state = backends()["native"]
    if not state.available:
        print(f"no compiled kernel: {state.reason}")
    if args.out is not None:
        write(args.out / "growth.md", f"{text}\n")
        write_json(args.out / "growth.json", {"machine": about, "families": measured, "once": fixed})
        draw(measured, foot, args.out / "growth.png")
    if args.docs is not None:
        draw(measured, foot, args.docs / "docs" / "figures" / "growth.png")
        for page in PAGES:
            pages.refresh(args.docs / page, {"growth": text, "speed": sentence(measured, fixed)})
    return 0
