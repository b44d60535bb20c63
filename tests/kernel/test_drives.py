"""Prescribed motions in the kernel: the same motion, torque and work as in Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.dynamics.prescribed.driven import DrivenEquations

from ..compiled import needs_kernel, some
from .test_random_floating import made

pytestmark = needs_kernel

RECORD = ("a", "energy", "multipliers", "tau")
COMPARED = (*RECORD, "q", "v", "work", "drive_torque")


def swings(mechanism: rg.Mechanism, names: Sequence[str]) -> dict[str, rg.Motion]:
    """Each joint to and fro about its home, at a pace of its own."""
    home = {name: float(mechanism.home[mechanism.joint(name).idx_q]) for name in names}
    return {
        name: rg.Motion(lambda t, at=at, i=i: at + 0.2 * np.sin((2.0 + i) * t))
        for i, (name, at) in enumerate(home.items())
    }


def both(mechanism: rg.Mechanism, drive: dict[str, rg.Motion], **options: Any) -> list[rg.Trajectory]:
    options = {"drive": drive, "record": RECORD, **options}
    return [rg.simulate(mechanism, backend=backend, **options) for backend in ("python", "native")]


def require_alike(ours: rg.Trajectory, native: rg.Trajectory, within: float) -> None:
    for name in COMPARED:
        wanted, found = getattr(ours, name), getattr(native, name)
        size = 1.0 + np.nanmax(np.abs(wanted), initial=0.0)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=within * size, err_msg=name)
    assert [c.kind for c in native.crossings] == [c.kind for c in ours.crossings]


@pytest.mark.parametrize("name", ["andrews", "bricard", "delta", "five_bar", "stewart", "walker"])
@pytest.mark.parametrize("all_of_them", [False, True])
def test_shipped_scenes_move_alike(name: str, all_of_them: bool) -> None:
    mechanism = rg.load(name)
    single = [each for each in mechanism.independent if mechanism.joint(each).single]
    drive = swings(mechanism, single if all_of_them else single[:1])
    ours, native = both(mechanism, drive, duration=0.2, step=2e-3)
    assert native.stats.native_steps == 100
    require_alike(ours, native, 1e-12)


@pytest.mark.parametrize("seed", some(range(40), 6))
def test_random_mechanisms_on_joints_on_groups_move_alike(seed: int) -> None:
    mechanism, _ = made(seed)
    cranks = [name for name in mechanism.independent if name.startswith("crank")]
    ours, native = both(
        mechanism, swings(mechanism, cranks[: 1 + seed % len(cranks)]), duration=0.2, step=2e-3
    )
    require_alike(ours, native, 1e-10)
    assert native.stats.native_steps > 90


@pytest.mark.parametrize("stepper", ["rk4", "DOP853"])
def test_through_a_crossing(stepper: str) -> None:
    mechanism = rg.load("change_point")
    begin = float(mechanism.home[mechanism.joint("q1").idx_q])
    drive = {"q1": rg.Motion(lambda t: begin + 3.0 * t)}
    options = {"stepper": stepper, "rtol": 1e-10, "atol": 1e-12}
    ours, native = both(mechanism, drive, duration=2.0, step=5e-3, **options)
    assert len(native.crossings) == 1
    require_alike(ours, native, 1e-8 if stepper == "DOP853" else 1e-10)


def test_events_and_outputs_between_steps() -> None:
    mechanism = rg.load("five_bar")
    drive = swings(mechanism, mechanism.independent[:1])
    options: dict[str, Any] = {
        "duration": 1.0,
        "step": 1e-2,
        "events": [lambda t, q, v: q[mechanism.joint("q1").idx_q] - mechanism.home[0] - 0.1],
        "outputs": np.linspace(0.0, 1.0, 37),
    }
    ours, native = both(mechanism, drive, **options)
    require_alike(ours, native, 1e-11)
    assert len(native.t_events[0]) > 0
    np.testing.assert_allclose(native.t_events[0], ours.t_events[0], rtol=0.0, atol=1e-12)


def test_a_motion_that_ends_on_the_way_ends_the_run_there() -> None:
    """What is asked ahead of the steps says nothing; the step that needs it does, as in Python."""
    mechanism, reached = rg.load("slider_crank"), []
    begin = float(mechanism.home[mechanism.joint("q1").idx_q])

    def position(t: float) -> float:
        if t > 0.5:
            raise ValueError("no more")
        last.append(t)
        return begin + t

    for backend in ("python", "native"):
        last: list[float] = []
        drive = {"q1": rg.Motion(position, lambda t: 1.0, lambda t: 0.0)}
        sim = rg.Simulation(mechanism, step=1e-2, drive=drive, backend=backend)
        with pytest.raises(ValueError, match="no more"):
            sim.step(n=100)
        reached.append((max(last), sim.t))
    assert reached[0] == reached[1]
    assert 0.49 < reached[0][1] <= 0.5


def test_step_by_step_as_in_one_go() -> None:
    mechanism = rg.load("five_bar")
    drive = swings(mechanism, mechanism.independent[:1])
    run = rg.simulate(mechanism, duration=0.2, step=2e-3, drive=drive)
    steps = rg.Simulation(mechanism, step=2e-3, drive=drive)
    for _ in range(100):
        steps.step()
    np.testing.assert_array_equal(steps.trajectory.q, run.q)
    np.testing.assert_array_equal(steps.trajectory["drive.q1"], run["drive.q1"])
    assert steps.trajectory.stats.native_steps == 100


def test_a_controller_is_asked_with_the_velocities_that_the_drive_begins_with() -> None:
    mechanism = rg.load("five_bar")
    drive = swings(mechanism, mechanism.independent[:1])
    for backend in ("python", "native"):
        asked: list[np.ndarray] = []

        def torque(t: float, q: np.ndarray, v: np.ndarray, asked: list[np.ndarray] = asked) -> np.ndarray:
            asked.append(v)
            return np.zeros(len(v))

        run = rg.simulate(
            mechanism, duration=4e-3, step=2e-3, drive=drive, torque=torque, hold=True, backend=backend
        )
        np.testing.assert_allclose(asked[0], run.v[0], rtol=0.0, atol=1e-14)
        assert run.v[0][mechanism.joint(mechanism.independent[0]).idx_v] == pytest.approx(0.4)


def test_close_to_a_dead_point_the_kernel_goes_as_far_as_python(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, begin = rg.load("slider_crank"), float(rg.load("slider_crank").home[2])
    drive = {"q3": rg.Motion(lambda t: begin + (3.5 - 2e-3 - begin) * np.sin(2.0 * t))}
    evaluated = []
    evaluate = DrivenEquations.evaluate
    monkeypatch.setattr(DrivenEquations, "evaluate", lambda *a: evaluated.append(a[1]) or evaluate(*a))
    run = rg.simulate(mechanism, duration=1.0, step=1e-2, drive=drive, backend="native")
    np.testing.assert_allclose(run["q3"], [drive["q3"].at(t)[0] for t in run.t], rtol=0.0, atol=1e-13)
    assert len(evaluated) < 0.2 * run.stats.rhs
