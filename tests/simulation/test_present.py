"""`Simulation` at a step: what is there, by name; wrenches, events, states that are pickled."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

from ..compiled import needs_kernel

BACKENDS = ("python", pytest.param("native", marks=needs_kernel))
EVERYTHING = ("a", "energy", "multipliers", "tau")


def push(t: float, q: Any, v: Any) -> list[float]:
    return [0.0, 2.0 * np.cos(3.0 * t), -1.0 + 0.1 * v[0], 0.0, 0.0, 0.0]


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_there_at_a_step_is_what_a_run_records(backend: Any) -> None:
    """Names, numbers and forces in joints of a held run, at every step."""
    linkage, wrench = rg.load("crank_rocker"), rg.Wrench("coupler_tip", push)
    held = {"torque": lambda t, q, v: [np.sin(t), 0.0, 0.0], "wrenches": [wrench], "hold": True}
    run = rg.simulate(linkage, duration=0.05, step=5e-3, record=EVERYTHING, backend=backend, **held)
    sim = rg.Simulation(linkage, step=5e-3, wrenches=[wrench], record=EVERYTHING, backend=backend)
    for i in range(10):
        sim.step({"q1": float(np.sin(sim.t))})
        np.testing.assert_allclose(sim.q, run.q[i + 1], rtol=0.0, atol=1e-15)
    recorded = sim.trajectory
    names = set(run.columns())
    assert set(sim.now.columns()) == names
    for name in names:
        assert sim[name] == pytest.approx(recorded[name][-1], abs=1e-12), name
    assert sim.energy == pytest.approx(linkage.energy(sim.q, sim.v), abs=1e-12)
    np.testing.assert_allclose(sim.a, recorded.a[-1], rtol=0.0, atol=1e-12)
    for joint in ("q1", "q3", 0):
        one, other = sim.reaction(joint), recorded.reaction(joint)
        np.testing.assert_allclose(one.force, other.force[-1], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(one.moment, other.moment[-1], rtol=0.0, atol=1e-9)
    for what in ("position", "velocity", "acceleration", "angular_velocity"):
        last = getattr(recorded.frame("coupler_tip"), what)[-1]
        np.testing.assert_allclose(getattr(sim.frame("coupler_tip"), what), last, rtol=0.0, atol=1e-12)
    with pytest.raises(rg.OptionError, match="q7"):
        sim["q7"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_work_is_told_beside_stops_too(backend: Any) -> None:
    crank = rg.load("slider_crank")
    joints = [rg.Stop("q3", upper=float(crank.home[2]) + 0.01, restitution=0.4), rg.JointFriction("q1", 0.1)]
    sim = rg.Simulation(crank, None, crank.lift(crank.home, [-4.0]), joints=joints, backend=backend)
    for k in range(60):
        sim.step({"q1": float(np.sin(0.1 * k))})
    assert sim.happenings
    for name, values in sim.trajectory.columns().items():
        if name != "t":
            assert sim[name] == pytest.approx(values[-1], abs=1e-12), name


@pytest.mark.parametrize("backend", BACKENDS)
def test_wrenches_are_asked_once_a_step(backend: Any) -> None:
    asked: list[float] = []

    def counted(t: float, q: Any, v: Any) -> list[float]:
        asked.append(t)
        return push(t, q, v)

    wrench = rg.Wrench("coupler_tip", counted)
    rg.Simulation(rg.load("rhombus"), step=1e-2, wrenches=[wrench], backend=backend).step(n=7)
    np.testing.assert_allclose(asked, 1e-2 * np.arange(7), atol=1e-15)
    constant = rg.Wrench("coupler_tip", [0.0, 1.0, 2.0, 0.0, 0.0, 0.0])
    sim = rg.Simulation(rg.load("rhombus"), step=1e-3, wrenches=[constant], backend=backend).step(n=50)
    run = rg.simulate(rg.load("rhombus"), duration=0.05, step=1e-3, wrenches=[constant], hold=True)
    np.testing.assert_allclose(sim.q, run.q[-1], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("keep", ["all", "last", 3])
@pytest.mark.parametrize("backend", BACKENDS)
def test_events_are_those_of_a_run(backend: Any, keep: Any) -> None:
    """Through crossings, whatever is kept; a terminal one ends the simulation where it ends a run."""
    linkage = rg.load("rhombus")
    low = rg.Event(lambda t, q, v: q[0] + 2.0)
    still = rg.Event(lambda t, q, v: v[0], terminal=2)
    run = rg.simulate(linkage, duration=5.0, step=5e-3, events=[low, still])
    sim = rg.Simulation(linkage, step=5e-3, events=[low, still], backend=backend, keep=keep)
    saved = None
    while sim.ended_by is None:
        sim.step(n=37)
        if saved is None and sim.t > 1.0:
            saved = sim.save()
    for _ in range(2):
        assert sim.ended_by == run.ended_by == 1
        assert sim.t == pytest.approx(run.t[-1], abs=1e-12)
        np.testing.assert_allclose(sim.q, run.q[-1], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(sim.v, run.v[-1], rtol=0.0, atol=1e-9)
        for found, wanted in zip(sim.t_events, run.t_events, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-11)
        assert (
            [len(q) for q in sim.q_events] == [len(v) for v in sim.v_events] == [len(t) for t in sim.t_events]
        )
        assert len(sim.crossings) == len(run.crossings)
        np.testing.assert_allclose(sim.a, sim.now.a)
        assert sim.trajectory.t[-1] == sim.t
        with pytest.raises(rg.OptionError, match="event 1 ended this simulation"):
            sim.step()
        assert saved is not None
        sim.restore(saved)
        assert sim.ended_by is None
        while sim.ended_by is None:
            sim.step(n=11)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_pickled_state_leads_any_simulation_on(backend: Any) -> None:
    """To rounding: on regular ground, in a zone, and at a singular start on its mode."""
    linkage = rg.load("change_point")
    sim = rg.Simulation(linkage, v0=linkage.recommended.v0, step=2e-3, backend=backend)
    for _ in range(30):
        state = pickle.loads(pickle.dumps(sim.save()))
        again = rg.Simulation(linkage, step=2e-3, backend=backend).restore(state)
        assert again.t == sim.t
        sim.step(n=10)
        again.step(n=10)
        np.testing.assert_allclose(again.q, sim.q, rtol=0.0, atol=1e-9)
    flat = rg.load("rhombus")
    for mode in rg.analyse(flat, [0.0, 0.0, 0.0]).modes:
        sim = rg.Simulation(flat, [0.0, 0.0, 0.0], 2.0 * mode, mode=mode, backend=backend)
        again = rg.Simulation(flat, backend=backend).restore(pickle.loads(pickle.dumps(sim.save())))
        np.testing.assert_allclose(again.step(n=50).q, sim.step(n=50).q, rtol=0.0, atol=1e-12)
    other = rg.Simulation(rg.load("five_bar"), backend=backend)
    with pytest.raises(rg.OptionError, match="joints"):
        other.restore(pickle.loads(pickle.dumps(sim.save())))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_pickled_state_leads_on_in_its_own_coordinates(backend: Any) -> None:
    """To rounding, not only to the step's error, where coordinates were changed before it was saved."""
    arms = rg.load("five_bar")
    v0 = arms.G(arms.home) @ [3.0, -3.0]
    sim = rg.Simulation(arms, arms.home, v0, step=4e-3, backend=backend).step(n=115)
    *_, (_, names) = sim.trajectory.stats.repartitions
    assert names != arms.independent
    state = pickle.loads(pickle.dumps(sim.save()))
    again = rg.Simulation(arms, step=4e-3, backend=backend).restore(state).step(n=30)
    sim.step(n=30)
    np.testing.assert_allclose(again.q, sim.q, rtol=0.0, atol=1e-12)
    assert again.trajectory.stats.repartitions[0] == (pytest.approx(0.46), names)
    for kind in ({"joints": [rg.Stop("q1", lower=-50.0)]}, {"keep": 7}):  # theirs, to the step's error
        other = rg.Simulation(arms, step=4e-3, backend=backend, **kind)  # type: ignore[arg-type]
        np.testing.assert_allclose(other.restore(state).step(n=30).q, sim.q, rtol=0.0, atol=1e-6)
