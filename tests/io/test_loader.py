"""Model folders: the shipped ones, and what a folder may say."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import yaml

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.io.loader import models_folder

LENGTHS = {  # l0, l1, l2, l3 in m
    "rhombus": (1.0, 1.0, 1.0, 1.0),
    "parallelogram": (1.0, 2.0, 1.0, 2.0),
    "crank_rocker": (4.0, 1.0, 3.5, 3.0),
    "change_point": (4.0, 2.0, 3.0, 3.0),
    "kite": (2.0, 2.0, 1.0, 1.0),
}


def test_names_of_the_shipped_models() -> None:
    assert set(LENGTHS) <= set(rg.model_names())
    assert rg.model_names() == sorted(rg.model_names())


@pytest.mark.parametrize("name", LENGTHS)
def test_shipped_models_are_slender_rods_of_1_kg(name: str) -> None:
    """The same M, forces and energies as the linkage made from its lengths alone; gravity 9.81 down."""
    mech, rods = rg.load(name), linkages.four_bar(*LENGTHS[name], y=0.5)
    assert mech.name == name
    assert mech.joint_names == ("q1", "q2", "q3")
    assert mech.independent == ("q1",)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v, a = rng.uniform(-7, 7, 3), rng.uniform(-2, 2, 3), rng.uniform(-9, 9, 3)
        np.testing.assert_allclose(mech.tree.crba(q), rods.tree.crba(q), atol=1e-13)
        np.testing.assert_allclose(mech.tree.rnea(q, v, a), rods.tree.rnea(q, v, a), atol=1e-12)
        np.testing.assert_allclose(mech.tree.energies(q, v), rods.tree.energies(q, v), atol=1e-12)
    height = mech.tree.energies(np.array([0.5 * np.pi, 0.0, 0.5 * np.pi]), np.zeros(3))[1]
    _, l1, l2, l3 = LENGTHS[name]  # all upright: centres at l1/2, l1 + l2/2, l3/2
    assert height == pytest.approx(9.81 * (0.5 * l1 + l1 + 0.5 * l2 + 0.5 * l3), rel=1e-12)


@pytest.mark.parametrize("name", LENGTHS)
def test_homes_are_closed_and_regular(name: str) -> None:
    mech = rg.load(name)
    assert np.abs(mech.phi(mech.home)).max() <= 1e-14 * sum(LENGTHS[name])
    assert rg.analyse(mech, mech.home).kind == "regular"


def test_every_shipped_folder_travels_with_the_package() -> None:
    for name in rg.model_names():
        assert {p.name for p in (models_folder() / name).iterdir()} >= {"robot.urdf", "robot.yaml"}


# --------------------------------------------------------------------------- folders of one's own


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the crank-rocker to write in."""
    own = tmp_path / "mine"
    own.mkdir()
    for file in (models_folder() / "crank_rocker").iterdir():
        (own / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    return own


def rewrite(folder: Path, **changes: object) -> None:
    path = folder / "robot.yaml"
    settings = yaml.safe_load(path.read_text(encoding="utf-8")) | changes
    kept = {key: value for key, value in settings.items() if value is not None}
    path.write_text(yaml.safe_dump(kept), encoding="utf-8")


def test_a_folder_by_path(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for where in (folder, str(folder)):
        mech = rg.load(where)
        assert mech.name == "mine"
        np.testing.assert_array_equal(mech.home, rg.load("crank_rocker").home)
    monkeypatch.chdir(folder.parent)
    assert rg.load("mine").name == "mine"
    assert rg.load(f".{os.sep}mine").name == "mine"


def test_a_folder_of_the_parallel_robot_community(folder: Path) -> None:
    """closed_loop, type and name_mot alone: home is closed from Pinocchio's neutral configuration."""
    rewrite(folder, robust_gcp=None, type=["3D"])
    mech = rg.load(folder)
    assert mech.closures == (rg.PointClosure("coupler_tip", "rocker_tip"),)
    assert mech.closure_residual(mech.home) < 1e-12
    assert mech.independent == ("q1",)
    assert np.abs(mech.phi(mech.assemble([1.0, 0.0, 1.5]))).max() < 1e-12


def test_kinds_of_closures_by_name(folder: Path) -> None:
    rewrite(folder, type=["revolute"], robust_gcp={"axes": [[1, 0, 0]]})
    mech = rg.load(folder)
    assert mech.closures == (rg.RevoluteClosure("coupler_tip", "rocker_tip", (1.0, 0.0, 0.0)),)
    assert mech.nc == 2  # in the plane
    rewrite(folder, robust_gcp=None)
    with pytest.raises(rg.ClosureError, match=r"rad"):  # z, the axis when left out, must not tilt about x
        rg.load(folder)
    rewrite(folder, type=["6d"], name_mot=[], robust_gcp=None)
    # welded, coupler and rocker are a bar of 0.5 m, which crank and ground of 1 and 4 m do not span
    with pytest.raises(
        rg.ClosureError, match=r"robot.yaml: home: the loop coupler_tip – rocker_tip is open by"
    ):
        rg.load(folder)


def test_home_is_polished_to_rounding(folder: Path) -> None:
    """Six digits typed leave the loop open by 1e-6 m; the independent joint stays as typed."""
    q = rg.load("crank_rocker").home
    home = {"q1": 1.0, "q2": round(float(q[1]), 6), "q3": round(float(q[2]), 6)}
    rewrite(folder, robust_gcp={"schema": 1, "home": home})
    mech = rg.load(folder)
    assert np.abs(mech.phi(mech.home)).max() < 1e-14 * 11.5  # the sum of the lengths
    assert mech.home[0] == 1.0
    np.testing.assert_allclose(mech.home, q, atol=1e-6)


def test_a_tree_needs_no_yaml_keys(folder: Path) -> None:
    rewrite(folder, closed_loop=None, type=None, name_mot=None, robust_gcp={"home": {"q2": 0.5}})
    mech = rg.load(folder)
    assert (mech.m, mech.nc) == (3, 0)
    np.testing.assert_array_equal(mech.home, [0.0, 0.5, 0.0])  # joints that are not named stay neutral


SPATIAL = """<robot name="held">
  <link name="world"/>
  <link name="body"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="free" type="floating"><parent link="world"/><child link="body"/></joint>
  <joint name="hinge" type="continuous"><parent link="world"/><child link="arm"/>
    <origin xyz="1 2 3"/><axis xyz="0 0 1"/></joint>
</robot>"""


def test_home_of_a_joint_with_several_numbers(tmp_path: Path) -> None:
    """A free body held by an arm: position and quaternion (x, y, z, w) as one list."""
    (tmp_path / "robot.urdf").write_text(SPATIAL, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(
        "closed_loop: [[body, arm]]\ntype: [6d]\nname_mot: [hinge]\n"
        "robust_gcp: {home: {free: [1, 2, 3, 0, 0, 0.6, 0.8], hinge: 1.2870022175866}}\n",
        encoding="utf-8",
    )
    mech = rg.load(tmp_path)  # 2 atan(0.6/0.8) = 1.2870022175866 rad about z
    np.testing.assert_allclose(mech.home[:7], [1, 2, 3, 0, 0, 0.6, 0.8], atol=1e-12)
    assert np.abs(mech.phi(mech.home)).max() < 1e-14


def test_the_robots_file_beside_robot_yaml_may_have_a_name_of_its_own(tmp_path: Path) -> None:
    """As exporters call it; where there are several, one must be called robot."""
    shipped = models_folder() / "crank_rocker"
    (tmp_path / "robot.yaml").write_bytes((shipped / "robot.yaml").read_bytes())
    with pytest.raises(rg.ModelError, match=r"robot\.yaml needs robot\.urdf or robot\.xml"):
        rg.load(tmp_path)
    (tmp_path / "mine.urdf").write_bytes((shipped / "robot.urdf").read_bytes())
    assert rg.load(tmp_path).joint_names == rg.load("crank_rocker").joint_names
    (tmp_path / "other.urdf").write_text("<robot/>", encoding="utf-8")
    with pytest.raises(rg.ModelError, match=r"beside mine\.urdf, other\.urdf: call the one"):
        rg.load(tmp_path)
    (tmp_path / "robot.urdf").write_bytes((shipped / "robot.urdf").read_bytes())
    assert rg.load(tmp_path).m == 1
