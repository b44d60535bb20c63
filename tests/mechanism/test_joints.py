"""What a joint is, against what Pinocchio does with it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.mechanism.loops import ClosedLoops
from robust_gcp.mechanism.tree.joints import IN_KERNEL, JointKind, components_of, in_q, in_v, joints_of
from robust_gcp.mechanism.tree.tree import Tree

Array = NDArray[np.floating[Any]]

AXIS = np.array([0.36, 0.48, 0.8])
ACROSS = np.array([0.8, -0.6, 0.0])


def composite() -> Any:
    made = pin.JointModelComposite()
    made.addJoint(pin.JointModelRX())
    made.addJoint(pin.JointModelPY(), pin.SE3(pin.exp3(AXIS), AXIS))
    made.addJoint(pin.JointModelSpherical(), pin.SE3(pin.exp3(-AXIS), AXIS))
    return made


def continuous() -> Any:
    """Its type cannot be made from Python; URDF's reader makes it for an axis askew."""
    axis = " ".join(map(str, AXIS))
    return pin.buildModelFromXML(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="{axis}"/></joint></robot>'
    ).joints[1]


KINDS: dict[str, tuple[Callable[[], Any], JointKind]] = {
    "RX": (pin.JointModelRX, JointKind.REVOLUTE),
    "RY": (pin.JointModelRY, JointKind.REVOLUTE),
    "RZ": (pin.JointModelRZ, JointKind.REVOLUTE),
    "R": (lambda: pin.JointModelRevoluteUnaligned(AXIS), JointKind.REVOLUTE),
    "PX": (pin.JointModelPX, JointKind.PRISMATIC),
    "PY": (pin.JointModelPY, JointKind.PRISMATIC),
    "PZ": (pin.JointModelPZ, JointKind.PRISMATIC),
    "P": (lambda: pin.JointModelPrismaticUnaligned(AXIS), JointKind.PRISMATIC),
    "RUBX": (pin.JointModelRUBX, JointKind.CONTINUOUS),
    "RUBY": (pin.JointModelRUBY, JointKind.CONTINUOUS),
    "RUBZ": (pin.JointModelRUBZ, JointKind.CONTINUOUS),
    "RUB": (continuous, JointKind.CONTINUOUS),
    "HZ": (lambda: pin.JointModelHZ(0.3), JointKind.SCREW),
    "H": (lambda: pin.JointModelHelicalUnaligned(AXIS, 0.2), JointKind.SCREW),
    "ball": (pin.JointModelSpherical, JointKind.SPHERICAL),
    "translation": (pin.JointModelTranslation, JointKind.TRANSLATION),
    "free": (pin.JointModelFreeFlyer, JointKind.FREE_FLYER),
    "planar": (pin.JointModelPlanar, JointKind.PLANAR),
    "universal": (lambda: pin.JointModelUniversal(AXIS, ACROSS), JointKind.UNIVERSAL),
    "zyx": (pin.JointModelSphericalZYX, JointKind.EULER_ZYX),
    "ellipsoid": (lambda: pin.JointModelEllipsoid(0.3, 0.4, 0.5), JointKind.ELLIPSOID),
    "composite": (composite, JointKind.COMPOSITE),
}


def arm(made: Any) -> pin.Model:
    """A hinge, the joint in question, a slide; each askew on the one before."""
    model = pin.Model()
    body = 0
    for number, joint in enumerate((pin.JointModelRY(), made, pin.JointModelPX())):
        turn = pin.exp3(np.array([0.3, -0.5, 0.2]) * (number + 1))
        at = pin.SE3(turn, np.array([0.4, 0.1, -0.2]))
        body = model.addJoint(body, joint, at, ("first", "middle", "last")[number])
        model.appendBodyToJoint(body, pin.Inertia(1.0, 0.1 * AXIS, 0.02 * np.eye(3)), pin.SE3.Identity())
    for name, joint in (("tip", body), ("eye", 0)):
        model.addFrame(pin.Frame(name, joint, pin.SE3(pin.exp3(AXIS), AXIS), pin.FrameType.OP_FRAME))
    return model


def somewhere(model: pin.Model) -> Array:
    return np.asarray(pin.integrate(model, pin.neutral(model), np.linspace(0.3, 0.9, model.nv)))


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_joint_is_known_by_its_kind_and_its_numbers(kind: str) -> None:
    make, expected = KINDS[kind]
    model = arm(make())
    joints = joints_of(model)
    middle = joints[1]
    assert middle.kind is expected
    assert (middle.nq, middle.nv) == (model.nqs[2], model.nvs[2])
    assert [c.iq for c in in_q(joints)] == list(range(model.nq))
    assert [c.iv for c in in_v(joints)] == list(range(model.nv))
    names = [component.name for component in components_of(joints)]
    assert len(set(names)) == len(names)
    assert middle.single == (model.nqs[2] == 1 == model.nvs[2])


