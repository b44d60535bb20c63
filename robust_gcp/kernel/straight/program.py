"""The straight-line code of a mechanism: written, compiled with the compiler at hand, kept, called."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import subprocess
import tempfile
from collections.abc import Sequence
from ctypes import c_double, c_int64, c_void_p
from pathlib import Path
from typing import Any

from ...mechanism.mechanism import Mechanism
from ..loop_arrays import NotNativeError
from ..structures import Arrays
from .blocks import Numbers, described
from .stage import Stage

# for the vectors of this processor alone, which `_processor` tells: machines may share a folder
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fPIC", "-shared", "-w")

SWITCH = "ROBUST_GCP_COMPILE"
"""Environment variable: 0 leaves all steps to the kernel; a folder is where compiled code is kept."""

KEY = "straight-line code"
"""Under which a mechanism keeps it."""

LONGEST = 120.0
"""s that a compiler may take."""


class Motions(ctypes.Structure):
    """As in steps.cc."""

    _fields_ = [
        ("count", c_int64),
        ("which", c_void_p),
        *((name, c_double) for name in ("step", "zone")),
        *((name, c_void_p) for name in ["t0", "at", "left", "status", "limit", "uneven", "sizes"]),
        ("width", c_int64),
        *((name, c_void_p) for name in ["held", "x", "anchor", "ydd", "q", "v"]),
        ("room", c_int64),
        *((name, c_void_p) for name in ["all_q", "all_v"]),
    ]


def straight_steps(mechanism: Mechanism, arrays: Arrays) -> Any:
    """The compiled function, which takes a pointer to `Motions`; or the reason, as text, why there is none.

    Made once for a mechanism and choice of coordinates, and kept in a folder of the user's for others.
    """
    from ..build import BuildError  # a script of its own, which must not be imported before it is run

    def made() -> Any:
        if os.environ.get(SWITCH) == "0":
            return f"switched off by {SWITCH}=0"
        try:
            text = header(described(arrays))
        except NotNativeError as error:
            return f"it does not know {error}"
        try:
            library = ctypes.CDLL(str(compiled(text)))
        except (BuildError, OSError, subprocess.SubprocessError) as error:
            return f"it cannot be compiled here: {error}"
        function = library.straight_steps
        function.argtypes, function.restype = [c_void_p], None
        return function

    return mechanism.memo.once(KEY, made)


def known_steps(mechanism: Mechanism) -> bool:
    """Whether that was made, or found not to be possible, before."""
    return KEY in mechanism.memo


def header(numbers: Numbers) -> str:
    """What steps.cc includes of a mechanism."""
    d, blocks = numbers.structure, max(1, numbers.structure.blocks)  # C++ has no arrays of none
    part, inputs = _parts(numbers)
    stage = Stage(numbers)
    lines = [
        f"constexpr int NV = {d.nv}, M = {d.m}, BLOCKS = {blocks}, BLOCKS_OF_KERNEL = {d.blocks};",
        f"constexpr int PARTS = {max(part) + 1}, CONTROLS = {len(stage.ctrl)};",
        _array("int", "FREE", numbers["independent"].tolist()),
        _array("bool", "REVOLUTE", [str(kind == 0).lower() for kind in numbers["kind"].tolist()]),
        _array("int", "PART", part),
        _array("int", "PART_OF_INPUT", inputs),
        _array("double", "SIZE", [repr(x) for x in numbers["size"].tolist()]),
        _array("double", "TURN", [repr(x) for x in numbers["turn"].tolist()]),
    ]
    body = stage.text()
    if not d.blocks:
        body += "\n    out.det[0] = out.rcond[0] = fixed(1.0);"
    return "\n".join(lines) + "\n#define STAGE \\\n" + body.replace("\n", " \\\n") + "\n"


def compiled(text: str) -> Path:
    """The library of a mechanism; compiled where it was not before."""
    from ..build import BuildError, compiler

    source = Path(__file__).with_name("steps.cc")
    whole = hashlib.sha256()
    for part in (text, source.read_text(encoding="utf-8"), *FLAGS, _processor()):
        whole.update(part.encode())
    folder = _folder()
    library = folder / f"{whole.hexdigest()[:32]}.so"
    if library.is_file():
        return library
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:  # where `replace` is one act
        (Path(scratch) / "mechanism.h").write_text(text, encoding="utf-8")
        staged = Path(scratch) / "steps.so"
        command = [*compiler(), *FLAGS, f"-I{scratch}", "-x", "c++", str(source), "-o", str(staged)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
        if done.returncode or not staged.is_file():
            raise BuildError(f"{command[0]}: {done.stderr[:300]}")
        staged.replace(library)
    return library


def _parts(numbers: Numbers) -> tuple[list[int], list[int]]:
    """Which part of the mechanism each velocity and each input is of, as parts.h has them."""
    parent = [0, *numbers["parent"].tolist()]
    owner = list(range(len(parent)))

    def find(j: int) -> int:
        while owner[j] != j:
            j = owner[j]
        return j

    def join(a: int, b: int) -> None:
        a, b = find(a), find(b)
        owner[max(a, b)] = min(a, b)  # a part is called by its first joint

    def join_path(a: int, b: int) -> None:
        between = []
        while a != b:
            between.append(max(a, b))  # a parent's number is below its child's
            a, b = (parent[a], b) if a > b else (a, parent[b])
        for j in between[1:]:
            join(between[0], j)

    def several_roots() -> tuple[int, int] | None:
        root: dict[int, int] = {}
        for j in range(1, len(parent)):
            of = find(j)
            if (parent[j] > 0 and find(parent[j]) == of) or root.setdefault(of, parent[j]) == parent[j]:
                continue
            return j, root[of]
        return None

    for a, b in numbers["closure_joint"].reshape(-1, 2).tolist():
        join_path(a, b)
    while (pair := several_roots()) is not None:
        j, other = pair
        join_path(other, parent[j])
        for between in (other, parent[j]):
            if between > 0 and find(between) != find(j):
                join(j, between)
    names = sorted({find(j) for j in range(1, len(parent))})
    part = [names.index(find(j)) for j in range(1, len(parent))]
    return part, [part[i] for i in numbers["independent"].tolist()]


def _array(kind: str, name: str, values: Sequence[Any]) -> str:
    return f"constexpr {kind} {name}[] = {{{', '.join(map(str, values))}}};"


def _processor() -> str:
    """What tells this machine's processor from others."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text(encoding="utf-8", errors="replace").splitlines() if told.is_file() else []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return platform.machine() + platform.processor() + flags


def _folder() -> Path:
    """Where compiled code is kept."""
    wanted, cache = os.environ.get(SWITCH, ""), os.environ.get("XDG_CACHE_HOME")
    if wanted not in ("", "1"):
        return Path(wanted)
    return (Path(cache) if cache else Path.home() / ".cache") / "robust_gcp"
