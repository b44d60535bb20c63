"""What a scene does not need is not computed: counts that are exactly zero, and modules left unloaded."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.reports.costs import FAR, PARTS, SCENES, SHARES, Cost, import_milliseconds, measure

RARE = ("zone_evaluations", "marching_steps", "bridges_built", "svds", "second_order", "refined_steps")
CONSTRAINT = ("constraint_evaluations", "newton_iterations")


@functools.cache
def cost_of(name: str) -> Cost:
    return measure(name, rounds=1)


def nonzero(cost: Cost) -> set[str]:
    """Counters of the run and parts of its steps that are not zero."""
    names = (*RARE, *CONSTRAINT, "force_evaluations")
    return {n for n in names if getattr(cost.stats, n)} | {part for part in PARTS if cost.calls[part]}


ROBOT = {"RNEA", "CRBA", *CONSTRAINT, "forces", "force_evaluations"}  # sprung

NEEDED = {
    "one pendulum": {"RNEA"},
    "a pendulum with spring and damper": {"RNEA", "forces", "force_evaluations"},
    "one loop, far from singular": {"RNEA", *CONSTRAINT},
    "… with spring and damper": {"RNEA", *CONSTRAINT, "forces", "force_evaluations"},
    "… with a torque": {"RNEA", *CONSTRAINT, "force_evaluations"},
    "… recording a": {"RNEA", *CONSTRAINT, "a"},
    "… recording the energy": {"RNEA", *CONSTRAINT, "energies"},
    "… recording λ": {"RNEA", *CONSTRAINT, "a", "multipliers", "SVD"},
    "… by DOP853": {"RNEA", *CONSTRAINT},
    "two coordinates, far from singular": {"RNEA", "CRBA", *CONSTRAINT},
    "one closure row too many (Bricard)": {"RNEA", *CONSTRAINT, "svds"},
    "a delta robot, far from singular": ROBOT,
    "a walker's two clusters, far from singular": ROBOT,
    "a floating walker, far from singular": ROBOT,
}
"""Whatever is not named here must not run at all in these scenes."""


@pytest.mark.parametrize("name", NEEDED)
def test_only_what_is_needed_runs(name: str) -> None:
    assert nonzero(cost_of(name)) == NEEDED[name]


def test_counts_of_a_step() -> None:
    """RK4 has four right-hand sides a step and one at the end; each needs τ once and C + M g once.

    What is recorded is computed once an output, the first one excepted (it precedes the steps).
    """
    for cost in map(cost_of, SCENES):
        if cost.scene != "… by DOP853" and not cost.stats.repartitions and not cost.stats.refined_steps:
            assert cost.stats.rhs == 4 * cost.steps + 1
    assert cost_of("one pendulum").calls["RNEA"] == 4 * cost_of("one pendulum").steps
    for name in ("a pendulum with spring and damper", "… with spring and damper"):
        assert cost_of(name).calls["forces"] == 4 * cost_of(name).steps
    for name, part in (("a", "a"), ("the energy", "energies"), ("λ", "multipliers")):
        assert cost_of(f"… recording {name}").calls[part] == cost_of(f"… recording {name}").steps


def test_each_solve_evaluates_the_constraint_once_more_than_it_corrects() -> None:
    """φ is evaluated before each correction of Newton's and after the last, where G and g are solved."""
    stats = cost_of("one loop, far from singular").stats
    at_the_start = stats.constraint_evaluations - stats.newton_iterations - stats.rhs
    assert 0 <= at_the_start < 30


@pytest.mark.parametrize("name", ["delta", "walker"])
def test_far_from_singular_the_method_evaluates_nothing_more(name: str) -> None:
    """Classical GCP and the bridge count the same parts, to the last one, and give the same motion."""
    robot = rg.load(name)
    rg.simulate(robot, duration=1e-3, step=1e-3, backend="python")  # finds the structure of K_d, once
    methods: tuple[Any, ...] = ("classical", "bridge")
    runs = [
        rg.simulate(robot, v0=robot.recommended.v0, duration=0.02, step=1e-3, method=method, backend="python")
        for method in methods
    ]
    counts = [
        {n: getattr(run.stats, n) for n in (*RARE, *CONSTRAINT, "rhs", "force_evaluations")} for run in runs
    ]
    assert counts[0] == counts[1]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)


