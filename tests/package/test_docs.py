"""The documents keep their word: examples print what is shown, and what is pointed at exists."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.reports.work_precision.command import in_short

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)

Example = tuple[str, str]


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of each fenced block."""
    return [(m[1], m[2]) for m in BLOCK.finditer(page.read_text(encoding="utf-8"))]


def examples(page: Path) -> list[Example]:
    """Each Python block with the output shown after it, if any."""
    found = [*blocks(page), ("", "")]
    return [
        (code, shown if kind == "text" else "")
        for (language, code), (kind, shown) in pairwise(found)
        if language == "python"
    ]


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_examples_print_what_is_shown(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each by itself; those of the tutorial one after the other, in an empty folder."""
    names: dict[str, Any] = {"__name__": "example"}
    if page.name in ("tutorial.md", "export.md"):
        monkeypatch.chdir(tmp_path)
    if page.name == "export.md" and not rg.backends()["native"].available:
        pytest.skip("a unit holds the compiled kernel")
    if page.name == "comparison.md" and pin.__version__ != "4.1.0":
        pytest.skip("the page shows errors of Pinocchio 4.1.0")
    for code, shown in examples(page):
        if not all(map(importlib.util.find_spec, re.findall(r"^import (jax|torch)$", code, re.MULTILINE))):
            continue  # extras that tests do without
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, str(page), "exec", dont_inherit=True), names)
        if page.name != "tutorial.md":
            names = {"__name__": "example"}
        assert printed.getvalue() == shown


def test_the_readme_has_a_short_example_with_its_output() -> None:
    ((code, shown),) = examples(ROOT / "README.md")
    assert len(code.splitlines()) <= 12
    assert shown


def rounding_left_out(text: str) -> list[str]:
    """Lines with what differs between machines masked: times of a run, and sizes of rounding."""
    text = re.sub(r"(wall time +)\S+ s", r"\1…", text)
    return [line.rstrip() for line in re.sub(r"\d\.\d+e-\d\d", "…", text).splitlines()]


@pytest.mark.slow
def test_the_readme_shows_what_its_command_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = [text for kind, text in blocks(ROOT / "README.md") if kind != "python"]
    command = found[1].splitlines()[-1].split()
    assert command[:3] == ["python", "-m", "robust_gcp"]
    monkeypatch.chdir(tmp_path)
    assert main(command[3:]) == 0
    assert rounding_left_out(capsys.readouterr().out) == rounding_left_out(found[2])


def test_the_readme_shows_two_commands_that_stand_alone() -> None:
    commands = [text.splitlines() for language, text in blocks(ROOT / "README.md") if language == "sh"]
    assert len(commands) == 2
    for lines in commands:
        assert lines[:2] == ["python3 -m venv .venv", ". .venv/bin/activate"]
        assert lines[2].startswith("pip install ")


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    for link in links:
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


def test_figures_stay_small() -> None:
    figures = list((ROOT / "docs" / "figures").iterdir())
    assert figures
    for figure in figures:
        assert figure.stat().st_size < 300_000, figure.name


def test_every_public_name_is_in_the_api_page() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert [name for name in rg.__all__ if not re.search(rf"\b{name}\b", text)] == []


@pytest.mark.parametrize("name", ["Mechanism", "Trajectory", "Simulation", "Sample", "Runs", "Records"])
def test_every_public_member_is_in_the_api_page(name: str) -> None:
    """And what is not there is no member that one is shown."""
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    shown = dir(rg.load("rhombus")) if name == "Mechanism" else dir(getattr(rg, name))
    own = [member for member in shown if not member.startswith("_") and member not in dir(list)]
    assert [member for member in own if not re.search(rf"\b{member}\b", text)] == []


def test_every_public_name_is_in_the_reference() -> None:
    pages = (ROOT / "docs" / "reference").glob("*.md")
    named = [
        name for page in pages for name in re.findall(r"^::: (\S+)$", page.read_text("utf-8"), re.MULTILINE)
    ]
    named = [name for name in named if not name.startswith("robust_gcp.adapters.")]  # each with its extra
    assert sorted(name.rpartition(".")[2] for name in named) == sorted(rg.__all__)
    for name in named:
        module, _, what = name.rpartition(".")
        assert getattr(importlib.import_module(module), what) is getattr(rg, what), name


def test_every_page_is_on_the_site() -> None:
    docs = ROOT / "docs"
    listed = set(re.findall(r"(\S+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE))
    assert listed == {page.relative_to(docs).as_posix() for page in docs.rglob("*.md")}


def test_every_shipped_model_is_in_the_models_page() -> None:
    text = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
    assert [name for name in rg.model_names() if f"`{name}`" not in text] == []


@pytest.mark.slow
@pytest.mark.parametrize("table", ["floors", "options", "thresholds", "gaps", "gains"])
def test_the_tables_can_be_measured(table: str) -> None:
    script = [sys.executable, str(ROOT / "docs" / "tables.py"), table, "--quick"]
    done = subprocess.run(script, capture_output=True, text=True, encoding="utf-8", check=True)
    header, rule, *rows = done.stdout.splitlines()
    assert rule == "|" + "---|" * (header.count("|") - 1)
    assert rows
    assert all(row.count("|") == header.count("|") for row in rows)


def test_the_table_of_the_readme_is_part_of_the_one_of_all_scenes() -> None:
    def block(page: Path) -> str:
        return page.read_text("utf-8").split("<!-- begin: work-precision -->")[1].split("<!-- end")[0].strip()

    whole, short = block(ROOT / "docs" / "work-precision.md"), block(ROOT / "README.md")
    table, measured = short.rsplit("\n\n", 1)
    assert table == in_short(whole.split("\n\n")[0]) and len(table.splitlines()) == 7
    assert measured in whole
