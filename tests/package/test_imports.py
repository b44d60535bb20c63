"""What is loaded when: commands and the package load what they need, and no more."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import robust_gcp as rg
from robust_gcp.commands.register import COMMANDS, REPORTS

ROOT = Path(rg.__file__).parents[1]
PICTURES = ("matplotlib", "meshcat", "PIL", "robust_gcp.drawing")
SOLVERS = ("scipy.integrate", "scipy.optimize", "scipy.linalg", "yaml")
RARE = ("robust_gcp.sweeps", "concurrent.futures", "multiprocessing", "tqdm")


def python(code: str) -> str:
    """What a fresh interpreter prints."""
    words = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r}); {code}"]
    return subprocess.run(words, capture_output=True, text=True, check=True, timeout=300).stdout


def loaded_by(*words: str) -> set[str]:
    """Modules that a command line leaves in memory."""
    code = (
        "from robust_gcp.__main__ import main\n"
        f"try: main({list(words)!r})\n"
        "except SystemExit: pass\n"
        "print('loaded:', *sys.modules)"
    )
    return set(python(code).rpartition("loaded:")[2].split())


def within(modules: set[str], *packages: str) -> set[str]:
    return {m for m in modules for package in packages if m == package or m.startswith(f"{package}.")}


@pytest.mark.parametrize(
    "line",
    [
        "--help",
        "simulate --help",
        "simulate rhombus --duration 0.01",
        "simulate rhombus --duration 0.5 --method projection",
        "analyse rhombus --q 0 0 0",
        "models",
        "modes rhombus --seeds 0",
        "reports --help",
    ],
)
def test_commands_load_neither_reports_nor_pictures(line: str) -> None:
    assert not within(loaded_by(*line.split()), "robust_gcp.reports", *PICTURES)


def test_the_list_of_commands_loads_none_of_them() -> None:
    modules = loaded_by("--help")
    assert within(modules, "robust_gcp.commands") == {"robust_gcp.commands", "robust_gcp.commands.register"}


def test_a_study_loads_no_other_study() -> None:
    reports = within(loaded_by("reports", "a02", "--help"), "robust_gcp.reports")
    assert reports == {"robust_gcp.reports", "robust_gcp.reports.a02"}


def test_pictures_are_loaded_where_they_are_asked_for(tmp_path: Path) -> None:
    plot = ("--plot", str(tmp_path / "fall.png"))
    assert within(loaded_by("simulate", "rhombus", "--duration", "0.01", *plot), "matplotlib")


@pytest.mark.parametrize(
    "words", [*([c.name] for c in COMMANDS), *(["reports", c.name] for c in REPORTS)], ids=" ".join
)
def test_every_command_has_its_arguments(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    from robust_gcp.__main__ import main

    with pytest.raises(SystemExit) as exit:
        main([*words, "--help"])
    assert exit.value.code == 0
    assert "show this help message" in capsys.readouterr().out


def test_the_package_loads_what_is_used_when_it_is_used() -> None:
    """Neither pictures, sweeps, bars, SciPy's solvers nor YAML before something asks for them."""
    modules = set(python("import robust_gcp; print(*sys.modules)").split())
    assert not within(modules, *PICTURES, *SOLVERS, *RARE, "robust_gcp.reports", "robust_gcp.examples")


def test_public_names_are_all_there_whenever_they_are_loaded() -> None:
    assert set(rg._LATER) <= set(rg.__all__) <= set(dir(rg))
    for name in rg.__all__:
        assert getattr(rg, name) is getattr(rg, name)
    for name, module in rg._LATER.items():
        assert getattr(rg, name) is getattr(sys.modules[f"robust_gcp{module}"], name)
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = rg.simulat  # type: ignore[attr-defined]


def test_star_import_gives_what_is_public() -> None:
    printed = python("from robust_gcp import *; print(sweep.__module__, load.__module__)")
    assert printed.split() == ["robust_gcp.sweeps.runs", "robust_gcp.io.loader"]


def test_the_package_does_without_fcntl() -> None:
    """As on Windows, where a file is locked by msvcrt: a second sweep is refused, a later one goes on."""
    code = """
sys.modules["fcntl"] = None
import pathlib, tempfile, types
held = []
def locking(fd, mode, count):
    if held: raise PermissionError(13, "locked")
    held.append(fd)
import robust_gcp as rg
from robust_gcp.sweeps.file import SweepFile
sys.modules["msvcrt"] = types.SimpleNamespace(LK_NBLCK=2, locking=locking)
path = pathlib.Path(tempfile.mkdtemp()) / "runs.jsonl"
with SweepFile(path, {}):
    try: SweepFile(path, {})
    except rg.OptionError as error: print(error)
held.clear()
with SweepFile(path, {}) as again: print(again.done)
"""
    refused, resumed = python(f"exec({code!r})").splitlines()
    assert "another sweep is writing to this file" in refused
    assert resumed == "{}"