def test_a_crossing_costs_once() -> None:
    """One bridge, one second-order analysis and a few singular values, however long the motion is."""
    for name in ("through a crossing", "two coordinates, through a crossing", "everything on"):
        cost = cost_of(name)
        assert cost.crossings == 1
        assert cost.stats.bridges_built == cost.stats.second_order == cost.calls["2nd order"] == 1
        for_reactions = cost.calls["multipliers"]  # one of K for each λ, whose rank it decides
        # one for each point that a bridge is built from: six nodes, the steps to them, two held-out points
        assert 0 < cost.calls["SVD"] - for_reactions <= 30
        assert cost.stats.zone_evaluations > 0
        assert cost.stats.refined_steps == 0


def test_everything_on_is_everything() -> None:
    everything = nonzero(cost_of("everything on")) | {"CRBA", "refined_steps"}  # for m > 1; without a bridge
    everything |= {"newton_iterations"}  # none where modes are straight and predictions exact
    assert everything == {*RARE, *CONSTRAINT, "force_evaluations", *PARTS}


def test_a_change_of_coordinates_is_counted() -> None:
    assert len(cost_of("the coordinate turns back: repartition").stats.repartitions) == 1


def test_coordinates_of_a_tree_in_another_order() -> None:
    """The motion does not depend on the order in which the independent joints are named."""
    plain, turned = rg.load("flyball"), rg.load("flyball", ["s", "alpha2", "shaft", "alpha1"])
    v0 = [6.28, 0.0, 0.1, 0.0]
    motions = [rg.simulate(m, v0=v0, duration=2e-3, step=1e-4) for m in (plain, turned)]
    assert np.abs(motions[0].q - motions[1].q).max() < 1e-12
    assert motions[1].v[0].tolist() == v0


# --------------------------------------------------------------------------- import


def test_import_time_is_told_by_package() -> None:
    shares = import_milliseconds(rounds=1)
    assert list(shares) == [*SHARES, "others"]
    assert min(shares[name] for name in ("robust_gcp", "pinocchio", "numpy")) > 0.0


# --------------------------------------------------------------------------- command


def test_the_command_renews_the_document(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = list(SCENES)[:2]
    monkeypatch.setattr("robust_gcp.reports.costs.SCENES", {name: SCENES[name] for name in names})
    monkeypatch.setattr("robust_gcp.reports.costs.FAR", {"a four-bar": FAR["a four-bar"]})
    document = tmp_path / "costs.md"
    begin, end = (f"<!-- {side}: costs -->\n" for side in ("begin", "end"))
    document.write_text(f"before\n{begin}old\n{end}after\n", encoding="utf-8")
    words = ["reports", "costs", "--quick", "--out", str(tmp_path / "out"), "--refresh", str(document)]
    assert main(words) == 0
    table = (tmp_path / "out" / "costs.md").read_text(encoding="utf-8")
    assert document.read_text(encoding="utf-8") == f"before\n{begin}\n{table}\n{end}after\n"
    assert table in capsys.readouterr().out
    figures = json.loads((tmp_path / "out" / "costs.json").read_text(encoding="utf-8"))
    assert set(figures["method"]) == {"a four-bar"}
    assert [scene["scene"] for scene in figures["scenes"]] == names
    document.write_text("no marks", encoding="utf-8")
    assert main(words) == 2
    assert "no marks of a block named costs" in capsys.readouterr().err


def test_the_document_has_every_scene() -> None:
    document = Path(__file__).parents[2] / "docs" / "costs.md"
    text = document.read_text(encoding="utf-8")
    assert all(f"| {name} |" in text for name in SCENES)
