"""Checks of what a caller hands over: each error names the argument, its value and the remedy."""

from __future__ import annotations

import difflib
import math
import os
import reprlib
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from .errors import ModelError, OptionError, RobustGcpError, StateError

Array = NDArray[np.floating[Any]]

LARGEST = 10**300
"""Integers beyond it do not fit a float."""

CONTROLS = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Categories of characters that steer a terminal, a line or the direction of writing."""

_BRIEF = reprlib.Repr()
_BRIEF.maxstring = _BRIEF.maxother = 200
_BRIEF.maxlist = _BRIEF.maxtuple = _BRIEF.maxdict = _BRIEF.maxset = 12
_BRIEF.maxlevel = 4


def shown(value: Any) -> str:
    """`repr`, cut where it is long: input in a message may be of any size."""
    try:
        return _BRIEF.repr(value)
    except Exception:  # integers of thousands of digits, classes that are called like Python's own
        return f"<{type(value).__name__}>"


def plain(text: str) -> str:
    """Text for a terminal or a figure: control characters, but for line ends, are escaped."""
    return text if text.isprintable() else "".join(map(_shown_character, text))


def _shown_character(c: str) -> str:
    if c == "\n" or unicodedata.category(c) not in CONTROLS:
        return c
    return f"\\u{ord(c):04x}" if ord(c) < 0x10000 else f"\\U{ord(c):08x}"


def hint(name: Any, known: Iterable[str]) -> str:
    """`; did you mean …?` where known names are near, else nothing."""
    near = difflib.get_close_matches(str(name), list(known), n=3) if isinstance(name, str | Path) else []
    return f"; did you mean {' or '.join(map(repr, near))}?" if near else ""


def check_text(what: str, value: Any) -> None:
    """Refuse what is no text where a name is needed, by a ModelError."""
    if not isinstance(value, str):
        raise ModelError(f"{what} must be a name, not {shown(value)}")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise ModelError(f"{what}: {shown(value)} holds halves of characters, which no file has") from None


def names_given(what: str, value: Any) -> list[str]:
    """A list of names, or an OptionError."""
    names = listed(value, what, "names", OptionError)
    if not all(isinstance(name, str) for name in names):
        raise OptionError(f"{what} = {shown(value)} must be a list of names")
    return names


def path_given(name: str, value: Any) -> Path:
    """The path that an argument gives, or an OptionError."""
    try:
        sound = b"\0" not in os.fsencode(value) and isinstance(os.fspath(value), str)
    except (TypeError, ValueError):  # no path, or halves of characters that no system writes
        sound = False
    if not sound:
        raise OptionError(f"{name} = {shown(value)} is not a path; give a str or a pathlib.Path")
    return Path(value)


def check_number(name: str, value: Any) -> None:
    """Refuse what is not a real number; NaN and infinity pass."""
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not real or (isinstance(value, int) and abs(value) > LARGEST):
        raise OptionError(f"{name} = {shown(value)} must be a number" + " below 1e300" * real)


def check_finite(name: str, value: Any) -> None:
    """Refuse what is not a finite number."""
    check_number(name, value)
    if not math.isfinite(value):
        raise OptionError(f"{name} = {value} must be finite")


def check_positive(name: str, value: Any) -> None:
    """Refuse what is not a positive, finite number."""
    check_number(name, value)
    if not math.isfinite(value) or value <= 0.0:
        raise OptionError(f"{name} = {value} must be positive and finite")


def check_between(name: str, value: Any, low: float, high: float) -> None:
    """Refuse what is not a number in the open interval (low, high)."""
    check_number(name, value)
    if not low < value < high:
        raise OptionError(f"{name} = {value} must lie between {low:g} and {high:g}")


def check_whole(name: str, value: Any, low: int, high: int | None = None) -> None:
    """Refuse what is not a whole number within these bounds."""
    whole = type(value) is int or isinstance(value, np.integer)
    if not whole or value < low or (high is not None and value > high):
        bounds = f"{low} or more" if high is None else f"from {low} to {high}"
        raise OptionError(f"{name} = {shown(value)} must be a whole number, {bounds}")


def check_choice(name: str, value: Any, allowed: Sequence[str]) -> None:
    """Refuse what is not one of the words allowed."""
    if not isinstance(value, str) or value not in allowed:
        raise OptionError(f"{name} = {shown(value)} is unknown; use one of {', '.join(allowed)}")


def check_callable(name: str, value: Any, arguments: str) -> None:
    """Refuse what is neither None nor a function."""
    if value is not None and not callable(value):
        raise OptionError(f"{name} = {shown(value)} must be a function {arguments}")


WITH_PARTS = (
    "simulate", "simulate_many", "Simulation", "Batch", "MechanismVectorEnv", "impact", "analyse", "draw",
    "trace_modes",
)  # fmt: skip
"""Functions that take a mechanism with stops and dry friction of its file."""


WITH_MOVED = ("simulate", "simulate_many", "Simulation", "analyse", "draw", "trace_modes")
"""Functions that hold still what moves the ground, or only look at places."""


def check_mechanism(value: Any, kind: type[Any], function: str) -> None:
    """Refuse a model's name or a `pin.Model` where a mechanism (of type `kind`) is needed."""
    if isinstance(value, kind):
        value.require_unchanged()
        if getattr(value, "parts", ()) and function not in WITH_PARTS:
            raise OptionError(
                f"{function} does not know stops and dry friction, which this mechanism has of its file; "
                "load it without limits=True and friction=True"
            )
        if getattr(value, "moved", ()) and function not in WITH_MOVED:
            raise OptionError(
                f"{function} does not know that {', '.join(value.moved)} move the ground as prescribed; load "
                "the mechanism without moving="
            )
        return
    if isinstance(value, str):
        remedy = f"{shown(value)} is a name: give robust_gcp.load({shown(value)})"
    elif isinstance(value, pin.Model):
        remedy = "a pinocchio Model has no closures yet: give Mechanism.from_pinocchio(model, ...)"
    else:
        remedy = f"not {type(value).__name__}: give what robust_gcp.load(...) returns"
    raise OptionError(f"{function} needs a Mechanism; {remedy}")


