"""Stops: closed forms, orders through impacts, one motion for every choice of y, singular places."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.simulation.phases.polynomial_zeros import falling_root

from .machines import BACKENDS, orders, pendulum, require_backend, require_sound, sliders, times_of
from .machines import change_point as two_modes

G = 9.81


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def test_a_bouncing_mass_comes_to_rest_at_the_sum_of_its_bounces() -> None:
    """146 impacts down to 1e-6 m/s at e = 0.9, each where the series has it; then the stop carries it."""
    e, speed = 0.9, np.sqrt(2.0 * G)
    stop = rg.Stop("q1", lower=0.0, restitution=e)
    run = rg.simulate(sliders(2.0), [1.0], [0.0], 9.0, 0.05, joints=[stop])
    impacts = times_of(run, "impact")
    exact = speed / G * (1.0 + 2.0 * np.cumsum([0.0, *(e ** np.arange(1.0, len(impacts)))]))
    assert len(impacts) == 146
    assert np.abs(impacts - exact).max() < 1e-12
    rest = [x for x in run.happenings if x.kind == "hold"]
    assert len(rest) == 1 and rest[0].joints == ("q1",)
    assert 0.0 <= speed / G * (1.0 + e) / (1.0 - e) - rest[0].time < 5e-6
    assert run["stop.q1"][-1] == pytest.approx(2.0 * G, rel=1e-12) and run["stop.q1"][0] == 0.0
    assert run.dissipated is not None and run.dissipated[-1] == pytest.approx(2.0 * G, rel=1e-12)
    require_sound(run, 1e-10)
    assert run.q.min() > -1e-13


@pytest.mark.parametrize("push", [1e3, 1e5, 1e7])
def test_a_mass_that_is_pushed_hard_comes_to_rest_too(push: float, backend: Any) -> None:
    """Where a stop's rounding, 4e-17 m, is as much as a bounce at 1e-6 m/s."""
    e, at, fall = 0.5, 0.35, 0.01
    stop, time = rg.Stop("q1", lower=at, restitution=e), float(np.sqrt(2.0 * fall / (push + G)))
    run = rg.simulate(
        sliders(1.0),
        [at + fall],
        [0.0],
        5.0 * time,
        0.1 * time,
        torque=[-push],
        joints=[stop],
        backend=backend,
    )
    (rest,) = times_of(run, "hold")
    assert rest == pytest.approx(time * (1.0 + 2.0 * e / (1.0 - e)), rel=1e-5)
    speed = np.sqrt(2.0 * fall * (push + G))
    assert len(times_of(run, "impact")) <= np.log(speed / 1e-6) / np.log(1.0 / e) + 2.0
    assert run["stop.q1"][-1] == pytest.approx(push + G, rel=1e-12)


def test_outputs_are_at_the_usual_times_and_around_events(backend: Any) -> None:
    stop = rg.Stop("q1", lower=0.0, restitution=0.5)
    run = rg.simulate(sliders(1.0), [1.0], [0.0], 0.8, 0.1, joints=[stop], backend=backend)
    impact = times_of(run, "impact")[0]
    assert impact == pytest.approx(np.sqrt(2.0 / G), abs=1e-14)
    grid = rg.simulate(sliders(1.0), [1.0], [0.0], 0.8, 0.1, backend=backend).t
    assert set(grid) <= set(run.t) and len(run.t) == len(grid) + 2
    k = int(np.searchsorted(run.t, impact))
    assert run.t[k] == impact and run.t[k - 1] == np.nextafter(impact, 0.0)
    assert run.v[k, 0] == pytest.approx(-0.5 * run.v[k - 1, 0], rel=1e-14)
    assert (run.stats.native_steps > 0) == (backend == "native")
    half = run.at(0.5 * (impact + run.t[k + 1]))
    fall = half.t - impact
    assert half.q[0] == pytest.approx(run.v[k, 0] * fall - 0.5 * G * fall**2, abs=1e-14)


