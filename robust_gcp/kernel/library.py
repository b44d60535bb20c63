"""The compiled kernel: where it is, and why it is not there."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import os
import sys
from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import ModelError
from ..warning import warn
from .structures import (
    VERSION,
    Assembly,
    Bridging,
    Cluster,
    Description,
    Exported,
    ExportedChart,
    Guarded,
    ModeSeries,
    Request,
    Rows,
    States,
)

NAME = "kernel.dylib" if sys.platform == "darwin" else "kernel.so"

REPORT = "build_report.json"
"""What the build left behind: {"status": "built" | "failed" | "no compiler" | "skipped", "detail": ...}."""

SWITCH = "ROBUST_GCP_NATIVE"
"""Environment variable: 0 skips the build at installation and the kernel at run time; at run time it
may also name a library to use instead of the installed one."""


@dataclass(frozen=True)
class Backend:
    """Whether a backend of `simulate` can be used.

    Attributes
    ----------
    available : bool
    reason : str
        What it is, or why it is not there and what would help.
    """

    available: bool
    reason: str


class NativeBuildWarning(RuntimeWarning):
    """The compiled kernel should be there, but its build failed or it does not load."""


class Library:
    """The functions of the compiled kernel.

    Raises
    ------
    OSError
        When the file is not the one that was built, cannot be loaded, or speaks another version of the
        interface.
    """

    def __init__(self, path: Path) -> None:
        _require_as_built(path)
        library = ctypes.CDLL(str(path))
        if library.rg_version() != VERSION:
            raise OSError(f"{path} has interface {library.rg_version()}, this package needs {VERSION}")
        structures = Description, Cluster, Bridging, Request, States, ModeSeries, Assembly, Guarded, Rows
        # a field more or less here would shift all that follow, and be read without an error
        for i, structure in enumerate((*structures, ExportedChart, Exported)):
            theirs, ours = library.rg_size(i), ctypes.sizeof(structure)
            if theirs != ours:
                raise OSError(f"its {structure.__name__} has {theirs} bytes, this package's {ours}")
        self.create = library.rg_create
        self.create.argtypes, self.create.restype = [POINTER(Description), c_char_p, c_int32], c_void_p
        self.destroy = library.rg_destroy
        self.destroy.argtypes, self.destroy.restype = [c_void_p], None
        self.run = library.rg_run
        self.run.argtypes, self.run.restype = [c_void_p, POINTER(Request)], None
        self.rows = library.rg_rows
        self.rows.argtypes, self.rows.restype = [c_void_p, POINTER(Request), POINTER(Rows)], None
        self.look = library.rg_look
        self.look.argtypes, self.look.restype = [c_void_p, POINTER(Request)], None
        self.trackers = library.rg_trackers
        self.trackers.argtypes, self.trackers.restype = [c_void_p, POINTER(c_int64)], POINTER(c_double)
        self.begin = library.rg_begin
        self.begin.argtypes, self.begin.restype = [c_void_p, POINTER(Request)], None
        self.follow_from, self.follow, self.tell = library.rg_follow_from, library.rg_follow, library.rg_tell
        for function in (self.follow_from, self.follow, self.tell):
            function.argtypes, function.restype = [c_void_p, POINTER(Request)], None
        self.bend = library.rg_bend
        self.bend.argtypes, self.bend.restype = [c_void_p, POINTER(Request), c_void_p, c_void_p], None
        self.passed = library.rg_passed
        self.passed.argtypes = [c_void_p, POINTER(Request), *2 * [c_double], *2 * [c_void_p], c_int64]
        self.passed.restype = None
        self.keep, self.forget, self.renew = library.rg_keep, library.rg_forget, library.rg_renew
        for function in (self.keep, self.forget, self.renew):
            function.argtypes, function.restype = [c_void_p], None
        self.react = library.rg_react
        self.react.argtypes = [POINTER(Description), *2 * [c_void_p], c_int64, *5 * [c_void_p]]
        self.react.restype = None
        self.assemble, self.lift = library.rg_assemble, library.rg_lift
        self.assemble.argtypes = [POINTER(Description), POINTER(Assembly), c_int64, *3 * [c_void_p]]
        self.assemble.restype = None
        self.lift.argtypes = [POINTER(Description), POINTER(Assembly), c_int64, c_double, *3 * [c_void_p]]
        self.lift.restype = None
        self.weigh = library.rg_weigh
        self.weigh.argtypes, self.weigh.restype = [POINTER(Description), c_int64, *5 * [c_void_p]], None
        self.measure = library.rg_measure
        self.measure.argtypes = [POINTER(Description), c_int64, *4 * [c_void_p]]
        self.measure.restype = None
        self._know_derivatives(library)

    def _know_derivatives(self, library: Any) -> None:
        self.derive = library.rg_derive
        self.derive.argtypes, self.derive.restype = self.create.argtypes, c_void_p
        self.derived = library.rg_derived
        self.derived.argtypes, self.derived.restype = [c_void_p], None
        self.learn = library.rg_learn
        self.learn.argtypes, self.learn.restype = [c_void_p, POINTER(ModeSeries)], c_int32
        self.slopes = library.rg_slopes
        self.slopes.argtypes, self.slopes.restype = [c_void_p, POINTER(States)], None
        self.take = library.rg_take
        self.take.argtypes, self.take.restype = [c_void_p, POINTER(States), c_void_p], None
        self.pull = library.rg_pull
        self.pull.argtypes = [c_void_p, c_int64, c_int64, c_int32, *7 * [c_void_p]]
        self.pull.restype = None
        self.step_each = library.rg_step_each
        self.step_each.argtypes = [c_void_p, POINTER(States), c_double, c_double]
        self.step_each.restype = None
        self.feed = library.rg_feed
        self.feed.argtypes, self.feed.restype = [c_void_p, c_int64, c_int64, *2 * [c_void_p]], None


def _require_as_built(path: Path) -> None:
    """Compare with the checksum in the report beside the library, where there is one.

    A library that lost its end loads, and kills the process at the first call into the missing part.
    """
    wanted = _report(path.with_name(REPORT)).get("sha256")
    if wanted is not None and hashlib.sha256(path.read_bytes()).hexdigest() != wanted:
        raise OSError(f"its {path.stat().st_size} bytes are not what was built: truncated or changed")


def backends() -> dict[str, Backend]:
    """The backends of `simulate`: what is there, and why not."""
    library, reason = kernel_or_reason()
    return {
        "python": Backend(True, "the reference, always there"),
        "native": Backend(library is not None, reason),
    }


def library() -> Library | None:
    """The compiled kernel, or None; warns once where it should be there and is not."""
    found, reason = kernel_or_reason()
    if found is None and _broken():
        _warn(reason)
    return found


def kernel_file() -> Path:
    """The file of the compiled kernel, which is the C library too.

    Raises
    ------
    ModelError
        Where there is none.
    """
    wanted = os.environ.get(SWITCH, "")
    path = _installed(NAME) if wanted in ("", "1") else Path(wanted)
    if library() is None:
        raise ModelError(f"there is no compiled kernel, which is the C library: {kernel_or_reason()[1]}")
    return path


def kernel_or_reason() -> tuple[Library | None, str]:
    """The compiled kernel, and where it is or why there is none."""
    wanted = os.environ.get(SWITCH, "")
    if wanted == "0":
        return None, f"switched off by {SWITCH}=0"
    return _load(_installed(NAME) if wanted in ("", "1") else Path(wanted))


def _installed(name: str) -> Path:
    """A file beside this one; an editable installation keeps built files in another folder.

    A checkout without a build of its own takes the kernel that was installed from it. What is there once is
    not looked for again.
    """
    import robust_gcp.kernel as package

    folders = tuple(package.__path__)
    if (name, folders) in _FOUND:
        return _FOUND[name, folders]
    found = _first(name, folders)
    if found is not None:
        _FOUND[name, folders] = found
    elif name == NAME and _first(REPORT, folders) is None:
        found = _of_another(tuple(sys.path))
    return found or Path(__file__).parent / name


def _first(name: str, folders: tuple[str, ...]) -> Path | None:
    """The first such file in these folders."""
    return next((path for folder in folders if (path := Path(folder) / name).exists()), None)


_FOUND: dict[tuple[str, tuple[str, ...]], Path] = {}


@functools.cache
def _of_another(entries: tuple[str, ...]) -> Path | None:
    """The kernel of another installation, for a checkout that was not built: of the same sources or none."""
    from .build import fingerprint  # a script of its own, which must not be imported before it is run

    own = fingerprint(Path(__file__).parent)
    for entry in entries:
        folder = Path(entry or ".") / "robust_gcp" / "kernel"
        if own is not None and _report(folder / REPORT).get("sources") == own and (folder / NAME).exists():
            return folder / NAME
    return None


@functools.cache
def _load(path: Path) -> tuple[Library | None, str]:
    if not path.exists():
        return None, _why_not_built() if path.name == NAME else f"there is no {path}"
    try:
        return Library(path), f"compiled kernel {path}"
    except (OSError, AttributeError) as error:  # an older library lacks a function
        return None, f"{path} does not load ({error}); build it again"


def _report(path: Path) -> dict[str, Any]:
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return report if isinstance(report, dict) else {}


def _broken() -> bool:
    wanted = os.environ.get(SWITCH, "")
    if wanted not in ("", "1"):
        return wanted != "0"
    return _installed(NAME).exists() or _report(_installed(REPORT)).get("status") == "failed"


def _why_not_built() -> str:
    report = _report(_installed(REPORT))
    status, detail = report.get("status"), report.get("detail", "")
    if status == "failed":
        return f"its build failed at installation ({detail}); the log is {_installed('build.log')}"
    if status == "no compiler":
        return f"no C++ compiler was found at installation ({detail}); install one, then this package again"
    if status == "skipped":
        return f"its build was skipped at installation ({detail})"
    return "not built in this checkout; build it with: python -m robust_gcp.kernel.build"


@functools.cache
def _warn(reason: str) -> None:
    warn(
        f"the compiled kernel is not available: {reason}. Simulations run on the slower Python backend; "
        'robust_gcp.backends() tells more, simulate(backend="python") asks for it without this warning',
        NativeBuildWarning,
    )
