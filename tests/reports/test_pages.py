"""Pages that reports renew: blocks between marks, tables."""

import json
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.printing import write_json
from robust_gcp.reports import pages


def marked(name: str, block: str) -> str:
    return f"<!-- begin: {name} -->\n{block}\n<!-- end: {name} -->"


def test_a_page_is_renewed_between_its_marks_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"# T\n\n{marked('a', 'old')}\n\ntext\n{marked('b', 'kept')}\n", encoding="utf-8")
    assert pages.renew(page, {"a": r"| new \1 |", "elsewhere": "x"})
    once = page.read_text(encoding="utf-8")
    middle = marked("a", "\n| new \\1 |\n")
    assert once == f"# T\n\n{middle}\n\ntext\n{marked('b', 'kept')}\n"
    assert pages.renew(page, {"a": r"| new \1 |"})
    assert page.read_text(encoding="utf-8") == once
    assert not pages.renew(page, {"elsewhere": "x"})


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
        pages.renew(page, {"a": "new"})
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
