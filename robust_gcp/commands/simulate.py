"""The command `simulate`: a motion as a summary, a table, a figure or a page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..analysis import local
from ..arguments import (
    DEFAULT,
    NUMBERS,
    Arguments,
    file,
    finite,
    folder,
    names,
    not_negative,
    number,
    pathname,
    positive,
    whole,
)
from ..errors import OptionError, SimulationError, SingularStartError
from ..kernel.library import NativeBuildWarning
from ..maps.choice import METHODS
from ..maps.classical import SingularityWarning
from ..mechanism.closures import frame_of
from ..mechanism.joints import Component, components_of
from ..mechanism.mechanism import Mechanism
from ..printing import clean_warnings, complain, fixed, progress_bar, say, table, telling
from ..simulation.coarse import CoarseStepWarning
from ..simulation.schedule import last_output
from ..simulation.simulate import RECORDS, simulate
from ..simulation.stability import StabilityWarning
from ..simulation.steppers import SCIPY_STEPPERS
from ..simulation.trajectory import Trajectory
from .model import add_model, loaded

OURS = (SingularityWarning, StabilityWarning, CoarseStepWarning, NativeBuildWarning)


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)

    add_to.heading("start")
    text = f"{NUMBERS}; default: the model's"
    add_to.add("--q0", finite, nargs="+", type=number, metavar="Q", help=text)
    text = "with K v0 = 0; default: the model's where --q0 is left out too, else at rest"
    add_to.add("--v0", finite, nargs="+", type=number, metavar="V", help=text)
    text = "mode to take from a singular q0: its number in the list of analyse"
    add_to.add("--mode", whole(0), type=int, metavar="INDEX", help=text)

    add_to.heading("method")
    add_to.add("--duration", positive, type=number, metavar="S", help="s; default: the model's, else 1")
    text = "step of rk4, else spacing of the output, s; default: the model's, else 1e-3"
    add_to.add("--step", positive, type=number, metavar="S", help=text)
    add_to.add("--method", choices=METHODS, default=METHODS[0], help=f"explicit map; {DEFAULT}")
    text = f"Newton's start for --method classical; {DEFAULT}"
    add_to.add("--newton-start", choices=("previous", "tangent"), default="tangent", help=text)
    add_to.add("--stepper", choices=("rk4", *SCIPY_STEPPERS), default="rk4", help=DEFAULT)
    text = f"of the adaptive steppers; {DEFAULT}"
    add_to.add("--rtol", positive, type=number, default=1e-8, metavar="R", help=text)
    add_to.add("--atol", positive, type=number, default=1e-10, metavar="A", help=text)
    text = "where y turns back: change coordinates, as --method bridge does by default, or stop"
    add_to.add("--on-toggle", choices=("repartition", "error"), default=None, help=text)

    add_to.heading("output")
    text = "times to record, s, ascending; default: every step"
    add_to.add("--outputs", not_negative, nargs="+", type=number, metavar="T", help=text)
    text = f"write also any of {','.join(RECORDS)}"
    add_to.add("--record", type=names, default=[], metavar="LIST", help=text)
    add_to.add(
        "--out", csv_or_folder, type=pathname, metavar="PATH", help="write CSV: a file.csv, or a folder"
    )
    text = "draw q and v over time: a .png or .pdf file"
    add_to.add("--plot", file((".png", ".pdf"), "a figure"), type=pathname, metavar="FILE", help=text)
    text = "write the motion as a web page: a .html file"
    add_to.add("--replay", file((".html", ".htm"), "a replay"), type=pathname, metavar="FILE", help=text)
    text = "frames whose paths the replay draws; default: the first closure's"
    add_to.add("--trails", type=names, metavar="LIST", help=text)


def csv_or_folder(name: str, path: Path) -> None:
    """A .csv file or a folder."""
    (file() if path.suffix == ".csv" else folder)(name, path)


def run(args: argparse.Namespace) -> int:
    """Simulate, summarise on stdout, write what was asked for."""
    mechanism = loaded(args)
    csv: Path | None = args.out
    if csv is not None and csv.suffix != ".csv":
        csv = csv / f"{mechanism.name}_{args.method}.csv"
    if args.plot is not None:
        from ..drawing.figures.style import require_matplotlib

        require_matplotlib()
    if args.replay is not None:
        from ..drawing.replay.replay import meshcat_folder, replay

        meshcat_folder()
    for frame in args.trails or ():
        frame_of(mechanism.own_model, frame, "--trails")
    mode = None if args.mode is None else _mode(mechanism, args.q0, args.mode)
    last = last_output(args.outputs, 0.0)
    duration = last if args.duration is None else args.duration
    stop: SimulationError | None = None
    duration, spacing = mechanism.recommended.run(duration, args.step)
    with clean_warnings(OURS), progress_bar(duration, mechanism.name) as progress:
        try:
            trajectory = simulate(
                mechanism,
                args.q0,
                args.v0,
                duration,
                args.step,
                args.method,
                args.stepper,
                outputs=args.outputs,
                record=args.record,
                mode=mode,
                rtol=args.rtol,
                atol=args.atol,
                on_toggle=args.on_toggle,
                newton_start=args.newton_start,
                progress=progress,
            )
        except SimulationError as error:
            if isinstance(error, SingularStartError) and args.mode is None:
                error.args = (f"{error} (here: --mode INDEX)",)
            if error.trajectory is None or len(error.trajectory.t) == 0:
                raise
            trajectory, stop = error.trajectory, error
    tell: Callable[[str], None] = say if stop is None else complain
    if stop is None:
        newton = f", Newton from {args.newton_start}" if args.method == "classical" else ""
        taken = trajectory.stats.stepper, trajectory.stats.step or spacing
        tell(f"{mechanism!r}\nmethod {args.method}{newton}; {taken[0]}, step {taken[1]:g} s\n")
        with telling("checking loops and energy of every output"):
            told = summary(trajectory)
        tell(told)
    else:
        tell(str(stop))
        tell(f"simulated until t = {trajectory.t[-1]:.6g} s ({len(trajectory.t)} rows)")
    if csv is not None:
        csv.parent.mkdir(parents=True, exist_ok=True)
        with telling(f"writing {csv}"):
            trajectory.to_csv(csv)
        tell(f"wrote {csv}")
    if args.plot is not None:
        with telling(f"drawing {args.plot}"):
            trajectory.plot(("q", "v"), args.plot)
        tell(f"drew {args.plot}")
    if args.replay is not None:
        with telling(f"writing {args.replay}"):
            replay(trajectory, args.replay, trails=args.trails)
        tell(f"wrote {args.replay}")
    return 0 if stop is None else 2


def summary(trajectory: Trajectory) -> str:
    """Tell end state, certificates, cost and crossings in lines to print."""
    stats, q, v = trajectory.stats, trajectory.q[-1], trajectory.v[-1]
    state = [
        [c.name, fixed(q[c.iq]) if c.iq >= 0 else "", fixed(v[c.iv]) if c.iv >= 0 else "", _units(c)]
        for c in components_of(trajectory.mechanism.joints)
    ]
    figures = {
        "max closure error": f"{trajectory.closure_error().max(initial=0.0):.1e}",
        "max |energy error|": f"{np.abs(trajectory.energy_error()).max(initial=0.0):.1e} J",
        "right-hand sides": str(stats.rhs),
        "wall time": f"{stats.wall_seconds:.3g} s",
        "crossings": str(len(trajectory.crossings) or "none"),
    }
    lines = [
        f"state at t = {trajectory.t[-1]:g} s",
        table(["joint", " q", " v", ""], state),
        "",
        *(f"{name:<20}{value}" for name, value in figures.items()),
    ]
    if trajectory.crossings:
        rows = [
            [f"{c.time:.6f}", " ".join(fixed(y, 6) for y in c.y), c.kind, f"{c.certificate:.1e}"]
            for c in trajectory.crossings
        ]
        lines.append(table(["t [s]", " y", "kind", "certificate"], rows))
    lines += [f"from t = {t:.6g} s: y = {', '.join(names)}" for t, names in stats.repartitions]
    return "\n".join(lines)


def _units(component: Component) -> str:
    """Of what is shown of it: "rad, rad/s" where it has both."""
    if not component.unit:
        return ""
    shown = [component.unit] * (component.iq >= 0) + [f"{component.unit}/s"] * (component.iv >= 0)
    return ", ".join(shown)


def _mode(mechanism: Mechanism, q0: ArrayLike | None, index: int) -> Any:
    modes = local.analyse(mechanism, mechanism.home if q0 is None else q0).modes
    if not 0 <= index < len(modes):
        raise OptionError(f"--mode {index}: analyse lists {len(modes)} modes at q0, from 0 on")
    return modes[index]
