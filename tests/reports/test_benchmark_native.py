"""The timing of the kernel: what it measures is the kernel's own work."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.examples.linkages import n_four_bar
from robust_gcp.io.loader import models_folder
from robust_gcp.reports import throughput
from robust_gcp.reports.robot_speed import batches, measured
from robust_gcp.reports.robots import robots_in
from robust_gcp.reports.throughput import thread_gain

from ..compiled import needs_kernel
from .test_peers import built

pytestmark = needs_kernel


def test_a_step_costs_microseconds() -> None:
    """Some 2 µs for one loop, which grows with the loops and stays far below Python's milliseconds."""
    one, ten = (batches(n_four_bar(n, 1.2), 100) for n in (1, 10))
    assert 0.0 < min(one()[0] for _ in range(50)) < min(ten()[0] for _ in range(50)) < np.inf
    assert one()[1] == 0.0  # on the parallelogram mode G is constant: predictions are exact


def test_two_threads_run() -> None:
    """Two threads finish what two threads were given; how much faster depends on what else runs."""
    assert 0.0 < thread_gain(rg.load("crank_rocker"), quick=True) < np.inf


def test_a_batch_that_stops_early_is_no_measurement() -> None:
    """Falling into the zone of a singular configuration ends a batch."""
    run = batches(n_four_bar(1, 0.2), 500, 1e-3)
    with pytest.raises(RuntimeError, match="ZONE"):
        run()
    assert np.isfinite(batches(n_four_bar(1, 1.2), 5, 1e-3)()[0])


@built  # else it is built here, for minutes
def test_robots_of_a_folder_are_timed_beside_pinocchio(tmp_path: Path) -> None:
    """What a step costs is there for each robot that steps; a file that is none is named with its reason."""
    for name in ("crank_rocker", "stewart"):
        shutil.copytree(models_folder() / name, tmp_path / "found" / name)
    (tmp_path / "none.xml").write_text("<mujoco/>", encoding="utf-8")
    (tmp_path / "none.sdf").write_text("<sdf/>", encoding="utf-8")
    assert list(robots_in(tmp_path)) == [
        tmp_path / "found" / "crank_rocker",
        tmp_path / "found" / "stewart",
        tmp_path / "none.sdf",
        tmp_path / "none.xml",
    ]
    rows = [measured(path, path.name, None, 2) for path in robots_in(tmp_path)]
    assert [row.nv for row in rows] == [3, 24, 0, 0]
    assert all(row.note and np.isnan(row.step) for row in rows[2:])
    for row in rows[:2]:
        assert 1e-1 < row.step < 1e4
        assert row.aba > 1e-2 and 1e-2 < row.constrained < 1e3
        assert row.ratio == row.step / row.constrained


def test_what_derivatives_cost_is_told_and_renews_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(models_folder() / "crank_rocker", tmp_path / "robots" / "crank_rocker")
    page, out = tmp_path / "page.md", tmp_path / "costs.json"
    begin, end = "<!-- begin: derivatives of robots -->", "<!-- end: derivatives of robots -->"
    page.write_text(f"# T\n\n{begin}\nold\n{end}\n", encoding="utf-8")
    line = ["reports", "benchmark", "--derivatives", "--quick", "--robots", str(tmp_path / "robots")]
    assert main([*line, "--out", str(out), "--refresh", str(page)]) == 0
    assert "crank_rocker" in capsys.readouterr().out
    (row,) = json.loads(out.read_text(encoding="utf-8"))
    assert (row["name"], row["nv"], row["m"]) == ("crank_rocker", 3, 1)
    assert 1e-2 < row["forward"] < row["derivatives"] < 1e3, "µs"
    assert row["gradient"] > 0.0
    text = page.read_text(encoding="utf-8")
    assert "| crank_rocker | 3 | 1 |" in text and "old" not in text


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--refresh page.md", "--refresh does not go with --shipped"),
        ("--starts 2 --paths", "--paths does not go with --starts"),
        ("--derivatives --shipped", "--shipped does not go with --derivatives"),
        ("--paths --base free", "--base does not go with --paths"),
        ("--shipped --refresh page.md", "--refresh does not go with --shipped"),
    ],
)
def test_options_that_would_not_be_looked_at_are_refused(
    line: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("page.md").write_text("# T\n", encoding="utf-8")
    assert main(["reports", "benchmark", "--quick", *line.split()]) == 2
    assert words in capsys.readouterr().err


def test_shipped_robots_are_measured_where_no_option_says_what(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reports", "benchmark", "--quick"]) == 0
    assert "stewart" in capsys.readouterr().out


def test_steps_of_many_starts_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Under the names of the table's columns."""
    monkeypatch.setattr(throughput, "MANY", ("rhombus",))
    out = tmp_path / "starts.json"
    assert main(["reports", "benchmark", "--starts", "2", "--quick", "--out", str(out)]) == 0
    rows = json.loads(out.read_text(encoding="utf-8"))
    assert {row["mechanism"] for row in rows} == {"rhombus"} and float(rows[0]["Batch"]) > 0.0
    assert rows[0]["simulate_many"] in capsys.readouterr().out


@pytest.mark.parametrize("line", ("--derivatives", ""))
def test_a_page_without_marks_or_table_is_refused(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text("# T\n", encoding="utf-8")
    assert main(["reports", "benchmark", *line.split(), "--quick", "--refresh", str(page)]) != 0
    assert "--refresh" in capsys.readouterr().err
    assert page.read_text(encoding="utf-8") == "# T\n"
