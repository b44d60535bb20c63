"""Time of a step against size: what is measured is a step, and what is told is what was measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.reports import growth
from robust_gcp.reports.contender import Outcome, Scene

Row = dict[str, float | str]


class Clockwork:
    """Takes 2 ms to start and 3 µs a step."""

    def refuses(self, scene: Scene) -> str:
        return ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        steps = round(float(scene.times[-1]) / setting)
        return Outcome(np.zeros((1, 1)), np.zeros((1, 1)), 2e-3 + 3e-6 * steps, 0)


def test_what_a_run_costs_once_is_not_in_a_step() -> None:
    contender: Any = Clockwork()
    assert growth.step_seconds(contender, rg.load("crank_rocker")) == pytest.approx(3e-6)


@pytest.mark.parametrize("family", growth.FAMILIES)
def test_families_have_their_size_and_move_regularly(family: str) -> None:
    """Closed, of the mobility that is told, and without a zone for as long as it is timed."""
    sizes, make = growth.FAMILIES[family]
    mechanism = make(sizes[1])
    assert mechanism.closure_residual(mechanism.home) < 1e-12
    loops, clusters, m = {
        "loops": (2, 1, 1),
        "clusters": (2, 2, 2),
        "mobility": (1, 1, 2),
        "joints": (0, 0, 2),
        "robots": (2, 2, 4),
    }[family]
    assert (len(mechanism.closures), len(mechanism.clusters), mechanism.m) == (loops, clusters, m)
    longest = 3 * growth.MOST * growth.OUTPUTS * growth.STEP
    run = rg.simulate(mechanism, v0=np.zeros(mechanism.nv), duration=longest, step=longest / 30)
    assert run.stats.zone_evaluations == 0


def test_the_exponent_is_that_of_the_largest_sizes() -> None:
    rows: list[Row] = [{"size": n, "compiled": 50.0 + n**2} for n in (1, 10, 20, 40)]
    exact = np.polyfit(np.log([10.0, 20.0, 40.0]), np.log([150.0, 450.0, 1650.0]), 1)[0]
    assert growth.exponent(rows, "compiled") == pytest.approx(exact)
    assert growth.exponent(rows, "Python") is None


def test_the_command_writes_tables_figure_and_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each figure that is told stands in the table that was measured with it."""
    pytest.importorskip("matplotlib")

    def measure(family: str, quick: bool) -> list[Row]:
        return [
            {
                "family": family,
                "size": n,
                "name": "x",
                "nv": 3 * n,
                "m": 1,
                "compiled": 1.5 * n,
                "Python": 80.0 * n,
            }
            for n in (1, 2, 40)
        ]

    monkeypatch.setattr(growth, "measure", measure)
    fixed = {
        "first run": 5.0,
        "start": 1.0,
        "crossing": 3.0,
        "fall in Python": 150.0,
        "threads": 1.9,
        "derivatives": 4.0,
        "jacobians": 9.0,
    }
    monkeypatch.setattr(growth, "once", lambda quick: fixed)
    (tmp_path / "docs" / "figures").mkdir(parents=True)
    for page, name in (("README.md", "speed"), ("docs/kernel.md", "growth")):
        (tmp_path / page).write_text(f"<!-- begin: {name} -->\n<!-- end: {name} -->\n", encoding="utf-8")
    assert main(["reports", "growth", "--out", str(tmp_path / "out"), "--docs", str(tmp_path)]) == 0
    told = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "An RK4 step of a four-bar takes 1.5 µs, of 40 four-bars in a row 60 µs." in told
    assert "kernel they take 53 and 53 times as long, a fall" in told
    assert "crossings 150 times" in told
    page = (tmp_path / "docs" / "kernel.md").read_text(encoding="utf-8")
    assert "| 40 | 120 | 1 | 60 | 3.2e+03 |" in page
    assert "| largest 3 |  |  | N^1.00 | N^1.00 |" in page
    assert "the start of each further one 1 ms" in page
    assert page.partition("-->")[2].partition("*µs")[0].strip() in capsys.readouterr().out
    data = json.loads((tmp_path / "out" / "growth.json").read_text(encoding="utf-8"))
    assert data["once"] == fixed
    assert (tmp_path / "docs" / "figures" / "growth.png").stat().st_size > 5000


def test_two_threads_run() -> None:
    """Two threads finish what two threads were given; how much faster depends on what else runs."""
    assert growth.thread_gain(rg.load("crank_rocker"), quick=True) > 0.1
