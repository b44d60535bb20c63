"""Locks, brakes, clutches: against the mechanism without the joint, momentum, and singular places."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

from .machines import BACKENDS, flywheels, require_backend, require_sound, sliders, times_of


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def test_a_locked_joint_is_as_one_left_out(backend: Any) -> None:
    bar = rg.load("five_bar")
    model, home = bar.model, bar.home
    v0 = np.zeros(4)
    locked = rg.simulate(bar, home, v0, 0.4, 0.005, joints=[rg.Lock("q1")], backend=backend)
    reduced = pin.buildReducedModel(model, [model.getJointId("q1")], home)
    without = rg.Mechanism.from_pinocchio(reduced, bar.closures, "auto", home[1:])
    alone = rg.simulate(without, home[1:], v0[1:], 0.4, 0.005, backend=backend)
    assert np.abs(locked.q[-1, 1:] - alone.q[-1]).max() < 1e-8
    assert np.abs(locked["q1"] - home[0]).max() < 1e-14 and np.abs(locked["v.q1"]).max() < 1e-14
    require_sound(locked, 1e-6)


def test_a_clutch_of_two_flywheels() -> None:
    """ω₁ = −3 ω₂ from 0.35 s to 0.8 s: reduced momentum is kept, the energy lost is exact."""
    I1, I2, ratio, w1, w2 = 2.0, 5.0, -3.0, 4.0, 1.0
    clutch = rg.Lock("q1", other="q2", ratio=ratio, start=0.35, end=0.8)
    run = rg.simulate(flywheels(I1, I2), [0.0, 0.0], [w1, w2], 1.0, 0.1, torque=[7.0, 0.0], joints=[clutch])
    before = w1 + 7.0 / I1 * 0.35
    after = (ratio * I1 * before + I2 * w2) / (ratio**2 * I1 + I2)  # of wheel 2
    k = int(np.searchsorted(run.t, 0.35))
    assert run.v[k] == pytest.approx([ratio * after, after], abs=1e-13)
    assert run.t[k - 1] == np.nextafter(0.35, 0.0)
    assert run.v[k - 1] == pytest.approx([before, w2], abs=1e-13)
    lost = 0.5 * (I1 * before**2 + I2 * w2**2) - 0.5 * (I1 * ratio**2 + I2) * after**2
    assert [x.kind for x in run.happenings] == ["lock", "hold", "release"]
    assert run.happenings[0].loss == pytest.approx(lost, rel=1e-13)
    a2 = ratio * 7.0 / (ratio**2 * I1 + I2)
    end = after + a2 * 0.45
    k = int(np.searchsorted(run.t, 0.8))
    assert run.v[k] == pytest.approx([ratio * end, end], abs=1e-12)
    held = (run.t > 0.35) & (run.t < 0.8)
    assert np.abs(run["lock.q1"][held] - (I1 * ratio * a2 - 7.0)).max() < 1e-11
    assert run["lock.q1"][-1] == 0.0
    assert run.v[-1] == pytest.approx([ratio * end + 7.0 / I1 * 0.2, end], abs=1e-12)
    require_sound(run, 1e-11)


def test_a_latch_holds_a_falling_mass_and_lets_it_go() -> None:
    latch = rg.Lock("q1", start=0.3, end=0.55)
    run = rg.simulate(sliders(2.0), [0.0], [0.0], 1.0, 0.1, joints=[latch])
    g = 9.81
    assert times_of(run, "lock") == pytest.approx([0.3]) and times_of(run, "release") == pytest.approx([0.55])
    assert run.q[-1, 0] == pytest.approx(-0.5 * g * (0.3**2 + 0.45**2), abs=1e-13)
    assert run["lock.q1"][(run.t >= 0.3) & (run.t < 0.55)] == pytest.approx(2.0 * g)
    assert run.dissipated is not None and run.dissipated[-1] == pytest.approx(g**2 * 0.09, rel=1e-12)
    require_sound(run, 1e-12)


def test_a_sum_of_joints_is_held() -> None:
    """The angle of a body above two joints, q1 + q2, held by a lock on the sum."""
    bar = rg.load("five_bar")
    v0 = np.zeros(4)
    run = rg.simulate(bar, bar.home, v0, 0.5, 0.005, joints=[rg.Lock("q1", more=(("q2", -1.0),))])
    total = run["q1"] + run["q2"]
    assert np.abs(total - total[0]).max() < 1e-13 and np.abs(run["q1"] - bar.home[0]).max() > 1e-2
    require_sound(run, 1e-6)


def test_names_tell_a_brake_from_a_clutch() -> None:
    parts = [rg.Lock("q1", start=0.5), rg.Lock("q1", other="q2", ratio=1.0, end=0.2)]
    run = rg.simulate(flywheels(1.0, 1.0), [0.0, 0.0], [1.0, 0.0], 1.0, 0.1, joints=parts)
    assert run.part_names == ("lock.q1", "lock.q1-q2")
    assert run.v[-1] == pytest.approx([0.0, 0.5]) and run.q[-1] == pytest.approx([0.25, 0.5])


def test_locks_that_end_the_motion_of_all() -> None:
    """At a flat rhombus, between its modes, a lock of q1 stops it there, as it does just before and after."""
    rhombus = rg.load("rhombus")
    q0, v0 = [0.6, -0.6, 0.6], rhombus.lift([0.6, -0.6, 0.6], [-3.0])
    free = rg.simulate(rhombus, q0, v0, 0.5, 0.005)
    flat = free.crossings[0].time
    for after in (-1e-3, 0.0, 1e-3):
        run = rg.simulate(rhombus, q0, v0, 0.4, 0.005, joints=[rg.Lock("q1", start=flat + after)])
        assert np.abs(run.v[-1]).max() < 1e-12
        k = int(np.searchsorted(run.t, flat + after))
        assert np.abs(run.v[k]).max() < 1e-6
        assert abs(run.q[-1, 0]) < 0.1


def test_at_rest_where_modes_meet() -> None:
    """A flat rhombus at rest: friction holds it, or lets it go along the mode that is named."""
    rhombus, flat = rg.load("rhombus"), np.zeros(3)
    modes = [np.ravel(mode) for mode in rg.analyse(rhombus, flat).modes]
    along = next(mode for mode in modes if np.abs(mode).min() > 1e-3)
    for bound, moves in ((1e3, False), (0.1, True)):
        run = rg.simulate(
            rhombus, flat, None, 0.05, 0.005, joints=[rg.JointFriction("q1", bound)], mode=along
        )
        assert bool(np.abs(run.v[-1]).max() > 0.01) is moves
        assert np.abs(run.q[-1] * [1.0, -1.0, 1.0] - run.q[-1, 0]).max() < 1e-12
        require_sound(run, 1e-6)
    with pytest.raises(rg.SimulationError, match="singular configuration of q1, q2, q3"):
        rg.simulate(rhombus, flat, [0.0] * 3, 0.05, 0.005, joints=[rg.JointFriction("q1", 0.1)])


def test_two_stops_of_one_joint_at_one_place() -> None:
    """Rows that depend on each other and ask for different rates: the livelier stop's is the one."""
    stops = [rg.Stop("q1", lower=0.0), rg.Stop("q1", lower=0.0, restitution=0.5)]
    run = rg.simulate(sliders(1.0, 1.0), [1.0, 0.0], [0.0, 0.0], 0.6, 0.1, joints=stops)
    assert run.happenings[0].kind == "impact" and run.q[:, 0].min() > -1e-12
    k = int(np.searchsorted(run.t, run.happenings[0].time))
    assert run.v[k, 0] == pytest.approx(-0.5 * run.v[k - 1, 0])