def swing(t_end: float, at: float, e: float) -> np.ndarray:
    """Impacts of a pendulum on a stop above, by DOP853 and the impact law by hand."""
    t, x, found = 0.0, np.array([0.0, 0.0]), []

    def stop(t: float, x: np.ndarray) -> float:
        return float(x[0] - at)

    stop.terminal, stop.direction = True, -1.0  # type: ignore[attr-defined]
    while True:
        part = solve_ivp(
            lambda t, x: [x[1], -G * np.cos(x[0])],
            (t, t_end),
            x,
            "DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=stop,
        )
        if part.status == 0:
            return np.array(found)
        t, x = part.t[-1], part.y[:, -1] * np.array([1.0, -e])
        found.append(t)


def test_a_pendulum_meets_its_stop_at_order_four(backend: Any) -> None:
    exact, found = swing(2.0, -1.2, 0.8), []
    for h in (0.02, 0.01, 0.005):
        stop = rg.Stop("q1", lower=-1.2, restitution=0.8)
        run = rg.simulate(pendulum(), [0.0], [0.0], 2.0, h, joints=[stop], backend=backend)
        found.append(np.abs(times_of(run, "impact") - exact).max())
        require_sound(run, 0.2 * h**3)
    assert found[-1] < 1e-8
    assert np.log2(found[0] / found[1]) > 3.5 and np.log2(found[1] / found[2]) > 3.8


def test_a_stop_of_a_dependent_joint_at_order_four() -> None:
    crank, runs = rg.load("slider_crank"), []
    for h in (0.01, 0.005, 0.0025):
        stop = rg.Stop("q3", lower=2.6, restitution=0.7)
        runs.append(rg.simulate(crank, crank.home, [0.0] * 3, 2.6, h, joints=[stop]))
    assert orders([times_of(run, "impact") for run in runs]).min() > 3.8
    assert orders([run.q[-1] for run in runs]).min() > 3.8
    require_sound(runs[-1], 1e-7)
    assert runs[-1].q[:, 2].min() > 2.6 - 1e-12
    energy = [np.abs(run.energy_error()).max() for run in runs]
    assert energy[1] / energy[2] > 14.0


@pytest.mark.parametrize("y", ["q2", "q3"])
def test_the_same_happenings_in_every_choice_of_coordinates(y: str) -> None:
    crank = rg.load("slider_crank")
    parts = [rg.Stop("q3", lower=2.6, upper=3.2, restitution=0.4), rg.JointFriction("q2", 0.3)]
    ask: dict[str, Any] = dict(q0=crank.home, v0=[0.0] * 3, duration=2.0, step=0.005, joints=parts)
    one, other = rg.simulate(crank, **ask), rg.simulate(crank.with_independent([y]), **ask)
    assert [(x.kind, x.joints) for x in one.happenings] == [(x.kind, x.joints) for x in other.happenings]
    assert len(one.happenings) > 5
    assert np.abs(times_of(one, "impact") - times_of(other, "impact")).max() < 1e-7
    assert np.abs(one.q[-1] - other.q[-1]).max() < 1e-6


def test_both_stops_of_a_mirrored_machine_are_as_one_half() -> None:
    """Two slider-cranks of which one lock makes one: stops on dependent rows at the same time."""
    half = sliders(1.0)
    both = sliders(1.0, 1.0)
    stops = [rg.Stop("q1", lower=0.0, restitution=0.6), rg.Stop("q2", lower=0.0, restitution=0.6)]
    tie = rg.Lock("q1", other="q2", ratio=1.0)
    one = rg.simulate(half, [1.0], [0.0], 1.5, 0.05, joints=stops[:1])
    two = rg.simulate(both, [1.0, 1.0], [0.0, 0.0], 1.5, 0.05, joints=[*stops, tie])
    assert np.abs(times_of(one, "impact") - times_of(two, "impact")).max() < 1e-13
    assert two.happenings[1].joints == ("q1", "q2")
    assert np.abs(two.q[-1] - one.q[-1]).max() < 1e-12


