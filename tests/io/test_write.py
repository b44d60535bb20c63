"""Mechanisms as files: read back, they move as before, with the same names."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import add_link

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))
FORMATS = ("robot.xml", "robot.urdf", "robot")

pytest.importorskip("mujoco")
pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.errors.ModelWarning")


def carried_over(one: rg.Mechanism, other: rg.Mechanism, q: np.ndarray, v: np.ndarray):
    """A state by the names of joints: Pinocchio sorts those of a URDF."""
    q2, v2 = np.zeros(other.nq), np.zeros(other.nv)
    for joint in one.joints:
        twin = other.joint(joint.name)
        q2[twin.idx_q : twin.idx_q + twin.nq] = q[joint.idx_q : joint.idx_q + joint.nq]
        v2[twin.v] = v[joint.v]
    return q2, v2


def read_back(mechanism: rg.Mechanism, path: Path) -> rg.Mechanism:
    """With the coordinates and the gravity, which a URDF does not tell, of the first."""
    read = rg.load(mechanism.write(path))
    model = read.model.copy()
    model.gravity.linear = mechanism.model.gravity.linear
    forces = list(read.forces)
    if path.suffix == ".urdf":  # it has no place for these
        forces += [force for force in mechanism.forces if isinstance(force, rg.JointTorque)]
    return rg.Mechanism.from_pinocchio(model, read.closures, mechanism.independent, forces=forces)


@pytest.mark.parametrize("file", FORMATS)
@pytest.mark.parametrize("name", rg.model_names())
def test_shipped_models_move_as_before(name: str, file: str, tmp_path: Path) -> None:
    mechanism = rg.load(name)
    read = read_back(mechanism, tmp_path / file)
    rng = np.random.default_rng(5)
    q, v = mechanism.home, mechanism.lift(mechanism.home, 0.3 * rng.normal(size=mechanism.m))
    step = mechanism.recommended.step
    runs = [
        rg.simulate(m, *carried_over(mechanism, m, q, v), duration=100 * step, step=step)
        for m in (mechanism, read)
    ]
    for joint in mechanism.joint_names:
        np.testing.assert_allclose(runs[1][joint], runs[0][joint], atol=1e-12, rtol=1e-12)


@pytest.mark.parametrize("name", rg.model_names())
def test_a_folder_holds_all_of_it(name: str, tmp_path: Path) -> None:
    mechanism = rg.load(name)
    read = rg.load(mechanism.write(tmp_path / "robot"))
    assert read.independent == mechanism.independent
    assert read.actuated == mechanism.actuated
    assert read.closures == mechanism.closures
    assert {f.name for f in mechanism.model.frames} <= {f.name for f in read.model.frames}
    q, _ = carried_over(mechanism, read, mechanism.home, np.zeros(mechanism.nv))
    np.testing.assert_allclose(read.home, q, atol=1e-14)
    assert read.energy(q, np.zeros(read.nv)) == pytest.approx(
        mechanism.energy(mechanism.home, np.zeros(mechanism.nv)), rel=1e-13
    )
    assert (read.recommended.duration, read.recommended.step) == (
        mechanism.recommended.duration,
        mechanism.recommended.step,
    )


@pytest.mark.parametrize("file", FORMATS)
@pytest.mark.parametrize(
    "robot",
    [
        "agility_cassie/cassie.xml",
        "drake_strandbeest/StrandbeestConstraints.urdf",
        "gepetto/battobot_6d",
        "gepetto/wl16_like",
        "grbda/mit_humanoid_leg.urdf",
        "newton_boxes_fourbar/boxes_fourbar.usda",
        "robotiq_2f85/2f85.xml",
        "toddlerbot/toddlerbot.xml",
    ],
)
def test_published_robots_accelerate_as_before(robot: str, file: str, tmp_path: Path) -> None:
    path = ROBOTS / robot
    if not path.exists():
        pytest.skip("the robots' files are not here")
    if path.suffix == ".usda":
        pytest.importorskip("pxr")
    mechanism = rg.load(path)
    if robot.endswith("leg.urdf") and file.endswith("urdf"):
        with pytest.raises(rg.ModelError, match="URDF has <mimic> alone, a multiple of one joint"):
            mechanism.write(tmp_path / file)
        return
    read = read_back(mechanism, tmp_path / file)
    rng = np.random.default_rng(1)
    q, v = mechanism.home, mechanism.lift(mechanism.home, 0.3 * rng.normal(size=mechanism.m))
    wanted = rg.forward_dynamics(mechanism, q, v)
    found = rg.forward_dynamics(read, *carried_over(mechanism, read, q, v))
    np.testing.assert_allclose(found, wanted, atol=1e-11 * np.abs(wanted).max())


def of_all_kinds(closure: str) -> rg.Mechanism:
    """A chain of joints of six kinds with armature, a range, springs and a loop."""
    model = pin.Model()
    model.gravity.linear = np.array([0.4, -1.0, -9.0])
    askew = pin.SE3(pin.exp3(np.array([0.3, np.pi / 2, -0.7])), np.array([0.1, 0.2, 0.3]))
    body = pin.Inertia(1.3, np.array([0.1, 0.05, -0.02]), np.diag([0.02, 0.03, 0.025]))
    kinds = {
        "base": pin.JointModelFreeFlyer(),
        "ball": pin.JointModelSpherical(),
        "turn": pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
        "slide": pin.JointModelPrismaticUnaligned(np.array([0.0, 0.8, -0.6])),
        "endless": pin.JointModelRUBZ(),
        "hinge": pin.JointModelRX(),
    }
    joint = 0
    for name, kind in kinds.items():
        joint = model.addJoint(joint, kind, askew if joint else pin.SE3.Identity(), name)
        model.addJointFrame(joint)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_link", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    model.addFrame(pin.Frame("end", joint, askew, pin.FrameType.OP_FRAME))
    rng = np.random.default_rng(3)
    home, data = pin.integrate(model, pin.neutral(model), 0.4 * rng.normal(size=model.nv)), model.createData()
    pin.forwardKinematics(model, data, home)
    there = data.oMi[2].actInv(data.oMi[joint] * askew)  # closed at home
    model.addFrame(pin.Frame("start", 2, there, pin.FrameType.OP_FRAME))
    model.armature = np.concatenate([np.zeros(6), [0.2] * 3, [0.1, 0.0, 0.03, 0.0]])
    limits = np.full(model.nq, np.inf)
    low, high = -limits, limits.copy()
    low[11], high[11] = -1.5, 2.0
    model.lowerPositionLimit, model.upperPositionLimit = low, high
    forces = [
        rg.JointSpring("turn", 3.0, 0.2),
        rg.JointDamper("slide", 0.4),
        rg.JointDamper("ball", 0.1),
        rg.PointSpring("end", "base_link", 20.0, 0.5, 0.3),
    ]
    kinds_of = {
        "3d": lambda: rg.PointClosure("end", "start"),
        "universal": lambda: rg.UniversalClosure("end", "start", (0.0, 0.6, 0.8), (1.0, 0.0, 0.0)),
        "coupling": lambda: rg.CouplingClosure("turn", "slide", 0.7, home[11] - 0.7 * home[12]),
    }
    return rg.Mechanism.from_pinocchio(model, [kinds_of[closure]()], "auto", home, forces=forces)


@pytest.mark.parametrize("file", FORMATS)
@pytest.mark.parametrize("closure", ["3d", "universal", "coupling"])
def test_joints_springs_and_closures_of_all_kinds(closure: str, file: str, tmp_path: Path) -> None:
    mechanism = of_all_kinds(closure)
    if closure == "universal" and file.endswith("xml"):
        with pytest.raises(rg.ModelError, match="MJCF has no equality like UniversalClosure"):
            mechanism.write(tmp_path / file)
        return
    read = rg.load(mechanism.write(tmp_path / file))
    assert read.joint_names == mechanism.joint_names
    assert {f.name for f in mechanism.model.frames} <= {f.name for f in read.model.frames}
    turned = read.model.lowerPositionLimit[read.joint("turn").idx_q]
    assert turned == -1.5
    q = mechanism.home
    v = mechanism.lift(q, np.linspace(-0.4, 0.4, mechanism.m))
    q2, numbers = np.zeros(read.nq), dict(zip(mechanism.joint_names, range(9), strict=False))
    for name in numbers:
        one, twin = mechanism.joint(name), read.joint(name)
        part = q[one.idx_q : one.idx_q + one.nq]
        q2[twin.idx_q : twin.idx_q + twin.nq] = (
            [np.arctan2(part[1], part[0])] if one.nq == 2 != twin.nq else part
        )
    model = read.model.copy()
    model.gravity.linear = mechanism.model.gravity.linear
    read = rg.Mechanism.from_pinocchio(model, read.closures, mechanism.independent, q2, forces=read.forces)
    np.testing.assert_allclose(read.energy(q2, v), mechanism.energy(q, v), rtol=1e-12)
    np.testing.assert_allclose(
        rg.forward_dynamics(read, q2, v), rg.forward_dynamics(mechanism, q, v), rtol=1e-9, atol=1e-10
    )


def test_what_a_format_has_no_place_for_is_told(tmp_path: Path) -> None:
    andrews = rg.load("andrews")
    with pytest.warns(
        rg.ModelWarning, match=r"gravity, which a URDF does not tell .*; forces \(JointTorque\)"
    ):
        andrews.write(tmp_path / "a.urdf")
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.ModelWarning)
        andrews.write(tmp_path / "a.xml")
        andrews.write(tmp_path / "a")
    with pytest.raises(rg.ModelError, match=r"written as \.xml \(MJCF\), \.urdf, or a folder"):
        andrews.write(tmp_path / "a.sdf")
    with pytest.raises(rg.ModelError, match="'' names no file"):
        andrews.write("")
    (tmp_path / "file").write_text("")
    with pytest.raises(rg.ModelError, match="cannot be written"):
        andrews.write(tmp_path / "file" / "a.xml")
    model = pin.Model()
    add_link(model, 0, 0.0, "q1", 1.0)
    screw = model.addJoint(1, pin.JointModelHZ(0.1), pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(screw, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    with pytest.raises(rg.ModelError, match=r"joint 'screw' \(JointModelHZ\) cannot be written as URDF"):
        rg.Mechanism.from_pinocchio(model).write(tmp_path / "screw.urdf")


def test_a_spring_to_the_ground_is_read_back(tmp_path: Path) -> None:
    """A site cannot be called "universe", as its frame is."""
    plain = rg.load("slider_crank")
    spring = rg.PointSpring(plain.closures[0].frame1, "universe", 10.0, 0.1, 0.2)
    mech = rg.Mechanism.from_pinocchio(
        plain.model, plain.closures, plain.independent, plain.home, forces=[spring]
    )
    for file in FORMATS:
        read, v = rg.load(mech.write(tmp_path / file)), mech.lift(mech.home, [1.0])
        np.testing.assert_allclose(
            rg.forward_dynamics(read, mech.home, v), rg.forward_dynamics(mech, mech.home, v), rtol=1e-9
        )


def test_restitutions_that_a_format_does_not_hold_are_told(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(
        """<mujoco><option><flag contact="disable"/></option><worldbody><body>
        <joint name="q" axis="0 1 0" range="-40 20"/><geom size="0.1" pos="1 0 0"/>
        </body></worldbody></mujoco>"""
    )
    arm = rg.load(tmp_path / "arm.xml", limits=True)
    with pytest.warns(rg.ModelWarning, match=r"restitution of stops \(q\)"):
        arm.write(tmp_path / "arm.urdf")
    assert rg.load(arm.write(tmp_path / "again.xml"), limits=True).parts == arm.parts


def test_moments_that_no_body_has_are_told(tmp_path: Path) -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "q")
    model.appendBodyToJoint(
        joint, pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0])), pin.SE3.Identity()
    )
    with pytest.warns(rg.ModelWarning, match=r"moments of inertia that no body can have, .* \(q\)"):
        rg.Mechanism.from_pinocchio(model).write(tmp_path / "a.xml")


@pytest.mark.parametrize("file", FORMATS)
def test_forces_that_their_numbers_do_not_tell_are_told(file: str, tmp_path: Path) -> None:
    class Hardening(rg.JointSpring):
        def tau(self, mechanism, q, v):
            return 2.0 * super().tau(mechanism, q, v)

    one = rg.load("five_bar")
    mechanism = rg.Mechanism.from_pinocchio(
        one.model, one.closures, one.independent, forces=[Hardening("q1", 1.0)]
    )
    with pytest.warns(rg.ModelWarning, match=r"forces \(Hardening\)"):
        mechanism.write(tmp_path / file)


def of_two_hinges(**more: Any) -> rg.Mechanism:
    model = pin.Model()
    add_link(model, add_link(model, 0, 0.0, "a", 1.0), 1.0, "b", 1.0)
    model.lowerPositionLimit, model.upperPositionLimit = np.array([-np.inf, -2.0]), np.array([1.5, np.inf])
    return rg.Mechanism.from_pinocchio(model, **more)


@pytest.mark.parametrize("file", FORMATS)
def test_ranges_with_one_end(file: str, tmp_path: Path) -> None:
    model = rg.load(of_two_hinges().write(tmp_path / file)).model
    assert model.upperPositionLimit[0] == 1.5
    assert model.lowerPositionLimit[1] == -2.0
    assert model.lowerPositionLimit[0] <= -1e9
    assert model.upperPositionLimit[1] >= 1e9


@pytest.mark.parametrize("lower", [-1.0, -1.2])
def test_tendon_springs_whatever_their_lengths(lower: float, tmp_path: Path) -> None:
    """Two of −1 say in MJCF that nothing is said."""
    spring = rg.TendonSpring(rg.FixedTendon({"a": 1.0, "b": -0.5}), 3.0, lower, -1.0, 0.2)
    mechanism = of_two_hinges(forces=[spring])
    read = rg.load(mechanism.write(tmp_path / "a.xml"))
    q, v = np.array([0.4, 0.9]), np.array([0.3, -0.2])
    assert read.energy(q, v) == pytest.approx(mechanism.energy(q, v), rel=1e-12)
    np.testing.assert_allclose(
        rg.forward_dynamics(read, q, v), rg.forward_dynamics(mechanism, q, v), rtol=1e-12
    )


@pytest.mark.parametrize("gain", [(1.0,), (2.0, 0.1)])
def test_ranges_of_activations_that_there_are_not(gain: tuple[float, ...], tmp_path: Path) -> None:
    motor = rg.Actuator("m", "a", gain=gain, activation_range=(-0.2, 0.9))
    read = rg.load(of_two_hinges(actuators=[motor]).write(tmp_path / "a.xml"))
    assert [(a.name, a.gain[: len(gain)], a.dynamics) for a in read.actuators] == [("m", gain, "none")]


@pytest.mark.parametrize("file", FORMATS)
def test_armature_along_axes_that_turn_is_told(file: str, tmp_path: Path) -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "float")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    model.armature = np.array([0.5, 0.5, 0.1])
    with pytest.warns(rg.ModelWarning, match=r"armature of joints \(float\)"):
        rg.Mechanism.from_pinocchio(model).write(tmp_path / file)


def test_plain_motors_are_the_joints_that_are_driven(tmp_path: Path) -> None:
    """Nothing of them is left out, nor of one with a gear."""
    path = rg.load("five_bar").write(tmp_path / "a.xml")
    read = rg.load(path)
    assert (read.actuated, read.left_out) == (("q1", "q3"), ())
    path.write_text(path.read_text().replace('<motor joint="q1"', '<motor gear="50" joint="q1"'))
    read = rg.load(path)
    assert (read.left_out, [(a.name, a.gear) for a in read.actuators]) == ((), [("q1", 50.0), ("q3", 1.0)])


def test_convert_translates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from robust_gcp.__main__ import main

    assert main(["convert", "five_bar", str(tmp_path / "a.xml")]) == 0
    assert main(["convert", str(tmp_path / "a.xml"), str(tmp_path / "b")]) == 0
    assert "wrote" in capsys.readouterr().out
    one, other = rg.load("five_bar"), rg.load(tmp_path / "b")
    np.testing.assert_allclose(other.home, one.home)
    assert other.independent == one.independent


def test_a_spring_along_a_tendon_of_the_file_is_written_into_that_tendon(tmp_path: Path) -> None:
    xml = """<mujoco><worldbody><site name="hook" pos="0 0 2"/>
      <body><joint name="j" axis="0 1 0"/><geom size="0.1" contype="0" conaffinity="0"/>
        <site name="tip" pos="1 0 0"/></body></worldbody>
      <tendon><spatial name="cord" stiffness="5" damping="0.1" springlength="0.3">
        <site site="hook"/><site site="tip"/></spatial></tendon></mujoco>"""
    mech = rg.Mechanism.from_mjcf(xml)
    back = rg.load(mech.write(tmp_path / "back.xml"))
    assert tuple(back.tendons) == ("cord",)
    assert back.forces == mech.forces == (rg.PointSpring("hook", "tip", 5.0, 0.3, 0.1),)
