"""Events: against elliptic functions and scipy's solve_ivp; their order; what they do to a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import robust_gcp as rg

Array = NDArray[np.float64]


@pytest.fixture(params=["python", "native"])
def backend(request: pytest.FixtureRequest) -> Any:
    if request.param == "native" and not rg.backends()["native"].available:
        pytest.skip(f"no compiled kernel: {rg.backends()['native'].reason}")
    return request.param


def chain(n: int) -> rg.Mechanism:
    """n uniform rods of 1 m and 1 kg, each hanging on the one before along y, hinged about x."""
    model = pin.Model()
    parent, at = 0, pin.SE3.Identity()
    for k in range(n):
        parent = model.addJoint(parent, pin.JointModelRX(), at, f"q{k + 1}")
        body = pin.Inertia(1.0, np.array([0.0, 0.5, 0.0]), np.diag([1.0 / 12.0] * 3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        at = pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0]))
    return rg.Mechanism.from_pinocchio(model, [], [f"q{k + 1}" for k in range(n)])


def pendulum_zeros(amplitude: float, count: int) -> Array:
    """When a rod of 1 m, let go at an amplitude, hangs straight: odd quarters of its period.

    The period is 4 K(sin²(amplitude/2)) / ω, ω² = m g (l/2) / (m l²/3).
    """
    quarter = ellipk(np.sin(0.5 * amplitude) ** 2) / np.sqrt(1.5 * 9.81)
    return np.asarray(quarter * (2.0 * np.arange(count) + 1.0))


def hangs(t: float, q: Array, v: Array) -> float:
    return float(q[0] + 0.5 * np.pi)


def rests(t: float, q: Array, v: Array) -> float:
    return float(v[0])


AMPLITUDE = 1.1
HELD_OUT = [-0.5 * np.pi + AMPLITUDE]


@pytest.mark.parametrize("stepper", ("rk4", "DOP853", "RK45", "Radau", "LSODA"))
def test_a_pendulum_against_elliptic_functions(stepper: str) -> None:
    """Both ways through the lowest point, and the turning points, the start among them."""
    # Radau takes small steps for such tolerances
    sharp = 1e-8 if stepper == "Radau" else 1e-11
    tight = {"rtol": sharp, "atol": sharp} if stepper != "rk4" else {}
    run = rg.simulate(chain(1), HELD_OUT, None, 5.0, 5e-3, stepper=stepper, events=[hangs, rests], **tight)
    exact = pendulum_zeros(AMPLITUDE, len(run.t_events[0]))
    assert len(exact) > 5
    # events of a low-order solver are as good as its dense output
    allowed = {"RK45": 1e-7, "Radau": 1e-6, "LSODA": 1e-6}.get(stepper, 5e-9)
    np.testing.assert_allclose(run.t_events[0], exact, atol=allowed)
    assert run.t_events[1][0] == 0.0
    np.testing.assert_allclose(
        run.t_events[1][1:], exact[: len(run.t_events[1]) - 1] + exact[0], atol=allowed
    )
    np.testing.assert_allclose(run.q_events[0][:, 0], -0.5 * np.pi, atol=1e-8)
    np.testing.assert_allclose(run.v_events[1], 0.0, atol=1e-8)


def test_the_error_of_an_event_falls_with_the_fourth_power_of_the_step(backend: Any) -> None:
    exact, found = pendulum_zeros(AMPLITUDE, 8), []
    for step in (0.04, 0.02, 0.01):
        run = rg.simulate(chain(1), HELD_OUT, None, 8.0, step, events=hangs, backend=backend)
        found.append(np.abs(run.t_events[0][:8] - exact).max())
    orders = np.log2(np.array(found[:-1]) / found[1:])
    assert np.all(np.abs(orders - 4.0) < 0.4), (found, orders)


def test_the_order_holds_in_a_singular_configuration(backend: Any) -> None:
    """A rhombus passes its flat position in the very step; the reference is a run of a smaller step."""
    start = [0.1, -0.1, 0.1], [-1.0, 1.0, -1.0]

    def passes(t: float, q: Array, v: Array) -> float:
        return float(q[2] + 1e-3)

    def when(step: float) -> Array:
        run = rg.simulate(rg.load("rhombus"), *start, 0.5, step, events=passes, backend=backend)
        assert run.crossings
        assert run.closure_error().max() < 1e-12
        for q in run.q_events[0]:
            assert np.abs(run.mechanism.phi(q)).max() < 1e-12
        return run.t_events[0]

    exact = when(2.5e-4)
    errors = [np.abs(when(step) - exact).max() for step in (0.02, 0.01, 0.005)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.6), (errors, orders)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("stepper", ("rk4", "DOP853"))
def test_random_functions_against_solve_ivp(seed: int, stepper: str, backend: Any) -> None:
    """A double pendulum; as many events, at the same times, in the same states, by direction."""
    rng, mech = np.random.default_rng(seed), chain(2)
    q0, v0 = rng.normal(size=2), rng.normal(size=2)
    weights, shifts = rng.normal(size=(4, 5)), 0.5 * rng.normal(size=4)
    directions = [0.0, 0.0, 1.0, -1.0]

    def value(k: int) -> Callable[[float, Array, Array], float]:
        def event(t: float, q: Array, v: Array) -> float:
            x = np.array([np.sin(q[0]), np.cos(q[1]), 0.3 * v[0], 0.3 * v[1], np.sin(3.0 * t)])
            return float(weights[k] @ x + shifts[k])

        return event

    ours = [rg.Event(value(k), direction=directions[k]) for k in range(4)]
    tight = {"rtol": 1e-12, "atol": 1e-13} if stepper != "rk4" else {}
    run = rg.simulate(mech, q0, v0, 1.5, 1.5e-3, stepper=stepper, events=ours, backend=backend, **tight)

    def rate(t: float, x: Array) -> Array:
        q, v = x[:2], x[2:]
        data = mech.model.createData()
        return np.concatenate([v, pin.aba(mech.model, data, q, v, np.zeros(2))])

    theirs = []
    for k in range(4):
        function = value(k)

        def event(t: float, x: Array, function: Any = function) -> float:
            return float(function(t, x[:2], x[2:]))

        event.direction = directions[k]  # type: ignore[attr-defined]
        theirs.append(event)
    x0 = np.concatenate([q0, v0])
    reference = solve_ivp(
        rate, (0.0, 1.5), x0, "DOP853", events=theirs, rtol=1e-12, atol=1e-13, max_step=0.01
    )
    for k in range(4):
        assert len(run.t_events[k]) == len(reference.t_events[k]), k
        np.testing.assert_allclose(run.t_events[k], reference.t_events[k], atol=5e-8)
        states = reference.y_events[k].reshape(-1, 4)
        np.testing.assert_allclose(np.hstack([run.q_events[k], run.v_events[k]]), states, atol=1e-6)


def test_two_events_of_one_step_come_in_their_order(backend: Any) -> None:
    """The pendulum's passage of two angles 1e-4 rad apart."""
    late = rg.Event(lambda t, q, v: q[0] + 0.5 * np.pi + 1e-4)
    run = rg.simulate(chain(1), HELD_OUT, None, 1.0, 1e-2, events=[late, hangs], backend=backend)
    apart = run.t_events[0][0] - run.t_events[1][0]
    assert apart * abs(run.v_events[1][0, 0]) == pytest.approx(1e-4, rel=1e-3)
    ends = rg.Event(lambda t, q, v: q[0] + 0.5 * np.pi + 1e-4, terminal=True)
    run = rg.simulate(chain(1), HELD_OUT, None, 1.0, 1e-2, events=[ends, hangs], backend=backend)
    assert (run.ended_by, len(run.t_events[1])) == (0, 1)
    ends = rg.Event(hangs, terminal=True)
    run = rg.simulate(chain(1), HELD_OUT, None, 1.0, 1e-2, events=[late, ends], backend=backend)
    assert (run.ended_by, len(run.t_events[0])) == (1, 0)


