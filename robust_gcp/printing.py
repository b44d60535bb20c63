"""How the commands print: tables, numbers, warnings as lines, and signs of life while work takes long."""

from __future__ import annotations

import json
import math
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .checks import plain

Item = TypeVar("Item")

LONGEST_TABLE = 12
"""Rows of a printed table; the rest is counted, and is in the CSV."""

PATIENCE = 2.0
"""s of silence before a line tells what is being done."""


OPTIONS = (
    (r"\Awhat = ", "--columns "),
    (r"\Ax = ", "--over "),
    (r"\brecord=\(\"(\w+)\",\)", r"--record \1"),
    (r"\b(?:simulate\()?(method|stepper|backend|base)=[\"'](\w+)[\"']\)?", r"--\1 \2"),
    (r"\b(on|newton)_(toggle|start)=\"(\w+)\"", r"--\1-\2 \3"),
    (r"\bstrict=True", "--strict"),
    (r"\bmode=\.\.\.", "--mode INDEX"),
    (r"\bspeed=(?=\S)", "--speed "),
    (r"\bdrive=\{joint: Motion\}", "--drive JOINT=TABLE.csv"),
    (r"\Actrl: ", "--ctrl: "),
    (r"\bctrl=\{actuator: control\}", "--ctrl ACTUATOR=U"),
    (r"\btorque=\{joint: value\}, or a mechanism with actuators=\[\.\.\.\]", "--torque JOINT=TAU"),
    (r"\bmech\.assemble\(q\)", "robust-gcp assemble"),
    (r"give v = G ẏ, for instance from mech\.lift\(q, ydot\)", "give --v0 = G ẏ, or leave --v0 out"),
    (r"\bgive (q0|v0)\b", r"give --\1"),
    (r"\(q0\)", "(--q0)"),
)
"""What messages for Python advise, and how the command line spells it."""


def complain(message: str) -> None:
    """Print one line on stderr, with what it advises as options of the command line."""
    for python, option in OPTIONS:
        message = re.sub(python, option, message)
    print(plain(f"robust_gcp: {message}"), file=sys.stderr)


def say(text: str) -> None:
    """Print on stdout; names from files may hold anything."""
    print(plain(text))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], longest: int | None = LONGEST_TABLE) -> str:
    """Set rows in indented columns; a long table ends with a count of the rest, None sets all.

    A column whose header begins with a space is aligned to the right, others to the left.
    """
    header = [_cell(text) for text in header]
    shown = [[_cell(text) for text in row] for row in rows[:longest]]
    set_columns = []
    for column in zip(header, *shown, strict=True):
        width = max(map(len, column))
        right = column[0].startswith(" ")
        set_columns.append([c.rjust(width) if right else c.ljust(width) for c in column])
    lines = ["  " + "  ".join(line).rstrip() for line in zip(*set_columns, strict=True)]
    if len(rows) > len(shown):
        lines.append(f"  … and {len(rows) - len(shown)} more")
    return "\n".join(lines)


def _cell(text: str) -> str:
    """In one line."""
    return plain(text).replace("\n", "\\n")


def fixed(value: float, digits: int = 8) -> str:
    """Write fixed digits; what rounds to zero has no sign."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def listed(values: Iterable[float], digits: int = 8) -> str:
    """Write (a, b, …), as short as the digits allow."""
    return "(" + ", ".join(f"{round(float(x), digits) + 0.0:.{digits}g}" for x in values) + ")"


@contextmanager
def clean_warnings(kinds: Sequence[type[Warning]]) -> Iterator[None]:
    """Show warnings of these kinds as one line each on stderr, others as Python does."""
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            for kind in kinds:
                warnings.simplefilter("always", kind)
            yield
    finally:
        for w in caught:
            if issubclass(w.category, tuple(kinds)):
                complain(f"warning: {w.message}")
            else:
                warnings.showwarning(w.message, w.category, w.filename, w.lineno)


@contextmanager
def telling(what: str) -> Iterator[None]:
    """Say on stderr what is being done, once, when it takes longer than `PATIENCE`."""
    timer = threading.Timer(PATIENCE, complain, [f"{what} …"])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def progress_bar(total: float, what: str) -> Iterator[Callable[[float], None] | None]:
    """A bar over `total` seconds or things on stderr, moved by the fraction that is done.

    Where that is no terminal there is None to move, and one line when the work takes long.
    """
    if not sys.stderr.isatty():
        with telling(what):
            yield None
        return
    from tqdm import tqdm

    shape = "{desc} {percentage:3.0f}% |{bar}| {n:.3g}/{total:.3g} [{elapsed}<{remaining}]"
    with tqdm(total=total, desc=what, bar_format=shape, leave=False, delay=0.5) as bar:
        yield lambda fraction: bar.update(fraction * total - bar.n)


def along(items: Sequence[Item], what: str) -> Iterator[Item]:
    """The items one after the other, with a bar that counts those that are done."""
    with progress_bar(float(len(items)), what) as progress:
        for i, item in enumerate(items, start=1):
            yield item
            if progress is not None:
                progress(i / len(items))


def write(path: Path, text: str) -> None:
    """Write a text file, its folder made where it is missing, and tell."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    print(f"wrote {path}")


def finite(value: Any) -> Any:
    """What JSON has: Python's own lists and numbers, null for those that are not finite."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        return finite(value.tolist())
    return value if not isinstance(value, float) or math.isfinite(value) else None


def write_json(path: Path, value: Any) -> None:
    """As `write`, for values that `finite` takes."""
    write(path, json.dumps(finite(value), indent=1, ensure_ascii=False) + "\n")