def test_what_turns_and_where_the_axis_is(kind: str) -> None:
    model = arm(KINDS[kind][0]())
    data, q = model.createData(), somewhere(model)
    pin.computeJointJacobians(model, data, q)
    J = pin.getJointJacobian(model, data, 2, pin.ReferenceFrame.LOCAL)
    middle = joints_of(model)[1]
    turning = np.any(np.abs(J[3:]) > 1e-12, axis=0)
    rotates = Tree(model).rotates
    np.testing.assert_array_equal(rotates[middle.v], turning[middle.v])
    assert [c.unit == "rad" for c in in_v([middle])] == rotates[middle.v].tolist()
    if middle.axis is not None:
        column = J[3:, middle.idx_v] if turning[middle.idx_v] else J[:3, middle.idx_v]
        np.testing.assert_allclose(middle.axis, column, atol=1e-15)
        assert np.linalg.norm(middle.axis) == pytest.approx(1.0, abs=1e-15)


def test_periodic_numbers_are_those_of_which_a_whole_turn_changes_nothing(kind: str) -> None:
    model = arm(KINDS[kind][0]())
    q, data = somewhere(model), model.createData()
    pin.forwardKinematics(model, data, q)
    here = data.oMi[2].homogeneous.copy()
    for component in in_q([joints_of(model)[1]]):
        turned = q.copy()
        turned[component.iq] += 2.0 * np.pi
        pin.forwardKinematics(model, data, turned)
        same = bool(np.allclose(data.oMi[2].homogeneous, here, atol=1e-12))
        assert same == component.periodic, component.name


def test_a_moving_subspace_is_told(kind: str) -> None:
    model = arm(KINDS[kind][0]())
    data, subspaces = model.createData(), []
    for q in (pin.neutral(model), somewhere(model)):
        pin.computeJointJacobians(model, data, q)
        subspaces.append(pin.getJointJacobian(model, data, 2, pin.ReferenceFrame.LOCAL).copy())
    middle = joints_of(model)[1]
    constant = bool(np.allclose(subspaces[0][:, middle.v], subspaces[1][:, middle.v], atol=1e-12))
    assert constant == middle.constant_subspace


def test_the_constraint_holds_for_every_kind(kind: str, derivative: Callable[..., Array]) -> None:
    """K = ∂φ/∂q and k = −K̇ v, also where the motion subspace moves."""
    loops = ClosedLoops(arm(KINDS[kind][0]()), [rg.FrameClosure("tip", "eye")])
    q = somewhere(loops.model)
    K = loops.K(q)
    for i, e in enumerate(np.eye(loops.nv)):
        slope = derivative(lambda t, e=e: loops.phi(loops.tree.integrate(q, t * e)))
        np.testing.assert_allclose(K[:, i], slope, atol=1e-9)
    v = np.linspace(-1.0, 1.3, loops.nv)
    rate = derivative(lambda t: loops.K(loops.tree.integrate(q, t * v)) @ v)
    np.testing.assert_allclose(loops.k(q, v), -rate, atol=1e-8)


def test_the_kernel_counts_its_kinds_alike() -> None:
    header = Path(__file__).parents[2] / "robust_gcp" / "kernel" / "tree" / "joints.h"
    (listed,) = re.findall(r"enum Kind : std::int32_t \{ (.*) \};", header.read_text(encoding="utf-8"))
    assert listed.split(", ") == [JointKind(number).name for number in range(len(IN_KERNEL))]
    assert {JointKind(number) for number in range(len(IN_KERNEL))} == IN_KERNEL


def test_names_of_components() -> None:
    model = arm(pin.JointModelFreeFlyer())
    quaternion, turning = [f"middle.q{a}" for a in "xyzw"], [f"middle.r{a}" for a in "xyz"]
    places = [f"middle.{a}" for a in "xyz"]
    assert [c.name for c in in_q(joints_of(model))] == ["first", *places, *quaternion, "last"]
    assert [c.name for c in in_v(joints_of(model))] == ["first", *places, *turning, "last"]
    parts = [c.name for c in in_v(joints_of(arm(composite()))[1:2])]
    assert parts == ["middle.0", "middle.1", "middle.2.rx", "middle.2.ry", "middle.2.rz"]
    unbounded = joints_of(arm(pin.JointModelRUBX()))[1]
    assert [(c.name, c.iq >= 0) for c in unbounded.components] == [
        ("middle.cos", True),
        ("middle.sin", True),
        ("middle", False),
    ]


def test_a_type_that_is_not_known_is_refused_by_name() -> None:
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "leader")
    follower = pin.JointModelMimic(model.joints[first], 2.0, 0.1)
    model.addJoint(first, follower, pin.SE3.Identity(), "follower")
    with pytest.raises(rg.ModelError, match="joint 'follower' is of type JointModelMimic, which"):
        joints_of(model)