def test_a_latch_that_an_event_closes(backend: Any) -> None:
    """A falling mass passes its latch at 0.5 m, is stopped there and held to the end of the lock."""
    g = 9.81
    latch = rg.Lock("q1", end=0.6, when=rg.Event(lambda t, q, v: float(q[0]) + 0.5, direction=-1.0))
    event = rg.Event(lambda t, q, v: float(q[0]) + 0.6)
    ask: dict[str, Any] = dict(joints=[latch], events=event, backend=backend)
    run = rg.simulate(sliders(2.0), [0.0], [0.0], 1.0, 0.1, **ask)
    fall = np.sqrt(1.0 / g)
    assert [x.kind for x in run.happenings] == ["lock", "hold", "release"]
    assert times_of(run, "lock") == pytest.approx([fall], abs=1e-13)
    assert run.happenings[0].loss == pytest.approx(2.0 * g * 0.5, rel=1e-12)
    assert run["lock.q1"][(run.t >= fall) & (run.t < 0.6)] == pytest.approx(2.0 * g)
    assert run.q[-1, 0] == pytest.approx(-0.5 - 0.5 * g * 0.16, abs=1e-12)
    assert run.ended_by is None and len(run.t_events) == 1
    assert run.t_events[0] == pytest.approx([0.6 + np.sqrt(0.2 / g)], abs=1e-12)
    sim = rg.Simulation(sliders(2.0), [0.0], [0.0], 0.1, **ask).step(n=5)
    state = sim.save()
    assert sim.step(n=5).q[0] == pytest.approx(run.q[-1, 0], abs=1e-13)
    assert sim.restore(state).step(n=5).happenings == sim.happenings and len(sim.happenings) == 3


