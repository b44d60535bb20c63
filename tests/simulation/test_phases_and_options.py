"""Stops, friction and locks with `outputs=`, `events=` and other fixed steppers: one motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar

from .machines import BACKENDS, pendulum, require_backend, require_sound, sliders, times_of

G = 9.81


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def crank(**more: Any) -> rg.Trajectory:
    mech = rg.load("slider_crank")
    parts = [rg.Stop("q3", lower=2.6, restitution=0.5), rg.JointFriction("q1", 2.0)]
    return rg.simulate(mech, mech.home, [0.0] * 3, joints=parts, **more)


def test_outputs_do_not_change_the_motion(backend: Any) -> None:
    """Inside steps, at their ends, next to impacts and where all rests: closed loops, order four."""
    plain = crank(duration=3.2, step=0.02, backend=backend)
    impact, rest = times_of(plain, "impact")[0], times_of(plain, "at rest")[0]
    asked = np.sort(
        [0.0, 0.013, 0.02, 0.5, 0.503, 0.509, impact - 1e-6, impact, impact + 1e-6, 1.7, rest, 3.2]
    )
    run = crank(duration=3.2, step=0.02, outputs=asked, backend=backend)
    assert np.array_equal(run.t, asked)
    assert [(x.kind, x.time) for x in run.happenings] == [(x.kind, x.time) for x in plain.happenings]
    ends = np.isin(asked, plain.t)
    same = plain.q[np.searchsorted(plain.t, asked[ends])]
    assert ends.sum() >= 6 and np.array_equal(run.q[ends], same)
    fine = crank(duration=3.2, step=0.005, outputs=asked[asked < 1.0], backend=backend)
    assert len(fine.t) == 6 and np.abs(run.q[:6] - fine.q).max() < 1e-7
    assert run.closure_error().max() < 1e-12 and np.abs(run.energy_error()).max() < 1e-4
    k = int(np.searchsorted(asked, impact))
    assert run.v[k, 2] * run.v[k - 1, 2] < 0.0
    alone = crank(duration=3.2, step=0.02, outputs=[1.0], backend=backend)
    assert np.array_equal(alone.t, [1.0])
    k = int(np.searchsorted(plain.t, 1.0))
    assert np.abs(alone.q[0] - plain.q[k]).max() < 1e-12
    assert alone["dissipated"][0] == pytest.approx(plain["dissipated"][k], rel=1e-12)


def test_outputs_while_nothing_moves() -> None:
    mech, stop = sliders(1.0), [rg.Stop("q1", lower=0.0)]
    asked = [0.1, 0.55, 0.77, 0.9]
    run = rg.simulate(mech, [1.0], [0.0], 0.9, 0.1, joints=stop, outputs=asked)
    assert np.array_equal(run.t, asked)
    assert run.q[:, 0] == pytest.approx([1.0 - 0.005 * G, 0.0, 0.0, 0.0], abs=1e-13)
    assert run["stop.q1"] == pytest.approx([0.0, G, G, G])
    assert run.dissipated == pytest.approx([0.0, G, G, G])


def test_events_of_the_user_between_impacts(backend: Any) -> None:
    """A bouncing mass passes 0.5 m: closed form; a sign that an impact flips is no zero."""
    fall, e = np.sqrt(2.0 / G), 0.9
    stop = [rg.Stop("q1", lower=0.0, restitution=e)]
    height = rg.Event(lambda t, q, v: float(q[0]) - 0.5)
    upward = rg.Event(lambda t, q, v: float(v[0]) - 0.1, direction=1.0)
    ask: dict[str, Any] = dict(joints=stop, backend=backend)
    run = rg.simulate(sliders(1.0), [1.0], [0.0], 1.6, 0.05, events=[height, upward], **ask)
    without = rg.simulate(sliders(1.0), [1.0], [0.0], 1.6, 0.05, **ask)
    speed = e * np.sqrt(2.0 * G)
    rise = (speed - np.sqrt(speed**2 - G)) / G
    second = (e * speed - np.sqrt((e * speed) ** 2 - G)) / G
    met = fall + 2.0 * speed / G
    exact = [np.sqrt(1.0 / G), fall + rise, met - rise, met + second]
    assert run.t_events[0] == pytest.approx(exact, abs=1e-13)
    assert np.abs(run.q_events[0] - 0.5).max() < 1e-13 and len(run.t_events[1]) == 0
    assert np.array_equal(run.t, without.t) and np.abs(run.q - without.q).max() < 1e-12


def test_a_terminal_event_before_and_behind_an_impact_in_its_step(backend: Any) -> None:
    stop = [rg.Stop("q1", lower=0.0, restitution=0.5)]
    fall = np.sqrt(2.0 / G)
    for place, up, when, hits in ((0.01, -1.0, np.sqrt(1.98 / G), 0), (0.01, 1.0, None, 1)):
        event = rg.Event(lambda t, q, v, place=place: float(q[0]) - place, terminal=True, direction=up)
        run = rg.simulate(sliders(1.0), [1.0], [0.0], 0.9, 0.1, joints=stop, events=event, backend=backend)
        speed = 0.5 * np.sqrt(2.0 * G)
        exact = when if when is not None else fall + (speed - np.sqrt(speed**2 - 2.0 * G * place)) / G
        assert run.ended_by == 0 and run.t[-1] == pytest.approx(exact, abs=1e-13)
        assert run.q[-1, 0] == pytest.approx(place, abs=1e-13) and len(run.happenings) == hits
        assert np.all(np.diff(run.t) > 0.0)


def test_a_terminal_event_while_all_rests() -> None:
    friction = [rg.JointFriction("q1", 50.0)]
    event = rg.Event(lambda t, q, v: t - 0.333, terminal=True)
    run = rg.simulate(sliders(1.0), [0.2], [0.0], 1.0, 0.1, joints=friction, events=event)
    assert run.t[-1] == pytest.approx(0.333, abs=1e-15) and run.ended_by == 0 and run.q[-1, 0] == 0.2


@pytest.mark.parametrize(("name", "order"), [("midpoint", 2), ("kutta", 3)])
def test_other_fixed_steppers_keep_their_order(backend: Any, name: str, order: int) -> None:
    """Times of a pendulum's impacts, on steps halved: events do not spoil the order of the tableau."""
    tables = {
        "midpoint": rg.Tableau(((0.5,),), (0.0, 1.0)),
        "kutta": rg.Tableau(((0.5,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6)),
    }
    stop = [rg.Stop("q1", lower=-1.2, restitution=0.8)]
    found = []
    for h in (0.01, 0.005, 0.0025):
        run = rg.simulate(
            pendulum(), [0.0], [0.0], 1.5, h, stepper=tables[name], joints=stop, backend=backend
        )
        found.append(times_of(run, "impact"))
        require_sound(run, 1e2 * h**order)
    assert len(found[0]) >= 2 and run.stats.stepper == "tableau"
    rate = np.log2(np.abs(found[0] - found[1]) / np.abs(found[1] - found[2]))
    assert rate.min() > order - 0.3


def test_no_parts_are_a_plain_run() -> None:
    mech = rg.load("slider_crank")
    plain = rg.simulate(mech, mech.home, [0.0] * 3, 0.2, 0.01)
    none = rg.simulate(mech, mech.home, [0.0] * 3, 0.2, 0.01, joints=[])
    assert np.array_equal(none.q, plain.q) and none.dissipated is None and none.stats.rhs == plain.stats.rhs
    rg.simulate(mech, mech.home, [0.0] * 3, 0.2, stepper="DOP853", joints=[])


@pytest.mark.parametrize("step", [1e-3, 2e-3])
@pytest.mark.parametrize("by", [1e-2, 1e-3, -1e-3])
def test_error_control_outlasts_a_phase(by: float, step: float, backend: Any) -> None:
    """Beside a miss, where a joint turns back, friction without energy changes no motion but by rounding.

    Phases begin in the user's coordinates, and these lose some digits there: to 1e-5 before.
    """
    mech = four_bar(1.0, 2.0 + by, 1.5, 1.5, y=1.0)
    start = mech.home, mech.lift(mech.home, [4.0]), 0.9, step
    truth = rg.simulate(mech, *start, stepper="DOP853", rtol=1e-11, atol=1e-13)
    rubbed = rg.simulate(mech, *start, joints=[rg.JointFriction("q1", 1e-11)], backend=backend)
    assert (len(rubbed.happenings) > 0) == (by > 0.0)
    assert rubbed.stats.refined_steps > 0
    np.testing.assert_allclose(rubbed.q[-1], truth.q[-1], rtol=0, atol=5e-7)