@pytest.mark.parametrize("stepper", ("rk4", "DOP853"))
@pytest.mark.parametrize("count", (True, 3))
def test_a_terminal_event_is_the_end(count: Any, stepper: str) -> None:
    run = rg.simulate(
        chain(1), HELD_OUT, None, 9.0, 1e-2, stepper=stepper, rtol=1e-10,
        events=rg.Event(hangs, count), record=("a", "energy"),
    )  # fmt: skip
    assert run.ended_by == 0
    assert len(run.t_events[0]) == int(count)
    assert (
        run.t[-1]
        == run.t_events[0][-1]
        == pytest.approx(pendulum_zeros(AMPLITUDE, 3)[int(count) - 1], abs=1e-6)
    )
    np.testing.assert_array_equal(run.q[-1], run.q_events[0][-1])
    assert run.a is not None
    assert run.a[-1] == pytest.approx(0.0, abs=1e-6)  # it hangs
    assert np.all(np.diff(run.t) > 0.0)
    assert np.abs(run.energy_error()).max() < 1e-5
    assert "ended at number 0" in repr(run)


def test_a_run_may_go_on_where_another_ended(backend: Any) -> None:
    """A pendulum that bounces off the vertical: each half swing is as long as the first."""
    mech, q, v, t0, times = chain(1), HELD_OUT, [0.0], 0.0, []
    for _ in range(4):
        run = rg.simulate(
            mech, q, v, 2.0, 2e-3, events=rg.Event(hangs, terminal=True), t0=t0, backend=backend
        )
        times.append(run.t[-1])
        q, v, t0 = run.q[-1], -run.v[-1], run.t[-1]
    np.testing.assert_allclose(times, pendulum_zeros(AMPLITUDE, 4), atol=1e-9)