def hunt_crossley(t_end: float) -> np.ndarray:
    """q, v of 1 kg falling from 0.1 m on a spring of 2,000 N/m with 0.3 s/m of damping."""
    t, x, inside = 0.0, np.array([0.1, 0.0]), False

    def surface(t: float, x: np.ndarray) -> float:
        return float(x[0])

    surface.terminal = True  # type: ignore[attr-defined]
    while True:
        surface.direction = 1.0 if inside else -1.0  # type: ignore[attr-defined]
        force = 2000.0 if inside else 0.0
        part = solve_ivp(
            lambda t, x, f=force: [x[1], -G - f * x[0] * (1.0 - 0.3 * x[1])],
            (t, t_end), x, "DOP853", rtol=1e-13, atol=1e-15, events=surface,
        )  # fmt: skip
        t, x = part.t[-1], part.y[:, -1]
        if part.status == 0:
            return x
        inside = not inside


def test_a_springy_stop_at_order_four(backend: Any) -> None:
    exact, found = hunt_crossley(0.3), []
    for h in (2e-3, 1e-3, 5e-4):
        stop = rg.Stop("q1", lower=0.0, stiffness=2000.0, damping=0.3)
        run = rg.simulate(sliders(1.0), [0.1], [0.0], 0.3, h, joints=[stop], backend=backend)
        found.append(np.abs(np.array([run.q[-1, 0], run.v[-1, 0]]) - exact).max())
        require_sound(run, 2e5 * h**4)
    assert {x.kind for x in run.happenings} == {"touch", "leave"}
    assert run["stop.q1"].min() >= -1e-9
    assert np.log2(found[1] / found[2]) > 3.6 and found[2] < 1e-6


def test_a_stop_lets_go_where_its_force_turns() -> None:
    """1 kg on a stop under gravity, pulled up by 20 t: it leaves at t = g/20, as the closed form says."""
    stop = rg.Stop("q1", lower=0.0)
    pull = {"q1": lambda t, q, v: 20.0 * t}
    run = rg.simulate(sliders(1.0), [0.0], [0.0], 1.0, 0.07, torque=pull, joints=[stop])
    release = times_of(run, "release")
    assert np.abs(release - G / 20.0).max() < 1e-13 and len(release) == 1
    s = 1.0 - G / 20.0
    assert run.q[-1, 0] == pytest.approx(20.0 * s**3 / 6.0, abs=1e-13)
    held = run.t < release[0]
    assert np.abs(run["stop.q1"][held] - (G - 20.0 * run.t[held])).max() < 1e-12


@pytest.mark.parametrize("beyond", [0.1, 1e-3, 0.0])
def test_a_stop_behind_a_crossing(beyond: float) -> None:
    """The change-point linkage passes a crossing and meets a stop just behind it, whatever y is."""
    mech, start, v = two_modes()
    free = rg.simulate(mech, start, v, 1.0, 0.005)
    crossing = free.crossings[0]
    rate = float(np.sign(free.at(crossing.time).v[0]))
    place = crossing.q[0] + rate * beyond
    limit = {"upper" if rate > 0.0 else "lower": float(place)}
    found = []
    for y in ("q1", "q3"):
        run = rg.simulate(
            mech.with_independent([y]),
            start,
            v,
            0.9,
            0.0025,
            joints=[rg.Stop("q1", restitution=0.8, **limit)],
        )
        require_sound(run, 1e-4)
        assert (rate * (run.q[:, 0] - place)).max() < 1e-11
        found.append(run)
    one, two = (times_of(run, "impact") for run in found)
    assert len(one) == len(two) >= 1 and np.abs(one - two).max() < 1e-8
    assert np.abs(found[0].q[-1] - found[1].q[-1]).max() < 1e-6


def test_an_elastic_impact_runs_backwards() -> None:
    crank, stop = rg.load("slider_crank"), [rg.Stop("q3", lower=2.6, restitution=1.0)]
    there = rg.simulate(crank, crank.home, [0.0] * 3, 1.5, 0.0025, joints=stop)
    back = rg.simulate(crank, there.q[-1], -there.v[-1], 1.5, 0.0025, joints=stop)
    assert np.abs(back.q[-1] - crank.home).max() < 1e-7
    assert there.dissipated is not None and abs(there.dissipated[-1]) < 1e-9


