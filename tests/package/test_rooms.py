"""The house as CONTRIBUTING.md draws it: rooms use those below them, and a file is read in one sitting."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

import robust_gcp as rg

PACKAGE = Path(__file__).parents[2] / "robust_gcp"
ROOMS = ("mechanism", "io", "analysis", "maps", "dynamics", "kernel", "simulation")
"""Each may use those before it; all others, such as drawing, may use them all."""
FLOORS = ("linalg", "tree", "constraint", "path", "cluster", "dynamics", "derivatives", "simulation")
"""Of the kernel."""


def imports(file: Path) -> Iterator[str]:
    """The rooms that a file asks for when it is loaded."""
    here = file.relative_to(PACKAGE.parent).parent.parts
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = here[: len(here) - node.level + 1] + tuple((node.module or "").split("."))
            yield [*(name for name in base if name), ""][1]


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_use_those_below_them(room: str) -> None:
    below = ROOMS[: ROOMS.index(room) + 1]
    rooms = {folder.name for folder in PACKAGE.iterdir() if folder.is_dir()}
    files = list((PACKAGE / room).rglob("*.py"))
    assert files
    for file in files:
        assert not {*imports(file)} & (rooms - {*below}), file


def test_floors_of_the_kernel_use_those_below_them() -> None:
    for i, floor in enumerate(FLOORS):
        files = [*(PACKAGE / "kernel" / floor).glob("*.h"), *(PACKAGE / "kernel" / floor).glob("*.cpp")]
        assert files, floor
        for file in files:
            included = re.findall(r'#include "(\w+)/', file.read_text(encoding="utf-8"))
            assert not {*included} & {*FLOORS[i + 1 :]}, file


def test_a_file_is_read_in_one_sitting() -> None:
    for ending in ("py", "h", "cpp", "js", "css"):
        for file in PACKAGE.rglob(f"*.{ending}"):
            assert len(file.read_text(encoding="utf-8").splitlines()) <= 300, file


def test_a_folder_has_a_few_dozen_files() -> None:
    for folder in (PACKAGE, *(each for each in PACKAGE.rglob("*") if each.is_dir())):
        assert len([*folder.glob("*.py")]) <= 32, folder


def test_a_function_is_read_at_a_glance() -> None:
    """At most 60 lines of statements."""
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                body = node.body[ast.get_docstring(node) is not None :] or node.body
                assert (node.end_lineno or 0) - body[0].lineno < 60, f"{file}: {node.name}"


@pytest.mark.skipif(not rg.backends()["native"].available, reason="steps in Python enter others")
def test_a_call_can_be_followed() -> None:
    """What `simulate` enters of the package where nothing happens: better if less, kept from growing.

    A mechanism's first run enters some twenty files more, by which it is described to the kernel.
    """
    mechanism = rg.load("rhombus")
    rg.simulate(mechanism, duration=0.01)
    package, entered = str(Path(rg.__file__).parent), set[tuple[str, str]]()

    def entering(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(package) and code.co_name[0] != "<":
            entered.add((code.co_filename, f"{code.co_firstlineno}: {code.co_name}"))

    sys.setprofile(entering)
    try:
        rg.simulate(mechanism, duration=0.01)
    finally:
        sys.setprofile(None)
    files = {file for file, _ in entered}
    assert 10 < len(files) <= 39, sorted(files)
    assert len(entered) <= 150, sorted(entered)
