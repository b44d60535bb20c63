"""The file of a sweep: JSON lines, one header and one line a run, appended as the runs end.

A process may be killed while it writes: a last line that is torn is cut off, and its run is done
again. Nothing else is ever rewritten.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

from ..errors import OptionError
from .lock import lock
from .record import Failure, RunRecord, key, plain

FORMAT = "robust_gcp sweep 1"


class SweepFile:
    """An open sweep file, held by this process alone.

    Parameters
    ----------
    path : Path
        Made where it does not exist.
    sweep : mapping
        What makes all runs of the sweep comparable: the same in every file of this sweep.

    Attributes
    ----------
    done : dict
        The last line of each run, by `key` of its parameters and its repetition.

    Raises
    ------
    OptionError
        For the file of another sweep, another kind of file, or one that another process writes to.
    """

    def __init__(self, path: Path, sweep: Mapping[str, Any]) -> None:
        self.path, self.done = path, dict[tuple[str, int], dict[str, Any]]()
        header = {"format": FORMAT, **{k: plain(v, k) for k, v in sweep.items()}}
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a+b")
        try:
            if not lock(self._file):
                raise OptionError(f"{path}: another sweep is writing to this file; give another")
            self._read(header)
        except BaseException:
            self._file.close()
            raise

    def append(self, record: RunRecord, repetition: int) -> RunRecord:
        """Write a run; returns it as it will be read back."""
        line = {
            "parameters": plain(record.parameters, f"runs[{record.index}]"),
            "repetition": repetition,
            "summary": plain(record.summary, "summary"),
            "kept": plain(record.kept, "what keep returned"),
            "failure": None if record.failure is None else asdict(record.failure),
        }
        self._write(line)
        return self.record(line, record.index, record.parameters, resumed=False)

    def record(
        self, line: dict[str, Any], index: int, parameters: Mapping[str, Any], resumed: bool = True
    ) -> RunRecord:
        """The run that a line holds."""
        failure = None if line["failure"] is None else Failure(**line["failure"])
        return RunRecord(index, parameters, line["summary"], line["kept"], failure, resumed)

    def __enter__(self) -> SweepFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _read(self, header: dict[str, Any]) -> None:
        self._file.seek(0)
        first, *lines = self._file.read().split(b"\n")
        wanted = json.dumps(header, ensure_ascii=False).encode()
        if not lines and wanted.startswith(first):  # new, or torn within its first line
            self._file.truncate(0)
            self._write(header)
            return
        self._require(first, header)
        whole = len(first) + 1
        for number, text in enumerate(lines[:-1], start=2):
            whole += len(text) + 1
            try:
                line = json.loads(text)
                self.done[key(line["parameters"], ""), line["repetition"]] = line
            except (ValueError, KeyError, TypeError) as error:
                raise OptionError(
                    f"{self.path}, line {number}: not a run of a sweep; mend or remove that line"
                ) from error
        self._file.truncate(whole)

    def _require(self, first: bytes, header: dict[str, Any]) -> None:
        try:
            found = json.loads(first)
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get("format") != FORMAT:
            raise OptionError(f"{self.path} is not the file of a sweep; give another name")
        wrong = [name for name in header if found.get(name) != header[name]]
        if wrong:
            name = wrong[0]
            raise OptionError(
                f"{self.path} belongs to another sweep: its {name} is {found.get(name)!r}, not "
                f"{header[name]!r}; give another file, or the same {name}"
            )

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
        self._file.flush()
