"""Derivatives through impacts, holds, releases, locks: closed forms, and differences of whole runs."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.change_of_coordinates import Slope
from robust_gcp.kernel.derivatives import derivations
from robust_gcp.simulation.phases.decision import Phase
from robust_gcp.simulation.phases.rows import Rows
from robust_gcp.simulation.phases.saltation import jump_of
from robust_gcp.simulation.phases.transitions import Turn
from tests.compiled import needs_kernel

Array = NDArray[np.float64]

WEIGHTS = {1: 45.0 / 60.0, 2: -9.0 / 60.0, 3: 1.0 / 60.0}
"""Of central differences of order 6."""


def ball() -> rg.Mechanism:
    """1 kg that falls along z."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model, [], ["z"])


def pendulum() -> rg.Mechanism:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "q")
    body = pin.Inertia(1.0, np.array([0.0, 0.0, -0.5]), 0.1 * np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model, [], ["q"])


def started(mech: rg.Mechanism, q: Array, v: Array, i: int, by: float) -> tuple[Array, Array]:
    """The start moved along the i-th of (η, u), loops closed."""
    m, own = mech.m, mech.iv_independent
    u = v[own].copy()
    if i < m:
        q = mech.tree.integrate(q, by * (mech.G(q) if mech.nc else np.eye(mech.nv))[:, i])
        q = mech.polish(q, mech.iv_dependent) if mech.nc else q
    else:
        u[i - m] += by
    return q, (mech.G(q) if mech.nc else np.eye(mech.nv)) @ u


def differences(mech: rg.Mechanism, run: rg.Trajectory, by: float, result: Any, **asked: Any) -> Array:
    """By (η, u) of the start, central, order 6; the same things happen in every run."""
    found = []
    for i in range(2 * mech.m):
        total: Any = 0.0
        for n, weight in WEIGHTS.items():
            for sign in (1, -1):
                other = rg.simulate(mech, *started(mech, run.q[0], run.v[0], i, sign * n * by), **asked)
                assert [h.kind for h in other.happenings] == [h.kind for h in run.happenings]
                total = total + sign * weight * result(other)
        found.append(np.asarray(total) / by)
    return np.array(found).T


def whole(found: rg.Sensitivity) -> Array:
    return np.block([[found.dq_dy, found.dq_dv], [found.dv_dy, found.dv_dv]])


def require_right(mech: rg.Mechanism, v: Any, within: float, by: float, **asked: Any) -> rg.Trajectory:
    run = rg.simulate(mech, mech.home, mech.lift(mech.home, v) if mech.nc else v, **asked)
    tree = mech.tree
    expected = differences(
        mech, run, by, lambda other: np.r_[tree.difference(run.q[-1], other.q[-1]), other.v[-1]], **asked
    )
    found = whole(rg.sensitivity(run))
    assert np.abs(found - expected).max() < within * np.abs(found).max()
    return run


# --------------------------------------------------------------------------- closed forms


def test_a_bouncing_ball() -> None:
    """With w = √(v² + 2 g z) the speed at the ground, reached at t₁ = (v + w)/g, and e w after it:

    z(T) = e w s − g s²/2, v(T) = e w − g s, s = T − t₁.
    """
    g, e, z, v, T = 9.81, 0.7, 0.4, 0.3, 0.5
    run = rg.simulate(
        ball(), [z], [v], duration=T, step=1e-2, joints=[rg.Stop("z", lower=0.0, restitution=e)]
    )
    assert [h.kind for h in run.happenings] == ["impact"]
    w = np.sqrt(v**2 + 2 * g * z)
    s = T - (v + w) / g
    dw = np.array([g, v]) / w  # by z and by v
    ds = -(np.array([0.0, 1.0]) + dw) / g
    expected = np.array([e * dw * s + (e * w - g * s) * ds, e * dw - g * ds])
    np.testing.assert_allclose(whole(rg.sensitivity(run)), expected, rtol=1e-11)


