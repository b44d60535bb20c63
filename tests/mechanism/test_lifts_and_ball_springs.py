"""Springs of balls and gravity compensation: MuJoCo's passive forces, exact slopes, energy, reactions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.mechanism.differences import torque_differences
from robust_gcp.simulation.derivatives import reverse_sweep
from tests.io.drives import Beside, differences

XML = """<mujoco model="lifted"><compiler angle="radian"/>
<option gravity="0.3 -0.5 -9.81"><flag contact="disable"/></option><worldbody>
<body name="still" gravcomp="1"><geom size="0.1"/></body>
<body name="arm" quat="0.9 0.1 0.2 0.3" gravcomp="0.7">
  <joint name="s" type="ball" stiffness="3" damping="0.1"/>
  <geom type="box" size="0.1 0.2 0.3" pos="0.3 0.1 0.2" mass="2"/>
  <body name="fist" pos="0.5 0 0" euler="0.1 0.2 0.3" gravcomp="1.4">
    <geom size="0.1" pos="0 0 0.1" mass="0.5"/></body>
  <body name="fore" pos="0.6 0 0" gravcomp="1"><joint name="q" axis="0 1 0" stiffness="2"/>
    <geom size="0.1" pos="0.2 0 0" mass="1.5"/><site name="wrist"/>
    <body name="tip" pos="0.5 0 0"><joint name="p" type="slide" axis="0 0 1"/>
      <geom size="0.05" mass="0.2"/></body>
  </body></body>
