"""What is kept of one run of a sweep, and how it is written as JSON."""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import shown
from ..dynamics.prescribed.motion import Motion
from ..errors import OptionError, RobustGcpError
from ..kernel.dynamics.measures import measured
from ..mechanism.tree.tree import Array
from ..simulation.trajectories.files import data_frame, write_csv
from ..simulation.trajectories.trajectory import Trajectory, energy_drift

if TYPE_CHECKING:
    from pandas import DataFrame

OWN = {"index", "ok", "rows", "t", "max_closure_error", "max_energy_error", "crossings", "failure"}
"""Columns that are no parameters."""

LONGEST = 20_000
"""Characters kept of a message (its beginning) and of a traceback (its end)."""


@dataclass(frozen=True)
class Failure:
    """Why a run has no result.

    Attributes
    ----------
    kind : str
        The error's type, such as "ToggleError".
    message : str
    ours : bool
        True for a `RobustGcpError`: the mechanism or the numbers refuse, and would again. False for
        any other error: a mistake in the code that was called, or a worker that died.
    trace : str
        The traceback of an error that is not ours.
    """

    kind: str
    message: str
    ours: bool
    trace: str = ""


def failure_of(error: BaseException) -> Failure:
    """An error in words, however it was made."""
    ours = isinstance(error, RobustGcpError)
    try:
        trace = "" if ours else "".join(traceback.format_exception(error))
    except Exception as second:
        trace = f"no traceback: {type(second).__name__} while it was written"
    return Failure(type(error).__name__, words_of(error), ours, trace[-LONGEST:])


def words_of(error: BaseException) -> str:
    """`str(error)`, cut; or what went wrong in it."""
    try:
        return str(error)[:LONGEST]
    except BaseException as second:
        return f"no message: its __str__ raised {type(second).__name__}"


@dataclass(frozen=True)
class RunRecord:
    """One run of a sweep.

    Attributes
    ----------
    index : int
        Its place in `runs`.
    parameters : dict
        What was given for it, with what all runs share.
    summary : dict or None
        See `summary`; of the partial trajectory where the run had to stop, None where it never began.
    kept : object
        What `keep` made of the trajectory.
    failure : Failure or None
    resumed : bool
        Whether it was read from the sweep's file instead of computed.
    """

    index: int
    parameters: Mapping[str, Any]
    summary: dict[str, Any] | None = None
    kept: Any = None
    failure: Failure | None = None
    resumed: bool = field(default=False, compare=False)

    @property
    def ok(self) -> bool:
        """Whether the run reached its end."""
        return self.failure is None


class Records(list[RunRecord]):
    """The records of a sweep, a list, and as a table."""

    def columns(self) -> dict[str, list[Any]]:
        """One value a run and name: "index", "ok", the parameters, the numbers of `summary`, "failure".

        q and v at the end are "q.0", "q.1", … and "v.0", …; counts of `Stats` "stats.rhs" and so on; a
        parameter of a function that has one of the other names, such as t, "build.t". None where a run has
        none.
        """
        rows = [_row(record) for record in self]
        names = list(dict.fromkeys(name for row in rows for name in row))
        return {name: [row.get(name) for row in rows] for name in names}

    def to_dataframe(self) -> DataFrame:
        """`columns` as a pandas.DataFrame with the index of the runs; needs pandas."""
        return data_frame(self.columns(), "index")

    def to_csv(self, path: str | Path) -> Path:
        """Write `columns`, one row a run, every digit kept; returns the path."""
        return write_csv(self.columns(), path)


def _row(record: RunRecord) -> dict[str, Any]:
    row: dict[str, Any] = {"index": record.index, "ok": record.ok}
    row |= {f"build.{name}" if name in OWN else name: value for name, value in record.parameters.items()}
    for name, value in (record.summary or {}).items():
        if isinstance(value, list):
            row |= {f"{name}.{i}": number for i, number in enumerate(value)}
        elif isinstance(value, dict):
            counts = {f"{name}.{key}": number for key, number in value.items()}
            row |= {key: number for key, number in counts.items() if isinstance(number, int | float | str)}
        else:
            row[name] = value
    return row | (
        {} if record.failure is None else {"failure": f"{record.failure.kind}: {record.failure.message}"}
    )


def summary(trajectory: Trajectory) -> dict[str, Any]:
    """The figures of a run that fit on a line.

    Returns
    -------
    dict
        "rows", "t" (s), "q", "v" (at the end), "max_closure_error" (m or rad), "max_energy_error" (J),
        "crossings" (how many), "stats" (as `Stats`). The two errors of a run in the compiled kernel are
        measured there.
    """
    rows = len(trajectory.t)
    left_open, drift = _errors(trajectory) if rows else (np.zeros(0), np.zeros(0))
    return {
        "rows": rows,
        "t": float(trajectory.t[-1]) if rows else None,
        "q": trajectory.q[-1].tolist() if rows else None,
        "v": trajectory.v[-1].tolist() if rows else None,
        "max_closure_error": float(left_open.max(initial=0.0)),
        "max_energy_error": float(np.abs(drift).max(initial=0.0)),
        "crossings": len(trajectory.crossings),
        "stats": asdict(trajectory.stats),
    }


def _errors(trajectory: Trajectory) -> tuple[Array, Array]:
    """`closure_error` and `energy_error`."""
    found = None
    if trajectory.stats.native_steps:
        found = measured(trajectory.mechanism, trajectory.q, trajectory.v)
    if found is None:
        return trajectory.closure_error(), trajectory.energy_error()
    left_open, energy = found
    return left_open, energy_drift(energy, trajectory.work_left)


def plain(value: Any, what: str) -> Any:
    """The value as JSON holds it: arrays as lists, dataclasses and named functions by name.

    Raises
    ------
    OptionError
        For what has no such form, naming it as `what`.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist(), what)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(k): plain(v, f"{what}[{k!r}]") for k, v in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, bytes):
        return [plain(v, f"{what}[{i}]") for i, v in enumerate(value)]
    if isinstance(value, Motion):
        return {"Motion": plain(value.recipe(), what)}
    if is_dataclass(value) and not isinstance(value, type):
        parts = {f.name: plain(getattr(value, f.name), f"{what}.{f.name}") for f in fields(value)}
        return {type(value).__name__: parts}
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    if callable(value) and getattr(sys.modules.get(str(module)), name, None) is value:
        return f"{module}.{name}"
    raise OptionError(
        f"{what} = {shown(value)} cannot be written to the sweep's file; give numbers, lists, names, or a "
        "function defined at the top of a module; or leave file out"
    )


def key(parameters: Mapping[str, Any], what: str) -> str:
    """The same text for the same parameters."""
    return text_of(parameters, what, sort_keys=True)


def text_of(value: Any, what: str, sort_keys: bool = False) -> str:
    """The value as JSON on one line.

    Raises
    ------
    OptionError
        For what has no such form, naming it as `what`.
    """
    try:
        return json.dumps(plain(value, what), sort_keys=sort_keys, ensure_ascii=False)
    except (ValueError, RecursionError) as error:  # integers of thousands of digits; lists in themselves
        if isinstance(error, OptionError):
            raise
        raise OptionError(
            f"{what} cannot be written to the sweep's file ({error}); leave file out"
        ) from error