def test_a_block_that_rubs_to_a_stop_and_is_pulled_loose() -> None:
    """Friction F brakes 1 kg from v at z to rest at z + v²/2F; a force that grows as k t frees it at F/k.

    From there z̈ = k t − F: where it rests is all that the start changes.
    """
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model, [], ["x"])
    force, k, x, v, T = 2.0, 1.0, 0.3, 0.2, 3.0
    run = rg.simulate(
        mech, [x], [v], duration=T, step=1e-2, joints=[rg.JointFriction("x", force)],
        torque=lambda t, q, v: np.array([max(0.0, k * t)]) if t > 0.5 else np.array([0.0]),
    )  # fmt: skip
    assert [h.kind for h in run.happenings] == ["at rest", "hold", "release"]
    expected = np.array([[1.0, v / force], [0.0, 0.0]])
    np.testing.assert_allclose(whole(rg.sensitivity(run)), expected, atol=1e-12)


def test_a_plastic_stop_forgets() -> None:
    """At rest on a stop nothing of the start is left; let go at a time that it does not change, neither."""
    push = lambda t, q, v: np.array([-3.0 * np.sin(2.0 * t)])  # noqa: E731
    run = rg.simulate(
        pendulum(), [0.3], [1.0], duration=2.0, step=2e-3, torque=push, joints=[rg.Stop("q", lower=-0.2)]
    )
    assert [h.kind for h in run.happenings] == ["impact", "hold", "release"]
    assert np.abs(whole(rg.sensitivity(run))).max() < 1e-12


def test_a_lock_stops_what_it_holds() -> None:
    """Locked at a given time, a joint stays where it is then: δq of that time, δv = 0."""
    mech = pendulum()
    free = rg.simulate(mech, [0.3], [1.0], duration=0.4, step=1e-3)
    run = rg.simulate(mech, [0.3], [1.0], duration=1.0, step=1e-3, joints=[rg.Lock("q", start=0.4)])
    found = rg.sensitivity(run)
    angle = rg.gradient(free, rg.Cost(terminal=lambda q, v: q[0]))
    np.testing.assert_allclose([found.dq_dy[0, 0], found.dq_dv[0, 0]], [angle.dy[0], angle.dv[0]], rtol=1e-9)
    assert np.abs(found.dv_dy).max() < 1e-13 > np.abs(found.dv_dv).max()


# --------------------------------------------------------------------------- differences of runs


def test_a_pendulum_between_springy_stops() -> None:
    stops = [rg.Stop("q", lower=-0.2, upper=0.5, stiffness=50.0, damping=0.5)]
    mech = pendulum()
    mech = rg.Mechanism.from_pinocchio(mech.model, [], ["q"], home=[0.3])
    run = require_right(mech, [1.0], 1e-8, 1e-4, duration=2.0, step=1e-3, joints=stops)
    assert {h.kind for h in run.happenings} == {"touch", "leave"}


def test_a_forced_coulomb_oscillator() -> None:
    """Sticks and slips both ways: 8 events."""
    mech = rg.Mechanism.from_pinocchio(pendulum().model, [], ["q"], home=[0.3])
    pull = lambda t, q, v: np.array([3.0 * np.sin(2.0 * t)])  # noqa: E731
    run = require_right(
        mech, [1.0], 2e-9, 1e-3, duration=5.0, step=2e-3, torque=pull, joints=[rg.JointFriction("q", 1.0)]
    )
    assert {h.kind for h in run.happenings} == {"at rest", "hold", "release"}


def test_a_slider_crank_with_a_stop_on_a_dependent_joint() -> None:
    mech = rg.load("slider_crank")
    stop = rg.Stop("q3", lower=float(mech.home[2]) - 0.25, restitution=0.7)
    rub = rg.JointFriction("q1", 2.0)
    run = require_right(mech, [2.0], 1e-9, 1e-3, duration=2.0, step=2e-3, joints=[stop, rub])
    assert [h.kind for h in run.happenings].count("impact") == 2


@pytest.fixture(scope="module")
def five_bar() -> rg.Mechanism:
    return rg.load("five_bar")


def test_a_five_bar_with_a_lock(five_bar: rg.Mechanism) -> None:
    """From mobility 2 to 1 and back; where it is locked depends on the start."""
    lock = [rg.Lock("q2", start=0.3, end=0.6)]
    require_right(five_bar, [1.0, -0.5], 1e-9, 1e-3, duration=1.0, step=2e-3, joints=lock)


