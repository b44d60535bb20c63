"""The same motion, whatever the description: some; `robust-gcp reports descriptions` runs all of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.studies.descriptions.drawing import Drawing, View
from robust_gcp.studies.descriptions.graph import Graph
from robust_gcp.studies.descriptions.judge import compare
from robust_gcp.studies.descriptions.scenes import SCENES

SMALL = (
    "rhombus",
    "kite",
    "five_bar",
    "slider_crank",
    "scissor lift, 2",
    "parallel legs",
    "Bennett",
    "Sarrus",
)
"""Scenes that take a second or two; the command runs all of them."""

BY_NAME = {scene.name: scene for scene in SCENES}


@pytest.mark.parametrize("name", SMALL)
def test_a_scene_moves_alike_in_other_descriptions(name: str) -> None:
    report = compare(BY_NAME[name], most=1, seed=3)
    assert len(report.findings) > 5
    assert [finding for finding in report.findings if not finding.same] == []
    assert np.isnan(report.order) or 3.8 < report.order < 4.3


@pytest.mark.parametrize("name", ["change_point", "five_bar"])
def test_a_scene_moves_alike_with_every_stepper(name: str) -> None:
    report = compare(BY_NAME[name], most=1, steppers=("DOP853", "RK45", "Radau", "LSODA", "BDF"))
    assert [finding for finding in report.findings if not finding.same] == []
    assert len(report.findings) > 10


@pytest.mark.parametrize(
    ("name", "cuts", "names", "backend"),
    [
        ("joined by a dyad", "A2@O2 C1@Q1 E1@Q1", "D1@R1:0:D1@R1:1 E2@Q2", "native"),
        ("joined by a dyad", "A2@O2 C1@Q1 E1@Q1", "D1@R1:0:D1@R1:1 E2@Q2", "python"),
        ("joined by a dyad, both", "B1@P1 B2@P2 E2@Q2", "D2@R2:0:D2@R2:1 A1@O1", "native"),
        ("joined by a dyad, both", "A1@O1 B2@P2 E2@Q2", "D1@R1:0:D1@R1:1 C2@Q2", "native"),
        ("joined by a dyad, both", "B1@P1 C2@Q2 D2@R2:0:D2@R2:1", "E1@Q1 C1@Q1", "native"),
        ("joined by a dyad, both", "D1@R1:0:D1@R1:1 D2@R2:0:D2@R2:1 E1@Q1", "B1@P1 B2@P2", "native"),
    ],
)
def test_lines_across_singular_surfaces_are_as_good_in_poor_coordinates(
    name: str, cuts: str, names: str, backend: Any
) -> None:
    """Of two coordinates: they hardly move where other joints do, and the surfaces cross each other.

    Where the nodes of one surface's line are stopped by the other one, a shorter line passes.
    """
    if backend == "native" and not rg.backends()["native"].available:
        pytest.skip("no compiled kernel")
    scene = BY_NAME[name]
    mechanism, v0 = scene.started()
    graph = Graph(mechanism, mechanism.home, v0)
    drawn = Drawing(graph, View(cuts=tuple(cuts.split())))
    options: dict[str, Any] = {"duration": scene.duration, "step": scene.step, "backend": backend}
    run = rg.simulate(mechanism, v0=v0, **options)
    other = rg.simulate(drawn.mechanism.with_independent(names.split()), v0=drawn.v0, **options)
    assert np.abs(drawn.poses(other.q) - graph.poses(run.q)).max() < 1e-10
    assert other.stats.refined_steps == 0
    assert [c.kind for c in other.crossings] == ["transversal"] * len(scene.crossings)
    for found, wanted in zip(other.crossings, run.crossings, strict=True):
        assert found.time == pytest.approx(wanted.time, abs=1e-10)


def test_what_is_not_the_same_is_seen() -> None:
    """A step so long that RK4 errs differently in other coordinates, and a crossing that is not there."""
    coarse = compare(replace(BY_NAME["slider_crank"], step=1.25e-2), most=2)
    assert any(finding.silently_wrong for finding in coarse.findings)
    other = compare(replace(BY_NAME["rhombus"], crossings=(1, 1)), most=1)
    assert not other.findings[0].same
    assert other.findings[0].crossings == "coranks (1,) instead of (1, 1)"


def test_a_drawing_has_the_energy_of_the_original() -> None:
    """Trees, axes and units change neither masses nor speeds: energy in mm² is a million times as large."""
    for name in ("stewart", "andrews", "strandbeest", "Sarrus", "slider_crank"):
        mechanism, v0 = BY_NAME[name].started()
        graph = Graph(mechanism, mechanism.home, v0)
        rng = np.random.default_rng(4)
        still = mechanism.energy(mechanism.home, 0.0 * v0)
        moving = mechanism.energy(mechanism.home, v0) - still
        for unit in (1.0, 1000.0):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            turn *= np.linalg.det(turn)
            view = View(graph.spanning_cuts(rng), order=2, turn=turn, shift=np.ones(3), unit=unit)
            drawn = Drawing(graph, view)
            other = drawn.mechanism
            kinetic = other.energy(other.home, drawn.v0) - other.energy(other.home, 0.0 * drawn.v0)
            assert kinetic == pytest.approx(moving * unit**2, rel=1e-10, abs=1e-12)
            np.testing.assert_allclose(
                drawn.poses(other.home[None]), graph.poses(mechanism.home[None]), atol=1e-12
            )


def test_couplings_are_refused_by_name() -> None:
    model = BY_NAME["rhombus"].make().model
    geared = rg.Mechanism.from_pinocchio(model, [rg.CouplingClosure("q2", "q1", 2.0)], ["q1", "q3"])
    with pytest.raises(rg.OptionError, match="couplings"):
        Graph(geared, geared.home, np.zeros(3))


def test_the_command_prints_a_line_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "found.json"
    assert (
        main(["reports", "descriptions", "--scenes", "rhombus,Bennett", "--most", "1", "--out", str(out)])
        == 0
    )
    printed = capsys.readouterr().out
    assert "silently wrong" in printed and "2 scenes, 0 differ" in printed
    reports = json.loads(out.read_text(encoding="utf-8"))
    assert [report["scene"] for report in reports] == ["rhombus", "Bennett"]
    assert main(["reports", "descriptions", "--scenes", "rombus"]) == 2
    assert "'rombus' is unknown" in capsys.readouterr().err
