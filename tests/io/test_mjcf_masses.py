"""Masses, springs and switches of MJCF: compiled as MuJoCo does it, what is left out told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf

GEOMS = """
<geom type="box" size="0.1 0.2 0.3" pos="0.1 0.2 0.3" euler="10 20 30"/>
<geom type="box" size="0.05 0.7" fromto="0 0 0 0.3 0.1 -0.5" density="300"/>
<geom type="ellipsoid" size="0.04 0.1 0.2" pos="-0.2 0 0" mass="0.7"/>
<geom type="ellipsoid" size="0.04" fromto="0.1 0 0 0.3 0.1 0.5"/>
<geom type="capsule" size="0.05 0.2" pos="0 0.3 0" zaxis="1 2 3"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0.3 0.4 0.5"/>
<geom type="cylinder" size="0.05 0.2" quat="1 2 3 4"/>
<geom type="cylinder" size="0.03" fromto="0 0 0 -0.3 0.4 0.5"/>
<geom size="0.07" pos="0 0 1"/><geom size="0.4" mass="0"/><geom size="0.4" group="4"/>
"""
DOCUMENT = f"""<mujoco><compiler angle="degree" {{compiler}}/><option {{option}}>{{flags}}</option><worldbody>
<geom type="plane" size="1 1 1"/><body name="stand" pos="0 0 1"><geom size="0.2"/>
  <body name="arm" {{arm}}><joint name="j" axis="0 1 0" {{joint}}/>{GEOMS}
    <body name="plate" pos="0 0 1"><joint name="k" axis="1 0 0" armature="0.2"/>
      <inertial pos="0.1 0 0" quat="1 2 3 4" mass="0.5" diaginertia="0.01 0.011 0.05"/>
      <body name="knob" pos="0 1 0"><joint name="l" type="slide" axis="1 1 0"/>
        <inertial pos="0 0 0.2" mass="0.4" fullinertia="0.02 0.03 0.025 0.001 -0.002 0.003"/></body>
    </body></body></body></worldbody>
<equality><joint joint1="j" joint2="k" polycoef="0 2 0 0 0"/></equality></mujoco>"""


def document(**given: str) -> str:
    return DOCUMENT.format_map({"compiler": "", "option": "", "flags": "", "arm": "", "joint": ""} | given)


BALANCED = 'balanceinertia="true"'


@pytest.mark.parametrize(
    "compiler",
    [
        BALANCED,
        f'{BALANCED} boundmass="20"',
        f'{BALANCED} boundinertia="0.03"',
        f'{BALANCED} boundmass="0.45" boundinertia="0.02" settotalmass="14"',
        f'{BALANCED} inertiafromgeom="false" settotalmass="3"',
        f'{BALANCED} inertiafromgeom="true"',
        f'{BALANCED} inertiafromgeom="true" inertiagrouprange="4 4" settotalmass="3"',
        f'{BALANCED} inertiagrouprange="4 4" boundmass="0.1" boundinertia="0.01"',
    ],
)
def test_masses_are_those_that_mujoco_compiles(
    compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """M and gravity's torques at random configurations."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log of what it deprecates
    if "inertiafromgeom" in compiler:  # the arm's own mass is then zero there too
        compiler += ' boundmass="0.2" boundinertia="0.01"'
    theirs = mujoco.MjModel.from_xml_string(document(compiler=compiler))
    ours, state, rng = read_mjcf(document(compiler=compiler)), mujoco.MjData(theirs), np.random.default_rng(0)
    for _ in range(3):
        q = rng.uniform(-1.0, 1.0, 3)
        state.qpos[:] = q
        mujoco.mj_forward(theirs, state)
        M = np.zeros((3, 3))
        for column, direction in zip(M, np.eye(3), strict=True):
            mujoco.mj_mulM(theirs, state, column, direction.copy())
        found = pin.crba(ours.model, ours.model.createData(), q)
        np.testing.assert_allclose(np.triu(found) + np.triu(found, 1).T, M, rtol=1e-12, atol=1e-13)
        weight = pin.computeGeneralizedGravity(ours.model, ours.model.createData(), q)
        np.testing.assert_allclose(weight, state.qfrc_bias, rtol=1e-12, atol=1e-12)


