"""The same motion, whatever the description: each scene in other coordinates, cuts, trees, axes and units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

from .descriptions.drawing import Drawing, View
from .descriptions.graph import Graph
from .descriptions.judge import STEPPERS, Report, compare
from .descriptions.scenes import SCENES, Scene

SEED = 1
BY_NAME = {scene.name: scene for scene in SCENES}


def different(report: Report) -> str:
    """The descriptions that move otherwise, a line each."""
    return "\n".join(str(asdict(finding)) for finding in report.findings if not finding.same)


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")  # rows implied but for rounding
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_a_scene_moves_alike(
    scene: Scene, seed: int, pytestconfig: pytest.Config, record_property: Callable[..., None]
) -> None:
    report = compare(scene, pytestconfig.option.most, seed)
    found = report.findings
    worst = max((finding.difference for finding in found if not finding.refused), default=np.inf)
    figures = {
        "descriptions": len(found),
        "order": report.order,
        "largest difference": worst,
        "other crossings": sum(bool(finding.crossings) for finding in found),
        "refused": sum(bool(finding.refused) for finding in found),
        "silently wrong": sum(finding.silently_wrong for finding in found),
    }
    record_property(f"{scene.name}, seed {seed}", figures)
    assert not different(report)


@pytest.mark.parametrize("name", ["parallel legs", "Bennett"])
def test_a_scene_moves_alike_in_some_descriptions(name: str) -> None:
    report = compare(BY_NAME[name], most=1, seed=3)
    assert len(report.findings) > 5
    assert not different(report)
    assert np.isnan(report.order) or 3.8 < report.order < 4.3


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["change_point", "five_bar"])
def test_a_scene_moves_alike_with_every_stepper(name: str) -> None:
    report = compare(BY_NAME[name], most=1, steppers=STEPPERS)
    assert not different(report)
    assert len(report.findings) > 10


@pytest.mark.parametrize(
    ("name", "cuts", "names", "backend"),
    [
        ("joined by a dyad", "A2@O2 C1@Q1 E1@Q1", "D1@R1:0:D1@R1:1 E2@Q2", "native"),
        pytest.param(
            *("joined by a dyad", "A2@O2 C1@Q1 E1@Q1", "D1@R1:0:D1@R1:1 E2@Q2", "python"),
            marks=pytest.mark.campaign,
        ),
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
    coarse = compare(replace(BY_NAME["slider_crank"], step=1.25e-2), most=1)
    assert any(finding.silently_wrong for finding in coarse.findings)
    other = compare(replace(BY_NAME["rhombus"], crossings=(1, 1)), most=1)
    assert [finding.same for finding in other.findings] == [False] + [True] * (len(other.findings) - 1)
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
