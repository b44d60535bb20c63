"""The command `simulate`: a motion as a summary, a table, a figure or a page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
    part,
    positive,
    whole,
)
from ..checks import hint
from ..dynamics.prescribed.drive import KinkedDriveWarning
from ..errors import OptionError, SimulationError
from ..kernel.library import NativeBuildWarning
from ..maps.choice import METHODS
from ..maps.classical import SingularityWarning
from ..mechanism.constraint.closures import frame_of
from ..mechanism.mechanism import Mechanism
from ..printing import clean_warnings, complain, progress_bar, say, telling
from ..simulation.runs.schedule import last_output
from ..simulation.runs.stability import StabilityWarning
from ..simulation.runs.steppers import SCIPY_STEPPERS
from ..simulation.runs.too_long_steps import CoarseStepWarning
from ..simulation.simulate import RECORDS, simulate
from ..simulation.trajectories.trajectory import Trajectory
from .acting import add_acting, ctrl_of, drive_of, torque_of
from .model import add_model, loaded
from .summary import as_json, summary

OURS = (SingularityWarning, StabilityWarning, CoarseStepWarning, KinkedDriveWarning, NativeBuildWarning)


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

    add_acting(add_to)

    add_to.heading("method")
    add_to.add("--duration", positive, type=number, metavar="S", help="s; default: the model's, else 1")
    text = "step of rk4, else spacing of the output, s; default: the model's, else 1e-3"
    add_to.add("--step", positive, type=number, metavar="S", help=text)
    add_to.add("--method", choices=METHODS, default=METHODS[0], help=f"explicit map; {DEFAULT}")
    text = "Newton's start for --method classical; default: tangent"
    add_to.add("--newton-start", choices=("previous", "tangent"), help=text)
    add_to.add("--stepper", choices=("rk4", *SCIPY_STEPPERS), default="rk4", help=DEFAULT)
    text = f"of the adaptive steppers; {DEFAULT}"
    add_to.add("--rtol", positive, type=number, default=1e-8, metavar="R", help=text)
    add_to.add("--atol", positive, type=number, default=1e-10, metavar="A", help=text)
    text = "where y turns back: change coordinates, as --method bridge does by default, or stop"
    add_to.add("--on-toggle", choices=("repartition", "error"), default=None, help=text)

    add_to.add("--backend", choices=("auto", "python", "native"), default="auto", help=DEFAULT)
    _output(add_to)


def _output(add_to: Arguments) -> None:
    add_to.heading("output")
    add_to.add("--json", action="store_true", help="print the summary as JSON, all digits")
    text = "times to record, s, ascending; default: every step"
    add_to.add("--outputs", not_negative, nargs="+", type=number, metavar="T", help=text)
    text = f"write also any of {','.join(RECORDS)}"
    add_to.add("--record", type=names, default=[], metavar="LIST", help=text)
    add_to.path("--out", csv_or_folder, "PATH", "write CSV: a file.csv, or a folder")
    text = "keep everything in a .npz file, for load_trajectory in Python"
    add_to.path("--save", file((".npz",), "a trajectory"), "FILE", text)

    add_to.heading("pictures")
    text = "draw q, v and what drives take over time, or --columns: a .png or .pdf file"
    add_to.path("--plot", file((".png", ".pdf"), "a figure"), "FILE", text)
    text = "what --plot draws: columns of the CSV, joints, or quantities such as q, drive, closure"
    add_to.add("--columns", part, nargs="+", metavar="NAME", help=text)
    add_to.add("--over", part, metavar="NAME", help="the column that --plot draws over; default: time")
    text = "write the motion as an animation: a .gif file, or a .mp4 file where ffmpeg is installed"
    add_to.path("--animate", file((".gif", ".mp4"), "an animation"), "FILE", text)
    text = "seconds of the motion in a second of --animate; default: 1"
    add_to.add("--speed", positive, type=number, metavar="X", help=text)
    text = "write the motion as a web page: a .html file"
    add_to.path("--replay", file((".html", ".htm"), "a replay"), "FILE", text)
    text = "frames whose paths the replay draws; default: the first closure's"
    add_to.add("--trails", type=names, metavar="LIST", help=text)


def csv_or_folder(name: str, path: Path) -> None:
    """A .csv file or a folder."""
    (file() if path.suffix == ".csv" else folder)(name, path)


def run(args: argparse.Namespace) -> int:
    """Simulate, summarise on stdout, write what was asked for."""
    mechanism = loaded(args)
    _require(args, mechanism)
    trajectory, stop = _simulated(args, mechanism)
    tell: Callable[[str], None] = say if stop is None else complain
    if stop is not None:
        tell(str(stop))
        tell(f"simulated until t = {trajectory.t[-1]:.6g} s ({len(trajectory.t)} rows)")
    elif not args.json:
        newton = f", Newton from {_newton_start(args)}" if args.method == "classical" else ""
        spacing = mechanism.recommended.run(args.duration, args.step)[1]
        taken = trajectory.stats.stepper, trajectory.stats.step or spacing
        tell(f"{mechanism!r}\nmethod {args.method}{newton}; {taken[0]}, step {taken[1]:g} s\n")
        with telling("checking loops and energy of every output"):
            told = summary(trajectory)
        tell(told)
    written = _write(args, trajectory, (lambda text: None) if args.json else tell)
    if args.json:
        say(as_json(trajectory, args.method, stop, written))
    return 0 if stop is None else 2


def _require(args: argparse.Namespace, mechanism: Mechanism) -> None:
    """Refuse, before any work, what could not be written."""
    for option in ("columns", "over"):
        if getattr(args, option) is not None and args.plot is None:
            raise OptionError(f"--{option} goes with --plot FILE, which draws it")
    if args.speed is not None and args.animate is None:
        raise OptionError("--speed goes with --animate FILE, whose speed it is")
    if args.newton_start is not None and args.method != "classical":
        raise OptionError(f"--newton-start goes with --method classical, not {args.method}")
    if args.plot is not None or args.animate is not None:
        from ..drawing.figures.style import require_matplotlib

        require_matplotlib()
    if args.plot is not None:
        from ..drawing.figures.panels import known_names

        known = known_names(mechanism)
        for option, given in (("columns", args.columns or ()), ("over", [args.over] if args.over else ())):
            for name in given:
                if name not in known:
                    raise OptionError(f"--{option} {name}: no joint, column or quantity{hint(name, known)}")
    if args.animate is not None:
        from ..drawing.figures.animation import require_writer

        require_writer(args.animate)
    if args.replay is not None:
        from ..drawing.replay.replay import meshcat_folder

        meshcat_folder()
    for frame in args.trails or ():
        frame_of(mechanism.own_model, frame, "--trails")
    if args.trails is not None and args.replay is None:
        raise OptionError("--trails goes with --replay FILE, which shows them")


def _simulated(args: argparse.Namespace, mechanism: Mechanism) -> tuple[Trajectory, SimulationError | None]:
    """The motion, or how far it came and why it stopped."""
    mode = None if args.mode is None else _mode(mechanism, args.q0, args.mode)
    last = last_output(args.outputs, 0.0)
    duration = mechanism.recommended.run(last if args.duration is None else args.duration, args.step)[0]
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
                torque=torque_of(args),
                ctrl=ctrl_of(args),
                drive=drive_of(mechanism, args),
                outputs=args.outputs,
                record=_recorded(args),
                mode=mode,
                rtol=args.rtol,
                atol=args.atol,
                on_toggle=args.on_toggle,
                newton_start=_newton_start(args),
                progress=progress,
                backend=args.backend,
            )
        except SimulationError as error:
            if error.trajectory is None or len(error.trajectory.t) == 0:
                raise
            return error.trajectory, error
    return trajectory, None


def _newton_start(args: argparse.Namespace) -> Any:
    return args.newton_start or "tangent"


def _recorded(args: argparse.Namespace) -> list[str]:
    """What is to be recorded: what --record lists, and what the columns drawn are made of."""
    drawn = [name.partition(".")[0] for name in [*(args.columns or ()), args.over or ""]]
    made = [
        name for name in ("multipliers" if name == "lambda" else name for name in drawn) if name in RECORDS
    ]
    return list(dict.fromkeys([*args.record, *made]))


def _write(args: argparse.Namespace, trajectory: Trajectory, tell: Callable[[str], None]) -> list[str]:
    """Write every file that was asked for; returns their paths."""
    csv: Path | None = args.out
    if csv is not None and csv.suffix != ".csv":
        csv = csv / f"{trajectory.mechanism.name}_{args.method}.csv"

    usual = ("q", "v") if trajectory.drive_torque is None else ("q", "v", "drive")

    def replayed(path: Path) -> None:
        from ..drawing.replay.replay import replay

        replay(trajectory, path, trails=args.trails)

    asked: tuple[tuple[Path | None, str, str, Callable[[Path], object]], ...] = (
        (csv, "writing", "wrote", trajectory.to_csv),
        (args.save, "writing", "wrote", trajectory.save),
        (
            args.plot,
            "drawing",
            "drew",
            lambda path: trajectory.plot(args.columns or usual, path, x=args.over),
        ),
        (args.animate, "drawing", "drew", lambda path: trajectory.animate(path, speed=args.speed or 1.0)),
        (args.replay, "writing", "wrote", replayed),
    )
    written = []
    for path, doing, done, make in asked:
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            with telling(f"{doing} {path}"):
                make(path)
            tell(f"{done} {path}")
            written.append(str(path))
    return written


def _mode(mechanism: Mechanism, q0: ArrayLike | None, index: int) -> Any:
    modes = local.analyse(mechanism, mechanism.home if q0 is None else q0).modes
    if not 0 <= index < len(modes):
        raise OptionError(f"--mode {index}: analyse lists {len(modes)} modes at q0, from 0 on")
    return modes[index]