def listed(
    value: Any,
    what: str,
    items: str,
    error_type: type[RobustGcpError] = ModelError,
    kind: Any = str,
) -> list[Any]:
    """The items of a list, or an error that tells how to write the list of one item of this kind."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        hint = f"; write [{shown(value)}]" if isinstance(value, kind) else ""
        raise error_type(f"{what} must be a list of {items}, not {shown(value)}{hint}")
    try:
        return list(value)
    except Exception as error:  # an array without dimensions, an iterator that fails
        raise error_type(f"{what} must be a list of {items}, not {shown(value)}") from error


_FLOAT = np.dtype(float)


def real_array(value: Any) -> Array:
    """A new float array of the real numbers given, row by row.

    NumPy would drop imaginary parts and masks, and read numbers out of text, times and truths.

    Raises
    ------
    TypeError
        For anything but integers and floats, and for what NumPy makes no array of.
    """
    if type(value) is np.ndarray and value.dtype == _FLOAT:
        return np.array(value, order="C")
    given = value
    if type(value) is not np.ndarray:  # an array needs no conversion
        raised = ValueError if _is_plain(value) else Exception  # conversions of others raise what they like
        try:
            given = np.asarray(value)
        except raised as error:
            raise TypeError(f"no array: {error}") from error
    if given.dtype.kind not in "iuf" or np.ma.isMaskedArray(value):
        raise TypeError(f"numbers of kind {given.dtype}")
    return given.astype(float, order="C")


def _is_plain(value: Any, depth: int = 3) -> bool:
    """Whether these are numbers, or lists of such: what else their conversion raises is a signal's own."""
    if type(value) in (list, tuple):
        return depth > 0 and all(_is_plain(one, depth - 1) for one in value)
    return type(value) in (float, int)


def checked_vector(value: ArrayLike, size: int, what: str, letter: str) -> Array:
    """A finite float array (size,), or a StateError that names `what` and its size's letter."""
    try:
        array = real_array(value)
    except TypeError as error:
        raise StateError(f"{what}: {shown(value)} is not a list of {size} numbers") from error
    if array.shape != (size,):
        raise StateError(f"{what} has shape {array.shape}, expected ({letter},) = ({size},)")
    if not np.all(np.isfinite(array)):
        bad = int(np.flatnonzero(~np.isfinite(array))[0])
        raise StateError(f"{what}[{bad}] is {array[bad]}: every entry must be finite")
    return array


def checked_rows(value: ArrayLike, count: int | None, size: int, what: str, letter: str) -> Array:
    """A finite float array (count, size), or a StateError; any number of rows where `count` is None."""
    try:
        array = real_array(value)
    except TypeError as error:
        raise StateError(f"{what}: {shown(value)} is no table with {size} numbers a row") from error
    wanted = len(array) if count is None and array.ndim == 2 else count
    if array.shape != (wanted, size):
        raise StateError(
            f"{what} has shape {array.shape}, expected (N, {letter}) = ({wanted or 'N'}, {size})"
        )
    if not np.all(np.isfinite(array)):
        raise StateError(f"{what} holds entries that are not finite")
    return array


def rows_like(*tables: tuple[ArrayLike, int, str, str]) -> list[tuple[Array, ...]]:
    """Rows of several tables of one length, each with its `checked_rows`; the first says how many."""
    count: int | None = None
    found: list[Array] = []
    for table, size, what, letter in tables:
        found.append(checked_rows(table, count, size, what, letter))
        count = len(found[0])
    return list(zip(*found, strict=True))


@contextmanager
def at_row(i: int) -> Iterator[None]:
    """Errors in this context say which row of many states they are about."""
    try:
        yield
    except RobustGcpError as error:
        error.args = (f"q[{i}]: {error.args[0]}", *error.args[1:])
        raise


def of_each(function: Callable[..., Any], rows: Iterable[Sequence[Any]], *shape: int) -> Array:
    """A function at each of many states, whose number comes first; errors say which row they are about.

    `shape` is that of what it gives, of no states too.
    """
    found = []
    for i, row in enumerate(rows):
        with at_row(i):
            found.append(np.array(function(*row)))
    return np.array(found).reshape(len(found), *shape)


def is_table(value: Any) -> bool:
    """Whether numbers are given in rows."""
    try:
        return np.ndim(value) > 1
    except ValueError:  # of lists of different lengths, which whoever checks them refuses
        return False


def require_finite(value: Array, what: str) -> Array:
    """The value, or a StateError: finite states can be so large that their products are not."""
    if np.isfinite(value).all():
        return value
    raise StateError(f"{what} is not a finite number: q or v is too large; give m, rad and seconds")
