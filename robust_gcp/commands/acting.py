"""What acts on a motion of the command line: torques and drives by joint, controls by actuator.

A joint is driven at constant speed, which needs no file and answers the commonest question, or as a table
says, which says everything else.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..arguments import NUMBERS, Arguments, finite, known_file, number, pathname
from ..dynamics.prescribed.motion import Motion
from ..errors import OptionError
from ..mechanism.mechanism import Mechanism

Value = TypeVar("Value")
Pairs = list[tuple[str, Value]]


def add_acting(add_to: Arguments) -> None:
    """Name the options."""
    add_to.heading("torques and drives")
    often: dict[str, Any] = {"nargs": "+", "action": "extend", "default": []}
    text = f"constant torque, N m, or force, N, on a joint ({NUMBERS})"
    add_to.add("--torque", _finite, type=named_number, metavar="JOINT=TAU", help=text, **often)
    text = "constant control of an actuator of the file"
    add_to.add("--ctrl", _finite, type=named_number, metavar="ACTUATOR=U", help=text, **often)
    text = "drive a joint at constant speed, rad/s or m/s, from where it starts"
    add_to.add("--drive-speed", _finite, type=named_number, metavar="JOINT=SPEED", help=text, **often)
    text = "drive a joint as a table says: a CSV file with two columns, time, s, and position, rad or m"
    add_to.add("--drive", _table, type=named_path, metavar="JOINT=FILE", help=text, **often)


def named_number(text: str) -> tuple[str, float]:
    """Read NAME=NUMBER."""
    name, value = _halves(text)
    try:
        return name, number(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{value!r} of {text!r} is no number") from error


def named_path(text: str) -> tuple[str, Path]:
    """Read NAME=FILE."""
    name, value = _halves(text)
    return name, pathname(value)


def _halves(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as q1=0.5")
    return name, value


def _finite(name: str, pair: tuple[str, float]) -> None:
    finite(f"{name} {pair[0]}", pair[1])


def _table(name: str, pair: tuple[str, Path]) -> None:
    known_file(f"{name} {pair[0]}", pair[1])


def torque_of(args: argparse.Namespace) -> dict[str, float] | None:
    """The torques by joint, or None."""
    return _once("--torque", args.torque) or None


def ctrl_of(args: argparse.Namespace) -> dict[str, float] | None:
    """The controls by actuator, or None."""
    return _once("--ctrl", args.ctrl) or None


def drive_of(mechanism: Mechanism, args: argparse.Namespace) -> dict[str, Motion] | None:
    """The prescribed motions by joint, or None."""
    speeds, tables = _once("--drive-speed", args.drive_speed), _once("--drive", args.drive)
    for name in speeds.keys() & tables.keys():
        raise OptionError(f"--drive and --drive-speed both drive {name!r}; leave one out")
    q = mechanism.home if args.q0 is None else mechanism.configuration(args.q0, "q0")
    drives = {name: Motion(_table_of(path)) for name, path in tables.items()}
    for name, speed in speeds.items():
        start = float(q[mechanism.joint(name).idx_q])
        drives[name] = _steady(start, speed)
    return drives or None


def _steady(start: float, speed: float) -> Motion:
    """start + speed · t, as a spline, which --save keeps where it would lose a function."""
    from scipy.interpolate import PPoly

    return Motion(PPoly([[speed], [start]], [0.0, 1.0]))


def _once(option: str, pairs: Iterable[tuple[str, Value]]) -> dict[str, Value]:
    found: dict[str, Value] = {}
    for name, value in pairs:
        if name in found:
            raise OptionError(f"{option} names {name!r} twice; leave one out")
        found[name] = value
    return found


def _table_of(path: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Times and positions of a CSV file; a first line without numbers is its header."""
    rows: list[list[float]] = []
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        for line, cells in enumerate(csv.reader(file), start=1):
            if not any(cell.strip() for cell in cells):
                continue
            try:
                time, position = (float(cell) for cell in cells)
            except ValueError as error:
                if line == 1:
                    continue
                raise OptionError(
                    f"--drive {path}, line {line}: {','.join(cells)} is not a time, s, and a position"
                ) from error
            rows.append([time, position])
    times, positions = np.array(rows).reshape(-1, 2).T
    try:
        Motion((times, positions))
    except OptionError as error:
        raise OptionError(f"--drive {path}: {error}") from error
    return times, positions
