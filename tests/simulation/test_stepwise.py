"""One step at a time: the digits of a whole run, and the way back to a saved state."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages

from ..compiled import needs_kernel

START = [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0]
STEP = 2.0**-8
"""Its multiples are exact."""

TAU = [0.3, 0.1, -0.2]


@pytest.fixture(params=["python", "native"])
def backend(request: pytest.FixtureRequest) -> Any:
    if request.param == "native" and not rg.backends()["native"].available:
        pytest.skip(f"no compiled kernel: {rg.backends()['native'].reason}")
    return request.param


def same(a: rg.Trajectory, b: rg.Trajectory) -> None:
    for name in ("t", "q", "v", "a", "energy", "multipliers"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    assert [c.time for c in a.crossings] == [c.time for c in b.crossings]
    for c, d in zip(a.crossings, b.crossings, strict=True):
        np.testing.assert_array_equal(c.q, d.q)


@pytest.mark.parametrize("method", ["bridge", "projection", "closed_form"])
@pytest.mark.parametrize("tau", [TAU, None])
def test_the_digits_of_a_whole_run(backend: Any, method: Any, tau: Any) -> None:
    """Through the flat position, step by step or some at a time."""
    if backend == "native" and method != "bridge":
        pytest.skip("not a method of the kernel's")
    record = ("a", "energy", "multipliers")
    run = rg.simulate(
        rg.load("rhombus"), *START, 0.5, STEP, method, torque=tau, record=record, backend=backend
    )
    assert run.crossings or method == "closed_form"  # which passes through without a word
    for sizes in ([1] * 128, [1, 7, 60, 60]):
        sim = rg.Simulation(rg.load("rhombus"), *START, STEP, method, backend, record=record)
        for n in sizes:
            assert sim.step(tau, n=n) is sim
        same(sim.trajectory, run)
        assert sim.t == 0.5
        np.testing.assert_array_equal(sim.q, run.q[-1])
        np.testing.assert_array_equal(sim.v, run.v[-1])
        np.testing.assert_array_equal(sim.y, run.y[-1])


def test_steps_taken_once_more_with_error_control_have_the_torques_that_they_had(backend: Any) -> None:
    """Past a near miss, under a torque that is held over each step: as a solver goes from step to step."""
    mech = linkages.four_bar(1.0, 1.0, 1.0, 1.001, y=np.pi - 0.4)
    q, v, h = mech.home, mech.lift(mech.home, [4.0]), 5e-3

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([3.0 * np.sin(60.0 * t), 0.0, 0.0])

    run = rg.simulate(
        mech, v0=v, duration=0.25, step=h, torque=torque, hold=True, record=["tau"], backend=backend
    )
    assert run.stats.refined_steps > 10
    np.testing.assert_array_equal(run.tau[:-1], [torque(t, q, v) for t in run.t[:-1]])
    for t in run.t[:-1]:
        held = torque(t, q, v)
        tight = {"stepper": "DOP853", "rtol": 1e-11, "atol": 1e-13}
        piece = rg.simulate(mech, q, v, h, h, torque=held, backend=backend, **tight)
        q, v = piece.q[-1], piece.v[-1]
    assert np.abs(run.q[-1] - q).max() < 1e-5  # RK4 before and after the near miss


def test_torques_that_change_are_runs_one_after_the_other(backend: Any) -> None:
    """Held over a step, by array or by name; the whole is made of pieces to rounding."""
    mech = rg.load("crank_rocker")
    sim = rg.Simulation(mech, step=STEP, backend=backend)
    q, v = mech.home, np.zeros(mech.nv)
    for k in range(20):
        torque = 3.0 * np.sin(k)
        sim.step({"q1": torque}, n=4)
        piece = rg.simulate(mech, q, v, 4 * STEP, STEP, torque={"q1": torque}, backend=backend)
        q, v = piece.q[-1], piece.v[-1]
        np.testing.assert_allclose(sim.q, q, atol=1e-12)
        np.testing.assert_allclose(sim.v, v, atol=1e-11)
    work = sim.trajectory.work
    assert work is not None
    assert np.abs(sim.trajectory.energy_error()).max() < 1e-7


def test_torques_are_held_again_where_steps_are_taken_again(backend: Any) -> None:
    """Coordinates that turn back are changed after a return over many steps; the motion stays what it is."""
    mech, found = rg.load("slider_crank"), []
    for independent in (["q1"], ["q3"]):
        sim = rg.Simulation(mech.with_independent(independent), mech.home, step=2e-3, backend=backend)
        for k in range(500):
            sim.step({"q1": 30.0 * np.sin(0.1 * k) + 10.0})
        found.append(sim.trajectory)
    assert found[1].stats.repartitions
    np.testing.assert_allclose(found[1].q, found[0].q, atol=1e-9)


def test_many_steps(backend: Any) -> None:
    """Beyond the room that there is at first."""
    sim = rg.Simulation(rg.load("crank_rocker"), step=STEP, backend=backend).step(n=1000).step(n=50)
    run = rg.simulate(rg.load("crank_rocker"), duration=1050 * STEP, step=STEP, backend=backend)
    np.testing.assert_array_equal(sim.trajectory.q, run.q)


@pytest.mark.parametrize("before", [3, 23, 27, 60])
def test_back_to_the_last_bit(backend: Any, before: int) -> None:
    """From before, on and behind the bridge at the flat position, as often as one likes, in any order."""
    sim = rg.Simulation(rg.load("rhombus"), *START, STEP, backend=backend, record=("a",))
    sim.step(TAU, n=before)
    early = sim.save()
    sim.step(TAU, n=60)
    late, there, path = sim.save(), sim.q, sim.trajectory
    sim.step([1.0, 0.0, 0.0], n=20)
    for _ in range(2):
        assert sim.restore(early).t == before * STEP
        sim.step(None, n=9)
        sim.restore(early).step(TAU, n=60)
        np.testing.assert_array_equal(sim.q, there)
        np.testing.assert_array_equal(sim.trajectory.q, path.q)
        np.testing.assert_array_equal(sim.trajectory.a, path.a)
        assert [c.time for c in sim.crossings] == [c.time for c in path.crossings]
    sim.restore(late)
    np.testing.assert_array_equal(sim.q, there)
    np.testing.assert_array_equal(sim.trajectory.q, path.q)


def test_what_was_given_out_stays() -> None:
    sim = rg.Simulation(rg.load("rhombus"), *START, STEP)
    sim.step(n=5)
    state, run, q = sim.save(), sim.trajectory, sim.q
    kept = run.q.copy()
    q[:] = 9.0
    sim.step(TAU, n=5)
    sim.restore(state).step(TAU)
    np.testing.assert_array_equal(run.q, kept)
    np.testing.assert_array_equal(sim.trajectory.q[:6], kept)


@pytest.mark.parametrize("backend", ["python", "auto"])
def test_a_state_leads_back_the_simulation_that_saved_it_alone(backend: Any) -> None:
    mech = rg.load("rhombus")
    sim, twin = (rg.Simulation(mech, *START, backend=backend) for _ in range(2))
    other = rg.Simulation(rg.load("crank_rocker"), backend=backend)
    state = sim.step(n=5).save()
    for stranger in (twin, other, rg.Simulation(mech, *START, step=2e-3, backend=backend)):
        before = stranger.q
        with pytest.raises(rg.OptionError, match=r"another simulation .*rhombus"):
            stranger.restore(state)
        np.testing.assert_array_equal(stranger.q, before)
    assert copy.deepcopy(state) is state
    assert sim.step().restore(state).t == 5e-3
    with pytest.raises(rg.OptionError, match="cannot be copied or pickled"):
        pickle.dumps(sim)
    with pytest.raises(rg.OptionError, match="for another one from here"):
        copy.deepcopy(sim)


def test_what_cannot_be_stepped_is_refused() -> None:
    mech = rg.load("rhombus")
    sim = rg.Simulation(mech, *START)
    for n in (0, -1, 1.5, True, "two"):
        with pytest.raises(rg.OptionError, match="n ="):
            sim.step(n=n)  # type: ignore[arg-type]
    for tau in ([1.0], {"q9": 1.0}, "much", [np.nan] * 3):
        with pytest.raises(rg.StateError, match="tau"):
            sim.step(tau)
    assert sim.t == 0.0
    with pytest.raises(rg.OptionError, match="save"):
        sim.restore({"t": 0.0})
    with pytest.raises(rg.OptionError, match="step"):
        rg.Simulation(mech, step=0.0)
    with pytest.raises(rg.OptionError, match="Mechanism"):
        rg.Simulation("rhombus")  # type: ignore[arg-type]


def test_a_prescribed_motion_step_by_step() -> None:
    """The digits of a whole run, the torque that the motion takes, and a torque beside it."""
    turn, step = {"q1": rg.Motion(lambda t: 1.0 + 2.0 * (t - 3.0) ** 2)}, 2.0**-7
    mech = rg.load("slider_crank")
    run = rg.simulate(mech, None, None, 0.5, step, drive=turn, t0=3.0, record=("a",), torque={"q3": 4.0})
    sim = rg.Simulation(mech, step=step, drive=turn, t0=3.0, record=("a",))
    for _ in range(32):
        sim.step({"q3": 4.0}, n=2)
    assert sim.t == 3.5
    found = sim.trajectory
    for name in ("t", "q", "v"):
        np.testing.assert_array_equal(getattr(found, name), getattr(run, name), err_msg=name)
    np.testing.assert_allclose(found["drive.q1"], run["drive.q1"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.q[0], 1.0 + 2.0 * 0.25, atol=1e-14)
    state = sim.save()
    sim.step(n=5)
    end = sim.restore(state).step(n=5).q
    np.testing.assert_array_equal(end, sim.q)


def test_what_is_not_driven_is_free() -> None:
    """Two degrees of freedom, one of them driven: the energy of the other is accounted for."""
    mech = rg.load("five_bar")
    turn = rg.Motion(lambda t: float(mech.home[0]) + 0.1 * t)
    sim = rg.Simulation(mech, step=2e-3, drive={mech.independent[0]: turn})
    sim.step(n=100)
    assert np.abs(sim.trajectory.energy_error()).max() < 1e-6


def test_a_start_outside_of_the_region_of_stability_is_told_of() -> None:
    mech = rg.load("rhombus")
    stiff = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, ["q1"], mech.home, forces=[rg.JointDamper("q1", 1e5)]
    )
    with pytest.warns(rg.StabilityWarning, match="step = 0.01 s"):
        rg.Simulation(stiff, step=0.01)


def test_a_simulation_says_what_it_is() -> None:
    assert repr(rg.Simulation(rg.load("rhombus"), step=0.5**8).step(n=64)) == (
        "Simulation of 'rhombus': t = 0.25 s, step 0.00390625 s, 1 crossings"
    )


def test_a_new_beginning(backend: Any) -> None:
    """The digits of a new simulation, from home or elsewhere; what was saved before leads back."""
    mech = rg.load("rhombus")
    sim = rg.Simulation(mech, *START, STEP, backend=backend).step(TAU, n=60)
    there, state = sim.q, sim.save()
    for start in ((None, None), START):
        fresh = rg.Simulation(mech, *start, STEP, backend=backend)
        assert sim.reset(*start) is sim
        assert sim.t == 0.0
        assert not sim.crossings
        np.testing.assert_array_equal(sim.q, fresh.q)
        np.testing.assert_array_equal(sim.step(n=40).q, fresh.step(n=40).q)
    sim.reset().restore(state)
    np.testing.assert_array_equal(sim.q, there)
    np.testing.assert_allclose(
        sim.step(TAU, n=5).q, rg.Simulation(mech, *START, STEP).step(TAU, n=65).q, atol=1e-12
    )


def test_a_start_that_is_none_leaves_the_simulation_as_it_was(backend: Any) -> None:
    sim = rg.Simulation(rg.load("rhombus"), *START, STEP, backend=backend).step(TAU, n=3)
    state = sim.save()
    with pytest.raises(rg.ClosureError):
        sim.reset([0.3, 0.9, 0.1])
    ahead = sim.step(TAU, n=3).q
    np.testing.assert_array_equal(sim.restore(state).step(TAU, n=3).q, ahead)


@pytest.mark.parametrize("keep", ["last", "none", 1, 7, 3000])
@pytest.mark.parametrize("size", [1, 50, 2500])
@needs_kernel
def test_what_is_kept_does_not_change_the_motion(keep: Any, size: int) -> None:
    """Beyond the room that there is at first, crossings, torques that change, a saved state."""
    steps, record = 5000, ("a", "energy", "tau")
    whole = rg.Simulation(rg.load("rhombus"), *START, 1e-3, record=record)
    thin = rg.Simulation(rg.load("rhombus"), *START, 1e-3, record=record, keep=keep)
    torques = np.random.default_rng(1).uniform(-1.0, 1.0, (steps // size + 1, 3))
    half = len(torques) // 2

    def advance(sim: rg.Simulation, some: Any) -> None:
        for tau in some:
            sim.step(tau, n=min(size, steps))

    advance(whole, torques)
    advance(thin, torques[:half])
    saved = thin.save()
    a = whole.trajectory
    reached = len(a.t) - 1
    rows = list(range(0, reached + 1, keep)) if isinstance(keep, int) else []
    if keep != "none" and (not rows or rows[-1] != reached):
        rows.append(reached)
    for _ in range(2):
        advance(thin, torques[half:])
        b = thin.trajectory
        for name in ("t", "q", "v", "a", "tau", "work"):
            np.testing.assert_array_equal(getattr(b, name), getattr(a, name)[rows], err_msg=name)
        np.testing.assert_allclose(b.energy, a.energy[rows], rtol=1e-14)
        assert [c.time for c in a.crossings] == [c.time for c in b.crossings]
        assert (thin.t, len(a.crossings) > 1) == (whole.t, True)
        np.testing.assert_array_equal(thin.q, whole.q)
        np.testing.assert_array_equal(thin.v, whole.v)
        thin.restore(saved)


@pytest.mark.parametrize("keep", [100_000, "last", "none"])
def test_memory_stays_flat_where_nothing_is_kept(keep: Any) -> None:
    """Room for a thousand steps, whatever their number, torques included."""
    sim = rg.Simulation(rg.load("crank_rocker"), step=1e-3, keep=keep)
    sim.step([1.0, 0.0, 0.0], n=3000)
    room = len(sim._run.times)
    for i in range(100):
        sim.step([0.01 * i, 0.0, 0.0], n=97)
    assert len(sim._run.times) == room <= 2048
    assert len(sim._run._torques._values) <= room


@pytest.mark.parametrize("keep", ["some", 0, -1, 2.5, None, True])
def test_what_is_to_be_kept_is_checked(keep: Any) -> None:
    with pytest.raises(rg.OptionError, match="keep = "):
        rg.Simulation(rg.load("rhombus"), keep=keep)


def test_the_reference_keeps_as_much() -> None:
    runs = [rg.Simulation(rg.load("rhombus"), *START, 1e-3, backend="python", keep=k) for k in ("all", 100)]
    for sim in runs:
        sim.step(TAU, n=1100)
    a, b = (sim.trajectory for sim in runs)
    np.testing.assert_array_equal(b.q, a.q[::100])
    assert [c.time for c in a.crossings] == [c.time for c in b.crossings]
