"""Pages that reports renew: blocks between marks, tables."""

import json
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.printing import write_json
from robust_gcp.reports import growth, pages
from robust_gcp.reports.stability.command import PAGE, families
from robust_gcp.reports.work_precision import command


def marked(name: str, block: str) -> str:
    return f"<!-- begin: {name} -->\n{block}\n<!-- end: {name} -->"


def test_a_page_is_renewed_between_its_marks_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"# T\n\n{marked('a', 'old')}\n\ntext\n{marked('b', 'kept')}\n", encoding="utf-8")
    pages.refresh(page, {"a": r"| new \1 |", "elsewhere": "x"})
    once = page.read_text(encoding="utf-8")
    middle = marked("a", "\n| new \\1 |\n")
    assert once == f"# T\n\n{middle}\n\ntext\n{marked('b', 'kept')}\n"
    pages.refresh(page, {"a": r"| new \1 |"})
    assert page.read_text(encoding="utf-8") == once
    assert capsys.readouterr().out == 2 * f"renewed {page}\n"
    pages.refresh(page, {"elsewhere": "x"})
    assert not capsys.readouterr().out and page.read_text(encoding="utf-8") == once


@pytest.mark.parametrize(
    "text",
    (
        "<!-- begin: a -->\n",
        "<!-- end: a -->\n<!-- begin: a -->\n",
        f"{marked('a', '')}\n{marked('a', '')}\n",
    ),
)
def test_marks_that_do_not_pair_are_refused(tmp_path: Path, text: str) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(rg.OptionError, match="once each"):
        pages.refresh(page, {"a": "new"})
    assert page.read_text(encoding="utf-8") == text


def test_a_table_keeps_bars_and_breaks_inside_its_cells() -> None:
    assert pages.table([["a", "b"], ["x|y", "1\n2"]], numbers=(1,)).splitlines() == [
        "| a | b |",
        "|---|---:|",
        r"| x\|y | 1 2 |",
    ]


def test_figures_that_are_not_finite_become_null(tmp_path: Path) -> None:
    """JSON has neither NaN nor infinity, which other programs refuse to read."""
    path = tmp_path / "figures.json"
    given = {"a": float("nan"), "b": [np.float64(-np.inf), (1.5, np.int64(2))], "c": np.array([np.nan, 1.0])}
    write_json(path, given)
    assert json.loads(path.read_text(encoding="utf-8"), parse_constant=pytest.fail) == {
        "a": None,
        "b": [None, [1.5, 2]],
        "c": [None, 1.0],
    }


@pytest.mark.parametrize(
    ("command", "page", "missing"),
    [
        ("growth", "docs/kernel.md", "README.md"),
        ("work-precision --out out", "README.md", "docs/work-precision.md"),
        ("stability --out out", "stability.md", "stability.md"),
    ],
)
def test_pages_that_could_not_be_renewed_are_told_before_the_work(
    command: str, page: str, missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Each measures for a long time, and would then have refreshed nothing, or ended in an error."""
    pytest.importorskip("matplotlib")
    for work in ("growth.measure", "work_precision.command.Study", "stability.command.judge_all"):
        monkeypatch.setattr(f"robust_gcp.reports.{work}", lambda *_: pytest.fail("work has begun"))
    monkeypatch.chdir(tmp_path)
    Path("docs").mkdir()
    names = ("growth", "speed", "work-precision", "stiff springs")
    marks = "\n".join(marked(name, "old") for name in names)
    line = ["reports", *command.split(), "--docs", "."]
    if page != missing:
        Path(page).write_text(marks, encoding="utf-8")
        assert main(line) == 2 and f"there is no {missing} to refresh" in capsys.readouterr().err
    Path(missing).write_text("# T\n", encoding="utf-8")
    assert main(line) == 2 and f"{missing}: there are no marks of a block named" in capsys.readouterr().err
    Path(missing).write_text(marks.replace("<!-- end", "<!-- ende"), encoding="utf-8")
    assert main(line) == 2 and "once each, in this order" in capsys.readouterr().err


def test_the_pages_of_this_checkout_can_be_renewed() -> None:
    root = Path(__file__).parents[2]
    pages.require_pages(root, growth.PAGES)
    pages.require_pages(root, command.PAGES)
    pages.require_pages(root / "docs", {PAGE: families()})
