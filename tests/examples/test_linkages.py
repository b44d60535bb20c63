"""The shipped scenes: closed, of the stated mobility, and moving as other formulations say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import robust_gcp as rg

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]
PI = np.pi
GRAVITY = 9.81


@dataclass(frozen=True)
class Scene:
    """What is known of a scene, and a short motion from its home."""

    independent: tuple[str, ...]
    rows: int
    kind: str
    duration: float
    step: float
    energy: float
    """J: largest energy error of RK4 at `step`, measured, doubled."""
    speed: dict[str, float] = field(default_factory=dict)


HIPS = tuple(f"hip_{leg}_{end}" for leg in ("left", "right") for end in ("front", "rear"))

SCENES = {
    "andrews": Scene(("beta",), 6, "regular", 0.002, 4e-5, 1e-11),
    "bricard": Scene(("hinge1",), 5, "redundant", 0.2, 0.01, 1e-8, {"hinge1": 0.5}),
    "bricard_square": Scene(("hinge1",), 5, "redundant", 0.2, 0.01, 1e-8, {"hinge1": 0.5}),
    "slider_crank": Scene(("q1",), 2, "regular", 0.2, 0.01, 2e-8, {"q1": 0.5}),
    "five_bar": Scene(("q1", "q3"), 2, "regular", 0.2, 0.01, 8e-7, {"q1": 0.5, "q3": -0.5}),
    "flyball": Scene(("shaft", "alpha1", "alpha2", "s"), 0, "regular", 0.02, 1e-4, 2e-7, {"shaft": 2 * PI}),
    "stewart": Scene(tuple(f"leg{i}" for i in range(1, 7)), 18, "regular", 0.04, 1e-3, 2e-8, {"leg1": 0.3}),
    "delta": Scene(("arm1", "arm2", "arm3"), 18, "regular", 0.1, 4e-3, 3.2e-6, {"arm1": 1.0, "arm2": -1.0}),
    "walker": Scene(HIPS, 4, "regular", 0.1, 4e-3, 8e-8, {HIPS[0]: 1.5, HIPS[3]: 1.0}),
    "strandbeest": Scene(("crank",), 6, "regular", 0.2, 0.01, 5e-8, {"crank": 2.0}),
    "strandbeest_pair": Scene(("crank",), 12, "regular", 0.2, 0.01, 5e-7, {"crank": 2.0}),
}


def kick(mech: rg.Mechanism, speed: dict[str, float]) -> Array:
    return mech.lift(mech.home, [speed.get(name, 0.0) for name in mech.independent])


def run(name: str, duration: float | None = None, step: float | None = None) -> rg.Trajectory:
    scene, mech = SCENES[name], rg.load(name)
    return rg.simulate(
        mech, v0=kick(mech, scene.speed), duration=duration or scene.duration, step=step or scene.step
    )


# --------------------------------------------------------------------------- every scene


@pytest.mark.parametrize("name", SCENES)
def test_it_is_closed_and_has_its_mobility(name: str) -> None:
    scene, mech = SCENES[name], rg.load(name)
    assert mech.independent == scene.independent
    assert mech.nc == scene.rows
    assert mech.closure_residual(mech.home) < 1e-12
    here = rg.analyse(mech, mech.home)
    assert here.kind == scene.kind
    assert here.kernel.shape[1] == len(scene.independent)


@pytest.mark.parametrize("name", SCENES)
def test_a_short_motion_stays_closed_and_conserves_energy(name: str) -> None:
    """Energy, work of drives and dampers accounted for, to the order of RK4: four at least."""
    scene = SCENES[name]
    coarse, fine = (run(name, step=h) for h in (scene.step, 0.5 * scene.step))
    for traj in (coarse, fine):
        assert traj.closure_error().max() / traj.mechanism.length < 1e-10
        assert traj.velocity_error().max() < 1e-10
        assert not traj.crossings
        assert (traj.work is not None) == (name in ("andrews", "flyball"))
    errors = [np.abs(traj.energy_error()).max() for traj in (coarse, fine)]
    assert errors[0] < scene.energy
    assert errors[0] / errors[1] > 12.0 or errors[1] < 1e-12


def contacts(mech: rg.Mechanism) -> pin.StdVec_RigidConstraintModel:
    """The closures as Pinocchio knows them; a hinge as two points on its axis."""
    models = pin.StdVec_RigidConstraintModel()
    for closure in mech.closures:
        one, two = (mech.model.frames[mech.model.getFrameId(f)] for f in (closure.frame1, closure.frame2))
        offsets = [np.zeros(3)]
        if isinstance(closure, rg.RevoluteClosure):
            offsets.append(np.asarray(closure.axis))
        for offset in offsets:
            shift = pin.SE3(np.eye(3), offset)
            models.append(
                pin.RigidConstraintModel(
                    pin.ContactType.CONTACT_3D,
                    mech.model,
                    one.parentJoint,
                    one.placement * shift,
                    two.parentJoint,
                    two.placement * shift,
                    pin.ReferenceFrame.LOCAL,
                )
            )
    return models


@pytest.mark.parametrize("name", SCENES)
def test_agreement_with_pinocchios_constraint_dynamics(closed_states: States, name: str) -> None:
    """Accelerations at random regular configurations, springs and drives passed as torques."""
    mech = rg.load(name)
    models = contacts(mech)
    datas = pin.StdVec_RigidConstraintData()
    for model in models:
        datas.append(model.createData())
    data = mech.model.createData()
    pin.initConstraintDynamics(mech.model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 1e-14, 1e-6, 200)
    rng = np.random.default_rng(0)
    free = [(mech.home + rng.uniform(-0.3, 0.3, mech.nq), rng.uniform(-1, 1, mech.nv)) for _ in range(4)]
    for q, v in closed_states(mech, 4) if mech.closures else free:
        tau = np.zeros(mech.nv) if mech.applied is None else mech.applied.tau(q, v)
        traj = rg.simulate(mech, q, v, duration=1e-6, step=1e-6, record=("a",))
        assert traj.a is not None
        theirs = pin.constraintDynamics(mech.model, data, traj.q[0], traj.v[0], tau, models, datas, settings)
        np.testing.assert_allclose(traj.a[0], theirs, atol=1e-9 * max(1.0, np.abs(theirs).max()))


@pytest.mark.parametrize(
    ("name", "others", "duration", "step", "tolerance"),
    [
        ("andrews", [("theta",), ("gamma",), ("delta",), ("epsilon",)], 0.0006, 1e-5, 1e-9),
        ("five_bar", [("q1", "q2"), ("q2", "q3"), ("q2", "q4"), ("q3", "q4")], 0.1, 1e-3, 1e-9),
        ("stewart", [("leg1_x", "leg1_y", "leg1", "leg2_x", "leg2", "leg3")], 0.02, 1e-3, 1e-9),
    ],
)
def test_other_coordinates_give_the_same_motion(
    name: str, others: list[tuple[str, ...]], duration: float, step: float, tolerance: float
) -> None:
    mech = rg.load(name)
    v0 = kick(mech, SCENES[name].speed)
    if name == "andrews":  # at home crank and coupler are in line: a toggle for the other joints
        early = rg.simulate(mech, duration=0.004, step=2e-5)
        mech.home, v0 = early.q[-1], early.v[-1]
    reference = rg.simulate(mech, v0=v0, duration=duration, step=step)
    for names in others:
        other = rg.simulate(mech.with_independent(names), v0=v0, duration=duration, step=step)
        np.testing.assert_allclose(other.q, reference.q, atol=tolerance)


# --------------------------------------------------------------------------- other formulations


def test_slider_crank_against_its_lagrangian() -> None:
    """θ̈ = −(½ M′ θ̇² + V′)/M in the crank angle θ, written out by hand."""
    l1, l2 = 1.0, 2.5

    def slope(t: float, x: Array) -> Array:
        theta, rate = x
        s, c = np.sin(theta), np.cos(theta)
        sin_p = -l1 / l2 * s  # φ, the rod's angle: l1 sin θ + l2 sin φ = 0
        cos_p = np.sqrt(1.0 - sin_p**2)
        p1 = -l1 * c / (l2 * cos_p)  # dφ/dθ
        p2 = (l1 * s / l2 + sin_p * p1**2) / cos_p  # d²φ/dθ²
        h = 0.5 * l2  # the rod's centre, (x, z) and derivatives by θ
        x1, z1 = -l1 * s - h * sin_p * p1, l1 * c + h * cos_p * p1
        x2 = -l1 * c - h * (cos_p * p1**2 + sin_p * p2)
        z2 = -l1 * s + h * (-sin_p * p1**2 + cos_p * p2)
        b1 = -l1 * s - l2 * sin_p * p1  # the slider
        b2 = -l1 * c - l2 * (cos_p * p1**2 + sin_p * p2)
        M = l1**2 / 3.0 + x1**2 + z1**2 + l2**2 / 12.0 * p1**2 + b1**2
        dM = 2.0 * (x1 * x2 + z1 * z2 + l2**2 / 12.0 * p1 * p2 + b1 * b2)
        dV = GRAVITY * (0.5 * l1 * c + z1)
        return np.array([rate, -(0.5 * dM * rate**2 + dV) / M])

    mech = rg.load("slider_crank")
    start = [float(mech.home[0]), 2.0]
    traj = rg.simulate(mech, v0=mech.lift(mech.home, [2.0]), duration=2.0, step=2e-3)
    exact = solve_ivp(slope, (0.0, 2.0), start, method="DOP853", rtol=1e-12, atol=1e-12)
    assert np.ptp(traj.y) > PI  # past both dead points of the slider
    assert traj.y[-1, 0] == pytest.approx(exact.y[0, -1], abs=1e-8)
    theta = traj.q[:, 0]
    np.testing.assert_allclose(
        traj.q[:, 2], l1 * np.cos(theta) + np.sqrt(l2**2 - (l1 * np.sin(theta)) ** 2), atol=1e-13
    )


def test_five_bar_against_cartesian_coordinates() -> None:
    """Four rods with three coordinates each, held together by ten constraints and their multipliers."""
    lengths, ground = np.array([0.8, 1.4, 0.8, 1.4]), 1.0  # left crank, coupler, right crank, coupler
    pins = [  # (rod, end) or ground point: the end −1 is a rod's root, +1 its tip
        ((0, -1), np.array([0.0, 0.0])),
        ((0, 1), (1, -1)),
        ((2, -1), np.array([ground, 0.0])),
        ((2, 1), (3, -1)),
        ((1, 1), (3, 1)),
    ]
    mass = np.concatenate([[1.0, 1.0, length**2 / 12.0] for length in lengths])
    weight = np.tile([0.0, -GRAVITY, 0.0], 4)

    def slope(t: float, x: Array) -> Array:
        angle, rate = x[2:12:3], x[14:24:3]
        J, gamma = np.zeros((10, 12)), np.zeros(10)
        for i, ends in enumerate(pins):
            for sign, end in zip((1.0, -1.0), ends, strict=True):
                if isinstance(end, np.ndarray):
                    continue
                rod, side = end
                arm = 0.5 * side * lengths[rod] * np.array([np.cos(angle[rod]), np.sin(angle[rod])])
                J[2 * i : 2 * i + 2, 3 * rod : 3 * rod + 2] += sign * np.eye(2)
                J[2 * i : 2 * i + 2, 3 * rod + 2] += sign * np.array([-arm[1], arm[0]])
                gamma[2 * i : 2 * i + 2] += sign * arm * rate[rod] ** 2
        matrix = np.block([[np.diag(mass), J.T], [J, np.zeros((10, 10))]])
        a = np.linalg.solve(matrix, np.concatenate([weight, gamma]))[:12]
        return np.concatenate([x[12:], a])

    mech = rg.load("five_bar")
    T = np.zeros((4, 4))  # absolute angles of the rods from the joints
    for rod, joints in enumerate((("q1",), ("q1", "q2"), ("q3",), ("q3", "q4"))):
        T[rod, [mech.joint_names.index(name) for name in joints]] = 1.0

    def centres(angle: Array) -> Array:
        end = lengths[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        roots = np.array([[0.0, 0.0], end[0], [ground, 0.0], [ground, 0.0] + end[2]])
        return roots + 0.5 * end

    v0 = mech.lift(mech.home, [1.0, -0.5])
    angle, rate = T @ mech.home, T @ v0
    h = 1e-5
    speeds = (centres(angle + h * rate) - centres(angle - h * rate)) / (2.0 * h)
    start = np.concatenate(
        [np.column_stack([centres(angle), angle]).ravel(), np.column_stack([speeds, rate]).ravel()]
    )
    duration = 0.3
    traj = rg.simulate(mech, v0=v0, duration=duration, step=1e-3)
    other = solve_ivp(slope, (0.0, duration), start, method="DOP853", rtol=1e-11, atol=1e-12)
    # the difference quotient of the start is good to h² = 1e-10
    np.testing.assert_allclose(T @ traj.q[-1], other.y[2:12:3, -1], atol=1e-9)


def test_stewart_moves_the_platform_that_its_legs_carry() -> None:
    """At every recorded time the legs' lengths are the distances that the platform's pose gives."""
    traj = run("stewart", duration=0.04, step=2e-3)
    mech = traj.mechanism
    model, data = mech.model, mech.model.createData()
    assert np.ptp(traj.q[:, mech.iq_independent], axis=0).min() > 1e-4
    for q in traj.q[::5]:
        pin.framesForwardKinematics(model, data, q)
        for i in range(1, 7):
            ball = data.oMf[model.getFrameId(f"plate_ball{i}")].translation
            foot = data.oMi[model.getJointId(f"leg{i}_x")].translation
            length = q[model.joints[model.getJointId(f"leg{i}")].idx_q]
            assert np.linalg.norm(ball - foot) == pytest.approx(length, abs=1e-12)


def test_strandbeest_walks() -> None:
    """Over a turn of the crank the foot draws Jansen's curve: flat below for half of the time."""
    mech = rg.load("strandbeest")
    model, data = mech.model, mech.model.createData()
    crank = mech.iq_independent[0]
    foot, q = [], mech.home
    for angle in mech.home[crank] + np.linspace(0.0, 2.0 * PI, 181):
        guess = q.copy()
        guess[crank] = angle
        q = mech.assemble(guess)
        pin.framesForwardKinematics(model, data, q)
        foot.append(data.oMf[model.getFrameId("foot")].translation.copy())
    path = np.array(foot)
    np.testing.assert_allclose(path[-1], path[0], atol=1e-12)
    below = path[:, 2] < path[:, 2].min() + 0.01
    assert 0.4 < below.mean() < 0.6
    assert np.ptp(path[below, 1]) > 0.5  # m, the stride
    assert np.ptp(path[:, 2]) == pytest.approx(0.2245, abs=1e-3)


def test_the_two_legs_of_a_pair_are_half_a_turn_apart() -> None:
    """Each leg alone at its crank angle: the same joint angles, but for the crank's half turn."""
    one, pair = rg.load("strandbeest"), rg.load("strandbeest_pair")
    angles = dict(zip(pair.joint_names, pair.home, strict=True))
    for prefix, turn in (("left_", 0.0), ("right_", PI)):
        guess = [
            angles["crank"] + turn
            if name == "crank"
            else angles[prefix + name] - (turn if name in "jk" else 0.0)
            for name in one.joint_names
        ]
        assert one.closure_residual(np.array(guess)) < 1e-12
