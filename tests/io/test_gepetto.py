"""Folders in the format of example-parallel-robots: joints that stand for others, extra keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml

import robust_gcp as rg
from robust_gcp.io.gepetto import with_joint_changes
from robust_gcp.io.urdf.reader import read_urdf

pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
"""Limits of joints are not what these tests are about."""


def link(name: str, length: float) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0 {length / 2} 0"/><mass value="1"/><inertia ixx="0.1" '
        'iyy="0.02" izz="0.11" ixy="0.01" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name: str, parent: str, child: str, xyz: str, axis: str = "1 0 0", kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/><dynamics damping="0.5"/></joint>'
    )


URDF = "".join(
    [
        '<robot name="spatial_four_bar"><link name="ground"/>',
        link("crank", 0.3) + joint("motor", "ground", "crank", "0 0 0"),
        link("coupler", 1.0) + joint("passive", "crank", "coupler", "0 0.3 0", axis="0 0 1"),
        '<link name="tip_A"/>' + joint("tip_joint", "coupler", "tip_A", "0 1 0", kind="fixed"),
        link("rocker", 0.8) + joint("rocker_hinge", "ground", "rocker", "0.2 1 0", axis="0 0 1"),
        '<link name="tip_B"/>' + joint("tip_joint_B", "rocker", "tip_B", "0 0.8 0", kind="fixed"),
        "</robot>",
    ]
)
SETTINGS: dict[str, Any] = {
    "closed_loop": [["tip_A", "tip_B"]],
    "type": ["3D"],
    "name_mot": ["motor"],
    "joint_name": ["passive"],
    "joint_type": ["UJOINT_ZX"],
    "solver": {"not": "ours"},
}


def folder(path: Path, **changed: Any) -> Path:
    (path / "robot.urdf").write_text(URDF, encoding="utf-8")
    settings = {key: value for key, value in (SETTINGS | changed).items() if value is not None}
    (path / "robot.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    return path


def by_hand(middle: list[tuple[Any, str]]) -> pin.Model:
    """The same tree with other joints between crank and coupler, added one by one."""
    old, new = read_urdf(URDF).model, pin.Model()
    crank = new.addJoint(0, pin.JointModelRX(), old.jointPlacements[1], "motor")
    new.appendBodyToJoint(crank, old.inertias[1], pin.SE3.Identity())
    at, placement = crank, old.jointPlacements[2]
    for kind, name in middle:
        at, placement = new.addJoint(at, kind, placement, name), pin.SE3.Identity()
    new.appendBodyToJoint(at, old.inertias[2], pin.SE3.Identity())
    rocker = new.addJoint(0, pin.JointModelRZ(), old.jointPlacements[3], "rocker_hinge")
    new.appendBodyToJoint(rocker, old.inertias[3], pin.SE3.Identity())
    for name, parent in (("tip_A", at), ("tip_B", rocker)):
        placement = old.frames[old.getFrameId(name)].placement
        new.addFrame(pin.Frame(name, parent, placement, pin.FrameType.OP_FRAME))
    return new


CASES = {
    "UJOINT_ZX": [(pin.JointModelRZ(), "passive_Z"), (pin.JointModelRX(), "passive_X")],
    "ujoint_yz": [(pin.JointModelRY(), "passive_Y"), (pin.JointModelRZ(), "passive_Z")],
    "CARDAN": [(pin.JointModelRX(), "passive_X"), (pin.JointModelRY(), "passive_Y")],
    "SPHERICAL": [(pin.JointModelSpherical(), "passive")],
}


@pytest.mark.parametrize("kind", CASES)
def test_a_changed_joint_is_the_joint_added_by_hand(tmp_path: Path, kind: str) -> None:
    if kind in ("SPHERICAL", "CARDAN"):  # the coupler spins about its own line, which no loop determines
        completed = rg.load(folder(tmp_path, joint_type=[kind]))
        assert completed.actuated == ("motor",)
        if kind == "SPHERICAL":
            assert (completed.independent[0], completed.m) == ("motor", 2)
        else:
            assert completed.independent == ("passive_Y",)  # all else is rigid: the motor cannot serve
        kind_in_full = {"CARDAN": "UJOINT_XY"}.get(kind, kind)
        changed = with_joint_changes(read_urdf(URDF).model, {"passive": kind_in_full}, tmp_path)
    else:
        mechanism = rg.load(folder(tmp_path, joint_type=[kind]))
        assert mechanism.independent == ("motor",)
        changed = mechanism.model
    expected = by_hand(CASES[kind])
    assert list(changed.names) == list(expected.names)
    q = pin.integrate(expected, pin.neutral(expected), 0.3 * np.arange(1, expected.nv + 1))
    v = np.linspace(-1.0, 1.0, expected.nv)
    a = v[::-1].copy()
    taus = [pin.rnea(m, m.createData(), q, v, a) for m in (changed, expected)]
    np.testing.assert_allclose(taus[0], taus[1], rtol=1e-14, atol=1e-14)
    places = []
    for model in (changed, expected):
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        places.append([data.oMf[model.getFrameId(name)].homogeneous for name in ("tip_A", "tip_B")])
    np.testing.assert_allclose(places[0], places[1], atol=1e-15)


def test_the_spatial_four_bar_moves(tmp_path: Path) -> None:
    mechanism = rg.load(folder(tmp_path))
    q = mechanism.assemble(mechanism.home)
    trajectory = rg.simulate(mechanism, q, duration=0.2, step=1e-3, record=("energy",))
    assert trajectory.closure_error().max() < 1e-12
    assert np.abs(trajectory.energy_error()).max() < 1e-8
    assert np.ptp(trajectory.q[:, 0]) > 1e-2


def test_a_fixed_joint_carries_its_body_along(tmp_path: Path) -> None:
    path = folder(tmp_path, joint_type=["FIXED"], closed_loop=None, type=None, name_mot=None)
    mechanism = rg.load(path)
    assert mechanism.joint_names == ("motor", "rocker_hinge")
    model = read_urdf(URDF).model
    total = sum(inertia.mass for inertia in model.inertias)
    assert sum(inertia.mass for inertia in mechanism.model.inertias) == pytest.approx(total, rel=1e-15)
    # the frozen tree at rest weighs on the motor as the whole tree does
    weights = [
        pin.computeGeneralizedGravity(m, m.createData(), np.zeros(m.nv)) for m in (mechanism.model, model)
    ]
    np.testing.assert_allclose(weights[0], weights[1][[0, 2]], rtol=1e-14)


def test_joints_that_stay_keep_their_data(tmp_path: Path) -> None:
    model = rg.load(folder(tmp_path)).model
    assert model.damping.tolist() == [0.5, 0.0, 0.0, 0.5]
    assert model.upperPositionLimit[[0, 3]].tolist() == [3.0, 3.0]
    assert model.upperEffortLimit[[0, 3]].tolist() == [1.0, 1.0]


def test_folders_without_joint_lists_load(tmp_path: Path) -> None:
    path = folder(tmp_path, joint_name=[], joint_type=[], name_mot=None, closed_loop=[], type=[])
    assert rg.load(path).joint_names == ("motor", "passive", "rocker_hinge")


def test_independent_joints_may_be_given_in_place_of_the_motors(tmp_path: Path) -> None:
    path = folder(tmp_path)
    assert rg.load(path, independent=["rocker_hinge"]).independent == ("rocker_hinge",)
    assert rg.load(path, independent="auto").m == 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"joint_type": ["BALL"]}, "joint_type 'BALL' of joint 'passive' is unknown; use one of SPHERICAL"),
        ({"joint_type": ["UJOINT_XX"]}, "'UJOINT_XX'.*UJOINT_XY"),
        ({"joint_name": ["pasive"]}, "'pasive', which the URDF does not have; did you mean 'passive'"),
        ({"joint_type": []}, "joint_name lists 1 joints and joint_type 0"),
        ({"joint_name": "passive"}, "joint_name must be a list"),
        ({"joint_name": ["passive"] * 2, "joint_type": ["FIXED"] * 2}, "names the joint 'passive' twice"),
        ({"type": ["4d"]}, "type '4d' is unknown; use one of 3d, 6d, revolute"),
    ],
)
def test_a_wrong_folder_says_file_key_and_remedy(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(rg.ModelError, match=message) as raised:
        rg.load(folder(tmp_path, **changed))
    assert str(tmp_path / "robot.yaml") in str(raised.value)
