"""When a run begins, what it records, when it asks for torques, and how it tells of its progress."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp import printing
from robust_gcp.dynamics.equations import EquationsOfMotion
from robust_gcp.examples.families import four_bars
from robust_gcp.simulation.runs.schedule import SAME, Schedule

from ..compiled import needs_kernel

Array = NDArray[np.float64]
START = [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0]
RECORD = ("a", "energy", "multipliers")


@pytest.fixture(params=["python", "native"])
def backend(request: pytest.FixtureRequest) -> Any:
    if request.param == "native" and not rg.backends()["native"].available:
        pytest.skip(f"no compiled kernel: {rg.backends()['native'].reason}")
    return request.param


def drift(t: float, q: Array, v: Array) -> Array:
    return np.array([0.3 * np.sin(4.0 * t), 0.0, -0.1 * float(v[2])])


def test_outputs_at_ends_of_steps_are_the_rows_of_a_whole_run(backend: Any) -> None:
    """Through the flat position; to the last digit."""
    whole = rg.simulate(rg.load("rhombus"), *START, 0.5, 1e-2, record=RECORD, backend=backend)
    few = rg.simulate(
        rg.load("rhombus"),
        *START,
        0.5,
        1e-2,
        record=RECORD,
        backend=backend,
        outputs=0.01 * np.array([0, 3, 17, 50]),
    )
    for name in ("q", "v", "a", "energy", "multipliers"):
        np.testing.assert_array_equal(getattr(few, name), getattr(whole, name)[[0, 3, 17, 50]], err_msg=name)
    assert [c.time for c in few.crossings] == [c.time for c in whole.crossings]
    np.testing.assert_array_equal(few.t, [0.0, 0.03, 0.17, 0.5])


@needs_kernel
@pytest.mark.parametrize("name", ["rhombus", "delta", "strandbeest"])
@pytest.mark.parametrize("more", [{}, {"torque": lambda t, q, v: -0.1 * v}, {"hold": True}])
def test_outputs_within_steps_are_the_kernels(name: str, more: dict[str, Any], monkeypatch: Any) -> None:
    """All that is recorded as in Python, the steps to the last bit as without them; Python sees the start."""
    mech, record = rg.load(name), (*RECORD, "tau")
    if "hold" in more:
        more = {"torque": {mech.independent[0]: lambda t, q, v: 0.1 * np.sin(9.0 * t)}, "hold": True}
    times = np.append(np.sort(np.random.default_rng(5).uniform(0.0, 0.1, 60)), 0.1)
    asked: Any = dict(duration=0.1, step=2e-3, record=record, **more)
    wanted = rg.simulate(mech, outputs=times, backend="python", **asked)
    plain = rg.simulate(mech, backend="native", **asked)
    calls, evaluate = [], EquationsOfMotion.evaluate
    monkeypatch.setattr(EquationsOfMotion, "evaluate", lambda *at: calls.append(at) or evaluate(*at))
    found = rg.simulate(mech, outputs=times, backend="native", **asked)
    assert found.stats.rhs == wanted.stats.rhs
    assert all(t == 0.0 for _, t, _ in calls)
    for column in ("q", "v", "a", "energy", "multipliers", "tau", "work"):
        one, other = getattr(found, column), getattr(wanted, column)
        if other is not None:
            scale = 1e-8 * max(1.0, np.abs(other).max())
            np.testing.assert_allclose(one, other, rtol=0.0, atol=scale, err_msg=column)
    assert found.closure_error().max() < 1e-14
    np.testing.assert_allclose(found.q[-1], plain.q[-1], rtol=0.0, atol=0.0 if name != "rhombus" else 1e-15)


@pytest.mark.parametrize("more", [{}, {"hold": True}, {"events": lambda t, q, v: float(np.sin(40.0 * t))}])
def test_all_outputs_are_there_on_a_floating_base(more: dict[str, Any], backend: Any) -> None:
    """The last one too, at the end of a step that has others within."""
    body = pin.Inertia(5.0, np.zeros(3), np.diag([1.0, 1.2, 0.9]))
    mech = four_bars([(1.0, 2.0, 1.5, 1.5)], [1.2], floating=body)
    if "hold" in more:
        more = more | {"torque": lambda t, q, v: -0.1 * v}
    start = mech.home, mech.lift(mech.home, 0.5 + np.arange(mech.m)), 0.05, 1e-3
    asked = np.append(np.sort(np.random.default_rng(2).uniform(0.0, 0.05, 200)), 0.05)
    found = rg.simulate(mech, *start, outputs=asked, record=("a", "energy"), backend=backend, **more)
    plain = rg.simulate(mech, *start, record=("a", "energy"), backend=backend, **more)
    np.testing.assert_array_equal(found.t, asked)
    for column in ("q", "v", "a", "energy"):
        np.testing.assert_allclose(getattr(found, column)[-1], getattr(plain, column)[-1], rtol=0, atol=1e-13)


def test_the_error_between_steps_is_the_steppers(backend: Any) -> None:
    """Order four, loops closed, energy and its work balanced, at times that suit no step."""
    asked = np.sort(np.random.default_rng(3).uniform(0.0, 0.5, 40))

    def run(step: float) -> rg.Trajectory:
        return rg.simulate(
            rg.load("rhombus"), *START, 0.5, step, torque=drift, outputs=asked, record=RECORD, backend=backend
        )

    runs = {step: run(step) for step in (0.01, 0.005, 2.5e-3, 2.5e-4)}
    exact = runs.pop(2.5e-4)
    for name, order in (("q", 3.7), ("v", 3.7), ("a", 3.7), ("multipliers", 3.5)):
        errors = [np.abs(getattr(r, name) - getattr(exact, name)).max() for r in runs.values()]
        assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > order), (name, errors)
    for found in runs.values():
        np.testing.assert_array_equal(found.t, asked)
        assert found.closure_error().max() < 1e-12
        assert found.velocity_error().max() < 1e-11
        assert found.crossings
    errors = [np.abs(r.energy_error()).max() for r in runs.values()]
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.5), errors


def test_outputs_of_a_solver() -> None:
    """The same motion, whatever is asked of it; its own steps do not depend on that."""
    mech = rg.load("crank_rocker")
    asked = [0.013, 0.2, 0.777]
    found = rg.simulate(mech, stepper="DOP853", rtol=1e-11, atol=1e-12, outputs=asked)
    exact = rg.simulate(mech, duration=0.777, step=1e-3, stepper="DOP853", rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(found.t, asked)
    np.testing.assert_allclose(found.q[1:], exact.q[[200, 777]], atol=1e-8)
    assert found.closure_error().max() < 1e-12


@pytest.mark.parametrize("stepper", ("rk4", "DOP853"))
def test_changes_of_coordinates_lose_no_output(stepper: str, backend: Any) -> None:
    """Where steps are taken again, outputs are too; rare ones do not make the way back longer."""
    mech = rg.load("slider_crank").with_independent(["q3"])
    asked = np.array([0.0203, 0.5, 0.5001, 0.93331, 1.4])
    runs = [
        rg.simulate(
            mech, mech.home, None, 1.5, 2e-3, torque={"q1": 20.0}, stepper=stepper,
            outputs=outputs, backend=backend, rtol=1e-10, atol=1e-11,
        )
        for outputs in (asked, None)
    ]  # fmt: skip
    assert runs[0].stats.repartitions == runs[1].stats.repartitions != []
    np.testing.assert_array_equal(runs[0].t, asked)
    np.testing.assert_allclose(runs[0].q, runs[1].at(asked).q, atol=1e-8)
    assert runs[0].closure_error().max() < 1e-11


def test_outputs_of_a_floating_mechanism() -> None:
    """On a group, y within a step is in the chart of its start."""
    base = pin.Model()
    body = base.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    base.appendBodyToJoint(body, pin.Inertia(1.0, np.zeros(3), np.diag([0.1, 0.2, 0.3])), pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(base, [], ["base"])
    v = np.array([0.3, 0.1, 4.0, 1.0, 2.0, -1.5])
    asked = [0.1003, 0.25, 0.70707]
    exact = rg.simulate(
        mech, mech.home, v, 0.8, 1e-3, stepper="DOP853", rtol=1e-12, atol=1e-13, outputs=asked
    )
    errors = []
    for step in (0.02, 0.01):
        run = rg.simulate(mech, mech.home, v, 0.8, step, outputs=asked)
        errors.append(
            max(np.abs(mech.tree.difference(a, b)).max() for a, b in zip(run.q, exact.q, strict=True))
        )
    assert errors[1] < 1e-7
    assert np.log2(errors[0] / errors[1]) > 3.6


@pytest.mark.parametrize("stepper", ("rk4", "RK45"))
def test_a_run_that_begins_later_is_the_same_run(stepper: str, backend: Any) -> None:
    """Functions of time see the time since the start plus t0; crossings too are told in it."""
    later = 64.0  # exact sums
    step = 2.0**-7
    runs = [
        rg.simulate(
            rg.load("rhombus"), *START, 0.5, step, stepper=stepper, backend=backend, t0=t0, rtol=1e-10,
            torque=lambda t, q, v, t0=t0: drift(t - t0, q, v),
            wrenches=[rg.Wrench("rocker", lambda t, q, v, t0=t0: np.array([0, t - t0, 0, 0, 0, 0]))],
        )
        for t0 in (0.0, later)
    ]  # fmt: skip
    np.testing.assert_array_equal(runs[1].t, runs[0].t + later)
    np.testing.assert_allclose(runs[1].q, runs[0].q, atol=1e-9)
    times = [[c.time for c in run.crossings] for run in runs]
    assert times[0]
    np.testing.assert_allclose(times[1], np.array(times[0]) + later, atol=1e-9)
    assert runs[1].at(later + 0.1).q == pytest.approx(runs[0].at(0.1).q, abs=1e-9)


def test_a_prescribed_motion_begins_at_the_start_of_the_run() -> None:
    turn = rg.Motion(lambda t: 0.2 * t**2)
    run = rg.simulate(rg.load("slider_crank"), duration=0.5, step=1e-2, drive={"q1": turn}, t0=3.0)
    np.testing.assert_allclose(run["q1"], 0.2 * run.t**2, atol=1e-13)
    assert run.t[0] == 3.0


@pytest.mark.parametrize(
    "given",
    [
        {"outputs": [0.2, 0.1]},
        {"outputs": [0.1, 0.1]},
        {"outputs": []},
        {"outputs": [-0.1, 0.1]},
        {"outputs": [0.1, 1.1]},
        {"outputs": [np.nan]},
        {"outputs": "often"},
        {"outputs": 0.1},
        {"t0": np.inf},
        {"t0": "soon"},
        {"t0": 1e15},
        {"hold": 1},
        {"hold": True, "stepper": "RK45"},
        {"progress": "yes"},
    ],
)
def test_what_is_refused(given: Any) -> None:
    with pytest.raises(rg.OptionError, match=next(iter(given))):
        rg.simulate(rg.load("rhombus"), **{"duration": 1.0, "step": 0.01} | given)


class Memory:
    """A controller that counts its calls, as one with an integral would."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        self.asked.append(t)
        return np.array([2.0 * np.sin(0.3 * len(self.asked)), 0.0, -0.1 * float(v[2])])


