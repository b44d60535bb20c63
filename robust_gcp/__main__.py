"""The command line: `robust-gcp` or `python -m robust_gcp`."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import __version__, commands
from .errors import RobustGcpError
from .simulation.simulate import METHODS, RECORDS
from .simulation.steppers import SCIPY_STEPPERS
from .studies import a02, benchmark, costs, crossings, modes, paper
from .studies.stability import command as stability
from .studies.work_precision import command as work_precision

ROOMS = (modes, paper, crossings, a02, benchmark, costs, work_precision, stability)
"""Modules that bring subcommands of their own by `add_parser(subparsers)`."""

MODEL = "a shipped model's name, or a folder with robot.urdf and robot.yaml"
NUMBERS = "numbers, or multiples of pi such as -pi or 2*pi/3"
DEFAULT = "default: %(default)s"
PI = re.compile(r"(?P<sign>[+-]?)(?:(?P<times>\d+\.?\d*)\*?)?pi(?:/(?P<over>\d+\.?\d*))?")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand; the exit code is 0 when done, 2 when refused or stopped by an error."""
    given = sys.argv[1:] if argv is None else argv
    if any("\0" in text for text in given):
        commands.complain("a word holds a null character, which no name or path does; remove it")
        return 2
    args = _parser().parse_args([shield(text) for text in given])
    try:
        return int(args.run(args))
    except BrokenPipeError:  # the reader of our output left, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (RobustGcpError, OSError) as error:
        commands.complain(str(error))
        return 2
    except KeyboardInterrupt:
        commands.complain("interrupted")
        return 130


def number(text: str) -> float:
    """Read a float, or a multiple of π such as `pi`, `-pi`, `2*pi/3`."""
    match = PI.fullmatch(text.strip())
    if match is None:
        return float(text)
    over = float(match["over"] or 1.0)
    if over == 0.0:
        raise ValueError(f"{text} divides by zero")
    value = math.pi * float(match["times"] or 1.0) / over
    return -value if match["sign"] == "-" else value


def shield(text: str) -> str:
    """Put a space before a negative number, which argparse may take for an option (`-pi`)."""
    try:
        return f" {text}" if text.startswith("-") and number(text) <= 0.0 else text
    except ValueError:
        return text


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robust-gcp",
        description="Closed-loop mechanisms in minimal coordinates, straight through singular "
        "configurations.",
        epilog="robust-gcp COMMAND --help tells a command's options.",
    )
    parser.add_argument("--version", action="version", version=f"robust_gcp {__version__}")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_simulate(subparsers)
    _add_analyse(subparsers)
    text = "list the shipped models"
    models = subparsers.add_parser("models", help=text, description=text)
    models.add_argument("--full", action="store_true", help="every joint and closure by name")
    models.set_defaults(run=commands.models)
    for room in ROOMS:
        room.add_parser(subparsers)
    return parser


def _add_simulate(subparsers: Any) -> None:
    text = "simulate a mechanism and summarise the motion"
    parser = subparsers.add_parser("simulate", help=text, description=text)
    parser.add_argument("model", metavar="MODEL", help=MODEL)

    add = parser.add_argument_group("start").add_argument
    add("--q0", nargs="+", type=number, metavar="Q", help=f"{NUMBERS}; default: the model's home")
    add("--v0", nargs="+", type=number, metavar="V", help="with K v0 = 0; default: at rest")
    text = "mode to take from a singular q0: its number in the list of analyse"
    add("--mode", type=int, metavar="INDEX", help=text)

    add = parser.add_argument_group("method").add_argument
    add("--duration", type=number, default=5.0, metavar="S", help=f"s; {DEFAULT}")
    text = f"step of rk4, else spacing of the output, s; {DEFAULT}"
    add("--step", type=number, default=1e-3, metavar="S", help=text)
    add("--method", choices=METHODS, default=METHODS[0], help=f"explicit map; {DEFAULT}")
    text = f"Newton's start for --method classical; {DEFAULT}"
    add("--newton-start", choices=("previous", "tangent"), default="tangent", help=text)
    add("--stepper", choices=("rk4", *SCIPY_STEPPERS), default="rk4", help=DEFAULT)
    text = f"of the adaptive steppers; {DEFAULT}"
    add("--rtol", type=number, default=1e-8, help=text)
    add("--atol", type=number, default=1e-10, help=text)
    text = f"where y turns back: stop, or change coordinates; {DEFAULT}"
    add("--on-toggle", choices=("error", "repartition"), default="error", help=text)

    add = parser.add_argument_group("output").add_argument
    text = f"write also any of {','.join(RECORDS)}"
    add("--record", type=lambda items: items.split(","), default=[], metavar="LIST", help=text)
    add("--out", type=Path, metavar="PATH", help="write CSV: a file.csv, or a folder")
    add("--plot", type=Path, metavar="FILE", help="draw q and v over time: a .png or .pdf file")
    add("--replay", type=Path, metavar="FILE", help="write the motion as a web page: a .html file")
    text = "frames whose paths the replay draws; default: the first closure's"
    add("--trails", type=lambda names: names.split(","), metavar="LIST", help=text)
    parser.set_defaults(run=commands.simulate)


def _add_analyse(subparsers: Any) -> None:
    text = "rank, kernel and operation modes at a configuration"
    parser = subparsers.add_parser("analyse", help=text, description=text)
    parser.add_argument("model", metavar="MODEL", help=MODEL)
    text = f"{NUMBERS}; default: the model's home"
    parser.add_argument("--q", nargs="+", type=number, metavar="Q", help=text)
    parser.add_argument("--json", action="store_true", help="print JSON, all digits")
    parser.set_defaults(run=commands.analyse)


if __name__ == "__main__":
    sys.exit(main())