<body name="float" gravcomp="1"><freejoint name="f"/><geom type="box" size="0.1 0.2 0.3"/></body></worldbody>
{more}</mujoco>"""


def states(mech: rg.Mechanism, count: int) -> list[tuple[Any, Any]]:
    rng = np.random.default_rng(3)
    return [
        (mech.tree.integrate(mech.home, rng.normal(size=mech.nv)), rng.normal(size=mech.nv))
        for _ in range(count)
    ]


@pytest.mark.parametrize("flags", ["", "spring", "damper", "gravity", "spring damper"])
def test_they_are_mujocos(flags: str) -> None:
    off = " ".join(f'{flag}="disable"' for flag in flags.split())
    switch = f"<option><flag {off}/></option>"
    beside = Beside(XML.format(more=switch))
    assert beside.contents.left_out == []
    assert max(differences(beside, seed=4, count=50)) < 1e-12


def test_lifting_by_actuators_is_lifting_all_the_same() -> None:
    """MuJoCo counts it among what actuators do, where a range may bound it: then it is left out, and told.

    So it is without actuators, where MuJoCo does not lift by them.
    """
    by_actuators = XML.replace('axis="0 1 0"', 'axis="0 1 0" actuatorgravcomp="true"')
    motor = '<actuator><motor joint="p" gear="0"/></actuator>'
    beside = Beside(by_actuators.format(more=motor))
    q, v, _ = beside.random(np.random.default_rng(1))
    assert beside.open.applied is not None and np.abs(beside.d.qfrc_actuator).max() > 1.0
    ours, d = beside.to_mujoco(beside.open.applied.tau(q, v)), beside.d
    np.testing.assert_allclose(ours, d.qfrc_passive + d.qfrc_actuator, atol=1e-12)
    bounded = by_actuators.replace('axis="0 1 0"', 'axis="0 1 0" actuatorfrcrange="-1 1"')
    for xml in (bounded.format(more=motor), by_actuators.format(more="")):
        assert Beside(xml).contents.left_out == [
            "gravity compensation of bodies (still, arm, fist, fore, float)"
        ]


def test_slopes_are_exact() -> None:
    mech = rg.Mechanism.from_mjcf(XML.format(more=""))
    for force in mech.forces:
        if not isinstance(force, rg.BallSpring | rg.GravityCompensation):
            continue
        for q, v in states(mech, 5):

            def tau(q: Any, v: Any, force: Any = force) -> Any:
                return force.tau(mech, q, v)

            ours, theirs = force.derivatives(mech, q, v), torque_differences(mech.tree, mech.units, tau, q, v)
            for a, b in zip(ours, theirs, strict=True):
                np.testing.assert_allclose(a, b, atol=2e-8)


@pytest.mark.parametrize(
    "joint", [pin.JointModelSphericalZYX(), pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1])]
)
def test_slopes_are_exact_behind_joints_whose_axes_turn(joint: pin.JointModel) -> None:
    model = pin.Model()
    at = pin.SE3(pin.exp3(np.array([0.3, 0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
    first = model.addJoint(0, joint, at, "gimbal")
    second = model.addJoint(first, pin.JointModelRX(), at, "hinge")
    model.addFrame(pin.Frame("hand", second, at, pin.FrameType.OP_FRAME))
    lift = rg.GravityCompensation({"hand": (2.0, (0.1, 0.2, 0.3))})
    mech = rg.Mechanism.from_pinocchio(model, forces=[lift])
    for q, v in states(mech, 3):
        wanted = torque_differences(mech.tree, mech.units, lambda q, v: lift.tau(mech, q, v), q, v)
        np.testing.assert_allclose(lift.derivatives(mech, q, v)[0], wanted[0], atol=1e-7)


def test_derivatives_and_gradients_know_them() -> None:
    mech = rg.Mechanism.from_mjcf(XML.format(more=""))
    (q, v), h = states(mech, 1)[0], 1e-6
    found = rg.derivatives(mech, q, v).da_dy
    for i, e in enumerate(h * np.eye(mech.nv)):
        after, before = (rg.forward_dynamics(mech, mech.tree.integrate(q, s * e), v) for s in (1.0, -1.0))
        np.testing.assert_allclose(found[:, i], (after - before) / (2.0 * h), atol=1e-6)
    start, h = v.copy(), 1e-5

    def end(first: float) -> float:
        run = rg.simulate(mech, q, [first, *start[1:]], duration=0.02, step=1e-3)
        return float(run.v[-1] @ run.v[-1])

    run = rg.simulate(mech, q, v, duration=0.02, step=1e-3)
    slope = rg.gradient(run, rg.Cost(terminal=lambda q, v: float(v @ v))).dv[0]
    assert slope == pytest.approx((end(v[0] + h) - end(v[0] - h)) / (2.0 * h), rel=1e-7)


@pytest.mark.parametrize("native", [True, False])
def test_gravity_as_a_parameter_changes_what_is_lifted(native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not native:
        monkeypatch.setattr(reverse_sweep, "kernel_of", lambda *_: None)
    plain = rg.load("crank_rocker")
    lift, cost = rg.GravityCompensation({"q2": (1.5, (0.0, 0.3, 0.0))}), rg.Cost(lambda q, v: float(q[2]))

    def under(more: float) -> rg.Trajectory:
        model = plain.model.copy()
        model.gravity.linear = model.gravity.linear + more * np.eye(3)[2]
        home = plain.home
        mech = rg.Mechanism.from_pinocchio(model, plain.closures, plain.independent, home, forces=[lift])
        return rg.simulate(mech, home, mech.lift(home, [2.0]), 0.05, 5e-3, record="a")

    run, after, before = under(0.0), under(1e-3), under(-1e-3)
    found = rg.gradient(run, cost, parameters=["gravity.z"]).parameters["gravity.z"]
    assert found == pytest.approx((after.q[-1, 2] - before.q[-1, 2]) / 2e-3, rel=1e-6)
    by = rg.by_parameters(run.mechanism, run.q[0], run.v[0], parameters=["gravity.z"])
    assert after.a is not None and before.a is not None
    assert by[0, 0] == pytest.approx((after.a[0, 0] - before.a[0, 0]) / 2e-3, rel=1e-9)


def test_what_is_wholly_lifted_stays_where_it_is() -> None:
    mech = rg.Mechanism.from_mjcf(XML.format(more=""))
    run = rg.simulate(mech, duration=0.5, step=5e-3)
    start, end = run.frame("float").position[[0, -1]]
    np.testing.assert_allclose(end, start, atol=1e-13)
    assert np.abs(run.energy_error()).max() < 1e-7


def test_a_ball_on_a_spring_swings_and_keeps_its_energy(tmp_path: Path) -> None:
    """About a principal axis θ̈ = −k θ/I, half a turn and back at order 4."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "s")
    moments = np.diag([0.5, 1.0, 0.7])
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), moments), pin.SE3.Identity())
    rest = pin.Quaternion(pin.exp3(np.array([0.3, -0.2, 0.5])))
    mech = rg.Mechanism.from_pinocchio(model, forces=[rg.BallSpring("s", 2.0, rest.coeffs())])
    turn, times = np.array([0.0, 1.5, 0.0]), 2.0
    q0 = (rest * pin.Quaternion(pin.exp3(turn))).coeffs()
    errors = []
    for n in (100, 200):
        run = rg.simulate(mech, q0, duration=times, step=times / n)
        wanted = rest * pin.Quaternion(pin.exp3(turn * np.cos(np.sqrt(2.0) * times)))
        errors.append(min(np.linalg.norm(run.q[-1] - s * wanted.coeffs()) for s in (1.0, -1.0)))
    assert errors[1] < 1e-8 and np.log2(errors[0] / errors[1]) > 3.8
    rng = np.random.default_rng(0)
    run = rg.simulate(mech, q0, rng.normal(size=3), duration=times, step=2e-3)
    assert np.abs(run.energy_error()).max() < 1e-9
    back = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert back.mechanism.forces == mech.forces
    d = rg.derivatives(mech, run.q[50], run.v[50])
    np.testing.assert_allclose(moments @ d.da_dtau, np.eye(3), atol=1e-12)