@pytest.mark.parametrize("record", [RECORD, ()], ids=["all", "nothing more"])
def test_a_held_torque_is_asked_once_a_step(record: tuple[str, ...], backend: Any) -> None:
    """The digits of steps taken one by one; the first state is Python's here and the kernel's there."""
    memory, step = Memory(), 2.0**-7
    run = rg.simulate(
        rg.load("rhombus"), *START, 0.5, step, torque=memory, hold=True, record=record, backend=backend
    )
    assert memory.asked == list(step * np.arange(64))
    again = Memory()
    sim = rg.Simulation(rg.load("rhombus"), *START, step, record=record, backend=backend)
    for _ in range(64):
        sim.step(again(sim.t, sim.q, sim.v))
    for name in ("q", "v", *(("a", "energy", "multipliers", "work") if record else ())):
        one, other = getattr(run, name), getattr(sim.trajectory, name)
        np.testing.assert_allclose(one[0], other[0], rtol=1e-13, atol=1e-13, err_msg=name)
        np.testing.assert_array_equal(one[1:], other[1:], err_msg=name)
    assert run.crossings
    if record:
        assert np.abs(run.energy_error()).max() < 1e-6


def test_a_held_torque_is_not_asked_again_where_steps_are(backend: Any) -> None:
    """Over steps that are taken again each torque acts where it did, within steps too."""
    asked: list[float] = []

    def remembers(t: float, q: Array, v: Array) -> float:
        asked.append(t)
        return 10.0 + 30.0 * float(np.sin(0.1 * len(asked)))

    mech = rg.load("slider_crank").with_independent(["q3"])
    push = rg.Event(lambda t, q, v: np.sin(q[1]))
    run = rg.simulate(
        mech, mech.home, None, 1.0, 2e-3, hold=True, backend=backend, events=push, outputs=[0.1, 0.5005, 1.0],
        torque={"q1": remembers},
    )  # fmt: skip
    assert run.stats.repartitions
    np.testing.assert_allclose(asked, 2e-3 * np.arange(500), atol=1e-12)
    assert len(run.t) == 3
    assert np.abs(run.energy_error()).max() < 1e-5