def test_bounds_of_bodies_that_nothing_weighs() -> None:
    """MuJoCo has their centre at their own `pos`, in their own axes, whatever frame they are in."""
    text = """<mujoco><compiler boundmass="0.5" boundinertia="0.01"/><worldbody>
      <body name="a" pos="0 0 1"><joint name="j" axis="0 1 0"/><geom size="0.1"/>
        <frame pos="1 2 3" euler="10 20 30">
          <body name="b" pos="0.1 0.2 0.3" euler="40 0 0"><joint name="k" axis="1 0 0"/>
            <body name="c"><joint name="l" axis="0 0 1"/></body></body></frame></body></worldbody></mujoco>"""
    theirs, ours = mujoco.MjModel.from_xml_string(text), read_mjcf(text).model
    for i in (2, 3):
        np.testing.assert_allclose(ours.inertias[i].lever, theirs.body_ipos[i], rtol=0.0, atol=1e-14)
        assert ours.inertias[i].mass == theirs.body_mass[i] == 0.5


def test_springs_given_by_time_and_damping_ratio_are_those_of_mujoco() -> None:
    text = document(
        compiler=BALANCED, joint='springdamper="0.1 0.5" springref="20" stiffness="7" damping="3"'
    )
    theirs = mujoco.MjModel.from_xml_string(text)
    spring, damper = read_mjcf(text).forces
    assert isinstance(spring, rg.JointSpring)
    assert isinstance(damper, rg.JointDamper)
    np.testing.assert_allclose(spring.stiffness, theirs.jnt_stiffness[0], rtol=1e-12)
    np.testing.assert_allclose(spring.rest, theirs.qpos_spring[0], rtol=1e-12)
    np.testing.assert_allclose(damper.damping, theirs.dof_damping[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("switch", "closures", "forces"),
    [
        ("", 1, ["JointSpring", "JointDamper"]),
        ("equality", 0, ["JointSpring", "JointDamper"]),
        ("constraint", 0, ["JointSpring", "JointDamper"]),
        ("spring", 1, ["JointDamper"]),
        ("damper", 1, ["JointSpring"]),
        ("contact", 1, ["JointSpring", "JointDamper"]),
    ],
)
def test_what_the_options_switch_off_is_not_there(switch: str, closures: int, forces: list[str]) -> None:
    flags = f'<flag {switch}="disable"/>' if switch else ""
    parts = read_mjcf(document(compiler=BALANCED, flags=flags, joint='stiffness="7" damping="3"'))
    assert len(parts.closures) == closures
    assert [type(force).__name__ for force in parts.forces] == forces


MESH = '<geom type="mesh" mesh="a"/>'
LEFT_OUT: list[tuple[dict[str, Any], str]] = [
    ({"option": 'density="1.2" viscosity="0.1"'}, "drag of a medium (density, viscosity)"),
    ({"arm": 'gravcomp="-1"'}, "gravity compensation of bodies (arm)"),
    ({"joint": 'frictionloss="1"'}, "dry friction of joints (j)"),
    ({"joint": 'range="-1 1"'}, "limits of joints (j)"),
    ({"joint": 'stiffness="1 2"'}, "nonlinear parts of springs and dampers (j)"),
    ({"joint": 'damping="0 0 2"'}, "nonlinear parts of springs and dampers (j)"),
]


@pytest.mark.parametrize(("given", "entry"), LEFT_OUT)
def test_what_is_left_out_is_told(given: dict[str, Any], entry: str) -> None:
    assert entry in read_mjcf(document(compiler=BALANCED, **given)).left_out


ASSET = '<asset><mesh name="a" file="a.obj"/></asset>'
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BARE = f"""<mujoco>{ASSET}<option><flag contact='disable'/></option>
<worldbody><body name='b'><joint name='j'/>{MESH}</body></worldbody></mujoco>"""


def test_masses_of_meshes_that_are_absent_are_told_or_refused() -> None:
    """A body that has other mass keeps that; one that has none is refused by name."""
    text = document(compiler=BALANCED)
    parts = read_mjcf(
        text.replace('<geom size="0.07"', f'{MESH}<geom size="0.07"').replace(
            "<worldbody>", ASSET + "<worldbody>"
        )
    )
    assert "masses of meshes on bodies (arm)" in parts.left_out
    assert parts.model.inertias[1].mass == pytest.approx(read_mjcf(text).model.inertias[1].mass, rel=1e-14)
    with pytest.raises(rg.ModelError, match=r"mass of 'b' comes from meshes .*'a' \(this is text.*root="):
        read_mjcf(BARE)
    with pytest.raises(rg.ModelError, match=r"mass of 'b' comes from meshes"):
        read_mjcf(BARE.replace("<asset>", "<compiler settotalmass='3'/><asset>"))


def test_masses_of_meshes_are_those_that_mujoco_computes(tmp_path: Path) -> None:
    """Beside the file, in its `meshdir`, beside an included file, or in a folder that is named by root=."""
    assets, elsewhere = tmp_path / "model" / "assets", tmp_path / "elsewhere"
    for folder in (assets, elsewhere):
        folder.mkdir(parents=True)
        (folder / "a.obj").write_text(TETRAHEDRON, encoding="utf-8")
    file = assets.parent / "robot.xml"
    part = BARE.replace(ASSET, "").replace("<mujoco>", '<mujoco><include file="assets/meshes.xml"/>')
    (assets / "meshes.xml").write_text(f"<mujoco>{ASSET}</mujoco>", encoding="utf-8")
    for text in (
        BARE.replace("<asset>", '<compiler meshdir="assets"/><asset>'),
        BARE.replace("<asset>", '<compiler assetdir="assets"/><asset>'),
        BARE.replace("a.obj", "assets/a.obj"),
        part,
    ):
        file.write_text(text, encoding="utf-8")
        theirs = mujoco.MjModel.from_xml_path(str(file))
        assert read_mjcf(file).model.inertias[1].mass == pytest.approx(theirs.body_mass[1], rel=1e-14)
        assert theirs.body_mass[1] == pytest.approx(1000.0 / 6.0)
    file.write_text(BARE.replace("a.obj", "../elsewhere/a.obj"), encoding="utf-8")
    with pytest.raises(rg.ModelError, match=r"'a' \(it is outside the folder"):
        rg.load(file)
    assert rg.load(file, root=elsewhere).model.inertias[1].mass == pytest.approx(1000.0 / 6.0)


def test_meshes_that_no_mass_needs_are_not_opened(tmp_path: Path) -> None:
    """Nor heights and pictures; what is beside the file may be anything."""
    file = tmp_path / "robot.xml"
    given = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    assets = """<mesh name="a" file="a.obj"/><mesh file="robot.xml.stl"/>
    <hfield name="h" file="h.png" size="1 1 1 1"/><texture name="t" type="2d" file="t.png"/>
    <material name="m" texture="t"/><skin file="s.skn"/>"""
    text = BARE.replace(ASSET, f"<asset>{assets}</asset>").replace(
        MESH, given + MESH.replace("/>", ' material="m"/>')
    )
    text = text.replace("<worldbody>", '<worldbody><geom type="hfield" hfield="h"/>')
    text = text.replace("<worldbody>", f'<worldbody><body mocap="true">{MESH}</body><body>{MESH}</body>')
    for content in (None, b"", b"no mesh"):
        for name in ("a.obj", "robot.xml.stl", "h.png", "t.png", "s.skn"):
            if content is not None:
                (tmp_path / name).write_bytes(content)
        file.write_text(text, encoding="utf-8")
        assert read_mjcf(file).model.inertias[1].mass == 1.0
        assert read_mjcf(file).left_out == ["motion of mocap bodies (body)"]


def test_bodies_that_a_user_moves_stand_still() -> None:
    held = """<mujoco><worldbody><body name="hand" mocap="true" pos="0 0 1"/>
    <body name="ball" pos="0 0 1"><joint name="s" type="ball" stiffness="2"/><geom size="0.1"/></body>
    <body name="free"><freejoint name="f"/><geom size="0.1"/></body></worldbody>
    <equality><connect body1="free" body2="hand" anchor="0.5 0 0"/></equality></mujoco>"""
    parts = read_mjcf(held)
    assert parts.model.njoints == 3
    assert "motion of mocap bodies (hand)" in parts.left_out
    assert [type(force).__name__ for force in parts.forces] == ["BallSpring"]
    assert len(parts.closures) == 1