def test_an_impulse_by_itself() -> None:
    """Two masses geared 1 : 2 strike: m_r u⁺ = −e m_r u⁻, and the stop's impulse is what changes momentum."""
    pair = sliders(1.0, 3.0)
    geared = rg.Mechanism.from_pinocchio(pair.model, [rg.CouplingClosure("q2", "q1", 2.0)], ["q1"])
    stop = rg.Stop("q2", lower=0.0, restitution=0.5)
    found = geared.impact([0.0, 0.0], [-1.0, -2.0], [stop, rg.JointFriction("q1", 3.0)])
    assert np.abs(found.v - [0.5, 1.0]).max() < 1e-14
    assert found.impulses == {"stop.q2": pytest.approx(13.0 * 1.5 / 2.0, rel=1e-13)}
    assert found.loss == pytest.approx(0.5 * 13.0 * (1.0 - 0.25), rel=1e-13)
    away = geared.impact([0.0, 0.0], [1.0, 2.0], [stop])
    assert away.loss == 0.0 and np.array_equal(away.v, [1.0, 2.0])
    locked = geared.impact([1.0, 2.0], [1.0, 2.0], [rg.Lock("q1")])
    assert np.abs(locked.v).max() < 1e-15 and locked.impulses["lock.q1"] == pytest.approx(-13.0)


def test_a_free_base_strikes_with_a_leg() -> None:
    """A row of a single-number joint on a floating base: momentum of the whole is kept."""
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia(3.0, np.zeros(3), 0.2 * np.eye(3)), pin.SE3.Identity())
    leg = model.addJoint(base, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, 0.2, 0.1])), "q1")
    body = pin.Inertia(1.0, np.array([0.0, 0.3, 0.0]), 0.02 * np.eye(3))
    model.appendBodyToJoint(leg, body, pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model)
    v0 = np.array([0.1, 0.2, -0.1, 0.3, -0.2, 0.1, 4.0])
    parts = [rg.Stop("q1", upper=0.5, restitution=0.8), rg.Stop("q1", lower=-0.2, restitution=0.9)]
    run = rg.simulate(mech, mech.home, v0, 2.0, 0.005, joints=parts)
    assert len(times_of(run, "impact")) >= 2
    data = model.createData()
    momenta = [
        pin.computeCentroidalMomentum(model, data, q, v).vector.copy()
        for q, v in zip(run.q, run.v, strict=True)
    ]
    assert np.abs(np.array(momenta) - momenta[0]).max() < 1e-7
    require_sound(run, 1e-7)


def test_what_happened_is_saved(tmp_path: Path) -> None:
    run = rg.simulate(
        sliders(1.0), [1.0], [0.0], 0.8, 0.05, joints=[rg.Stop("q1", lower=0.0)], record=("energy", "tau")
    )
    read = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert read.happenings == run.happenings and read.part_names == ("stop.q1",)
    for name in ("q1", "dissipated", "stop.q1", "tau.q1", "energy"):
        assert np.array_equal(read[name], run[name])
    assert np.array_equal(read.energy_error(), run.energy_error())
    assert run["tau.q1"][-1] == pytest.approx(G)
    with pytest.raises(rg.OptionError, match="holds no phases"):
        rg.gradient(read, rg.Cost(terminal=lambda q, v: 0.0, terminal_slopes=lambda q, v: (q * 0.0, v * 0.0)))


