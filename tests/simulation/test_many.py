"""Many starts of one mechanism: the motions of `simulate`, whatever the threads, and no error lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples.legged import legged
from robust_gcp.simulation.batches.many import Start

SAME = 1e-12


def starts_of(mech: rg.Mechanism, count: int = 6) -> list[Start]:
    rng = np.random.default_rng(3)
    return [(mech.home, mech.lift(mech.home, rng.normal(0.0, 0.5, mech.m))) for _ in range(count)]


def require_same(many: rg.Runs, mech: rg.Mechanism, starts: list[Start], **options: Any) -> None:
    assert len(many) == len(starts)
    for run, (q0, v0) in zip(many, starts, strict=True):
        one = rg.simulate(mech, q0, v0, **options)
        assert run is not None
        for name in ("t", "q", "v", "a", "energy", "multipliers", "work"):
            a, b = getattr(one, name), getattr(run, name)
            assert (a is None) == (b is None), name
            if a is not None:
                np.testing.assert_allclose(b, a, atol=(100.0 if name == "a" else 1.0) * SAME, rtol=SAME)
        assert [c.time for c in run.crossings] == pytest.approx([c.time for c in one.crossings], abs=SAME)
        assert run.stats.rhs == one.stats.rhs
        assert run.mechanism is mech


@pytest.mark.parametrize("threads", [1, np.int64(3)])
@pytest.mark.parametrize("name", ["crank_rocker", "five_bar", "stewart", "bricard"])
def test_each_start_moves_as_if_alone(name: str, threads: int) -> None:
    """A loop, two coordinates, dampers that do work, redundant rows."""
    mech = rg.load(name)
    options: dict[str, Any] = {"duration": 0.1, "step": 1e-3, "record": ("a", "energy")}
    starts = starts_of(mech)
    require_same(rg.simulate_many(mech, starts, threads=threads, **options), mech, starts, **options)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("name", ["crank_rocker", "five_bar", "rhombus"])
def test_many_go_side_by_side(name: str, threads: int) -> None:
    """As many as pay for steps that are compiled; the rhombus's pass singular places, one by one."""
    mech = rg.load(name)
    starts, torque = starts_of(mech, 260), {mech.independent[0]: 0.02}
    runs = rg.simulate_many(mech, starts, 0.4, 1e-3, threads=threads, torque=torque)
    assert not runs.errors and len(runs) == 260
    some = [0, 1, 2, 5, 77, 128, 258, 259]
    require_same(
        rg.Runs([runs[i] for i in some]),
        mech,
        [starts[i] for i in some],
        duration=0.4,
        step=1e-3,
        torque=torque,
    )
    if name == "rhombus":
        assert any(run.crossings for run in runs)


def test_floating_legs() -> None:
    mech = legged(3, floating=True)
    options: dict[str, Any] = {"duration": 0.05, "step": 1e-3}
    starts = starts_of(mech)
    far = mech.home.copy()
    far[:7] = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array([1.0, 2.0, 0.5])), np.array([3.0, 4.0, 5.0])))
    starts += [(far, v) for _, v in starts[:2]]
    require_same(rg.simulate_many(mech, starts, **options), mech, starts, **options)


@pytest.mark.parametrize("torque", [{"q1": 2.0}, lambda t, q, v: np.array([np.sin(t), 0.0, 0.0])])
def test_torques_act_on_every_start(torque: Any) -> None:
    mech = rg.load("crank_rocker")
    options: dict[str, Any] = {"duration": 0.1, "step": 1e-3, "torque": torque}
    starts = starts_of(mech)
    require_same(rg.simulate_many(mech, starts, **options), mech, starts, **options)


def test_crossings_multipliers_and_starts_at_singular_places() -> None:
    """What is not plain is left to `simulate`, with all that it finds."""
    mech = rg.load("rhombus")
    home = mech.assemble([1.2, -1.2, 1.2])
    starts: list[Start] = [(home, mech.lift(home, [u])) for u in (-6.0, 1.0, -5.0)]
    options: dict[str, Any] = {"duration": 0.5, "step": 2e-3, "record": ("multipliers",)}
    require_same(rg.simulate_many(mech, starts, **options), mech, starts, **options)
    del options["record"]
    runs = rg.simulate_many(mech, starts, **options)
    require_same(runs, mech, starts, **options)
    assert [len(run.crossings) > 0 for run in runs] == [True, False, True]
    flat = [(None, None), (np.zeros(3), None), (np.zeros(3), np.array([1.0, -1.0, 1.0]))]
    runs = rg.simulate_many(mech, [starts[1], *flat[1:]], **options)
    assert isinstance(runs.errors[1], rg.SingularStartError)
    assert runs.errors.keys() == {1}
    assert len(runs[2].t) == len(runs[0].t)


def test_errors_are_kept_by_start_and_stop_nothing() -> None:
    mech = rg.load("crank_rocker")
    good = starts_of(mech, 2)
    bad: list[Start] = [
        (mech.home + 1.0, None),
        (None, np.ones(3)),
        (np.zeros(2), None),
        (None, np.array([np.nan, 0.0, 0.0])),
    ]
    runs = rg.simulate_many(mech, [bad[0], good[0], *bad[1:], good[1]], 0.05, 1e-3)
    kinds = [type(runs.errors[i]).__name__ for i in sorted(runs.errors)]
    assert sorted(runs.errors) == [0, 2, 3, 4]
    assert kinds == ["ClosureError", "StateError", "StateError", "StateError"]
    assert [run is None for run in runs] == [True, False, True, True, True, False]
    require_same(rg.simulate_many(mech, good, 0.05, 1e-3), mech, good, duration=0.05, step=1e-3)
    assert "6 starts, 4 of them with errors" in repr(runs)


@pytest.mark.filterwarnings("ignore::robust_gcp.StabilityWarning")
def test_a_run_that_stops_keeps_what_it_did() -> None:
    mech = rg.load("slider_crank")
    fast = mech.lift(mech.home, [1e8])
    runs = rg.simulate_many(mech, [*starts_of(mech, 1), (mech.home, fast)], 0.05, 1e-3)
    assert isinstance(runs.errors[1], rg.SimulationError)
    assert runs[1] is runs.errors[1].trajectory
    assert runs[1] is not None
    assert len(runs[1].t) < len(runs[0].t)


def test_coarse_steps_are_warned_of() -> None:
    mech = rg.load("crank_rocker")
    starts = [(mech.home, mech.lift(mech.home, [u])) for u in (0.1, 40.0)]
    with pytest.warns(rg.CoarseStepWarning):
        rg.simulate_many(mech, starts, 0.4, 4e-2)


def test_refused() -> None:
    mech = rg.load("crank_rocker")
    with pytest.raises(rg.OptionError, match=r"starts\[1\]"):
        rg.simulate_many(mech, [(None, None), mech.home], 0.1)  # type: ignore[list-item]
    for threads in (0, 1.5, True):
        with pytest.raises(rg.OptionError, match="threads"):
            rg.simulate_many(mech, [(None, None)], 0.1, threads=threads)  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match="record"):
        rg.simulate_many(mech, [(None, None)], 0.1, record=("speed",))
    assert len(rg.simulate_many(mech, [], 0.1)) == 0
