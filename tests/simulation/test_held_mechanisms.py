"""Mechanisms in which rows are held: built once, held anywhere, and by one run at a time."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

from .machines import BACKENDS, require_backend, require_sound, times_of


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def sticking(bar: rg.Mechanism, backend: str = "auto", duration: float = 1.0, push: float = 60.0) -> Any:
    """A five-bar whose driven joint sticks at another place each time, while the rest moves on."""
    home = bar.home

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        rest = 20.0 * np.cos(11.0 * t) - 25.0 * (q[3] - home[3]) - 2.0 * v[3]
        return np.array([push * np.sin(40.0 * t), 0.0, 0.0, rest])

    return rg.simulate(
        bar, home, np.zeros(4), duration, 0.005, torque=torque, joints=[rg.JointFriction("q1", 45.0)],
        backend=backend,
    )  # fmt: skip


def test_one_mechanism_serves_all_places_and_runs(backend: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bar, made = rg.load("five_bar"), 0
    before = rg.Mechanism.__init__

    def counted(*given: Any, **more: Any) -> None:
        nonlocal made
        made += 1
        before(*given, **more)

    monkeypatch.setattr(rg.Mechanism, "__init__", counted)
    run = sticking(bar, backend)
    again = sticking(bar, backend)
    places = np.unique([run.q[np.searchsorted(run.t, t), 0] for t in times_of(run, "hold")])
    assert made == 1 and len(places) > 5
    assert np.array_equal(run.q, again.q)
    require_sound(run, 1e-3)


def test_what_was_held_elsewhere_before_does_not_matter(backend: Any) -> None:
    used = rg.load("five_bar")
    sticking(used, backend, push=70.0)
    fresh, run = sticking(rg.load("five_bar"), backend), sticking(used, backend)
    assert [x.kind for x in fresh.happenings] == [x.kind for x in run.happenings]
    assert np.abs(fresh.q - run.q).max() < 1e-9


def test_runs_at_once_do_not_share_what_they_hold() -> None:
    bar, found = rg.load("five_bar"), dict[float, Any]()
    pushes = (60.0, 65.0, 70.0)
    alone = {push: sticking(rg.load("five_bar"), push=push).q for push in pushes}

    def run(push: float) -> None:
        found[push] = sticking(bar, push=push).q

    threads = [threading.Thread(target=run, args=(push,)) for push in pushes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for push in pushes:
        assert np.abs(found[push] - alone[push]).max() < 1e-9


def test_a_saved_state_is_held_where_it_was() -> None:
    sim = rg.Simulation(rg.load("five_bar"), joints=[rg.JointFriction("q1", 45.0)], step=0.005)

    def on(n: int) -> np.ndarray:
        for k in range(n):
            sim.step({"q1": 60.0 * np.sin(0.2 * (k % 40)), "q4": 20.0})
        return np.array(sim.q)

    on(30)
    kept = sim.save()
    there = on(45)
    on(20)
    sim.restore(kept)
    assert np.abs(on(45) - there).max() < 1e-9