@needs_kernel
@pytest.mark.parametrize("slopes", [None, "given"])
def test_the_kernel_finds_what_the_reference_does(
    slopes: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside springs, under a torque that follows the state, free, locked and on a stop."""

    def torque(t: float, q: Array, v: Array) -> Array:
        return np.array([2.0 * np.sin(3.0 * t) - 0.4 * v[0], 0.3 * q[0] * q[1], -0.2 * v[2] * q[3], 0.0])

    def by_state(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        by_q, by_v = np.zeros((4, 4)), np.zeros((4, 4))
        by_v[0, 0], by_q[1, 0], by_q[1, 1] = -0.4, 0.3 * q[1], 0.3 * q[0]
        by_v[2, 2], by_q[2, 3] = -0.2 * q[3], -0.2 * v[2]
        return by_q, by_v

    def found() -> tuple[Array, Array]:
        shipped = rg.load("five_bar")
        springs = [rg.JointSpring("q1", 30.0, 0.4), rg.JointDamper("q4", 0.2)]
        mech = rg.Mechanism.from_pinocchio(
            shipped.model, shipped.closures, shipped.independent, shipped.home, forces=springs
        )
        parts = [rg.Lock("q2", start=0.1, end=0.15), rg.Stop("q1", lower=float(mech.home[0]) - 0.1)]
        v = mech.lift(mech.home, [-1.5, 0.5])
        run = rg.simulate(mech, mech.home, v, duration=0.24, step=4e-3, joints=parts, torque=torque)
        assert {"impact", "lock"} <= {happening.kind for happening in run.happenings}
        given = None if slopes is None else by_state
        cost = rg.Cost(terminal=lambda q, v: float(np.sin(q).sum() + 0.1 * v @ v))
        gradient = rg.gradient(run, cost, torque_slopes=given)
        return whole(rg.sensitivity(run, torque_slopes=given)), gradient.dtau

    compiled = found()
    monkeypatch.setattr(derivations, "library", lambda: None)
    for one, other in zip(compiled, found(), strict=True):
        assert np.abs(one - other).max() < 1e-9 * np.abs(other).max()


def test_a_five_bar_rests_on_a_stop_and_is_let_go(five_bar: rg.Mechanism) -> None:
    stop = [rg.Stop("q2", lower=float(five_bar.home[1]) - 0.3)]
    run = require_right(five_bar, [1.0, -0.5], 1e-9, 1e-3, duration=0.8, step=2e-3, joints=stop)
    assert [h.kind for h in run.happenings] == ["impact", "hold", "release"]


def test_a_five_bar_with_friction_is_right_to_the_fourth_order(five_bar: rg.Mechanism) -> None:
    """Two of four dry joints come to rest; steps of RK4 leave 16 times less at half their length.

    Differences of runs see an event pass an output, as a kink of the size of the error of a step.
    """
    dry = [rg.JointFriction(f"q{i}", bound) for i, bound in enumerate((3.0, 2.0, 2.5, 1.0), start=1)]
    v = five_bar.lift(five_bar.home, [1.0, -0.5])
    ends = [
        whole(rg.sensitivity(rg.simulate(five_bar, five_bar.home, v, duration=1.0, step=h, joints=dry)))
        for h in (4e-3, 2e-3, 1e-3)
    ]
    errors = [np.abs(end - ends[2]).max() / np.abs(ends[2]).max() for end in ends[:2]]
    assert errors[1] < 1e-6 and np.log2(errors[0] / errors[1]) > 3.5
    require_right(five_bar, [1.0, -0.5], 2e-9, 1e-4, duration=1.0, step=5e-4, joints=dry)


def floating() -> rg.Mechanism:
    """A free body, an arm hinged on it, a body on a ball joint at its tip."""
    rng, model = np.random.default_rng(3), pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(
        joint, pin.Inertia(1.0, 0.1 * rng.normal(size=3), np.diag([0.1, 0.15, 0.2])), pin.SE3.Identity()
    )
    for kind, name, at, mass in (
        (pin.JointModelRY(), "arm", [0.2, 0.1, 0.3], 0.5),
        (pin.JointModelSpherical(), "ball", [0.0, 0.1, -0.3], 0.3),
    ):
        joint = model.addJoint(joint, kind, pin.SE3(np.eye(3), np.array(at)), name)
        body = pin.Inertia(mass, np.array([0.1, 0.2, -0.3]), np.diag([0.03, 0.02, 0.03]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model, [], ["root", "arm", "ball"])


@pytest.mark.parametrize(
    "part", [rg.Stop("arm", lower=-0.3, upper=0.4, restitution=0.6), rg.JointFriction("arm", 1.0)]
)
def test_a_floating_body_with_a_ball_joint(part: Any) -> None:
    """Changes of q on groups are along the velocities there."""
    v = [0.1, 0.2, 0.3, 0.5, -0.4, 0.3, 2.0, 1.0, -0.5, 0.3]
    run = require_right(floating(), v, 1e-9, 1e-3, duration=0.6, step=4e-3, joints=[part])
    assert run.happenings


def test_a_clutch() -> None:
    """Two pendulums whose angles are tied to each other for a while, where they are then."""
    model = pin.Model()
    for name, length in (("a", 0.5), ("b", 0.8)):
        joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), name)
        body = pin.Inertia(1.0, np.array([0.0, 0.0, -length]), 0.1 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model, [], ["a", "b"], home=[0.3, -0.2])
    clutch = rg.Lock("a", other="b", ratio=-2.0, start=0.3, end=1.0)
    require_right(mech, [1.0, 0.5], 1e-9, 1e-3, duration=1.5, step=4e-3, joints=[clutch])


def test_coordinates_that_turn_back_on_the_way() -> None:
    """A rocker's angle as y, through its dead points: as with the crank's, to which the run changes."""
    crank = rg.load("crank_rocker")
    v, ends = crank.lift(crank.home, [3.0]), []
    for name in ("q1", "q3"):
        mech = crank.with_independent([name])
        run = rg.simulate(mech, crank.home, v, duration=2.0, step=2e-3, joints=[rg.JointFriction("q1", 1.0)])
        start = rg.derivatives(mech, crank.home, v)
        by_start = np.block([[start.G, 0.0 * start.G], [start.dv_dy, start.G]])
        ends.append(whole(rg.sensitivity(run)) @ np.linalg.pinv(by_start))
    np.testing.assert_allclose(ends[1], ends[0], atol=2e-8 * np.abs(ends[0]).max())


def test_the_end_is_the_same_in_other_coordinates(five_bar: rg.Mechanism) -> None:
    """Changes of the start in other independent joints, all velocities of it given, lead to the same end."""
    stop = [rg.Stop("q2", lower=float(five_bar.home[1]) - 0.3, restitution=0.5)]
    v = five_bar.lift(five_bar.home, [1.0, -0.5])
    ends = []
    for names in (five_bar.independent, ("q1", "q2"), ("q3", "q4")):
        mech = five_bar.with_independent(list(names))
        run = rg.simulate(mech, five_bar.home, v, duration=0.6, step=1e-3, joints=stop)
        start = rg.derivatives(mech, five_bar.home, v)
        by_start = np.block([[start.G, 0.0 * start.G], [start.dv_dy, start.G]])
        ends.append(whole(rg.sensitivity(run)) @ np.linalg.pinv(by_start))
    for other in ends[1:]:
        np.testing.assert_allclose(other, ends[0], atol=2e-9 * np.abs(ends[0]).max())


# --------------------------------------------------------------------------- gradients


def cost_of(run: rg.Trajectory, cost: rg.Cost) -> float:
    """J by the trapezoidal rule."""
    assert cost.terminal is not None and run.acted is not None
    total = cost.terminal(run.q[-1], run.v[-1])
    if cost.running is None:
        return float(total)
    f, none = run.acted.torque, np.zeros(run.mechanism.nv)
    states = zip(run.t, run.q, run.v, strict=True)
    taus = [none if f is None else np.asarray(f(*state) if callable(f) else f) for state in states]
    along = np.array([cost.running(*at) for at in zip(run.t, run.q, run.v, taus, strict=True)])
    return float(total + 0.5 * np.diff(run.t) @ (along[1:] + along[:-1]))


COST = rg.Cost(
    terminal=lambda q, v: float(np.sum(np.sin(q)) + 0.3 * v @ v),
    running=lambda t, q, v, tau: float(0.5 * q @ q + 0.1 * v @ v * np.cos(t) + 0.2 * tau @ v),
)


def test_gradients_through_impacts_and_friction() -> None:
    """The discrete cost's own: outputs just before and after an event move with it."""
    mech = rg.load("slider_crank")
    stop = rg.Stop("q3", lower=float(mech.home[2]) - 0.25, restitution=0.7)
    asked: dict[str, Any] = {"duration": 1.5, "step": 1e-3, "torque": [0.5, 0.0, 0.0]}
    asked["joints"] = [stop, rg.JointFriction("q1", 2.0)]
    run = rg.simulate(mech, mech.home, mech.lift(mech.home, [2.0]), **asked)
    found = rg.gradient(run, COST)
    assert found.value == pytest.approx(cost_of(run, COST), rel=1e-13)
    expected = differences(mech, run, 1e-5, lambda other: cost_of(other, COST), **asked)
    np.testing.assert_allclose(np.r_[found.dy, found.dv], expected, rtol=2e-9)


def test_gradients_through_sticking_and_release() -> None:
    """The moment of a release moves the outputs beside it too."""
    mech = rg.Mechanism.from_pinocchio(pendulum().model, [], ["q"], home=[0.3])
    pull = lambda t, q, v: np.array([3.0 * np.sin(2.0 * t) - 0.2 * q[0]])  # noqa: E731
    asked: dict[str, Any] = {"duration": 4.0, "step": 2e-3, "torque": pull}
    asked["joints"] = [rg.JointFriction("q", 1.0)]
    run = rg.simulate(mech, [0.3], [1.0], **asked)
    found = rg.gradient(run, COST)
    expected = differences(mech, run, 1e-5, lambda other: cost_of(other, COST), **asked)
    np.testing.assert_allclose(np.r_[found.dy, found.dv], expected, atol=1e-8)


def test_gradients_by_torques(five_bar: rg.Mechanism) -> None:
    """A torque that is added all the time is one that is added over each step."""
    stop = [rg.Stop("q2", lower=float(five_bar.home[1]) - 0.3)]
    cost, v = rg.Cost(terminal=COST.terminal), five_bar.lift(five_bar.home, [1.0, -0.5])

    def run(tau: Array) -> rg.Trajectory:
        return rg.simulate(five_bar, five_bar.home, v, duration=0.8, step=2e-3, torque=tau, joints=stop)

    tau = np.array([0.5, 0.0, 0.3, 0.0])
    found = rg.gradient(run(tau), cost).dtau.sum(axis=0)
    for i, way in enumerate(np.eye(4)):
        values = [
            s * w * cost_of(run(tau + s * n * 1e-2 * way), cost) for n, w in WEIGHTS.items() for s in (1, -1)
        ]
        assert sum(values) / 1e-2 == pytest.approx(found[i], abs=1e-9 * np.abs(found).max())


@pytest.mark.parametrize("follows", [False, True])
def test_gradients_from_beside_a_singular_place(follows: bool) -> None:
    """Where stretches of steps begin at states that are none of the kernel's, up to a bounce and on."""
    rhombus = rg.load("rhombus")
    stop, v = [rg.Stop("q1", lower=0.02, restitution=0.5)], rhombus.lift(rhombus.home, [-0.5])
    cost = rg.Cost(terminal=lambda q, v: float(np.sin(q[0]) + 0.2 * v[0]))

    def run(tau: Array) -> rg.Trajectory:
        def torque(t: float, q: Array, v: Array) -> Array:
            return tau - 0.3 * v

        torques = torque if follows else tau
        return rg.simulate(rhombus, rhombus.home, v, duration=0.24, step=4e-3, torque=torques, joints=stop)

    tau = np.array([0.3, 0.0, -0.2])
    assert "impact" in {happening.kind for happening in run(tau).happenings}
    found = rg.gradient(run(tau), cost).dtau.sum(axis=0)
    for i, way in enumerate(np.eye(3)):
        values = [
            s * w * cost_of(run(tau + s * n * 1e-2 * way), cost) for n, w in WEIGHTS.items() for s in (1, -1)
        ]
        assert sum(values) / 1e-2 == pytest.approx(found[i], abs=1e-7 * np.abs(found).max())


def test_the_gradient_is_that_of_the_sensitivity(five_bar: rg.Mechanism) -> None:
    """Forwards and backwards through the same chain."""
    joints = [rg.Stop("q2", lower=float(five_bar.home[1]) - 0.3, restitution=0.5), rg.Lock("q1", start=0.5)]
    run = rg.simulate(
        five_bar,
        five_bar.home,
        five_bar.lift(five_bar.home, [1.0, -0.5]),
        duration=0.7,
        step=2e-3,
        joints=joints,
    )
    rng = np.random.default_rng(0)
    by_q, by_v = rng.normal(size=(2, 4))
    cost = rg.Cost(lambda q, v: by_q @ q + by_v @ v, terminal_slopes=lambda q, v: (by_q, by_v))
    found, end = rg.gradient(run, cost), rg.sensitivity(run)
    np.testing.assert_allclose(found.dy, by_q @ end.dq_dy + by_v @ end.dv_dy, rtol=1e-11)
    np.testing.assert_allclose(found.dv, by_q @ end.dq_dv + by_v @ end.dv_dv, rtol=1e-11)


# --------------------------------------------------------------------------- what has no derivative


def test_grazing_grows_without_bound_and_is_refused() -> None:
    """A pendulum that just reaches its stop: δt = −∇c δx/ċ ~ off^(−1/2); none where ċ is rounding."""
    mech, found = pendulum(), []
    for off in (1e-4, 1e-6, 1e-8):
        stop = rg.Stop("q", lower=-0.5 + off, restitution=0.5)
        run = rg.simulate(mech, [0.5], [0.0], duration=2.0, step=2e-3, joints=[stop])
        found.append(float(np.abs(rg.sensitivity(run).dq_dy[0, 0])))
    slopes = np.diff(np.log10(found)) / 2.0
    np.testing.assert_allclose(slopes, 0.5, atol=0.02)
    turn = Turn(1.0, 0, np.array([-0.5]), np.array([-1e-10]), np.array([5e-11]), Phase())
    rows = Rows(mech, [rg.Stop("q", lower=-0.5, restitution=0.5)])
    slope = Slope(np.eye(1), np.zeros((1, 1)))
    with pytest.raises(rg.NotDifferentiableError, match="q grazes its stop"):
        jump_of(rows, mech, turn, [], slope, (np.zeros(1), np.zeros(1)), np.zeros(2))


def test_a_stop_beside_a_dead_point_is_refused() -> None:
    crank = rg.load("slider_crank")
    q0, top = crank.assemble({"q1": 0.3}, hold=["q1"]), crank.assemble({"q1": 0.0}, hold=["q1"])[2]
    stop = rg.Stop("q3", upper=top - 1e-9, restitution=0.5)
    with pytest.warns(rg.SingularityWarning, match="dead point"):
        run = rg.simulate(crank, q0, crank.lift(q0, [-3.0]), 0.3, 5e-3, joints=[stop])
    with pytest.raises(rg.NotDifferentiableError, match="dead point"):
        rg.sensitivity(run)


def test_stops_that_are_met_at_once_are_refused() -> None:
    mech = ball()
    stops = [rg.Stop("z", lower=0.0, restitution=0.5), rg.Stop("z", lower=0.0, restitution=0.2)]
    run = rg.simulate(mech, [0.3], [0.0], duration=0.4, step=1e-3, joints=stops)
    with pytest.raises(rg.NotDifferentiableError, match="met at once"):
        rg.sensitivity(run)


def test_a_start_that_is_held_has_no_derivative_by_what_holds_it() -> None:
    mech = rg.Mechanism.from_pinocchio(pendulum().model, [], ["q"], home=[0.05])
    push = lambda t, q, v: np.array([2.0 * t])  # noqa: E731
    run = rg.simulate(mech, duration=1.0, step=2e-3, torque=push, joints=[rg.JointFriction("q", 1.0)])
    assert [h.kind for h in run.happenings] == ["hold", "release"]
    found = rg.sensitivity(run)
    assert np.isnan(found.dq_dv).all() and np.isfinite(found.dq_dy).all()
    assert np.isnan(rg.gradient(run, rg.Cost(lambda q, v: q[0])).dv).all()


def test_a_start_with_an_impact_is_refused() -> None:
    stop = rg.Stop("z", lower=0.0, restitution=0.5)
    run = rg.simulate(ball(), [0.0], [-1.0], duration=0.1, step=1e-3, joints=[stop])
    with pytest.raises(rg.NotDifferentiableError, match="begins with an impact"):
        rg.sensitivity(run)


def test_runs_that_do_not_remember_are_refused(tmp_path: Any) -> None:
    stop = [rg.Stop("z", lower=0.0, restitution=0.5)]
    run = rg.simulate(ball(), [0.3], [0.0], duration=0.4, step=1e-3, joints=stop)
    cost = rg.Cost(lambda q, v: q[0])
    for other in (pickle.loads(pickle.dumps(run)), rg.load_trajectory(run.save(tmp_path / "run.npz"))):
        with pytest.raises(rg.OptionError, match="simulate it again"):
            rg.gradient(other, cost)
    with pytest.raises(rg.OptionError, match="parameters="):
        rg.gradient(run, cost, parameters=["z.m"])
    with pytest.raises(rg.OptionError, match="torque="):
        rg.gradient(run, cost, torque=[0.0])
    with pytest.raises(rg.OptionError, match="no stops"):
        rg.sensitivity(rg.simulate(ball(), duration=0.1, step=1e-2))


def test_limits_of_a_file_are_differentiated_too(tmp_path: Any) -> None:
    """As stops that are given."""
    mech = rg.load("slider_crank")
    low = float(mech.home[2]) - 0.25
    model = mech.model.copy()
    at = model.joints[model.getJointId("q3")].idx_q
    lower = model.lowerPositionLimit.copy()
    lower[at], upper = low, model.upperPositionLimit.copy()
    upper[at] = 10.0
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    ranged = rg.Mechanism.from_pinocchio(model, mech.closures, ["q1"], mech.home)
    limited = rg.load(ranged.write(tmp_path / "crank"), limits=True)
    v = mech.lift(mech.home, [2.0])
    runs = [
        rg.simulate(limited, limited.home, v, duration=1.0, step=2e-3),
        rg.simulate(mech, limited.home, v, duration=1.0, step=2e-3, joints=list(limited.parts)),
    ]
    assert runs[0].happenings
    np.testing.assert_allclose(*(whole(rg.sensitivity(run)) for run in runs), atol=1e-9)


def test_actuators_act_through_events() -> None:
    """A servo and a lagging motor press a slider-crank's slide on its stop."""
    shipped = rg.load("slider_crank")
    servo = rg.Actuator.position("servo", "q1", kp=8.0, kv=0.5)
    lag = rg.Actuator("lag", "q3", gain=(5.0,), dynamics="filter", time=(0.2,))
    mech = rg.Mechanism.from_pinocchio(
        shipped.model, shipped.closures, shipped.independent, shipped.home, actuators=[servo, lag]
    )
    stop = rg.Stop("q3", lower=float(shipped.home[2]) - 0.3, restitution=0.8)
    run = require_right(
        mech, [0.5], 1e-7, 1e-4, duration=0.9, step=2e-3, joints=[stop], ctrl={"servo": 3.0, "lag": -1.0}
    )
    assert "impact" in {x.kind for x in run.happenings}


def test_what_is_not_followed_is_refused() -> None:
    """Torques held over steps, outputs that are no ends of steps, locks that an event closes."""
    mech, stop = pendulum(), [rg.Stop("q", upper=1.2)]
    start = [1.0], [0.0], 0.5, 1e-2
    held = rg.simulate(mech, *start, torque=lambda t, q, v: -v, joints=stop, hold=True)
    few = rg.simulate(mech, *start, joints=stop, outputs=[0.1, 0.5])
    latched = rg.simulate(mech, *start, joints=[rg.Lock("q", when=rg.Event(lambda t, q, v: q[0] - 0.8))])
    for run, kind, words in (
        (held, rg.OptionError, "hold=True"), (few, rg.OptionError, "sensitivity: .* outputs="),
        (latched, rg.NotDifferentiableError, "Lock"),
    ):  # fmt: skip
        with pytest.raises(kind, match=words):
            rg.sensitivity(run)


def test_a_run_that_stopped_is_differentiated_up_to_there() -> None:
    mech, parts = rg.load("slider_crank"), [rg.Stop("q3", lower=2.6, restitution=0.5)]

    def torque(t: float, q: Array, v: Array) -> float:
        return np.nan if t > 1.4 + 1e-9 else 0.3

    asked: dict[str, Any] = {"step": 1e-2, "joints": parts, "torque": {"q1": torque}}
    with pytest.raises(rg.NonFiniteError) as caught:
        rg.simulate(mech, duration=2.0, **asked)
    assert caught.value.trajectory is not None
    whole_run = rg.simulate(mech, duration=1.4, **asked)
    assert [x.kind for x in whole_run.happenings] == ["impact"]
    found, wanted = whole(rg.sensitivity(caught.value.trajectory)), whole(rg.sensitivity(whole_run))
    assert found == pytest.approx(wanted, abs=1e-12)