def test_constraint_forces_include_the_stops() -> None:
    """A crank pressed on a stop of its slide: λ balances torque, gravity and the stop."""
    crank = rg.load("slider_crank")
    stop = rg.Stop("q3", upper=float(crank.home[2]))
    run = rg.simulate(crank, crank.home, [0.0] * 3, 0.1, 0.01, joints=[stop], record=("multipliers", "tau"))
    q, tree = crank.home, crank.tree
    force = tree.rnea(q, np.zeros(3), np.zeros(3)).copy()
    assert run.multipliers is not None
    assert np.abs(crank.K(q).T @ run.multipliers[-1] - force + [0.0, 0.0, run["stop.q3"][-1]]).max() < 1e-9


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: rg.Stop("q1"), "lower, upper or both"),
        (lambda: rg.Stop("q1", lower=1.0, upper=1.0), "below upper"),
        (lambda: rg.Stop("q1", lower=0.0, restitution=1.1), "restitution = 1.1"),
        (lambda: rg.Stop("q1", lower=0.0, restitution=-0.1), "restitution = -0.1"),
        (lambda: rg.Stop("q1", lower=np.nan), "finite"),
        (lambda: rg.Stop("q1", lower=0.0, damping=1.0), "damping goes with stiffness"),
        (lambda: rg.Stop("q1", lower=0.0, stiffness=-1.0), "positive"),
        (lambda: rg.Stop("q1", lower=0.0, stiffness=1.0, restitution=0.5), "rigid"),
        (lambda: rg.Stop("q1", lower=0.0, other="q2"), "ratio"),
        (lambda: rg.JointFriction("q1", -1.0), "bound = -1.0"),
        (lambda: rg.Lock("q1", start=1.0, end=1.0), "before end"),
        (lambda: rg.Lock(3), "name"),  # type: ignore[arg-type]
    ],
)
def test_parts_that_are_none(make: Any, words: str) -> None:
    with pytest.raises(rg.RobustGcpError, match=words):
        make()


