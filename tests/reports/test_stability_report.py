"""The stability study's tables, maps and command say what the cells say."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.reports.stability import command, maps, report
from robust_gcp.reports.stability.bound import Bound, Stride
from robust_gcp.reports.stability.case import Case, Cell, Setting, Verdict
from robust_gcp.reports.stability.command import families

Array = NDArray[np.float64]


def never() -> tuple[rg.Mechanism, Array, Array]:
    raise rg.ModelError("not built")


def cell(name: str, step: float, verdict: Verdict, reason: str = "", error: float = 2e-9) -> Cell:
    case = Case("springs | soft", name, never, 1.0, (), None)
    return Cell(case, Setting(step=step), verdict, error, 1e-7, 1e-15, 1, True, reason, 401, 0.1)


CELLS = [
    cell("k = 1", 1e-3, "right"),
    cell("k = 1", 1e-2, "stopped", "warned: StabilityWarning: too large"),
    cell("k = 2", 1e-3, "stopped", "ToggleError: turns back", float("nan")),
    cell("k = 2", 1e-2, "wrong", "error 2.0e-09 above 1.0e-09"),
]
BOUNDS = [Bound("spring", 3j, 0.9, 0.91), Bound("damper", -4 + 0j, 0.7, 0.69)]
NAN = float("nan")
STRIDES = [
    Stride("servo", "Radau", 1e-4, 1e-5, 1e-6, 2e-2, 5e-2, 120, 2e4),
    Stride("servo", "BDF", 1e-4, NAN, NAN, NAN, NAN, 0, 2e4),
]


def test_csv_and_json_hold_every_cell(tmp_path: Path) -> None:
    report.write_study(tmp_path, CELLS, BOUNDS, STRIDES)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["stability.csv", "stability.json", "stability.md"]
    with (tmp_path / "stability.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [c.verdict for c in CELLS]
    assert float(rows[0]["error"]) == CELLS[0].error
    assert rows[2]["error"] == ""

    def refuse(word: str) -> float:
        raise AssertionError(f"{word} is no JSON")

    whole = json.loads((tmp_path / "stability.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert [c["reason"] for c in whole["cells"]] == [c.reason for c in CELLS]
    assert whole["bounds"][1]["real"] == -4
    assert whole["strides"][1]["mean"] is None


def test_tables_have_one_line_a_case_and_one_column_a_setting() -> None:
    table = report.family_table(CELLS).splitlines()
    assert table[0] == "| case | RK4 0.001 s | RK4 0.01 s |"
    assert table[2:] == ["| k = 1 | ✓ 2e-09 | ■ warned |", "| k = 2 | ■ Toggle | ✗ 2e-09 |"]
    assert report.summary(CELLS).splitlines()[-1] == "| **all** | **4** | **1** | **0** | **2** | **1** |"
    for block in report.blocks(CELLS, BOUNDS, STRIDES).values():
        lines = [line.replace("\\|", "") for line in block.splitlines()]
        assert len({line.count("|") for line in lines}) == 1
    assert "| -4 | 0.7 | 0.69 | 0.9857 |" in report.bound_table(BOUNDS)
    assert "| 200 | 500 | 120 |" in report.stride_table(STRIDES)


def test_maps_are_drawn_with_each_cell_in_its_colour(tmp_path: Path) -> None:
    path = maps.draw_family(CELLS, tmp_path / "a" / "map.png")
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert maps.draw_summary(CELLS, tmp_path / "summary.png").stat().st_size > 5000
    assert maps.slug("RK4's bound") == "rk4_s_bound"
    # apart in lightness too, for a reader without colours: relative luminance of sRGB

    def luminance(colour: str) -> float:
        channels = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return float(np.dot([0.2126, 0.7152, 0.0722], linear))

    for colour in maps.COLOURS.values():
        assert (luminance(colour) + 0.05) / 0.05 > 4.5  # black print on it: WCAG's contrast
    assert luminance(maps.COLOURS["wrong"]) < 0.5 * luminance(maps.COLOURS["right"])


def test_a_thousand_cases_are_counted_and_drawn_as_tiles(tmp_path: Path) -> None:
    verdicts: tuple[Verdict, ...] = ("right", "right", "stopped")
    reasons = {"right": "", "stopped": "ToggleError: turns back"}
    many = [cell(f"{i}", 1e-3, (v := verdicts[i % 3]), reasons[v], 10.0 ** -(i % 7)) for i in range(1000)]
    assert report.family_table(many).splitlines()[2:] == [
        "| ✓ right | 667 | 1e-03 | 1e+00 |",
        "| ■ Toggle | 333 | 1e-03 | 1e+00 |",
    ]
    path = maps.draw_family(many, tmp_path / "many.png")
    assert path.stat().st_size < 300_000


@pytest.fixture
def two_cases(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """The command with one small family instead of all; its bound on the error is given."""

    def use(allowed: float) -> None:
        mech = rg.load("rhombus")

        def make(quick: bool) -> list[Case]:
            columns = (Setting(step=0.01), Setting(step=0.02))
            start = (mech, mech.home, np.zeros(3))
            return [Case("falls", "rhombus", lambda: start, 0.2, columns, allowed)]

        monkeypatch.setattr(command, "families", lambda: {"falls": make})

    return use


@pytest.mark.parametrize(("allowed", "code"), [(1e-3, 0), (0.0, 1)])
def test_the_command_writes_everything_and_fails_on_a_wrong_cell(
    two_cases: Callable[[float], None],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    allowed: float,
    code: int,
) -> None:
    two_cases(allowed)
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "stability.md").write_text("<!-- begin: falls -->\n<!-- end: falls -->\n", encoding="utf-8")
    out = tmp_path / "out"
    assert main(["reports", "stability", "--case", "falls", "--out", str(out), "--docs", str(docs)]) == code
    assert {p.name for p in out.iterdir()} == {
        "stability.csv", "stability.json", "stability.md", "stability_falls.png",
    }  # fmt: skip
    assert "| rhombus |" in (docs / "stability.md").read_text(encoding="utf-8")
    assert (docs / "figures" / "stability_falls.png").is_file()
    printed = capsys.readouterr().out
    assert ("wrong: falls, rhombus" in printed) == bool(code)


def test_unknown_families_and_missing_pages_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reports", "stability", "--case", "spring", "--out", str(tmp_path)]) == 2
    assert "'stiff springs'" in capsys.readouterr().err
    assert main(["reports", "stability", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 2
    assert "there is no stability.md to refresh" in capsys.readouterr().err


def test_the_documentation_has_a_place_and_a_map_for_each_family() -> None:
    docs = Path(__file__).parents[2] / "docs"
    page = (docs / "stability.md").read_text(encoding="utf-8")
    for name in ("summary", "bounds", "strides", "reasons", *families()):
        assert f"<!-- begin: {name} -->" in page, name
        assert f"<!-- end: {name} -->" in page, name
    for family in families():
        figure = f"figures/stability_{maps.slug(family)}.png"
        assert figure in page
        assert (docs / figure).is_file(), figure
    assert "✗ wrong" in page
