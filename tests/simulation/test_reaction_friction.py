"""Friction as a share of a joint's reaction: closed forms, orders, loops, and where it is not determined."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import robust_gcp as rg
from robust_gcp.simulation.phases.sliding import friction

from .machines import BACKENDS, orders, require_backend, require_sound, times_of

G, MU = 9.81, 0.3


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def block(angle: float, mass: float = 2.0) -> rg.Mechanism:
    """A block on an incline, q1 = its way down."""
    model = pin.Model()
    place = pin.SE3(pin.utils.rotate("y", angle), np.zeros(3))
    joint = model.addJoint(0, pin.JointModelPX(), place, "q1")
    model.appendBodyToJoint(
        joint, pin.Inertia(mass, np.array([0.1, 0.2, 0.3]), np.eye(3)), pin.SE3.Identity()
    )
    return rg.Mechanism.from_pinocchio(model)


def rotor(axis: Any, mass: float = 3.0, inertia: float = 0.2, arm: float = 0.0) -> rg.Mechanism:
    """A wheel on an axle, its mass `arm` from it along y."""
    model = pin.Model()
    joint = model.addJoint(0, axis, pin.SE3.Identity(), "q1")
    body = pin.Inertia(mass, np.array([0.0, arm, 0.0]), inertia * np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model)


CART, BOB, LENGTH = 1.0, 0.4, 0.5


def cart_and_pole(cart: float = CART) -> rg.Mechanism:
    """A cart along y that carries a point on a rod, q2 = 0 along y."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), "q1")
    model.appendBodyToJoint(joint, pin.Inertia(cart, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    joint = model.addJoint(joint, pin.JointModelRX(), pin.SE3.Identity(), "q2")
    bob = pin.Inertia(BOB, np.array([0.0, LENGTH, 0.0]), np.zeros((3, 3)))
    model.appendBodyToJoint(joint, bob, pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model)


# ----------------------------------------------------------------- closed forms


def test_a_block_slides_on_an_incline(backend: Any) -> None:
    for angle, v0 in ((0.6, 0.0), (0.6, 1.0), (0.1, 1.5)):
        down = G * (np.sin(angle) - MU * np.cos(angle))
        run = rg.simulate(
            block(angle), [0.0], [v0], 1.0, 0.01, joints=[rg.JointFriction("q1", coefficient=MU)],
            backend=backend,
        )  # fmt: skip
        stops = v0 / -down if down < 0.0 else np.inf
        t = np.minimum(run.t, stops)
        assert np.abs(run.q[:, 0] - (v0 * t + 0.5 * down * t**2)).max() < 1e-12
        slips, known = run.t < stops, (run.t > 0.0) & (np.abs(run.t - stops) > 1e-9)
        friction = np.where(slips, -MU * 2.0 * G * np.cos(angle), -2.0 * G * np.sin(angle))
        assert np.abs(run["friction.q1"] - friction)[known].max() < 1e-10
        assert np.abs(run.dissipated - MU * 2.0 * G * np.cos(angle) * run.q[:, 0]).max() < 1e-11
        require_sound(run, 1e-11)
        if np.isfinite(stops):
            assert times_of(run, "at rest") == pytest.approx([stops], abs=1e-13)


def test_a_block_sticks_up_to_the_angle_of_friction(backend: Any) -> None:
    for share, sticks in ((1.0 - 1e-7, True), (1.0 + 1e-7, False)):
        run = rg.simulate(
            block(np.arctan(MU * share)), [0.0], [0.0], 1.0, 0.1, backend=backend,
            joints=[rg.JointFriction("q1", coefficient=MU)],
        )  # fmt: skip
        assert (run.q[-1, 0] == 0.0) == sticks and len(times_of(run, "hold")) == sticks


def test_a_bearing_slows_a_rotor_down(backend: Any) -> None:
    mass, inertia, radius = 3.0, 0.2, 0.02
    torque = MU * radius * mass * G
    part = rg.JointFriction("q1", coefficient=MU, radius=radius)
    wheel = rotor(pin.JointModelRX(), mass, inertia)
    run = rg.simulate(wheel, [0.0], [2.0], 1.0, 0.01, joints=[part], backend=backend)
    assert np.abs(run.v[:, 0] - (2.0 - torque / inertia * run.t)).max() < 1e-12
    assert np.abs(run["friction.q1"][1:] + torque).max() < 1e-12
    ramp = rg.simulate(
        wheel, [0.0], [0.0], 2.0, 0.01, joints=[part], torque=lambda t, q, v: [0.2 * t], backend=backend
    )
    assert times_of(ramp, "release") == pytest.approx([torque / 0.2], abs=1e-12)
    level = rg.simulate(rotor(pin.JointModelRZ()), [0.0], [2.0], 1.0, 0.01, joints=[part], backend=backend)
    assert np.abs(level.v - 2.0).max() < 1e-12 and np.all(level["friction.q1"][1:] > -1e-11)


def test_a_constant_part_adds_to_the_share() -> None:
    part = rg.JointFriction("q1", 1.5, coefficient=MU)
    run = rg.simulate(block(0.6), [0.0], [0.0], 0.5, 0.01, joints=[part])
    down = G * (np.sin(0.6) - MU * np.cos(0.6)) - 1.5 / 2.0
    assert abs(run.v[-1, 0] - 0.5 * down) < 1e-12
    assert run.dissipated[-1] == pytest.approx((1.5 + MU * 2.0 * G * np.cos(0.6)) * run.q[-1, 0], abs=1e-12)


def test_what_presses_a_joint_counts(backend: Any) -> None:
    press = rg.Wrench("q1", [0.0, 0.0, -5.0, 0.0, 0.0, 0.0], "local")
    part = rg.JointFriction("q1", coefficient=MU)
    run = rg.simulate(block(0.6), [0.0], [0.0], 0.5, 0.01, joints=[part], wrenches=[press], backend=backend)
    down = G * np.sin(0.6) - MU * (G * np.cos(0.6) + 2.5)
    assert abs(run.v[-1, 0] - 0.5 * down) < 1e-12


def test_a_locked_joint_carries_on_what_it_bears(backend: Any) -> None:
    parts = [rg.JointFriction("q1", coefficient=MU), rg.Lock("q2")]
    run = rg.simulate(cart_and_pole(), [0.0, 0.5], [2.0, 0.0], 0.5, 0.01, joints=parts, backend=backend)
    assert np.abs(run.v[:, 0] - (2.0 - MU * G * run.t)).max() < 1e-12
    assert np.abs(run["friction.q1"][1:] + MU * G * (CART + BOB)).max() < 1e-11


# ----------------------------------------------------------------- friction that acts on its own reaction


def pendulum_truth(share: float, arm: float, mass: float, inertia: float, end: float) -> np.ndarray:
    """q and v of a pendulum whose bearing rubs by `share` |n|, forwards, by DOP853."""

    def rate(t: float, x: np.ndarray) -> list[float]:
        q, v = x

        def acceleration(friction: float) -> float:
            return float((-mass * G * arm * np.cos(q) - friction) / (inertia + mass * arm**2))

        def reaction(a: float) -> float:
            along = arm * np.array([-v * v * np.cos(q) - a * np.sin(q), -v * v * np.sin(q) + a * np.cos(q)])
            return float(mass * np.linalg.norm(along + [0.0, G]))

        x = 0.0
        for _ in range(200):
            x = share * reaction(acceleration(x))
        return [v, acceleration(x)]

    return solve_ivp(rate, (0.0, end), [0.3, 9.0], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def test_a_bearing_under_a_swinging_mass(backend: Any) -> None:
    part = rg.JointFriction("q1", coefficient=0.4, radius=0.05)
    mech = rotor(pin.JointModelRX(), 2.0, 0.05, 0.3)
    exact = pendulum_truth(0.02, 0.3, 2.0, 0.05, 0.6)
    found, errors = [], []
    for h in (0.01, 0.005, 0.0025):
        run = rg.simulate(mech, [0.3], [9.0], 0.6, h, joints=[part], backend=backend)
        found.append(np.array([run.q[-1, 0], run.v[-1, 0]]))
        errors.append(np.abs(run.energy_error()).max())
        reaction = run.reaction("q1").force
        assert np.abs(run["friction.q1"][1:] + 0.02 * np.linalg.norm(reaction[1:, 1:], axis=1)).max() < 1e-4
    assert np.abs(found[-1] - exact).max() < 1e-6
    assert np.log2(np.abs(found[1] - exact) / np.abs(found[2] - exact)).min() > 3.9
    assert np.log2(errors[1] / errors[2]) > 3.9


def test_a_cart_and_pole_at_order_four(backend: Any) -> None:
    part = rg.JointFriction("q1", coefficient=0.4)
    found, losses, when = [], [], []
    for h in (0.005, 0.0025, 0.00125):
        run = rg.simulate(
            cart_and_pole(), [0.0, 0.5], [0.0, 0.0], 0.9, h, joints=[part], record=("a",), backend=backend
        )
        n = np.abs(run.reaction("q1").force[:, 2])
        slips = np.abs(run.v[:, 0]) > 1e-6
        assert np.abs(np.abs(run["friction.q1"]) - 0.4 * n)[slips].max() < 1e-10
        assert np.all(np.abs(run["friction.q1"]) <= 0.4 * n + 1e-9)
        require_sound(run, 1e-5)
        found.append(run.q[-1]), losses.append(np.array([run.dissipated[-1], run.energy_error()[-1]]))
        when.append(times_of(run, "at rest", "release"))
    assert len(when[0]) == len(when[1]) == len(when[2]) > 2
    assert orders(found).min() > 3.9 and orders(losses).min() > 3.8


def test_the_friction_of_several_joints_solves_its_equation() -> None:
    random = np.random.default_rng(5)
    for k in (1, 2, 3, 5) * 50:
        by, n0 = random.normal(size=(k, k, 3)), random.normal(size=(k, 3)) * 10.0 ** random.uniform(-3, 3)
        least, share = random.uniform(0.0, 2.0, k), random.uniform(0.0, 1.0, k)
        by *= 0.95 / np.abs(np.linalg.eigvals(share[:, None] * np.linalg.norm(by, axis=2))).max()
        x = friction(least, share, n0, by)
        assert x is not None
        wrong = x - least - share * np.linalg.norm(n0 + np.einsum("ijc,j->ic", by, x), axis=1)
        assert np.abs(wrong).max() < 1e-13 * (1.0 + np.abs(n0).max() + x.max())


# ----------------------------------------------------------------- loops


def test_a_slide_rubs_by_what_the_loop_presses_it(backend: Any) -> None:
    crank, part = rg.load("slider_crank"), rg.JointFriction("q3", coefficient=MU)
    ends, drifts = [], []
    for h in (0.04, 0.02, 0.01):
        runs = [
            rg.simulate(
                crank.with_independent([y]), crank.home, [0.0] * 3, 1.0, h, joints=[part], backend=backend,
                record=("a", "multipliers"),
            )
            for y in ("q1", "q3")
        ]  # fmt: skip
        assert np.abs(runs[0].q[-1] - runs[1].q[-1]).max() < 100.0 * h**4
        run = runs[0]
        along = run.reaction("q3").force
        across = along - np.outer(along @ slide_axis(crank), slide_axis(crank))
        slips = np.abs(run.v[:, 2]) > 1e-6
        assert np.abs(np.abs(run["friction.q3"]) - MU * np.linalg.norm(across, axis=1))[slips].max() < 1e-8
        require_sound(run, 1e-3)
        ends.append(run.q[-1]), drifts.append(np.abs(run.energy_error()).max())
    assert orders(ends).min() > 3.9 and np.log2(drifts[1] / drifts[2]) > 3.9


def slide_axis(crank: rg.Mechanism) -> np.ndarray:
    q = crank.home
    pin.framesForwardKinematics(crank.model, data := crank.model.createData(), q)
    joint = crank.model.getJointId("q3")
    S = pin.computeJointJacobian(crank.model, data, q, joint)[:3, crank.joint("q3").idx_v]
    return np.asarray(data.oMi[joint].rotation @ S)


def test_a_loop_breaks_loose_where_its_reactions_say(backend: Any) -> None:
    crank, part = rg.load("slider_crank"), rg.JointFriction("q3", coefficient=1.0)
    run = rg.simulate(
        crank, crank.home, [0.0] * 3, 3.0, 0.01, joints=[part], record=("a", "multipliers"), backend=backend,
        torque=lambda t, q, v: np.array([10.0 - 12.0 * t, 0.0, 0.0]),
    )  # fmt: skip
    (start, *_) = times_of(run, "release")
    k = int(np.searchsorted(run.t, start)) - 1
    along = run.reaction("q3").at(k).force
    across = along - slide_axis(crank) * (slide_axis(crank) @ along)
    assert start > 0.0 and abs(run["friction.q3"][k]) == pytest.approx(np.linalg.norm(across), rel=1e-9)


def test_all_joints_of_a_loop_rub(backend: Any) -> None:
    crank = rg.load("slider_crank")
    parts = [
        rg.JointFriction("q1", coefficient=0.2, radius=0.05),
        rg.JointFriction("q2", coefficient=0.2, radius=0.05),
        rg.JointFriction("q3", coefficient=0.2),
    ]
    ends = []
    for h in (0.04, 0.02, 0.01):
        run = rg.simulate(crank, crank.home, [0.0] * 3, 1.0, h, joints=parts, backend=backend)
        require_sound(run, 1e-3)
        ends.append(run.q[-1])
    assert orders(ends).min() > 3.9


def four_bar(cut_at_ground: bool) -> rg.Mechanism:
    """Crank 0.3, coupler 0.8, rocker 0.6, ground 0.9 m; the rocker hangs on the ground or on the coupler."""
    model, masses, lengths = pin.Model(), (1.0, 2.0, 1.5), (0.3, 0.8, 0.6)

    def link(parent: int, at: float, number: int, back: bool = False) -> int:
        place = pin.SE3(np.eye(3), np.array([0.0, at, 0.0]))
        joint = model.addJoint(parent, pin.JointModelRX(), place, f"q{number}")
        mass, length = masses[number - 1], lengths[number - 1]
        lever = np.array([0.0, (-0.5 if back else 0.5) * length, 0.0])
        model.appendBodyToJoint(
            joint, pin.Inertia(mass, lever, mass * length**2 / 12.0 * np.eye(3)), pin.SE3.Identity()
        )
        return int(joint)

    def frame(name: str, joint: int, at: float) -> None:
        place = pin.SE3(np.eye(3), np.array([0.0, at, 0.0]))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))

    coupler = link(link(0, 0.0, 1), lengths[0], 2)
    if cut_at_ground:
        frame("a", link(coupler, lengths[1], 3, back=True), -lengths[2])
        frame("b", 0, 0.9)
    else:
        frame("a", coupler, lengths[1])
        frame("b", link(0, 0.9, 3), lengths[2])
    home = [1.0, -0.6, 1.4 if cut_at_ground else 1.8]
    return rg.Mechanism.from_pinocchio(model, [rg.PointClosure("a", "b")], ["q1"], home)


def test_all_bearings_of_a_four_bar_whichever_is_cut(backend: Any) -> None:
    how = {"coefficient": 0.3, "radius": 0.06}
    two = [rg.JointFriction("q1", **how), rg.JointFriction("q2", **how)]
    cut = rg.JointFriction("q3", other="q1", ratio=1.0, more=(("q2", 1.0),), reaction="a-b", **how)
    around = rg.JointFriction("q1", more=(("q2", -1.0), ("q3", -1.0)), reaction="a-b", **how)
    last = rg.JointFriction("q3", **how)
    runs = []
    for at_ground, parts in ((False, [*two, cut, last]), (True, [*two, last, around])):
        mech = four_bar(at_ground)
        q0 = mech.assemble(mech.home, hold=["q1"])
        run = rg.simulate(mech, q0, [0.0] * 3, 1.5, 0.01, joints=parts, backend=backend)
        require_sound(run, 1e-4)
        runs.append(run)
    assert np.array([abs(run.q[0, 0] - 1.0) for run in runs]).max() < 1e-12
    assert [x.kind for x in runs[0].happenings] == [x.kind for x in runs[1].happenings]
    assert np.abs(runs[0]["q1"][-1] - runs[1]["q1"][-1]) < 1e-9
    assert abs(runs[0].dissipated[-1] - runs[1].dissipated[-1]) < 1e-8 and runs[0].dissipated[-1] > 0.1


# ----------------------------------------------------------------- under torques that are held


def test_a_torque_that_grows_step_by_step_breaks_it_loose(backend: Any) -> None:
    joints = [rg.JointFriction("q1", coefficient=MU)]
    sim = rg.Simulation(block(0.1), [0.0], [0.0], 0.01, joints=joints, backend=backend)
    limit = 2.0 * G * (MU * np.cos(0.1) - np.sin(0.1))
    for tau in np.arange(0.0, limit + 0.1, 0.1):
        sim.step([tau])
    assert [x.kind for x in sim.happenings] == ["hold", "release"]
    assert sim.happenings[1].time == pytest.approx(sim.t - 0.01)
    assert sim.v[0] == pytest.approx((tau - limit) / 2.0 * 0.01, rel=1e-9)


def test_it_slows_what_is_held_as_what_is_not(backend: Any) -> None:
    """Held over each step, by a function or by calls, is piece by piece what a constant torque does."""
    mech, joints = cart_and_pole(), [rg.JointFriction("q1", coefficient=MU)]
    q, v, h = np.array([0.0, 0.3]), np.array([0.2, 0.0]), 0.02

    def torque(t: float, q: Any, v: Any) -> Any:
        return [8.0 * np.sin(5.0 * t), 0.0]

    held = rg.simulate(mech, q, v, 1.5, h, torque=torque, hold=True, joints=joints, backend=backend)
    sim, kinds = rg.Simulation(mech, q, v, h, joints=joints, backend=backend), list[str]()
    for k in range(75):
        tau = torque(k * h, q, v)
        piece = rg.simulate(mech, q, v, h, h, torque=tau, t0=k * h, joints=joints, backend=backend)
        q, v = piece.q[-1], piece.v[-1]
        kinds += [x.kind for x in piece.happenings]
        sim.step(tau)
    np.testing.assert_allclose(sim.q, q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(held.q[-1], q, rtol=0, atol=1e-13)
    assert [x.kind for x in sim.happenings] == [x.kind for x in held.happenings] == kinds
    assert "at rest" in kinds


def test_motors_that_are_held_move_a_loop_that_rubs(backend: Any) -> None:
    """Another cut and another root: the same motion; saved and restored: to the last bit."""
    how, ends = {"coefficient": 0.3, "radius": 0.06}, []
    two = [rg.JointFriction("q1", **how), rg.JointFriction("q2", **how)]
    cut = rg.JointFriction("q3", other="q1", ratio=1.0, more=(("q2", 1.0),), reaction="a-b", **how)
    around = rg.JointFriction("q1", more=(("q2", -1.0), ("q3", -1.0)), reaction="a-b", **how)
    last = rg.JointFriction("q3", **how)
    for at_ground, joints in ((False, [*two, cut, last]), (True, [*two, last, around])):
        mech = four_bar(at_ground)
        q0 = mech.assemble(mech.home, hold=["q1"])
        sim = rg.Simulation(mech, q0, step=0.02, joints=joints, backend=backend)
        saved = sim.save()
        for _ in range(2):
            sim.restore(saved)
            for k in range(30):
                sim.step({"q1": 4.0 * np.sin(0.12 * k)})
            ends.append((sim.q[0], sim.dissipated, [x.kind for x in sim.happenings]))
    assert ends[0] == ends[1] and ends[2] == ends[3]
    assert abs(ends[0][0] - ends[2][0]) < 1e-12 and abs(ends[0][1] - ends[2][1]) < 1e-12
    assert ends[0][2] == ends[2][2] and len(ends[0][2]) > 2


# ----------------------------------------------------------------- refused


def test_painleves_paradox_is_refused() -> None:
    with pytest.raises(rg.SimulationError, match=r"q1.*Painlevé"):
        rg.simulate(
            cart_and_pole(0.01), [0.0, 0.8], [1.0, 0.0], 0.1, 0.001,
            joints=[rg.JointFriction("q1", coefficient=3.0)],
        )  # fmt: skip


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (rg.JointFriction("q1", coefficient=0.1), "radius"),
        (rg.JointFriction("q3", coefficient=0.1, radius=0.1), "prismatic"),
        (rg.JointFriction("q1", coefficient=0.1, radius=0.1, other="q2", ratio=1.0), "cut joint"),
        (rg.JointFriction("q1", coefficient=0.1, radius=0.1, reaction="nowhere"), "nowhere"),
    ],
)
def test_joints_that_it_does_not_go_with(part: rg.JointFriction, words: str) -> None:
    crank = rg.load("slider_crank")
    with pytest.raises(rg.OptionError, match=words):
        rg.simulate(crank, duration=0.1, step=0.01, joints=[part])


def test_what_does_not_go_with_it() -> None:
    part = rg.JointFriction("q1", coefficient=MU)
    run = rg.simulate(block(0.6), [0.0], [0.0], 0.1, 0.01, joints=[part])
    with pytest.raises(rg.NotDifferentiableError, match=r"q1.*bound"):
        rg.sensitivity(run)
    with pytest.raises(rg.NotDifferentiableError, match=r"q1.*bound"):
        rg.gradient(run, rg.Cost(lambda q, v: float(q[0])))
