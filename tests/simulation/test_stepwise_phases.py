"""`Simulation` with stops, friction and locks: the motion of `simulate`, and the way back into a phase."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.meetings import cusp_cam

from .machines import BACKENDS, change_point, pendulum, require_backend, require_sound, sliders, times_of

G = 9.81


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def crank_parts() -> tuple[rg.Mechanism, list[Any]]:
    return rg.load("slider_crank"), [
        rg.Stop("q3", lower=2.6, restitution=0.5),
        rg.JointFriction("q1", 2.0),
        rg.Lock("q2", start=1.603, end=1.7),
    ]


def require_same(one: rg.Trajectory, two: rg.Trajectory, within: float = 1e-12) -> None:
    assert [(x.kind, x.joints) for x in one.happenings] == [(x.kind, x.joints) for x in two.happenings]
    times = np.array([[x.time for x in run.happenings] for run in (one, two)])
    assert np.abs(times[0] - times[1]).max(initial=0.0) < within
    assert one.t.shape == two.t.shape and np.abs(one.t - two.t).max() < within
    for name in ("q", "v", "part_forces", "dissipated"):
        a, b = getattr(one, name), getattr(two, name)
        assert np.abs(a - b).max() < 100.0 * within * (1.0 + np.abs(b).max()), name


@pytest.mark.parametrize("sizes", [[1] * 160, [7, 33, 120]])
def test_the_motion_of_a_whole_run(backend: Any, sizes: list[int]) -> None:
    """Impacts, rests, slips and a lock, with torques held: one step at a time, or some."""
    mech, parts = crank_parts()
    ask: dict[str, Any] = dict(joints=parts, backend=backend)
    run = rg.simulate(mech, mech.home, [0.0] * 3, 3.2, 0.02, torque={"q1": 0.3}, **ask)
    sim = rg.Simulation(mech, mech.home, [0.0] * 3, 0.02, record=["multipliers"], **ask)
    for n in sizes:
        sim.step({"q1": 0.3}, n=n)
    assert len(run.happenings) > 6
    require_same(sim.trajectory, run)
    require_sound(sim.trajectory, 1e-3)
    assert sim.happenings == sim.trajectory.happenings
    assert sim.t == pytest.approx(3.2) and np.abs(sim.q - run.q[-1]).max() < 1e-12
    assert sim.dissipated == pytest.approx(run.dissipated[-1], rel=1e-12)  # type: ignore[index]
    assert np.abs(sim.trajectory.reaction("q2").force[-1] - sim.reaction("q2").force).max() < 1e-9
    for name in ("stop.q3", "friction.q1", "lock.q2", "dissipated"):
        assert float(sim[name]) == pytest.approx(float(run[name][-1]), abs=1e-9)


def test_several_impacts_in_one_step() -> None:
    """A mass that bounces to rest within a step of 9 s; the step ends where it says."""
    sim = rg.Simulation(sliders(2.0), [1.0], [0.0], 9.0, joints=[rg.Stop("q1", lower=0.0, restitution=0.9)])
    sim.step()
    assert len(times_of(sim.trajectory, "impact")) == 146 and sim.t == 9.0
    assert abs(float(sim.q[0])) < 1e-13 and float(sim["stop.q1"]) == pytest.approx(2.0 * G)


def test_torques_that_change_let_go_and_hold(backend: Any) -> None:
    """A sticking mass is pulled over its bound and back: closed form, with the pull held over steps."""
    friction = rg.JointFriction("q1", 30.0)
    sim = rg.Simulation(sliders(2.0), [0.0], [0.0], 0.1, joints=[friction], backend=backend)
    pulls = [20.0, 40.0, 60.0, 60.0, 19.62, 19.62, 19.62, 19.62, 80.0]
    q = v = 0.0
    for pull in pulls:
        sim.step([pull])
        left, net = 0.1, pull - 2.0 * G
        while left > 0.0:
            if v == 0.0 and abs(net) <= 30.0:
                break
            a = (net - 30.0 * np.sign(v if v else net)) / 2.0
            span = min(left, -v / a) if v * a < 0.0 else left
            q, v, left = q + v * span + 0.5 * a * span**2, v + a * span, left - span
            v = 0.0 if abs(v) < 1e-12 else v
        assert sim.q[0] == pytest.approx(q, abs=1e-12) and sim.v[0] == pytest.approx(v, abs=1e-11)
    kinds = [x.kind for x in sim.happenings]
    assert kinds == ["hold", "release", "at rest", "hold", "release"]
    require_sound(sim.trajectory, 1e-10)


def test_torques_held_by_simulate_and_by_steps(backend: Any) -> None:
    mech, parts = crank_parts()

    def control(t: float, q: Any, v: Any) -> Any:
        return np.array([4.0 * np.sin(5.0 * t) - 0.3 * v[0], 0.0, 0.0])

    ask: dict[str, Any] = dict(joints=parts, backend=backend)
    run = rg.simulate(mech, mech.home, [0.0] * 3, 3.2, 0.02, torque=control, hold=True, **ask)
    sim = rg.Simulation(mech, mech.home, [0.0] * 3, 0.02, **ask)
    for _ in range(160):
        sim.step(control(sim.t, sim.q, sim.v))
    require_same(sim.trajectory, run, 1e-11)
    assert len(run.happenings) > 4


def test_springy_stops_under_torques_that_change(backend: Any) -> None:
    spring = [rg.Stop("q1", lower=0.0, stiffness=2000.0, damping=0.3)]

    def pull(t: float, q: Any, v: Any) -> Any:
        return np.array([3.0 * np.cos(30.0 * t)])

    ask: dict[str, Any] = dict(joints=spring, backend=backend)
    run = rg.simulate(sliders(1.0), [0.1], [0.0], 0.4, 0.004, torque=pull, hold=True, **ask)
    sim = rg.Simulation(sliders(1.0), [0.1], [0.0], 0.004, **ask)
    for _ in range(100):
        sim.step(pull(sim.t, sim.q, sim.v))
    require_same(sim.trajectory, run)
    require_sound(run, 1e-3)


def test_through_a_crossing(backend: Any) -> None:
    mech, start, v = change_point()
    stop = [rg.Stop("q1", lower=-40.0, upper=40.0, restitution=0.5), rg.JointFriction("q3", 0.3)]
    run = rg.simulate(mech, start, v, 1.0, 0.005, joints=stop, backend=backend)
    sim = rg.Simulation(mech, start, v, 0.005, joints=stop, backend=backend)
    for _ in range(200):
        sim.step()
    require_same(sim.trajectory, run, 1e-10)
    assert len(run.crossings) == len(sim.crossings) > 0
    assert [c.time for c in sim.crossings] == pytest.approx([c.time for c in run.crossings], abs=1e-9)


@pytest.mark.parametrize("before", [10, 70, 82, 84, 100])
def test_back_into_the_middle_of_a_phase(backend: Any, before: int) -> None:
    """To the last bit, as often as one likes; pickled, into another simulation, to rounding."""
    mech, parts = crank_parts()
    make = dict(step=0.02, joints=parts, backend=backend)
    sim = rg.Simulation(mech, mech.home, [0.0] * 3, **make).step({"q1": 0.3}, n=before)  # type: ignore[arg-type]
    state = sim.save()
    sim.step({"q1": 0.3}, n=160 - before)
    first, told = sim.trajectory, sim.happenings
    for _ in range(2):
        sim.restore(state)
        assert sim.t == pytest.approx(0.02 * before)
        sim.step({"q1": 0.3}, n=160 - before)
        assert np.array_equal(sim.trajectory.q, first.q) and sim.happenings == told
    other = rg.Simulation(mech, **make)  # type: ignore[arg-type]
    other.restore(pickle.loads(pickle.dumps(state))).step({"q1": 0.3}, n=160 - before)
    assert np.abs(other.q - sim.q).max() < 1e-11 and other.t == pytest.approx(sim.t)
    later = [x for x in told if x.time > 0.02 * before]
    assert [(x.kind, x.joints) for x in other.happenings] == [(x.kind, x.joints) for x in later]


def test_many_ways_on_from_one_state() -> None:
    """As often as one likes, also where each begins another phase at once."""
    sim = rg.Simulation(sliders(1.0), [0.0], [0.0], 0.1, joints=[rg.JointFriction("q1", 1.0)]).step([G])
    state = sim.save()
    for k in range(210):
        sim.restore(state).step([G + 2.0 + k])
        assert sim.v[0] == pytest.approx(0.1 * (1.0 + k))


@pytest.mark.parametrize("joints", [[], [rg.Lock("q2", start=0.05, end=0.1)]], ids=["plain", "phases"])
def test_a_visit_to_a_pickled_state_changes_neither_the_way_back_nor_a_new_beginning(joints: Any) -> None:
    """Times, locks and activations are those of the run that is gone back to, or of t0."""
    shipped = rg.load("crank_rocker")
    lag = rg.Actuator("lag", "q1", gain=(2.0,), dynamics="filter", time=(0.1,))
    mech = rg.Mechanism.from_pinocchio(
        shipped.model, shipped.closures, shipped.independent, shipped.home, actuators=[lag]
    )
    sim = rg.Simulation(mech, joints=joints, ctrl={"lag": 1.0})
    begin = sim.save()
    wanted = sim.step(n=1200).trajectory
    far = pickle.loads(pickle.dumps(sim.save()))
    for back in (lambda: sim.restore(begin), sim.reset):
        sim.restore(far)
        assert sim.t == pytest.approx(1.2)
        again = back().step(n=1200).trajectory
        assert again.happenings == wanted.happenings
        for name in ("q1", "q2", "q3", "v.q1", "activation.lag"):
            assert np.abs(again[name] - wanted[name]).max() < 1e-12
        assert np.array_equal(again.t, wanted.t)
    after = sim.step(n=3).q
    sim.restore(sim.restore(begin).step(n=1200).save())
    with pytest.raises(rg.ClosureError):
        sim.restore(dataclasses.replace(far, q=far.q + 1.0, driven=(-far.driven[0], far.driven[1])))
    assert np.abs(sim.step(n=3).q - after).max() < 1e-12


@pytest.mark.parametrize("joints", [[], [rg.Lock("q2", start=0.05, end=0.1)]], ids=["plain", "phases"])
def test_a_new_beginning_that_fails_where_it_is_looked_at_leaves_all_as_it_was(joints: Any) -> None:
    mech = rg.load("crank_rocker")

    def ahead(t: float, q: NDArray[np.float64], v: NDArray[np.float64]) -> float:
        if q[0] > 1.0:
            raise ValueError("no such place")
        return 1.0

    sims = [
        rg.Simulation(mech, joints=joints, events=rg.Event(ahead)).step([0.5, 0.0, 0.0], n=60) for _ in "ab"
    ]
    with pytest.raises(ValueError, match="no such place"):
        sims[0].reset(mech.assemble([1.2, *mech.home[1:]]))
    for sim in sims:
        sim.step([-0.3, 0.0, 0.0], n=60)
    assert sims[0].t == sims[1].t
    assert np.array_equal(sims[0].trajectory.q, sims[1].trajectory.q)
    assert sims[0].happenings == sims[1].happenings


def test_what_was_told_stays_as_it_was() -> None:
    """Costs so far of a mass that rests do not grow when it is torn off and comes to rest again."""
    sim = rg.Simulation(sliders(1.0), [0.0], [0.0], 0.05, joints=[rg.JointFriction("q1", 20.0)])
    assert sim.trajectory is not sim.trajectory
    told = sim.step(n=3).trajectory.stats
    before = dataclasses.asdict(told)
    sim.step([60.0], n=3).step([0.0], n=20)
    assert dataclasses.asdict(told) == before and told.wall_seconds > 0.0
    assert sim.trajectory.stats.rhs > told.rhs


def test_a_terminal_event_of_the_user() -> None:
    stop = [rg.Stop("q1", lower=0.0, restitution=0.9)]
    event = rg.Event(lambda t, q, v: float(v[0]), terminal=2, direction=-1.0)  # tops
    sim = rg.Simulation(sliders(1.0), [1.0], [0.0], 0.05, joints=stop, events=event)
    sim.step(n=100)
    fall = np.sqrt(2.0 / G)
    assert sim.t == pytest.approx(fall * (1.0 + 2.0 * 0.9 + 0.81), abs=1e-12)
    assert sim.ended_by == 0 and len(sim.t_events[0]) == 3  # with that of the start
    assert len(sim.happenings) == 2
    assert sim.trajectory.t[-1] == sim.t and sim.trajectory.q[-1, 0] == pytest.approx(0.9**4, abs=1e-12)
    with pytest.raises(rg.OptionError, match="ended this simulation"):
        sim.step()
    assert sim.reset([1.0], [0.0]).step(n=4).t == pytest.approx(0.2)


@pytest.mark.parametrize(("keep", "count"), [("all", 27), (10, 4), ("last", 1), ("none", 0)])
def test_what_is_kept(keep: Any, count: int) -> None:
    stop = [rg.Stop("q1", lower=0.0, restitution=0.5)]
    sim = rg.Simulation(sliders(1.0), [1.0], [0.0], 0.03, joints=stop, keep=keep)
    for _ in range(24):
        sim.step()
    run = sim.trajectory
    assert len(run.t) == count and len(run.happenings) == 1
    if count:
        assert run.t[-1] == sim.t and run.q[-1, 0] == sim.q[0]
    assert sim.dissipated == pytest.approx(0.75 * G)


def test_what_a_file_says(tmp_path: Path) -> None:
    """Limits and friction of a URDF act in steps as they do in a run."""
    path = tmp_path / "two.urdf"
    path.write_text(
        """<robot name="two"><link name="base"/>
        <link name="arm"><inertial><origin xyz="0 0.5 0"/><mass value="2"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="q1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="1 0 0"/>
        <limit lower="-0.8" upper="0.9" effort="100" velocity="9"/>
        <dynamics friction="0.7"/></joint></robot>"""
    )
    mech = rg.load(path, limits=True, friction=True)
    assert len(mech.parts) == 2
    run = rg.simulate(mech, duration=2.0, step=0.01)
    sim = rg.Simulation(mech, step=0.01).step(n=200)
    require_same(sim.trajectory, run)
    assert sim.q[0] == pytest.approx(-0.8, abs=1e-13) and float(sim["stop.q1"]) > 5.0
    assert rg.Simulation(mech, step=0.01, joints=[]).step(n=200).happenings == []


def test_what_does_not_go_together() -> None:
    parts = [rg.Stop("q1", lower=-1.0)]
    with pytest.raises(rg.OptionError, match="method="):
        rg.Simulation(pendulum(), joints=parts, method="classical")
    with pytest.raises(rg.StateError, match="beyond Stop"):
        rg.Simulation(pendulum(), [-1.5], joints=parts)
    with pytest.raises(rg.OptionError, match="no Stop"):
        rg.Simulation(pendulum(), joints=["q1"])  # type: ignore[list-item]


def test_a_simulation_that_stops_tells_when() -> None:
    mechanism = cusp_cam(0.1)
    v = mechanism.lift(mechanism.home, [-2.5])
    sim = rg.Simulation(mechanism, mechanism.home, v, joints=[rg.Stop("x", upper=0.3)])
    begun = sim.save()
    with pytest.raises(rg.CuspError):
        sim.step(n=100)
    assert 0.01 < sim.t < 0.05
    assert sim.t == pytest.approx(sim.trajectory.t[-1], abs=1e-15)
    assert sim.q == pytest.approx(sim.trajectory.q[-1], abs=0.0)
    sim.restore(begun)
    assert sim.step(n=3).t == 3e-3
