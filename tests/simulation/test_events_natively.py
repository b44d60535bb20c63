"""Events beside the compiled kernel: its steps are those without them, and Python looks within few."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.equations import EquationsOfMotion

from ..compiled import needs_kernel

pytestmark = needs_kernel
Array = NDArray[np.float64]
STEP, DURATION = 1e-3, 0.3
BETWEEN = np.append(np.sort(np.random.default_rng(8).uniform(0.0, DURATION, 200)), DURATION)
WAYS = ["plain", "function", "hold", "outputs", "function and outputs"]


def swings(t: float, q: Array, v: Array) -> float:
    """Has zeros in every motion, whatever q and v are."""
    return float(np.cos(31.0 * t) + 0.1 * np.sin(q[0]) * v[0] / (1.0 + v[0] ** 2))


class Damping:
    """A torque that counts how often it is asked for."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        self.calls += 1
        return np.asarray(-0.01 * v)


def asked(way: str) -> dict[str, Any]:
    more: dict[str, Any] = {"outputs": BETWEEN} if "outputs" in way else {}
    return more | ({"torque": Damping(), "hold": way == "hold"} if way not in ("plain", "outputs") else {})


def simulated(name: str, way: str, backend: Any = "native", **more: Any) -> tuple[rg.Trajectory, int]:
    """The run, and how often its torque was asked for."""
    options = asked(way)
    run = rg.simulate(rg.load(name), duration=DURATION, step=STEP, backend=backend, **options, **more)
    return run, options["torque"].calls if "torque" in options else 0


@pytest.mark.parametrize("name", ["rhombus", "delta", "walker"])
@pytest.mark.parametrize("way", WAYS)
def test_steps_and_outputs_are_those_without_events(name: str, way: str, monkeypatch: Any) -> None:
    """To the last bit, with as many right-hand sides; a torque is asked for no step once more."""
    plain, once = simulated(name, way)
    looked, evaluate = [], EquationsOfMotion.evaluate
    monkeypatch.setattr(EquationsOfMotion, "evaluate", lambda *at: looked.append(at) or evaluate(*at))
    found, calls = simulated(name, way, events=swings)
    assert len(found.t_events[0]) > 2
    assert calls == once
    assert not [t for _, t, _ in looked if t > 0.0]  # events that end nothing need the map alone
    assert found.stats.rhs == plain.stats.rhs
    assert found.stats.native_steps == plain.stats.native_steps == round(DURATION / STEP)
    for column in ("t", "q", "v"):
        np.testing.assert_array_equal(getattr(found, column), getattr(plain, column), err_msg=column)
    assert found.a is None  # kept for the events alone


@pytest.mark.parametrize("name", ["rhombus", "crank_rocker", "stewart"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("terminal", [False, 2])
def test_events_are_those_of_the_reference(name: str, way: str, terminal: int) -> None:
    """Times, states, and what is recorded up to one that ends the run."""
    event = rg.Event(swings, terminal=terminal)
    record = ("a", "energy", "tau")
    found, wanted = (
        simulated(name, way, backend, events=event, record=record)[0] for backend in ("native", "python")
    )
    assert (found.ended_by is None) == (not terminal)
    for one, other in ((found.t_events, wanted.t_events), (found.q_events, wanted.q_events)):
        np.testing.assert_allclose(one[0], other[0], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(found.v_events[0], wanted.v_events[0], rtol=0.0, atol=1e-10)
    for column in ("t", "q", "v", "a", "energy", "tau", "work"):
        one, other = getattr(found, column), getattr(wanted, column)
        if other is not None:
            scale = 1e-9 * max(1.0, float(np.abs(other).max()))
            np.testing.assert_allclose(one, other, rtol=0.0, atol=scale, err_msg=column)


@pytest.mark.parametrize("name", ["rhombus", "delta"])
@pytest.mark.parametrize("keep", ["all", "last"])
def test_stepwise_as_at_once(name: str, keep: Any) -> None:
    """Steps that go on in the kernel by themselves find the same events, and go on after each."""
    mech = rg.load(name)
    whole = rg.simulate(mech, mech.home, np.zeros(mech.nv), DURATION, STEP, events=swings, backend="native")
    steps = rg.Simulation(mech, mech.home, step=STEP, events=swings, backend="native", keep=keep)
    for n in (1, 2, 50, 1, 46, 200):
        steps.step(n=n)
    np.testing.assert_allclose(steps.trajectory.t_events[0], whole.t_events[0], rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(steps.q, whole.q[-1], rtol=0.0, atol=1e-13)


def test_what_an_event_raises_ends_the_run_there() -> None:
    def breaks(t: float, q: Array, v: Array) -> float:
        if t > 0.0105:
            raise ZeroDivisionError("an event of the user's")
        return 1.0

    mech = rg.load("rhombus")
    with pytest.raises(ZeroDivisionError, match="of the user's"):
        rg.simulate(mech, duration=0.1, step=1e-3, events=breaks, torque=Damping(), backend="native")
    steps = rg.Simulation(mech, step=1e-3, events=breaks, backend="native")
    with pytest.raises(ZeroDivisionError, match="of the user's"):
        for _ in range(100):
            steps.step()
    assert steps.t == pytest.approx(0.011, abs=1e-12)
