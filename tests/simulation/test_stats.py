"""Counters tell what was done: counted here beside them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.six_bars import watt
from robust_gcp.maps.cluster.regular_ground import POOR
from robust_gcp.mechanism.tree.tree import Tree
from robust_gcp.simulation.runs.recovery import Recovery


class Counted:
    """A function that counts its calls."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.calls = function, 0

    def __call__(self, *args: Any, **options: Any) -> Any:
        self.calls += 1
        return self.function(*args, **options)


@pytest.mark.parametrize("name", ("crank_rocker", "andrews", "bricard", "strandbeest"))
def test_every_singular_value_decomposition_is_counted(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mech = rg.load(name)
    rg.simulate(mech, duration=2e-3, step=1e-3, backend="python")  # what is kept with the mechanism is made
    counted = Counted(np.linalg.svd)
    for used in ("svd", "pinv", "matrix_rank", "cond"):
        monkeypatch.setattr(np.linalg, used, counted if used == "svd" else pytest.fail)
    stats = rg.simulate(mech, duration=5e-3, step=1e-3, backend="python").stats
    assert stats.svds == counted.calls
    assert stats.svds == (1 if mech.nc > mech.nv - mech.m else 0)


def test_nothing_is_evaluated_that_is_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """K is placed once for each evaluation that a regular run counts, and a few times at its start."""
    mech = rg.load("bricard")  # closed by frames: every evaluation is NumPy's
    rg.simulate(mech, duration=2e-3, step=1e-3, backend="python")
    placed = Counted(Tree.jacobians)
    monkeypatch.setattr(Tree, "jacobians", lambda tree, q: placed(tree, q))
    runs = []
    for steps in (10, 30):
        before = placed.calls
        stats = rg.simulate(mech, duration=steps * 1e-4, step=1e-4, backend="python").stats
        runs.append((placed.calls - before, stats.constraint_evaluations))
    assert runs[1][0] - runs[0][0] == runs[1][1] - runs[0][1]


@pytest.mark.parametrize("backend", ("python", "auto"))
def test_points_on_a_bridge_are_no_checkpoints(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that has to go back returns to a state that K_d determines well, whoever took the steps.

    As well as it did anywhere, where it never did better: from 0.15 at the start the rhombus falls flat.
    """
    safe: list[float] = []

    def watched(recovery: Recovery, name: str, value: Any) -> None:
        object.__setattr__(recovery, name, value)
        if name == "safe":
            safe.append(value.point.conditioning)

    monkeypatch.setattr(Recovery, "__setattr__", watched)
    q0 = 0.3 * np.array([1.0, -1.0, 1.0])
    mech = rg.load("rhombus")
    assert rg.simulate(mech, q0, mech.lift(q0, [-3.0]), 0.5, 1e-3, backend=backend).crossings
    well = next(i for i, conditioning in enumerate(safe) if conditioning >= POOR)
    assert min(safe[:well]) >= 0.8 * safe[0] > 0.05
    assert min(safe[well:]) >= POOR


@pytest.mark.parametrize("backend", ("python", "auto"))
def test_links_that_are_never_conditioned_well_are_refined_near_an_obstacle_alone(backend: str) -> None:
    """K_d of a Watt linkage is conditioned by 0.12 at best: it goes back to where it was 0.1."""
    mech = watt()
    run = rg.simulate(mech, v0=mech.lift(mech.home, [3.0]), duration=0.4, step=1e-3, backend=backend)
    ((begun, ended),) = run.stats.refined
    assert 0.25 < begun < 0.35 and ended == 0.4
    assert run.stats.refined_steps == round((ended - begun) / 1e-3)
    assert run.closure_error().max() < 1e-12
