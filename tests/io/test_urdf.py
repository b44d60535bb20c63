"""URDF to spanning tree: the two traps of the format, and nothing else changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.io.urdf.reader import read_urdf

pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
"""Limits of joints are not what these tests are about."""

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def arm(first: str = "continuous", second: str = "prismatic") -> str:
    """A hinge about z, a slide along x, a frame fixed at its end."""
    return f"""<robot name="arm">
      <link name="world"/>
      <link name="upper"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/><mass value="2"/>
        <inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="0.03" izz="0.3"/></inertial></link>
      <link name="fore"><inertial><mass value="1"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
      <link name="tip"/>
      <joint name="hinge" type="{first}"><parent link="world"/><child link="upper"/>
        <origin xyz="1 2 3" rpy="0.3 0.2 0.1"/><axis xyz="0 0 1"/>
        {"" if first == "continuous" else LIMIT}</joint>
      <joint name="slide" type="{second}"><parent link="upper"/><child link="fore"/>
        <origin xyz="0.5 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/>{LIMIT}</joint>
      <joint name="end" type="fixed"><parent link="fore"/><child link="tip"/>
        <origin xyz="0.7 0 0.1" rpy="0 0 0"/></joint>
    </robot>"""


def test_endless_joints_are_one_number() -> None:
    """Pinocchio alone stores a continuous joint as (cos, sin)."""
    text = arm()
    assert pin.buildModelFromXML(text).nq == 3
    model = read_urdf(text).model
    assert (model.nq, model.nv) == (2, 2)
    assert rg.Mechanism.from_urdf(text).independent == ("hinge", "slide")


def test_full_turns_are_counted() -> None:
    """A rotor pushed by 1 N m for 5 s: φ = t²/2 · τ/I, with I of the whole arm about its axis."""
    rotor = arm().replace('name="slide" type="prismatic"', 'name="slide" type="fixed"')
    mech = rg.Mechanism.from_urdf(rotor.replace('rpy="0.3 0.2 0.1"', 'rpy="0 0 0"'))
    assert mech.nq == 1
    M = float(mech.tree.crba(np.zeros(1))[0, 0])  # constant: one joint, axis along gravity
    traj = rg.simulate(mech, duration=5.0, step=0.1, torque=[4.0])
    assert traj.q[-1, 0] == pytest.approx(0.5 * 4.0 / M * 25.0, rel=1e-12)  # RK4 is exact for t²
    assert traj.q[-1, 0] > 4.0 * np.pi


def test_all_else_is_pinocchios_model() -> None:
    """Compared with the same text in which the joint is a revolute one with limits."""
    model, twin = read_urdf(arm()).model, pin.buildModelFromXML(arm(first="revolute"))
    assert list(model.names) == list(twin.names)
    assert [f.name for f in model.frames] == [f.name for f in twin.frames]
    data, other = model.createData(), twin.createData()
    rng = np.random.default_rng(0)
    for _ in range(3):
        q, v, a = rng.uniform(-9, 9, 2), rng.uniform(-1, 1, 2), rng.uniform(-1, 1, 2)
        np.testing.assert_array_equal(pin.rnea(model, data, q, v, a), pin.rnea(twin, other, q, v, a))
        pin.framesForwardKinematics(model, data, q)
        pin.framesForwardKinematics(twin, other, q)
        for one, two in zip(data.oMf, other.oMf, strict=True):
            np.testing.assert_array_equal(one.homogeneous, two.homogeneous)


def test_limits_are_not_enforced() -> None:
    """The slide's limits are ±1 m; a state beyond them is a state."""
    mech = rg.Mechanism.from_urdf(arm())
    traj = rg.simulate(mech, [0.0, 2.0], [0.0, 3.0], duration=0.1, step=0.01)
    assert traj.q[-1, 1] > 2.0


def test_file_path_and_text_are_the_same(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(arm(), encoding="utf-8")
    from_text = read_urdf("\n  " + arm()).model
    assert read_urdf(path).model == read_urdf(str(path)).model == from_text
    assert path.read_text(encoding="utf-8") == arm()  # the user's file is never written to


def test_xml_declaration_and_comments_may_come_first(tmp_path: Path) -> None:
    text = f'<?xml version="1.0" encoding="utf-8"?>\n<!-- ä comment -->\n{arm()}'
    path = tmp_path / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    assert read_urdf(path).model == read_urdf(text).model
