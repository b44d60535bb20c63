"""Arguments of the commands: words to values, and values refused before any work begins."""

from __future__ import annotations

import argparse
import math
import re
import tempfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from .checks import check_number, check_positive
from .errors import OptionError

Check = Callable[[str, Any], None]
"""Refuses a value by an OptionError that begins with the argument's name."""

DEFAULT = "default: %(default)s"
MODEL = "a shipped model's name, a folder with robot.urdf and robot.yaml, a URDF or MJCF file"
NUMBERS = "numbers, or multiples of pi such as -pi or 2*pi/3"
PI = re.compile(r"(?P<sign>[+-]?)(?:(?P<times>\d+\.?\d*)\*?)?pi(?:/(?P<over>\d+\.?\d*))?")
FILE_SUFFIX = re.compile(r"\.[A-Za-z]\w*")
"""Ending that marks a name as a file's; that of `results.2` is none."""


class Arguments:
    """The arguments of one command, each with the check that its values must pass.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Filled by `add`.
    """

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._add: Callable[..., argparse.Action] = parser.add_argument
        self._parser = parser
        self._checks: list[tuple[str, str, Check]] = []

    def heading(self, title: str) -> None:
        """Those added from here on stand below this title in the help."""
        self._add = self._parser.add_argument_group(title).add_argument

    def add(self, name: str, check: Check | None = None, **settings: Any) -> None:
        """As `ArgumentParser.add_argument`; the check sees each value that is not None."""
        action = self._add(name, **settings)
        if check is not None:
            self._checks.append((name, action.dest, check))

    def path(self, name: str, check: Check, metavar: str, text: str, **settings: Any) -> None:
        """As `add`, of a file or folder with this help."""
        self.add(name, check, type=pathname, metavar=metavar, help=text, **settings)

    def check(self, args: argparse.Namespace) -> None:
        """Refuse the first value that does not pass.

        Raises
        ------
        OptionError
            Naming the argument, the value and what is accepted.
        """
        for name, destination, check in self._checks:
            value = getattr(args, destination)
            for one in value if isinstance(value, list) else [] if value is None else [value]:
                check(name, one)


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


def pathname(text: str) -> Path:
    """A path; that of an empty word would be the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty word names no file or folder")
    return Path(text)


def names(text: str) -> list[str]:
    """Words between commas."""
    return text.split(",")


def positive(name: str, value: float) -> None:
    """A positive, finite number."""
    check_positive(name, value)


def finite(name: str, value: float) -> None:
    """A finite number."""
    check_number(name, value)
    if not math.isfinite(value):
        raise OptionError(f"{name} = {value} must be finite")


def not_negative(name: str, value: float) -> None:
    """A finite number from zero."""
    finite(name, value)
    if value < 0.0:
        raise OptionError(f"{name} = {value} must not be negative")


def whole(least: int, most: int = 10**9) -> Check:
    """A whole number from `least` to `most`."""

    def check(name: str, value: int) -> None:
        if not least <= value <= most:
            raise OptionError(f"{name} = {value} must be a whole number from {least} to {most:g}")

    return check


def word(allowed: Collection[str]) -> Check:
    """One of the words that are allowed."""

    def check(name: str, value: str) -> None:
        if value not in allowed:
            raise OptionError(f"{name} = {value!r} is unknown; use one of {', '.join(map(repr, allowed))}")

    return check


def part(name: str, value: str) -> None:
    """A word that is not empty."""
    if not value.strip():
        raise OptionError(f"{name} is empty; leave it out, or give a word")


def file(suffixes: Sequence[str] = (), what: str = "") -> Check:
    """A file that can be written; `what` with an article tells the kind that has these endings."""

    def check(name: str, given: Path) -> None:
        if _is(given, Path.is_dir, name) or not given.name:
            raise OptionError(f"{name} {given}: this is a folder; give the name of a file")
        if suffixes and given.suffix not in suffixes:
            raise OptionError(f"{name} {given}: {what} is a {' or a '.join(suffixes)} file")
        _require_writable(name, given)

    return check


def folder(name: str, given: Path) -> None:
    """A folder, there or to be made, that files can be written to."""
    if _is(given, Path.is_dir, name):
        return _require_writable(name, given)
    if given.exists():
        raise OptionError(f"{name} {given}: this is a file; give the name of a folder")
    if FILE_SUFFIX.fullmatch(given.suffix):
        raise OptionError(f"{name} {given}: {given.suffix} ends the name of a file; give that of a folder")
    return _require_writable(name, given)


def existing_file(name: str, given: Path) -> None:
    """A file that is there and can be written."""
    known_file(name, given)
    _require_writable(name, given)


def known_file(name: str, given: Path) -> None:
    """A file that is there."""
    if not _is(given, Path.is_file, name):
        raise OptionError(f"{name} {given}: there is no such file")


def known_folder(name: str, given: Path) -> None:
    """A folder that is there."""
    if not _is(given, Path.is_dir, name):
        raise OptionError(f"{name} {given}: there is no such folder")


def existing_folder(name: str, given: Path) -> None:
    """A folder that is there and can be written to."""
    known_folder(name, given)
    _require_writable(name, given)


def _is(given: Path, kind: Callable[[Path], bool], name: str) -> bool:
    """Ask the file system, which refuses some names by an error, such as those that are too long."""
    try:
        return kind(given)
    except OSError as error:
        raise OptionError(f"{name} {given}: {error.strerror}") from error


def _require_writable(name: str, given: Path) -> None:
    """What is there can be written to; of what is not, the nearest folder above."""
    there = given.absolute()
    while not _is(there, Path.exists, name):
        there = there.parent
    if there != given.absolute() and not there.is_dir():
        raise OptionError(f"{name} {given}: {there} is a file, not a folder")
    try:
        if there.is_dir():
            tempfile.TemporaryFile(dir=there).close()
        else:
            there.open("ab").close()
    except OSError as error:
        raise OptionError(f"{name} {given}: cannot write to {there}: {error.strerror}") from error