def test_starts_and_arguments_that_do_not_fit() -> None:
    mech, stop = sliders(1.0, 1.0), rg.Stop("q1", lower=0.0)
    ask: dict[str, Any] = dict(duration=0.2, step=0.1)
    with pytest.raises(rg.StateError, match=r"0\.5 beyond Stop 'q1', lower = 0\.0"):
        rg.simulate(mech, [-0.5, 0.0], [0.0, 0.0], joints=[stop], **ask)
    with pytest.raises(rg.ModelError, match="q9"):
        rg.simulate(mech, joints=[rg.Stop("q9", lower=0.0)], **ask)
    with pytest.raises(rg.OptionError, match="write"):
        rg.simulate(mech, joints=stop, **ask)  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match="no Stop"):
        rg.simulate(mech, joints=["q1"], **ask)  # type: ignore[list-item]
    for name, value in {"stepper": "DOP853", "method": "classical"}.items():
        with pytest.raises(rg.OptionError, match=name):
            rg.simulate(mech, [1.0, 1.0], [0.0, 0.0], joints=[stop], **{**ask, name: value})
    model = pin.Model()
    ball = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(ball, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(rg.ModelError, match="ball"):
        rg.simulate(rg.Mechanism.from_pinocchio(model), joints=[rg.Lock("ball")], **ask)


def test_a_kind_of_stop_of_ones_own() -> None:
    class Bumper(rg.Stop):
        """A stop by another name."""

    run = rg.simulate(sliders(1.0), [1.0], [0.0], 0.5, 0.05, joints=[Bumper("q1", lower=0.0)])
    assert run.part_names == ("stop.q1",) and [x.kind for x in run.happenings] == ["impact", "hold"]


def test_an_error_tells_what_was_simulated() -> None:
    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([np.nan if t > 0.6 else 0.0])

    with pytest.raises(rg.NonFiniteError) as caught:
        rg.simulate(sliders(1.0), [1.0], [0.0], 0.9, 0.05, torque=torque, joints=[rg.Stop("q1", lower=0.0)])
    assert caught.value.trajectory.t[-1] > 0.5 and len(caught.value.trajectory.happenings) == 2


def test_a_run_without_parts_takes_no_path_of_this(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("course", "machine", "first_event", "watch", "admissible"):
        monkeypatch.setitem(sys.modules, f"robust_gcp.simulation.phases.{name}", None)  # not to be imported
    run = rg.simulate(sliders(1.0), [1.0], [0.0], 0.1, 0.05)
    assert run.happenings == [] and run.dissipated is None and run.part_forces is None


def test_stops_that_drive_each_other_raise_no_energy() -> None:
    """Two stops of unlike restitution rattle against each other down to rest."""
    bar = rg.load("five_bar")
    q = bar.home
    stops = [
        rg.Stop("q2", float(q[1]), float(q[1]) + 0.2, 0.3),
        rg.Stop("q4", float(q[3]), float(q[3]) + 0.2, 0.7),
    ]
    for speed in np.random.default_rng(3).normal(0.0, 1.0, (40, 2)):
        v = bar.lift(q, speed)
        found = bar.impact(q, v, stops)
        assert found.loss >= -1e-12
        assert min(found.v[1], found.v[3]) > -1e-9


def test_a_stop_beside_a_dead_point_of_its_joint() -> None:
    """Inside by 1e-9 m it is met with half the speed of the crank, and told; at the dead point it is not."""
    crank = rg.load("slider_crank")
    q0, top = crank.assemble({"q1": 0.3}, hold=["q1"]), crank.assemble({"q1": 0.0}, hold=["q1"])[2]
    v0 = crank.lift(q0, [-3.0])
    free = rg.simulate(crank, q0, v0, 0.3, 0.005)
    with pytest.warns(rg.SingularityWarning, match="dead point"):
        met = rg.simulate(
            crank, q0, v0, 0.3, 0.005, joints=[rg.Stop("q3", upper=top - 1e-9, restitution=0.5)]
        )
    assert [x.kind for x in met.happenings] == ["grazing"]
    k = int(np.searchsorted(met.t, met.happenings[0].time))
    assert met.v[k, 0] == pytest.approx(-0.5 * met.v[k - 1, 0], rel=1e-9)
    require_sound(met, 1e-6)
    passed = rg.simulate(crank, q0, v0, 0.3, 0.005, joints=[rg.Stop("q3", upper=top, restitution=0.5)])
    assert passed.happenings == [] and np.abs(passed.q[-1] - free.q[-1]).max() < 1e-9


@pytest.mark.parametrize("inside", [1.2e-13, 1.6e-13, 1e-12])
def test_what_a_stop_hardly_inside_a_dead_point_takes_is_told(inside: float) -> None:
    """Its rate is that of a bounce off rounding, but nothing brings it back: it is no rest."""
    crank = rg.load("slider_crank")
    q0, top = (crank.assemble({"q1": y}, hold=["q1"]) for y in (0.3, 0.0))
    stop = rg.Stop("q3", upper=top[2] - inside, restitution=0.5)
    with pytest.warns(rg.SingularityWarning, match="dead point"):
        run = rg.simulate(
            crank, q0, crank.lift(q0, [-3.0]), 0.3, 0.005, joints=[stop], record=("energy", "a", "tau")
        )
    assert [x.kind for x in run.happenings] == ["grazing"] and run.happenings[0].loss > 5.0
    require_sound(run, 1e-6)


@pytest.mark.parametrize("beside", [1e-9, 1e-10, 1e-11])
def test_a_start_just_before_a_stop_at_a_dead_point(beside: float) -> None:
    """Its rate is more than rounding, and no impulse changes it: the motion passes."""
    crank = rg.load("slider_crank")
    q0, top = (crank.assemble({"q1": y}, hold=["q1"]) for y in (beside, 0.0))
    stop = rg.Stop("q3", upper=top[2], restitution=0.5)
    run = rg.simulate(crank, q0, crank.lift(q0, [-3.0]), 0.2, 0.005, joints=[stop])
    free = rg.simulate(crank, q0, crank.lift(q0, [-3.0]), 0.2, 0.005)
    assert run.happenings == []
    np.testing.assert_allclose(run.q[-1], free.q[-1], atol=1e-12)
    drive = {"q1": rg.Motion(lambda t: beside - 3.0 * t)}
    driven = rg.simulate(crank, duration=0.2, step=0.005, drive=drive, joints=[stop])
    assert driven.happenings == []


def test_a_stop_at_a_singular_place() -> None:
    """A rhombus meets a stop of q2 where its modes meet: when it would pass, along its mode."""
    rhombus = rg.load("rhombus")
    q0, v0 = [0.2, -0.2, 0.2], rhombus.lift([0.2, -0.2, 0.2], [-2.0])
    free = rg.simulate(rhombus, q0, v0, 0.2, 0.005)
    run = rg.simulate(rhombus, q0, v0, 0.12, 0.005, joints=[rg.Stop("q2", upper=0.0, restitution=0.5)])
    assert times_of(run, "impact") == pytest.approx([free.crossings[0].time], abs=1e-9)
    k = int(np.searchsorted(run.t, run.happenings[0].time))
    assert np.abs(run.v[k] + 0.5 * run.v[k - 1]).max() < 1e-9
    assert np.abs(run.v[k] * [1.0, -1.0, 1.0] - run.v[k, 0]).max() < 1e-9
    require_sound(run, 1e-6)


@pytest.mark.parametrize(
    ("step", "upper"), [(0.02, 2.45), (0.05, 2.4574)]
)  # the second step fails as a whole
def test_a_stop_keeps_a_mechanism_from_where_a_run_would_end(step: float, upper: float) -> None:
    """A rocker as coordinate, on_toggle="error": a stop before its dead point is met, and the run goes on."""
    mech = rg.load("crank_rocker").with_independent(["q3"])
    v0 = mech.lift(mech.home, [2.0])
    ask: dict[str, Any] = dict(q0=mech.home, duration=0.8, step=step, on_toggle="error")
    v0 *= 6.0 / v0[0]
    with pytest.raises(rg.ToggleError):
        rg.simulate(mech, v0=v0, **ask)
    stop = [rg.Stop("q3", upper=upper, restitution=0.2)]
    run = rg.simulate(mech, v0=v0, joints=stop, **ask)
    assert len(times_of(run, "impact")) >= 1 and run.t[-1] == 0.8
    idle = {"q1": lambda t, q, v: 0.0}
    held = rg.simulate(mech, v0=v0, joints=stop, torque=idle, hold=True, **ask)  # step by step
    # near its dead point y costs the others half of their digits; each impact is a fifth as fast as the one
    # before, and the rounding of q leaves its time that much less sure: the ninth has 3e-6 of the first speed
    apart = np.abs(times_of(held, "impact") - times_of(run, "impact"))
    assert (apart * 0.2 ** np.arange(len(apart))).max() < 1e-11 and apart[:2].max() < 1e-11
    assert held.t.shape == run.t.shape and np.abs(held.q[-1] - run.q[-1]).max() < 1e-9


@pytest.mark.parametrize("y", ["q1", "q2", "q3"])
def test_what_an_impact_leaves_of_a_velocity_is_zero(y: str) -> None:
    """Plastic stops that end a four-bar's motion: rounding is no velocity, whatever the coordinates."""
    mech = linkages.four_bar(1.4, 1.1, 2.0, 1.7, y=1.1).with_independent([y])
    for place in np.linspace(0.01, 0.4, 12):
        stops = [rg.Stop("q3", upper=float(mech.home[2] + place)), rg.JointFriction("q2", 1.3)]
        v0 = mech.lift(mech.home, [1.0])
        v0 *= 3.0 / v0[2]
        run = rg.simulate(mech, mech.home, v0, 0.4, 0.002, joints=stops, torque=[0.0, 0.0, 9.0])
        assert len(times_of(run, "impact")) == 1 and run["q3"].max() <= mech.home[2] + place + 1e-12


@pytest.mark.filterwarnings("ignore::robust_gcp.StabilityWarning")
def test_a_motion_that_leaves_the_finite_numbers_says_so(backend: Any) -> None:
    """A damper for whose slopes the steps are a hundred times too long."""
    shipped = rg.load("flyball")
    joint, home = shipped.joints[1].name, shipped.home
    forces = [*shipped.forces, rg.JointDamper(joint, 1e3)]
    mech = rg.Mechanism.from_pinocchio(shipped.model, [], shipped.independent, home, forces=forces)
    stop = rg.Stop(joint, lower=-10.0, upper=10.0)
    with pytest.raises(rg.NonFiniteError, match="smaller step") as caught:
        rg.simulate(mech, home, np.ones(mech.nv), 0.2, 4e-3, joints=[stop], backend=backend)
    assert caught.value.trajectory is not None


def test_roots_of_polynomials_whose_leading_coefficients_are_nothing() -> None:
    """Quotients by these overflow."""
    for tiny in (0.0, 5e-324, -1e-310, 1e-200):
        root = falling_root(np.array([tiny, 0.0, 2.0, -3.0, 1.0]), 1e-12)
        assert root is not None and root[0] == pytest.approx(0.5, abs=1e-15)