@pytest.mark.parametrize("h", [0.05, 0.013])
def test_latches_that_events_close_at_one_time(h: float, backend: Any) -> None:
    """By the clock, and where both of two masses that are thrown up alike turn back."""
    top = 1.0 / 9.81
    for first, second, when in (
        (lambda t, q, v: t - 0.2, lambda t, q, v: t - 0.2, 0.2),
        (lambda t, q, v: v[0], lambda t, q, v: v[1], top),
    ):
        latches = [rg.Lock("q1", when=first), rg.Lock("q2", when=second)]
        run = rg.simulate(sliders(1.0, 1.0), [0.5, 0.5], [1.0, 1.0], 0.5, h, joints=latches, backend=backend)
        assert np.all(run.v[-1] == 0.0) and run.q[-1] == pytest.approx(0.5 + when - 0.5 * 9.81 * when**2)
        assert {name for x in run.happenings if x.kind == "hold" for name in x.joints} == {"q1", "q2"}


def test_what_closes_a_latch_is_named_where_it_is_no_number() -> None:
    latch = rg.Lock("q1", when=lambda t, q, v: "soon")
    with pytest.raises(rg.OptionError, match="Lock 'q1': when"):
        rg.simulate(sliders(1.0), [0.5], [1.0], 0.5, 0.05, joints=[latch])


def test_an_event_counts_from_the_start_of_its_lock() -> None:
    """Zeros before `start` close nothing; a function that is below zero at `start` already is no zero."""
    spin, found = flywheels(1.0), []
    for start, when in ((0.0, 0.25), (0.3, 0.75), (0.6, 0.75)):
        passing = rg.Event(lambda t, q, v: np.cos(2.0 * np.pi * t))
        lock = rg.Lock("q1", start=start, when=passing)
        run = rg.simulate(spin, [0.0], [2.0], 1.0, 0.1, joints=[lock])
        found.append(times_of(run, "lock")[0] - when)
        assert run.v[-1, 0] == pytest.approx(0.0, abs=1e-15)
        assert run.q[-1, 0] == pytest.approx(2.0 * when, abs=1e-12)
    assert np.abs(found).max() < 1e-13
    with pytest.raises(rg.OptionError, match="when"):
        rg.Lock("q1", when=3.0)  # type: ignore[arg-type]


def test_a_latch_of_a_loop_at_order_four() -> None:
    """A slider-crank latches where its slide passes a place: the same in every choice of y."""
    crank, ends = rg.load("slider_crank"), []
    latch = rg.Lock("q1", when=rg.Event(lambda t, q, v: float(q[2]) - 2.8, direction=-1.0), end=1.6)
    for y in ("q1", "q3"):
        runs = [
            rg.simulate(crank.with_independent([y]), crank.home, [0.0] * 3, 2.0, h, joints=[latch])
            for h in (0.02, 0.01, 0.005)
        ]
        times = [times_of(run, "lock")[0] for run in runs]
        assert np.log2(abs(times[1] - times[0]) / abs(times[2] - times[1])) > 3.7
        require_sound(runs[-1], 1e-5)
        k = int(np.searchsorted(runs[-1].t, times[-1]))
        assert np.abs(runs[-1].v[k]).max() < 1e-12 and np.abs(runs[-1].v[k - 1]).max() > 0.5
        assert runs[-1].t[k - 1] == np.nextafter(times[-1], 0.0)
        ends.append(runs[-1].q[-1])
    assert np.abs(ends[0] - ends[1]).max() < 1e-7


@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_a_lock_that_begins_at_a_dead_point(speed: float, backend: Any) -> None:
    """At first order it holds nothing there; it stops the crank as it does beside that place."""
    crank, lock = rg.load("slider_crank"), [rg.Lock("q3")]
    kw: dict[str, Any] = {"joints": lock, "backend": backend, "record": ("energy", "a", "tau")}
    for beside in (0.0, 1e-10, 1e-6):
        q0 = crank.assemble({"q1": np.pi - beside}, hold=["q1"])
        v0 = crank.lift(q0, [speed])
        run = rg.simulate(crank, q0, v0, 0.05, 1e-3, **kw)
        assert not run.v[-1].any() and np.abs(run.q[-1] - q0).max() < 1e-4
        lost = crank.energy(q0, v0) - crank.energy(q0, np.zeros(3))
        assert run.dissipated[-1] == pytest.approx(lost, abs=1e-3)
        require_sound(run, 1e-9)


def test_derivatives_do_not_follow_a_lock_at_a_dead_point() -> None:
    crank = rg.load("slider_crank")
    q0 = crank.assemble({"q1": np.pi}, hold=["q1"])
    run = rg.simulate(crank, q0, duration=0.05, step=1e-3, joints=[rg.Lock("q3")])
    with pytest.raises(rg.NotDifferentiableError, match="lock of q3 stops it beside a dead point"):
        rg.sensitivity(run)
