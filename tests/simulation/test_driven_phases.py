"""Joints that move as prescribed beside stops, friction and locks: moving frames, power, statics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

from .machines import BACKENDS, orders, require_backend, require_sound, sliders

SIZE, OMEGA, MASS = 0.05, 7.0, 2.0
"""Of a shaken table, m and rad/s, and of a block on it, kg."""

DRY = 3.0
TABLE = rg.Motion(
    lambda t: SIZE * np.sin(OMEGA * t) + 0.1 * t,
    lambda t: SIZE * OMEGA * np.cos(OMEGA * t) + 0.1,
    lambda t: -SIZE * OMEGA**2 * np.sin(OMEGA * t),
)

ON_THE_TABLE = {
    "friction": [rg.JointFriction("r", DRY)],
    "bounces": [rg.Stop("r", lower=-0.02, upper=0.03, restitution=0.4)],
    "both": [rg.JointFriction("r", DRY), rg.Stop("r", lower=-0.02, upper=0.03, restitution=0.4)],
    "springs": [rg.JointFriction("r", DRY), rg.Stop("r", lower=-0.02, upper=0.03, stiffness=4e3)],
    "lock": [rg.JointFriction("r", DRY), rg.Lock("r", start=0.5, end=0.9)],
}


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def block(on_table: bool) -> rg.Mechanism:
    """A block that slides along x, on a table that does or on the ground."""
    model, parent = pin.Model(), 0
    for name, mass in (("x", 3.0), ("r", MASS))[0 if on_table else 1 :]:
        parent = model.addJoint(parent, pin.JointModelPX(), pin.SE3.Identity(), name)
        body = pin.Inertia(mass, np.zeros(3), 0.1 * np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model)


def swing(size: float, rate: float, mean: float) -> rg.Motion:
    return rg.Motion(
        lambda t: mean + size * np.sin(rate * t),
        lambda t: size * rate * np.cos(rate * t),
        lambda t: -size * rate**2 * np.sin(rate * t),
    )


def turning(start: float, rate: float) -> rg.Motion:
    return rg.Motion(lambda t: start + rate * t, lambda t: rate, lambda t: 0.0)


def require_same(one: rg.Trajectory, other: rg.Trajectory, joints: tuple[str, ...], within: float) -> None:
    """The same happenings at the same times, and the same motion."""
    assert [(x.kind, x.joints) for x in one.happenings] == [(x.kind, x.joints) for x in other.happenings]
    for of in (lambda x: x.time, lambda x: x.loss):
        np.testing.assert_allclose([*map(of, one.happenings)], [*map(of, other.happenings)], atol=within)
    t = np.linspace(one.t[0], one.t[-1], 201)
    for name in joints:
        np.testing.assert_allclose(one.at(t)[name], other.at(t)[name], atol=within)


@pytest.mark.parametrize("case", ON_THE_TABLE)
def test_a_block_on_a_shaken_table_feels_its_acceleration(case: str, backend: Any) -> None:
    """In the table's frame it moves as on the ground under −m ẍ: sticks, bounces and all."""
    kw: dict[str, Any] = {"duration": 1.2, "step": 4e-3, "joints": ON_THE_TABLE[case], "backend": backend}
    kw["record"] = "a", "tau", "energy"
    shaken = rg.simulate(block(True), drive={"x": TABLE}, **kw)

    def felt(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([MASS * SIZE * OMEGA**2 * np.sin(OMEGA * t)])

    apart = rg.simulate(block(False), [0.0], [0.0], torque=felt, **kw)
    assert len(apart.happenings) > 4
    require_same(shaken, apart, ("r",), 1e-11)
    # the drive's impulses are in its work; a spring's contact is 80 rad/s fast
    require_sound(shaken, 5e-6 if case == "springs" else 1e-8)
    np.testing.assert_allclose(shaken["x"], [TABLE.at(t)[0] for t in shaken.t], atol=1e-13)
    # what the table takes moves the block too
    a = shaken["a.x"] * (3.0 + MASS) + shaken["a.r"] * MASS
    np.testing.assert_allclose(shaken["drive.x"], a, atol=1e-10)


def test_a_crank_has_to_overcome_its_slide(backend: Any) -> None:
    """By power: its torque is that without friction and F |ṙ| / ω, across both dead points of the slide."""
    crank, rate, F = rg.load("slider_crank"), 3.1, 2.5
    kw: dict[str, Any] = {"duration": 2.0, "step": 5e-3, "drive": {"q1": turning(0.4, rate)}}
    free = rg.simulate(crank, backend=backend, **kw)
    for friction in (rg.JointFriction("q3", F), rg.JointFriction("q3", 0.5, coefficient=0.2)):
        record = "energy", "a", "tau", "multipliers"
        run = rg.simulate(crank, joints=[friction], backend=backend, record=record, **kw)
        assert [x.kind for x in run.happenings] == ["at rest", "at rest"]
        own = np.isin(run.t, free.t)
        F_now = np.abs(run["friction.q3"])
        lost = F_now * np.abs(run["v.q3"]) / rate
        np.testing.assert_allclose(run["drive.q1"][own], free["drive.q1"] + lost[own], atol=1e-10)
        np.testing.assert_allclose(run["q3"][own], free["q3"], atol=1e-14)
        if friction.coefficient:  # by the reaction of its own bearing, whatever says so
            normal = run.reaction("q3").force
            across = normal - np.outer(normal @ _rail(run), _rail(run))
            np.testing.assert_allclose(F_now, 0.5 + 0.2 * np.linalg.norm(across, axis=1), rtol=1e-6)
        require_sound(run, 2e-5)


def _rail(run: rg.Trajectory) -> np.ndarray:
    """The direction of the slide, along which its frame moves."""
    way = run.frame("q3").position[40] - run.frame("q3").position[0]
    return way / np.linalg.norm(way)


@pytest.mark.parametrize("case", ["friction", "stop", "both"])
def test_a_drive_at_rest_is_a_lock(case: str, backend: Any) -> None:
    """Of one crank of a five-bar, whose other one bounces, rubs and comes to rest."""
    mech = rg.load("five_bar")
    parts: list[Any] = [rg.Stop("q3", lower=mech.home[2] - 0.05, upper=mech.home[2] + 0.2, restitution=0.5)]
    dry: list[Any] = [rg.JointFriction("q2", 0.6), rg.JointFriction("q3", 0.4)]
    parts = {"friction": dry, "stop": parts, "both": parts + dry}[case]
    kw: dict[str, Any] = {"duration": 0.3, "step": 2e-3, "backend": backend, "record": ("a", "energy", "tau")}
    driven = rg.simulate(mech, drive={"q1": rg.Motion(2.2)}, joints=parts, **kw)
    locked = rg.simulate(mech, joints=[*parts, rg.Lock("q1")], **kw)
    assert locked.happenings[0].kind == "hold" and locked.happenings[0].joints == ("q1",)
    locked.happenings.pop(0)
    require_same(driven, locked, ("q1", "q2", "q3", "q4"), 1e-11)
    require_sound(driven, 1e-6)


def test_the_choice_of_coordinates_does_not_matter() -> None:
    mech = rg.load("five_bar")
    parts = [
        rg.Stop("q3", lower=mech.home[2] - 0.05, upper=mech.home[2] + 0.2, restitution=0.5),
        rg.JointFriction("q2", 0.6),
    ]
    kw: dict[str, Any] = {"duration": 0.4, "step": 1e-3, "drive": {"q1": swing(0.3, 3.0, 2.2)}}
    kw["v0"] = mech.lift(mech.home, [0.9, 0.0])
    runs = [
        rg.simulate(mech.with_independent(names), joints=parts, **kw)
        for names in (("q1", "q3"), ("q1", "q4"), ("q2", "q3"))
    ]
    assert len(runs[0].happenings) > 5
    for other in runs[1:]:
        require_same(runs[0], other, ("q1", "q2", "q3", "q4"), 1e-9)
    coarse = [rg.simulate(mech, joints=parts, **{**kw, "step": h}) for h in (2e-2, 1e-2, 5e-3)]
    assert orders([run.at([0.16])["v.q4"] for run in coarse])[0] > 3.5  # after an impact


def dwell(t: float) -> tuple[float, float, float]:
    """Still to 0.3 s, from 0.7 to 1.9 rad until 0.8 s, still to 1.1 s, and back: p, ṗ, p̈."""
    total = np.array([0.7, 0.0, 0.0])
    for begin, size in ((0.3, 1.2), (1.1, -1.2)):
        x, h = min(max((t - begin) / 0.5, 0.0), 1.0), 0.5
        rate, bend = 30 * x**2 * (1 - x) ** 2 / h, 60 * x * (1 - x) * (1 - 2 * x) / h**2
        total += size * np.array([x**3 * (10 - 15 * x + 6 * x * x), rate, bend])
    return float(total[0]), float(total[1]), float(total[2])


CAM = rg.Motion(lambda t: dwell(t)[0], lambda t: dwell(t)[1], lambda t: dwell(t)[2])


def test_what_a_drive_alone_leaves_at_rest_moves_when_it_does(backend: Any) -> None:
    """At rest it takes no friction; then F against the motion; in a dwell what it was, back the other way."""
    kw: dict[str, Any] = {"duration": 1.8, "step": 5e-3, "drive": {"q1": CAM}, "backend": backend}
    free = rg.simulate(rg.load("slider_crank"), **kw)
    run = rg.simulate(
        rg.load("slider_crank"), joints=[rg.JointFriction("q3", 2.5)], record=("energy", "a", "tau"), **kw
    )
    assert [x.kind for x in run.happenings] == ["hold", "release", "at rest"]
    np.testing.assert_allclose([x.time for x in run.happenings], [0.0, 0.3, 1.1], atol=2e-4)
    F = run["friction.q3"]
    assert not F[(run.t < 0.3)].any()
    moving = (run.t > 0.301) & (np.abs(run["v.q3"]) > 1e-5)
    np.testing.assert_allclose(F[moving], -2.5 * np.sign(run["v.q3"][moving]))
    own = np.isin(run.t, free.t)
    np.testing.assert_allclose(run["q3"][own], free["q3"], atol=1e-14)
    require_sound(run, 1e-5)


def test_a_singular_configuration_on_the_way() -> None:
    """A parallelogram driven through its flat configuration, with friction in all of its joints."""
    mech, rate = rg.load("parallelogram"), 2.0
    kw: dict[str, Any] = {"duration": 2.5, "step": 2e-3, "drive": {"q1": turning(float(mech.home[0]), rate)}}
    free = rg.simulate(mech, **kw)
    parts = [rg.JointFriction(name, 0.3) for name in mech.joint_names]
    run = rg.simulate(mech, joints=parts, **kw)
    assert len(free.crossings) == len(run.crossings) > 0
    own = np.isin(run.t, free.t)
    lost = 0.3 * np.abs(run.v).sum(axis=1) / rate
    np.testing.assert_allclose(run["drive.q1"][own], free["drive.q1"] + lost[own], atol=1e-8)


def test_what_is_driven_against_a_stop_is_refused_where_it_is_met() -> None:
    mech = rg.load("slider_crank")
    at = float(mech.home[2]) - 0.05
    for part in (rg.Stop("q3", lower=at), rg.Lock("q3", start=0.1)):
        words = "drive: q1 would take q3 through a closed stop or lock"
        with pytest.raises(rg.SimulationError, match=words) as stop:
            rg.simulate(mech, duration=2.0, step=1e-3, drive={"q1": turning(1.0, 3.0)}, joints=[part])
        run = stop.value.trajectory
        assert run is not None
        end = run.q[-1, 2] if isinstance(part, rg.Stop) else run.t[-1]
        np.testing.assert_allclose(end, at if isinstance(part, rg.Stop) else 0.1, atol=1e-9)


def test_step_by_step_and_under_held_torques() -> None:
    """`Simulation`, `hold=True`, saved and restored; the columns of a driven joint."""
    mech = rg.load("five_bar")
    parts = [rg.JointFriction("q2", 0.6), rg.Stop("q3", upper=0.75, restitution=0.3)]
    kw: dict[str, Any] = {"step": 2e-3, "joints": parts, "drive": {"q1": swing(0.3, 3.0, 2.2)}}
    push = [0.0, 0.0, 30.0, 0.0]
    run = rg.simulate(mech, duration=0.3, torque=lambda t, q, v: push, hold=True, **kw)
    assert len(run.happenings) > 3
    sim = rg.Simulation(mech, **kw)
    sim.step(push, n=70)
    saved = sim.save()
    for _ in range(2):
        sim.restore(saved)
        sim.step(push, n=80)
        np.testing.assert_allclose(sim.q, run.q[-1], atol=1e-13)
        assert sim["drive.q1"] == pytest.approx(run["drive.q1"][-1], abs=1e-10)
    assert sim.trajectory.happenings == run.happenings
    few = rg.simulate(
        mech, duration=0.3, torque=lambda t, q, v: push, hold=True, outputs=np.linspace(0.0, 0.3, 41), **kw
    )
    own = np.isin(run.t, few.t)
    np.testing.assert_allclose(few["drive.q1"][np.isin(few.t, run.t)], run["drive.q1"][own], atol=1e-10)


def test_ground_that_moves_beside_stops() -> None:
    """As a driven joint does; without a motion it holds still."""
    moved = rg.Mechanism.from_pinocchio(sliders(MASS, along=pin.JointModelPX()).model)
    parts = [rg.Stop("q1", upper=0.1, restitution=0.5)]
    still = rg.simulate(moved, [0.0], [1.0], 0.5, 1e-2, joints=parts)
    table = rg.simulate(
        block(True), [0.0, 0.0], [0.0, 1.0], 0.5, 1e-2, drive={"x": rg.Motion(0.0)},
        joints=[rg.Stop("r", upper=0.1, restitution=0.5)],
    )  # fmt: skip
    np.testing.assert_allclose(table["r"], still["q1"], atol=1e-13)


def test_derivatives_are_refused_by_name() -> None:
    run = rg.simulate(block(True), drive={"x": TABLE}, duration=0.1, step=1e-2, joints=ON_THE_TABLE["both"])
    with pytest.raises(rg.OptionError, match="joints= and drive="):
        rg.sensitivity(run)
    with pytest.raises(rg.OptionError, match="joints= and drive="):
        rg.gradient(run, rg.Cost(lambda q, v: q[1]))