def test_attributes_of_a_plain_function() -> None:
    def falls(t: float, q: Array, v: Array) -> float:
        return float(q[0] + 0.5 * np.pi)

    falls.direction, falls.terminal = -1, 2  # type: ignore[attr-defined]
    run = rg.simulate(chain(1), HELD_OUT, None, 9.0, 1e-2, events=[falls])
    np.testing.assert_allclose(run.t_events[0], pendulum_zeros(AMPLITUDE, 3)[::2], atol=1e-6)


def test_events_are_those_of_any_description(backend: Any) -> None:
    """A change of coordinates on the way, and steps that are taken again, lose none and list none twice."""
    mech = rg.load("slider_crank")

    def passes(t: float, q: Array, v: Array) -> float:
        return float(np.sin(q[1]))

    runs = [
        rg.simulate(
            mech.with_independent([name]), mech.home, None, 1.5, 2e-3,
            torque={"q1": 20.0}, events=passes, backend=backend,
        )
        for name in ("q1", "q3")
    ]  # fmt: skip
    assert runs[1].stats.repartitions
    assert len(runs[0].t_events[0]) >= 3
    np.testing.assert_allclose(runs[0].t_events[0], runs[1].t_events[0], atol=1e-8)
    for run in runs:
        for q in run.q_events[0]:
            assert np.abs(mech.phi(q)).max() < 1e-11


def test_events_of_a_driven_mechanism() -> None:
    """The crank turns by what is prescribed, so it is upright when that says so."""
    turn = rg.Motion(lambda t: 1.0 + 2.0 * np.pi * t)
    upright = rg.Event(lambda t, q, v: np.sin(q[0]), direction=-1)
    run = rg.simulate(
        rg.load("slider_crank"), duration=2.0, step=1e-2, drive={"q1": turn}, events=upright, record="a"
    )
    np.testing.assert_allclose(run.t_events[0], (np.pi - 1.0) / (2.0 * np.pi) + np.arange(2.0), atol=1e-12)
    ends = rg.Event(lambda t, q, v: np.sin(q[0]), terminal=True)
    run = rg.simulate(rg.load("slider_crank"), duration=2.0, step=1e-2, drive={"q1": turn}, events=ends)
    assert run.drive_torque is not None
    assert np.isfinite(run["drive.q1"][-1])
    assert run.t[-1] == pytest.approx((np.pi - 1.0) / (2.0 * np.pi), abs=1e-12)