def test_work_that_takes_long_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run: dict[str, Any] = {"duration": 0.2, "step": 1e-3, "backend": "python"}
    rg.simulate(rg.load("rhombus"), progress=True, **run)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(printing, "PATIENCE", 0.0)
    rg.simulate(rg.load("rhombus"), progress=True, **run)
    assert "simulating rhombus" in capsys.readouterr().err
    rg.simulate(rg.load("rhombus"), progress=False, **run)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("hold", [True, False])
def test_what_acts_is_recorded(hold: bool, backend: Any) -> None:
    """Torques, springs and dampers, at ends of steps and within one; held torques as they were held."""
    mech = rg.load("crank_rocker")
    sprung = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home,
        forces=[rg.JointSpring("q3", 3.0, 1.0), rg.JointDamper("q2", 0.5)],
    )  # fmt: skip
    asked = [0.0, 0.05, 0.0534, 0.2]

    def torque(t: float, q: Array, v: Array) -> float:
        return 2.0 * np.cos(7.0 * t) - float(v[0])

    run = rg.simulate(
        sprung, duration=0.2, step=0.01, torque={"q1": torque}, hold=hold, outputs=asked,
        record=("tau",), backend=backend,
    )  # fmt: skip
    np.testing.assert_allclose(run["tau.q3"], -3.0 * (run["q3"] - 1.0), atol=1e-12)
    np.testing.assert_allclose(run["tau.q2"], -0.5 * run["v.q2"], atol=1e-12)
    said = [torque(t, q, v) for t, q, v in zip(run.t, run.q, run.v, strict=True)]
    if hold:
        said[2] = said[1]  # within the step that begins at 0.05 s
        np.testing.assert_allclose(run["tau.q1"][:3], said[:3], atol=1e-12)
    else:
        np.testing.assert_allclose(run["tau.q1"], said, atol=1e-12)
    assert "tau.q1" in run.columns()
    plain = rg.simulate(mech, duration=0.02, step=0.01, record="tau", backend=backend)
    np.testing.assert_array_equal(plain["tau.q1"], 0.0)


def test_outputs_belong_to_the_steps_that_end_with_them() -> None:
    """Step by step as defined: `row` and `first` of random outputs at, beside and within steps."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        times = rng.uniform(-2.0, 2.0) + rng.uniform(0.01, 1.0) * np.arange(rng.integers(2, 20))
        step = times[1] - times[0]
        ends = rng.choice(times, rng.integers(0, len(times)), replace=False)
        some = np.concatenate([ends, rng.uniform(times[0], times[-1], 5)])
        outputs = np.unique(
            np.clip(some + rng.choice([0.0, 1e-10, -1e-10], len(some)) * step, *times[[0, -1]])
        )
        made = Schedule.at(times, outputs)
        for i, t in enumerate(times):
            at = np.flatnonzero(np.abs(outputs - t) <= SAME * step)
            assert made.first[i] == np.count_nonzero(outputs < t - SAME * step)
            assert made.row[i] == (at[0] if len(at) else -1)
