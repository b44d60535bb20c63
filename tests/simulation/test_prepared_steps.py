"""Steps that the kernel takes one after the other by a prepared call: the same motion, counts and record."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.simulation.runs.stepped import SteppedRun

from ..compiled import needs_kernel

pytestmark = needs_kernel

STEP = 2.0**-8

CALLS = 30
"""Python's calls a step: 83 µs were 170 of them."""


def stepped(name: str, backend: Any, steps: int, record: Any = ("a", "energy", "tau")) -> rg.Simulation:
    """A motion under a torque that changes with each step, and every third time with none of them."""
    mech = rg.load(name)
    sim = rg.Simulation(mech, step=STEP, backend=backend, record=record)
    for k in range(steps):
        sim.step(2.0 * np.cos(np.arange(mech.nv) + (k - k % 3)))
    return sim


@pytest.mark.parametrize("name", ["crank_rocker", "five_bar", "delta", "rhombus"])
def test_torques_by_the_step_in_both_backends(name: str) -> None:
    """Through the rhombus' flat positions too; accelerations are those under the torque of the next step."""
    found, wanted = (stepped(name, backend, 60).trajectory for backend in ("native", "python"))
    for item in ("q", "v"):
        np.testing.assert_allclose(getattr(found, item), getattr(wanted, item), rtol=1e-9, atol=1e-11)
    for item in ("a", "energy", "tau", "work"):
        np.testing.assert_allclose(getattr(found, item), getattr(wanted, item), rtol=1e-7, atol=1e-8)
    assert [c.time for c in found.crossings] == pytest.approx([c.time for c in wanted.crossings], abs=1e-10)
    assert found.stats.rhs == wanted.stats.rhs
    assert found.stats.native_steps >= 50


def test_what_was_computed_is_counted_once() -> None:
    """Step by step, and looked at on the way, as all at once."""
    counts = []
    for sizes in ([60], [1] * 60, [7, 3, 50]):
        sim = rg.Simulation(rg.load("rhombus"), [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0], STEP)
        for n in sizes:
            sim.step(n=n)
            assert sim.trajectory.t[-1] == sim.t
        stats = sim.trajectory.stats
        counts.append((stats.rhs, stats.newton_iterations, stats.native_steps, stats.bridges_built))
        assert len(sim.crossings) == 1
    assert counts[0] == counts[1] == counts[2]


def test_a_look_at_the_motion_changes_nothing() -> None:
    """What steps left behind may be taken over after each of them, or after all."""
    ends = []
    for looks in (False, True):
        sim = rg.Simulation(rg.load("rhombus"), [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0], STEP)
        for _ in range(60):
            sim.step([0.3, 0.1, -0.2])
            if looks:
                sim.save()
        ends.append(np.concatenate([sim.q, sim.v]))
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("tau", ["none", "held", "new"])
def test_few_calls_of_python_a_step(tau: str) -> None:
    mech = rg.load("crank_rocker")
    sim, torques = rg.Simulation(mech), [np.full(mech.nv, 1e-3 * (k % 2 or tau == "held")) for k in range(40)]
    sim.step()
    sim.step(torques[0])
    calls = 0

    def count(frame: Any, event: str, arg: Any) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        for torque in torques:
            sim.step(None if tau == "none" else torque)
    finally:
        sys.setprofile(None)
    assert calls / len(torques) < CALLS


def test_rows_left_open_are_noticed_at_each_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where rows of φ are redundant all of them are looked at, step by step as in a run."""
    seen = []
    look = SteppedRun._watch

    def watch(run: Any, q: Any, i: int) -> None:
        seen.append(i)
        look(run, q, i)

    monkeypatch.setattr(SteppedRun, "_watch", watch)
    sim = rg.Simulation(rg.load("bricard"), step=STEP)
    for _ in range(10):
        sim.step()
    assert seen == list(range(11))


@pytest.mark.filterwarnings("ignore::robust_gcp.SingularityWarning")
def test_a_step_that_fails_leaves_what_came_before() -> None:
    """At a toggle that classical GCP cannot pass: record and state end where the motion did."""
    sim = rg.Simulation(rg.load("slider_crank").with_independent(["q3"]), step=2e-3, method="classical")
    steps = 0
    with pytest.raises(rg.SimulationError) as caught:
        for _ in range(2000):
            sim.step({"q1": 5.0})
            steps += 1
    run = caught.value.trajectory
    assert run is not None
    assert len(run.t) == steps + 1
    assert run.t[-1] == sim.t