@pytest.mark.parametrize("stepper", ("rk4", "DOP853"))
def test_events_of_a_thrown_body(stepper: str) -> None:
    """It tumbles, and its centre of mass flies a parabola: the time at which it is back at its height."""
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(body, pin.Inertia(1.0, np.zeros(3), np.diag([0.1, 0.2, 0.3])), pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model, [], ["base"])
    v = np.array([0.3, 0.1, 4.0, 1.0, 2.0, -1.5])
    down = rg.Event(lambda t, q, v: q[2], terminal=True, direction=-1)
    run = rg.simulate(mech, mech.home, v, 2.0, 2e-3, stepper=stepper, rtol=1e-10, atol=1e-12, events=down)
    assert run.t[-1] == pytest.approx(8.0 / 9.81, abs=1e-9)
    np.testing.assert_allclose(run.q[-1][:2], v[:2] * run.t[-1], atol=1e-8)
    assert abs(run.q[-1][2]) < 1e-9


def test_a_function_with_a_memory_is_called_for_no_time_twice(backend: Any) -> None:
    """Time does not go back for the torque beside events that end nothing."""
    asked: list[float] = []

    def torque(t: float, q: Array, v: Array) -> Array:
        asked.append(t)
        return np.array([0.5 * np.sin(3.0 * t)])

    run = rg.simulate(chain(1), HELD_OUT, None, 3.0, 1e-2, torque=torque, events=hangs, backend=backend)
    assert len(run.t_events[0]) > 2
    assert np.all(np.diff(asked) >= 0.0)
    assert len(asked) <= 4 * 300 + 2


def test_events_do_not_change_the_motion(backend: Any) -> None:
    """Digit by digit, but behind events, where Newton's method begins from another point."""
    plain = rg.simulate(rg.load("crank_rocker"), duration=1.0, step=1e-3, backend=backend)
    never = rg.Event(lambda t, q, v: 1.0 + t)
    often = rg.Event(lambda t, q, v: np.sin(20.0 * t + 0.1))
    seen = rg.simulate(rg.load("crank_rocker"), duration=1.0, step=1e-3, events=never, backend=backend)
    np.testing.assert_array_equal(seen.q, plain.q)
    seen = rg.simulate(rg.load("crank_rocker"), duration=1.0, step=1e-3, events=often, backend=backend)
    np.testing.assert_allclose(seen.t_events[0], (np.pi * np.arange(1, 7) - 0.1) / 20.0, atol=1e-12)
    np.testing.assert_allclose(seen.q, plain.q, atol=1e-11)
    np.testing.assert_array_equal(seen.t, plain.t)


def test_events_are_saved(tmp_path: Path) -> None:
    run = rg.simulate(
        chain(1), HELD_OUT, None, 9.0, 1e-2, events=[rg.Event(hangs, 2), rests, rg.Event(lambda t, q, v: 1.0)]
    )
    again = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.ended_by == 0
    for name in ("t_events", "q_events", "v_events"):
        for one, other in zip(getattr(run, name), getattr(again, name), strict=True):
            np.testing.assert_array_equal(one, other)
    assert again.q_events[2].shape == (0, 1)


@pytest.mark.parametrize(
    ("events", "words"),
    [
        (3.0, "list of rg.Event or functions"),
        ([3.0], r"events\[0\]"),
        ([lambda t, q, v: "up"], "one real number"),
        ([lambda t, q, v: q], "one real number"),
        ([lambda t, q, v: np.nan], "nan"),
    ],
)
def test_what_is_no_event(events: Any, words: str) -> None:
    with pytest.raises(rg.RobustGcpError, match=words):
        rg.simulate(rg.load("rhombus"), duration=0.1, step=0.01, events=events)


@pytest.mark.parametrize("given", [{"terminal": -1}, {"terminal": "yes"}, {"direction": "up"}])
def test_what_no_event_can_be_told(given: Any) -> None:
    with pytest.raises(rg.OptionError, match=next(iter(given))):
        rg.Event(hangs, **given)
