"""Coordinates look after themselves: changed before a step, cluster by cluster, at full order."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import families, linkages

CRANK_ROCKER = (4.0, 1.0, 3.0, 3.5)
BACKENDS = ["python", pytest.param("native", marks=pytest.mark.skipif(
    not rg.backends()["native"].available, reason="no compiled kernel"))]  # fmt: skip
backends = pytest.mark.parametrize("backend", BACKENDS)


def straight_kite() -> tuple[rg.Mechanism, list[float]]:
    """Links 2 and 3 stretched: l0 = l1 = 2 subtend 2 sin(π/6) · 2 = l2 + l3 at q1 = π/3."""
    tilt = -np.pi / 3
    return rg.load("kite"), [np.pi / 3, tilt - np.pi / 3, tilt + np.pi]


@backends
def test_a_rocker_as_coordinate_keeps_the_cranks_error_and_order(backend: Any) -> None:
    """Against the closed form; the coordinate turns back twice in each turn of the crank."""
    crank = linkages.four_bar(*CRANK_ROCKER, y=0.5)
    v0 = crank.lift(crank.home, [6.0])
    rocker = crank.with_independent(["q3"])
    exact = rg.simulate(
        crank, v0=v0, duration=1.5, step=2e-2, method="closed_form", stepper="DOP853", rtol=1e-13, atol=1e-13
    )
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        run = rg.simulate(rocker, v0=v0, duration=1.5, step=step, backend=backend)
        floor = rg.simulate(crank, v0=v0, duration=1.5, step=step, method="closed_form")
        every = round(2e-2 / step)
        errors.append(np.abs(run.q[::every] - exact.q).max())
        assert run.stats.repartitions
        assert run.stats.refined_steps == 0
        assert errors[-1] < 1.5 * np.abs(floor.q[::every] - exact.q).max()
        np.testing.assert_array_equal(run.y[:, 0], run.q[:, 2])
    for coarse, fine in itertools.pairwise(errors):
        assert 3.6 < np.log2(coarse / fine) < 5.2


@backends
def test_links_that_fly_by_err_no_more_than_in_coordinates_that_do_not_turn(backend: Any) -> None:
    linkage = linkages.four_bar(1.0, 1.2, 1.4, 0.7, y=1.5)
    exact = {"stepper": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    before = rg.simulate(linkage, v0=linkage.lift(linkage.home, [3.0]), duration=0.32, step=1e-3, **exact)
    start = before.q[-1], before.v[-1]
    end = rg.simulate(linkage, *start, duration=0.032, step=1e-3, **exact).q[-1]
    for step in (2e-3, 5e-4):
        run = rg.simulate(linkage, *start, duration=0.032, step=step, backend=backend)
        assert [names for _, names in run.stats.repartitions] == [("q2",), ("q1",)]
        others = [
            rg.simulate(linkage.with_independent([name]), *start, 0.032, step, on_toggle="error")
            for name in ("q2", "q3")
        ]
        assert np.abs(run.q[-1] - end).max() < min(np.abs(other.q[-1] - end).max() for other in others)


@backends
def test_only_the_cluster_that_turns_back_is_changed(backend: Any) -> None:
    both = families.four_bars([CRANK_ROCKER] * 2, (0.5, 1.0))
    named = ("rocker0", "crank1")
    run = rg.simulate(
        both.with_independent(named),
        v0=both.lift(both.home, [5.0, 5.0]),
        duration=1.5,
        step=2e-3,
        backend=backend,
    )
    assert run.stats.repartitions
    assert all(names[1] == "crank1" for _, names in run.stats.repartitions)
    reference = rg.simulate(both, v0=both.lift(both.home, [5.0, 5.0]), duration=1.5, step=2e-3)
    assert not reference.stats.repartitions
    assert np.abs(run.q - reference.q).max() < 1e-7


def test_backends_change_at_the_same_times() -> None:
    linkage = linkages.four_bar(1.0, 1.2, 1.4, 0.7, y=1.5)
    v0 = linkage.lift(linkage.home, [3.0])
    runs = [rg.simulate(linkage, v0=v0, duration=1.5, step=1e-3, backend=b) for b in ("python", "auto")]
    changes = [run.stats.repartitions for run in runs]
    assert [names for _, names in changes[0]] == [names for _, names in changes[1]]
    for (t, _), (other, _) in zip(*changes, strict=True):
        whole = round(t, 3)  # else within a refined step, where error control feels rounding
        assert other == t if abs(t - whole) < 1e-12 else other == pytest.approx(t, abs=1e-6)
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-10


@backends
@pytest.mark.parametrize("stepper", ["rk4", "DOP853", "Radau"])
def test_a_start_at_a_toggle_begins_in_better_coordinates(backend: Any, stepper: str) -> None:
    if backend == "native" and stepper != "rk4":
        return
    kite, straight = straight_kite()
    v0 = kite.with_independent(["q2"]).lift(straight, [1.0])
    options = {"v0": v0, "duration": 0.5, "step": 2e-3, "stepper": stepper, "rtol": 1e-10, "atol": 1e-12}
    run = rg.simulate(kite, straight, backend=backend, **options)
    other = rg.simulate(kite.with_independent(["q2"]), straight, **options)
    assert run.stats.repartitions[0][0] == 0.0
    assert run.mechanism is kite
    np.testing.assert_array_equal(run.y[:, 0], run.q[:, 0])
    assert np.abs(run.q - other.q).max() < 1e-7
    with pytest.raises(rg.ToggleError):
        rg.simulate(kite, straight, backend=backend, on_toggle="error", **options)


def test_a_mode_on_which_the_coordinate_rests_begins_in_another() -> None:
    """Rhombus, links 2 and 3 folded: two rods about the tip of link 1, whose coordinate q1 stays at 0."""
    rhombus = rg.load("rhombus")
    folded = next(t for t in rg.analyse(rhombus, np.zeros(3)).modes if t[0] == 0.0)
    run = rg.simulate(rhombus, np.zeros(3), mode=folded, duration=0.5, step=2e-3)
    other = rg.simulate(rhombus.with_independent(["q2"]), np.zeros(3), mode=folded, duration=0.5, step=2e-3)
    assert run.stats.repartitions[0][0] == 0.0
    assert np.abs(run.q - other.q).max() < 1e-9
    assert np.abs(run.y).max() < 1e-12


@backends
def test_step_by_step_through_changes_to_the_last_bit(backend: Any) -> None:
    rocker = linkages.four_bar(*CRANK_ROCKER, y=0.5).with_independent(["q3"])
    crank = rocker.with_independent(["q1"])
    v0 = crank.lift(crank.home, [6.0])
    run = rg.simulate(rocker, v0=v0, duration=1.0, step=2e-3, backend=backend)
    sim = rg.Simulation(rocker, v0=v0, step=2e-3, backend=backend)
    states = []
    for _ in range(100):
        states.append(sim.save())
        sim.step(n=5)
    assert len(run.stats.repartitions) >= 1
    np.testing.assert_array_equal(sim.trajectory.q, run.q)
    for state, k in zip(states[::20], range(0, 500, 100), strict=True):
        sim.restore(state).step(n=500 - k)
        np.testing.assert_array_equal(sim.trajectory.q, run.q)
    kite, straight = straight_kite()
    assert rg.Simulation(kite, straight, step=2e-3, backend=backend).step(n=10).t == pytest.approx(0.02)


def test_good_coordinates_cost_nothing() -> None:
    """Where they are good nothing is computed; six coordinates with large entries of J are looked at once."""
    for name, looks in (("crank_rocker", 0), ("strandbeest", 0), ("stewart", 1)):
        mechanism = rg.load(name)
        runs = [
            rg.simulate(mechanism, duration=0.05, step=1e-3, on_toggle=what)
            for what in ("repartition", "error")
        ]
        stats = [run.stats for run in runs]
        assert stats[0].svds == stats[1].svds + looks
        assert (stats[0].rhs, stats[0].repartitions) == (stats[1].rhs, [])
        np.testing.assert_array_equal(runs[0].q, runs[1].q)