def test_lifts_are_no_load_on_the_joints_that_carry_them(tmp_path: Path) -> None:
    """A rod at rest whose weight is lifted by 0.6 of it: its hinge carries the other 0.4."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "q")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addBodyFrame("rod", joint, pin.SE3.Identity(), 0)
    mech = rg.Mechanism.from_pinocchio(model, forces=[rg.GravityCompensation({"rod": (1.2, np.zeros(3))})])
    run = rg.simulate(mech, duration=0.01, step=1e-3)
    force = run.reaction("q").force
    np.testing.assert_allclose(force, np.tile([0.0, 0.0, 0.8 * 9.81], (11, 1)), atol=1e-12)
    back = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert back.mechanism.forces == mech.forces
    with pytest.warns(rg.ModelWarning, match="forces \\(GravityCompensation\\)"):
        mech.write(tmp_path / "lifted.urdf")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: rg.BallSpring("s", -1.0), "zero or a positive number"),
        (lambda: rg.BallSpring("s", 1.0, (0.0, 0.0, 0.0, 0.0)), "must be a quaternion"),
        (lambda: rg.BallSpring("s", 1.0, (0.0, 1.0)), "rest"),
        (lambda: rg.GravityCompensation({}), "give {frame: \\(mass, point\\)}"),
        (lambda: rg.GravityCompensation({"a": 1.0}), "no mass, kg, and point"),
        (lambda: rg.GravityCompensation([("a", 1.0)]), "no frame, mass, kg, and point"),  # type: ignore[list-item]
        (lambda: rg.GravityCompensation({"a": (-1.0, [0, 0, 0])}), "zero or a positive number"),
        (lambda: rg.GravityCompensation({"a": (1.0, [0, 0])}), "point"),
    ],
)
def test_what_is_none_is_refused(make: Any, words: str) -> None:
    with pytest.raises(rg.RobustGcpError, match=words):
        make()


def test_they_act_where_there_is_something_to_act_on() -> None:
    for force, words in (
        (rg.BallSpring("q1", 1.0), "'q1' is not spherical; use a JointSpring"),
        (rg.BallSpring("q9", 1.0), "q9"),
        (rg.GravityCompensation({"nowhere": (1.0, [0, 0, 0])}), "no frame 'nowhere'"),
    ):
        shipped = rg.load("rhombus")
        with pytest.raises(rg.ModelError, match=words):
            rg.Mechanism.from_pinocchio(
                shipped.model, shipped.closures, shipped.independent, shipped.home, forces=[force]
            )
