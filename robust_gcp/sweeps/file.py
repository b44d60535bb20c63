"""The file of a sweep: JSON lines, one header and one line a run, appended as the runs end.

A process may be killed while it writes: a last line that is torn is cut off, and its run is done
again. Nothing else is ever rewritten. Each line holds a checksum of the rest of it.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import pickle
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from ..checks import path_given, shown
from ..errors import OptionError, RobustGcpError, SweepError
from ..io.loader import load
from ..mechanism.mechanism import Mechanism
from .record import Failure, RunRecord, key, plain, text_of
from .worker import Build

FAR = 2**30
"""Byte that is locked on Windows: others may go on reading what lies before it."""


def lock(file: IO[bytes]) -> bool:
    """Hold an open file until it is closed or this process ends; False when another one holds it."""
    try:
        fcntl = importlib.import_module("fcntl")
    except ImportError:  # Windows
        msvcrt = importlib.import_module("msvcrt")
        os.lseek(file.fileno(), FAR, os.SEEK_SET)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


FORMAT = "robust_gcp sweep 2"

UNCHECKED = "robust_gcp sweep 1"
"""Files of version 0.1.0, whose lines have no checksums; they may be gone on with."""

LONGEST_HEADER = 1_000_000
"""Bytes within which the first line ends; more of a file that is none of a sweep is not read."""


def identity_of(build: Build) -> Any:
    """What is written to the file for `build`: a mechanism by its name and a digest of all it is made of.

    So is a model on this disk, which may be edited before the sweep goes on; where it does not load, the runs
    say why.
    """
    name, made = str(build), build
    if isinstance(build, Mechanism):
        name = build.name
    elif isinstance(build, str | Path):
        # a name, or what no file can be called; what is left out of a file the runs tell
        with suppress(RobustGcpError, OSError, ValueError), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = load(build) if Path(build).exists() else build
    if not isinstance(made, Mechanism):
        return build
    # which words are one object in memory, a first pickle tells too
    own = pickle.dumps(pickle.loads(pickle.dumps(made)))
    return f"{name} {hashlib.sha256(own).hexdigest()[:16]}"


class SweepFile:
    """An open sweep file, held by this process alone.

    Parameters
    ----------
    path : str or Path
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
        For the file of another sweep, another kind of file, one that another process writes to, or one
        that cannot be opened; nothing is written to it then.
    """

    def __init__(self, path: str | Path, sweep: Mapping[str, Any]) -> None:
        self.path, self.done = path_given("file", path), dict[tuple[str, int], dict[str, Any]]()
        self._checked = True
        header = {"format": FORMAT, **{k: plain(v, k) for k, v in sweep.items()}}
        self._file = self._opened()
        try:
            self._lock()
            self._read(header)
        except BaseException:
            self._file.close()
            raise

    def append(self, record: RunRecord, repetition: int) -> RunRecord:
        """Write a run; returns it as it will be read back.

        Raises
        ------
        SweepError
            Where the disk does not take it.
        """
        line = {
            "parameters": plain(record.parameters, f"runs[{record.index}]"),
            "repetition": repetition,
            "summary": plain(record.summary, "summary"),
            "kept": plain(record.kept, "what keep returned"),
            "failure": None if record.failure is None else asdict(record.failure),
        }
        self._write({**line, "sha256": _sum(line)})
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

    def _opened(self) -> FileIO:
        """The file, for reading and appending without a buffer, whose rest could fail when it is closed."""
        path = self.path
        try:
            if path.exists() and not path.is_file():
                raise OptionError(f"{path} is a folder or a device, and cannot keep a sweep; give a file")
            path.parent.mkdir(parents=True, exist_ok=True)
            return FileIO(path, "a+")
        except OSError as error:
            raise OptionError(f"{path} cannot be the file of a sweep ({error}); give another") from error

    def _lock(self) -> None:
        try:
            held = lock(self._file)
        except OSError as error:
            raise OptionError(f"{self.path} cannot be locked ({error}); give one on a local disk") from error
        if not held:
            raise OptionError(f"{self.path}: another sweep is writing to this file; give another")

    def _read(self, header: dict[str, Any]) -> None:
        self._file.seek(0)
        first, *more = self._file.read(LONGEST_HEADER).split(b"\n", 1)
        wanted = _encoded(header, "the sweep")
        lines = b"".join([*more, self._file.readall()]).split(b"\n") if more else []
        if not lines and wanted.startswith(first):  # new, or torn within its first line
            self._file.truncate(0)
            self._write(header)
            return
        self._require(first, header)
        whole = len(first) + 1
        for number, text in enumerate(lines[:-1], start=2):  # what has no end of line is torn: it goes
            whole += len(text) + 1
            try:
                line = json.loads(text)
                self._require_sum(line)
                _require_run(line)
                self.done[key(line["parameters"], ""), line["repetition"]] = line
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
                raise OptionError(
                    f"{self.path}, line {number}: not a run of a sweep, or changed since it was written; "
                    "remove that line, and its run is done again"
                ) from error
        self._file.truncate(whole)

    def _require(self, first: bytes, header: dict[str, Any]) -> None:
        try:
            found = json.loads(first)
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict) or found.get("format") not in (FORMAT, UNCHECKED):
            raise OptionError(f"{self.path} is not the file of a sweep; give another name")
        self._checked = found["format"] == FORMAT
        wrong = [name for name in header if name != "format" and found.get(name) != header[name]]
        if wrong:
            name = wrong[0]
            raise OptionError(
                f"{self.path} belongs to another sweep: its {name} is {shown(found.get(name))}, not "
                f"{shown(header[name])}; give another file, or the same {name}"
            )

    def _require_sum(self, line: Any) -> None:
        """A ValueError for a line that does not add up to the checksum that it holds."""
        found = line.pop("sha256", None)
        if found != _sum(line) and (self._checked or found is not None):
            raise ValueError("its checksum is another")

    def _write(self, line: dict[str, Any]) -> None:
        left = memoryview(_encoded(line, "a run") + b"\n")
        end = self._file.seek(0, os.SEEK_END)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(end)  # else the next line would go on from half of this one
            raise SweepError(
                f"{self.path} cannot be written ({error}); all runs before this one are in it: make room and "
                "call sweep again, which goes on from there"
            ) from error


def _encoded(value: Any, what: str) -> bytes:
    """A line; halves of characters, such as in names of files, as they are."""
    return text_of(value, what).encode("utf-8", "surrogatepass")


def _sum(line: dict[str, Any]) -> str:
    """Of a line as it is written, and as it is written again once it was read."""
    return hashlib.sha256(_encoded(line, "a run")).hexdigest()[:16]


def _require_run(line: Any) -> None:
    """A TypeError for a line that does not hold what `append` writes."""
    failure = line["failure"]
    plain_failure = failure is None or (
        isinstance(failure["kind"], str) and isinstance(failure["ours"], bool)
    )
    plain_summary = line["summary"] is None or isinstance(line["summary"], dict)
    if not (isinstance(line["parameters"], dict) and plain_summary and plain_failure and "kept" in line):
        raise TypeError("values of other kinds")
    if failure is not None:
        Failure(**failure)
