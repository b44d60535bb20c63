"""MJCF files: the same mechanism as from URDF and from MuJoCo's own reader, or a refusal by name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.linalg import subspace_angles

import robust_gcp as rg
from robust_gcp.io.mjcf.reader import read_mjcf
from robust_gcp.mechanism.contents import FileContents
from robust_gcp.mechanism.loops import ClosedLoops

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]

ROD = '<inertial pos="0 0.5 0" mass="1" diaginertia="0.08333333333333333 1e-12 0.08333333333333333"/>'
BODIES = f"""
<body name="crank"><joint name="q1" axis="1 0 0"/>{ROD}
  <body name="coupler" pos="0 1 0"><joint name="q2" axis="1 0 0"/>{ROD}<site name="c" pos="0 1 0"/></body>
</body>
<body name="rocker" pos="0 1 0"><joint name="q3" axis="1 0 0"/>{ROD}<site name="r" pos="0 1 0"/></body>
"""
CONNECT = '<connect name="tip" body1="coupler" body2="rocker" anchor="0 1 0"/>'
KEY = '<keyframe><key name="start" qpos="0.2 -0.2 0.2"/></keyframe>'


def document(
    bodies: str = BODIES, equality: str = CONNECT, more: str = KEY, compiler: str = 'angle="radian"'
) -> str:
    return (
        f'<mujoco model="rhombus"><compiler {compiler}/><worldbody><geom type="plane" size="1 1 1"/>{bodies}'
        f"</worldbody><equality>{equality}</equality>{more}</mujoco>"
    )


def test_a_site_elsewhere_than_the_body_of_its_name_gets_a_name_of_its_own() -> None:
    """A cord from the ground to a site: its length is MuJoCo's, and the body keeps its name."""
    xml = document().replace('name="r" pos="0 1 0"', 'name="rocker" pos="0 0.7 0"')
    cord = '<tendon><spatial name="cord"><site site="c"/><site site="rocker"/></spatial></tendon>'
    mech = rg.Mechanism.from_mjcf(xml.replace("</mujoco>", f"{cord}</mujoco>"))
    R = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.2), -np.sin(0.2)], [0.0, np.sin(0.2), np.cos(0.2)]])
    run = rg.simulate(mech, mech.keyframes["start"].q, duration=1e-3, step=1e-3)
    np.testing.assert_allclose(run.frame("rocker").position[0], [0.0, 1.0, 0.0], atol=1e-12)
    site = R @ [0.0, 0.7, 0.0] + [0.0, 1.0, 0.0]
    np.testing.assert_allclose(run.frame("rocker_site").position[0], site, atol=1e-12)
    tip = R @ [0.0, 1.0, 0.0] + [0.0, 1.0, 0.0]
    assert run["tendon.cord"][0] == pytest.approx(np.linalg.norm(tip - site), abs=1e-12)


def rhombus(**changed: str) -> rg.Mechanism:
    return rg.Mechanism.from_mjcf(document(**changed), ["q1"], home="start")


# --------------------------------------------------------------------------- the same mechanism


def test_two_bodies_in_the_world_are_both_read(closed_states: States) -> None:
    """Pinocchio's parser alone stops after the first body under <worldbody>."""
    urdf, mjcf = rg.load("rhombus"), rhombus()
    assert mjcf.joint_names == urdf.joint_names
    assert mjcf.closures == (rg.PointClosure("tip_1", "tip_2"),)
    q = np.array([0.3, 0.7, -0.4])
    np.testing.assert_allclose(mjcf.phi(q), urdf.phi(q), atol=1e-15)
    np.testing.assert_allclose(mjcf.K(q), urdf.K(q), atol=1e-15)
    for q, v in closed_states(urdf, 3):
        np.testing.assert_allclose(mjcf.k(q, v), urdf.k(q, v), atol=1e-14)
        accelerations = [rg.implicit_dynamics(m, q, v)[0] for m in (mjcf, urdf)]
        np.testing.assert_allclose(*accelerations, rtol=1e-12, atol=1e-12)


def test_the_motion_is_that_of_the_urdf() -> None:
    ends = [rg.simulate(m, m.home, duration=0.2, step=1e-3).q[-1] for m in (rhombus(), rg.load("rhombus"))]
    np.testing.assert_allclose(*ends, atol=1e-13)


@pytest.mark.parametrize(
    "equality",
    [
        '<connect site1="c" site2="r"/>',
        CONNECT + '<connect name="off" body1="coupler" anchor="0 1 0" active="false"/>',
    ],
)
def test_other_ways_to_write_the_same_loop(equality: str) -> None:
    q = np.array([0.3, 0.7, -0.4])
    np.testing.assert_allclose(rhombus(equality=equality).K(q), rg.load("rhombus").K(q), atol=1e-15)


def test_a_constraint_on_the_world_pins_the_anchor_where_it_is_at_qpos0() -> None:
    parts = read_mjcf(document(equality='<connect body1="rocker" anchor="0 0.5 0"/>'))
    data = parts.model.createData()
    pin.framesForwardKinematics(parts.model, data, parts.home)
    ground = parts.model.frames[parts.model.getFrameId(parts.closures[0].frame2)]
    assert ground.parentJoint == 0
    np.testing.assert_allclose(ground.placement.translation, [0.0, 1.5, 0.0], atol=1e-15)


def test_files_and_folders_load(tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(document(), encoding="utf-8")
    alone = rg.load(file, independent=["q1"])
    (tmp_path / "robot.yaml").write_text(
        "name_mot: [q1]\nrobust_gcp: {home: {q1: 0.2, q2: -0.2, q3: 0.2}}", encoding="utf-8"
    )
    inside = rg.load(tmp_path)
    q = np.array([0.3, 0.7, -0.4])
    for mechanism in (alone, inside):
        np.testing.assert_allclose(mechanism.K(q), rg.load("rhombus").K(q), atol=1e-15)
    assert alone.home.tolist() == [0.2, -0.2, 0.2]  # the keyframe
    assert rg.Mechanism.from_mjcf(file, ["q1"]).home.tolist() == [0.0, 0.0, 0.0]  # qpos0
    assert inside.home.tolist() == [0.2, -0.2, 0.2]


# --------------------------------------------------------------------------- traps


def test_gravity_of_the_file_is_used() -> None:
    option = '<option gravity="1 2 -3"/>'
    assert rhombus(more=KEY + option).model.gravity.linear.tolist() == [1.0, 2.0, -3.0]
    off = '<option><flag gravity="disable"/></option>'
    assert not rhombus(more=KEY + off).model.gravity.linear.any()


def test_springs_and_dampers_of_joints_act() -> None:
    bodies = BODIES.replace('name="q1"', 'name="q1" stiffness="2" springref="30" damping="0.5"')
    forces = rhombus(bodies=bodies, compiler='angle="degree"').forces
    assert forces == (rg.JointSpring("q1", 2.0, np.pi / 6.0), rg.JointDamper("q1", 0.5))


def test_several_joints_of_a_body_stay_apart() -> None:
    joints = '<joint name="x" type="slide" axis="1 0 0"/><joint name="t" axis="0 1 0"/>'
    bodies = f'<body name="b">{joints}{ROD}</body>'
    model = read_mjcf(document(bodies, "", "")).model
    assert list(model.names)[1:] == ["x", "t"]
    assert [i.mass for i in model.inertias] == [0.0, 0.0, 1.0]


def test_a_class_replaces_the_inherited_one_as_a_whole() -> None:
    """`damping` of the childclass does not reach a joint of another class; that of the top class does."""
    classes = (
        '<default><joint armature="0.1"/><default class="a"><joint damping="3"/></default>'
        '<default class="b"><joint axis="1 0 0"/></default></default>'
    )
    bodies = f'<body childclass="a"><joint name="q" class="b"/>{ROD}</body>'
    parts = read_mjcf(document(bodies, "", classes))
    assert parts.forces == []
    assert parts.model.armature.tolist() == [0.1]
    assert parts.model.joints[1].shortname() == "JointModelRX"


def test_bodies_and_joints_without_names_are_all_read() -> None:
    bodies = f"<body><joint/>{ROD}<body><joint/>{ROD}</body><body><joint/>{ROD}</body></body>"
    assert read_mjcf(document(bodies, "", "")).model.nv == 3


EVERYTHING = """<mujoco model="everything"><compiler angle="degree" eulerseq="zYx"/>
<option gravity="0.5 -1 -3"><flag contact="disable"/></option>
<default><joint armature="0.01"/><geom density="500"/>
  <default class="a"><joint axis="1 0 0"/><default class="b"><joint ref="20"/></default></default>
  <default class="c"><geom type="capsule" size="0.05 0.3"/></default></default>
<worldbody><site name="ws" pos="1 2 3" axisangle="1 1 0 40"/>
  <body name="base" pos="0 1 0.3" euler="10 20 30">
    <joint name="x" type="slide" ref="0.2"/><joint name="y" axis="0 1 0" pos="0.1 0.2 0.3" ref="15"/>
    <inertial pos="0.1 0.2 0.3" mass="2" diaginertia="0.1 0.2 0.25" quat="1 2 3 4"/>
    <body childclass="a" name="arm" pos="0 0 1" xyaxes="1 1 0 -1 1 0.3"><joint class="b" name="j"/>
      <geom class="c"/><geom type="box" size="0.1 0.2 0.3" pos="1 0 0" euler="10 20 30" mass="1.5"/>
      <body name="fixed" pos="0.2 0 0" zaxis="1 2 3"><geom type="cylinder" size="0.1 0.2"/>
        <site name="s" pos="0.1 0.1 0.1" euler="20 30 40"/>
        <body name="top" pos="0 0 0.3"><joint type="ball" name="ball" pos="0 0 0.05"/>
          <geom type="ellipsoid" size="0.1 0.2 0.3"/>
          <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0.4 0.5"/></body></body></body>
    <body name="arm2" pos="0 0.5 0"><joint/><geom size="0.2"/></body></body>
  <body name="fly" pos="1 2 3" euler="40 50 60"><freejoint name="root"/>
    <geom type="box" size="0.1 0.2 0.3" contype="0" conaffinity="0"/>
    <body name="tail" pos="0 0 0.4"><joint axis="1 2 3" armature="0.5"/>
      <geom size="0.1" pos="0.2 0 0"/></body></body></worldbody>
<equality><connect name="z" body1="arm" body2="fly" anchor="0.1 0.2 0.3"/>
  <connect body1="arm2" anchor="0.1 0.2 0.3"/><connect body1="arm2" anchor="1 0.2 0.3" active="false"/>
  <weld name="a" body1="tail" body2="fixed" relpose="0.1 0.2 0.3 1 0.2 0.3 0.4" anchor="0.3 0.2 0.1"/>
  <weld site1="s" site2="ws"/><weld body1="arm2" body2="tail"/><connect site1="s" site2="ws"/></equality>
<keyframe><key name="k" qpos="0.1 0.2 0.3 1 0 0 0 0.5 1 2 3 0 1 0 0 0.2"/></keyframe></mujoco>"""


@pytest.fixture(scope="module")
def both() -> tuple[Any, FileContents]:
    """MuJoCo's model, and ours."""
    return mujoco.MjModel.from_xml_string(EVERYTHING), read_mjcf(EVERYTHING)


def mujoco_order(model: pin.Model, q: Array) -> Array:
    """Quaternions with their scalar first."""
    q = q.copy()
    for joint in list(model.joints)[1:]:
        if joint.nq in (4, 7):
            end = joint.idx_q + joint.nq
            q[end - 4 : end] = np.roll(q[end - 4 : end], 1)
    return q


def test_configurations_are_those_of_mujoco(both: tuple[Any, FileContents]) -> None:
    theirs, ours = both
    np.testing.assert_allclose(mujoco_order(ours.model, ours.home), theirs.qpos0, atol=1e-15)
    key = mujoco_order(ours.model, ours.keyframes["k"])
    np.testing.assert_allclose(key, theirs.key_qpos[0], atol=1e-15)


def test_poses_masses_and_loops_are_those_of_mujoco(both: tuple[Any, FileContents]) -> None:
    """At random configurations: body poses, gravity's torques, K of every closure's position rows."""
    theirs, ours = both
    model, rng = ours.model, np.random.default_rng(0)
    data, state = model.createData(), mujoco.MjData(theirs)
    names = ["base", "arm", "fixed", "top", "arm2", "fly", "tail"]
    free = model.joints[model.getJointId("root")]
    for _ in range(3):
        q = pin.integrate(model, ours.home, rng.uniform(-1.0, 1.0, model.nv))
        pin.framesForwardKinematics(model, data, q)
        state.qpos[:] = mujoco_order(model, q)
        mujoco.mj_forward(theirs, state)
        for name in names:
            pose = data.oMf[model.getFrameId(name, pin.FrameType.BODY)]
            np.testing.assert_allclose(pose.translation, state.body(name).xpos, atol=1e-13)
            np.testing.assert_allclose(pose.rotation.ravel(), state.body(name).xmat, atol=1e-13)
        # a free body's linear velocity is in world axes there, in its own here
        turn = np.eye(model.nv)
        linear = slice(free.idx_v, free.idx_v + 3)
        turn[linear, linear] = data.oMi[free.id].rotation
        weight = pin.computeGeneralizedGravity(model, model.createData(), q)
        np.testing.assert_allclose(turn.T @ state.qfrc_bias, weight, atol=1e-11)
        M = np.zeros((model.nv, model.nv))
        for column, direction in zip(M, turn.T, strict=True):
            mujoco.mj_mulM(theirs, state, column, direction.copy())
        np.testing.assert_allclose(M @ turn, crba(model, q), atol=1e-11)
        loops = ClosedLoops(model, ours.closures)
        phi, K = loops.phi(q), loops.K(q)
        J = state.efc_J.reshape(-1, model.nv) @ turn
        row = 0
        for index, closure in zip(np.flatnonzero(state.eq_active), ours.closures, strict=True):
            size = 3 if closure.kind == "3d" else 6
            rows = np.flatnonzero(state.efc_id == index)
            np.testing.assert_allclose(phi[row : row + 3], state.efc_pos[rows[:3]], atol=1e-13)
            np.testing.assert_allclose(K[row : row + 3], J[rows[:3]], atol=1e-13)
            if size == 6:  # they weigh rotations otherwise: the same row space
                assert subspace_angles(K[row : row + 6].T, J[rows].T).max() < 1e-12
            row += size
        assert row == loops.nc


def crba(model: pin.Model, q: Array) -> Array:
    """M(q), both halves."""
    M = pin.crba(model, model.createData(), q)
    return np.triu(M) + np.triu(M, 1).T


# --------------------------------------------------------------------------- refusals

REFUSED = [
    ({"more": "<wind/>"}, r"MuJoCo cannot compile it .*unrecognized element Element 'wind'"),
    ({"more": '<include file="a.xml"/>'}, r"<include file='a.xml'> cannot be read: this is text"),
    ({"equality": '<joint name="e" joint1="q7"/>'}, r"unknown element 'q7' in equality"),
    ({"equality": '<tendon name="e" tendon1="t"/>'}, r"unknown element 't' in equality"),
    ({"equality": '<connect body1="coupler" body2="roker" anchor="0 0 0"/>'}, r"unknown element 'roker'"),
    ({"equality": '<connect site1="c" site2="q"/>'}, r"unknown element 'q'"),
    ({"equality": '<connect body1="coupler"/>'}, r"\('body1', 'anchor'\) must be specified"),
    ({"bodies": f"<replicate>{BODIES}</replicate>"}, r"required attribute missing: 'count'"),
    (
        {"bodies": f'<replicate count="1e9">{BODIES}</replicate>'},
        r"as large as 6.*e\+09 bodies and joints, more than",
    ),
    ({"bodies": f"<composite>{BODIES}</composite>"}, r"unrecognized element Element 'composite'"),
    ({"bodies": BODIES.replace('axis="1 0 0"', 'axis="0 0 0"')}, r"axis too small in joint.*'q1'"),
    (
        {"bodies": BODIES.replace('axis="1 0 0"', 'axis="nan 0 0"')},
        r"<joint> axis='nan 0 0' has a number that is none",
    ),
    ({"bodies": BODIES.replace('pos="0 1 0"', 'pos="0 inf 0"')}, r"not finite"),
    ({"bodies": BODIES.replace('name="q1"', 'name="q1" class="z"')}, r"unknown default class name 'z'"),
    (
        {"bodies": '<body name="m"><joint/><geom type="box" size="1 1"/></body>', "equality": "", "more": ""},
        r"size 2 must be positive",
    ),
    (
        {"bodies": BODIES.replace("1e-12", "0")},
        r"larger than mjMINVAL.*'crank'.*write 1e-12 in place of zero",
    ),
    ({"compiler": 'coordinate="global"'}, r"global coordinates no longer supported"),
    ({"bodies": BODIES.replace('axis="1 0 0"', 'damping="x"')}, r"bad format in attribute 'damping'"),
    ({"bodies": ROD.join(["<body>", "</body>"]), "equality": "", "more": ""}, r"no body has a joint"),
    ({"equality": '<connect name="e" body1="coupler" anchor=" "/>'}, r"<connect> 'e': its anchor is empty"),
    ({"bodies": BODIES.replace("rocker", "a%s%n")}, r"<body> name='a%s%n' has a per cent sign"),
    ({"bodies": BODIES.replace("rocker", "crank")}, r"repeated name 'crank' in body"),
    (
        {"compiler": 'eulerseq="abc"', "bodies": f'<body euler="1 2 3"><joint/>{ROD}</body>'},
        r"euler sequence",
    ),
    ({"more": '<keyframe><key name="k" qpos="1 2 3 4"/></keyframe>'}, r"keyframe 'k': invalid qpos size"),
    (
        {"bodies": BODIES + '<flexcomp name="f" type="grid" count="90 90 90"/>'},
        r"as large as 2.*e\+06 bodies",
    ),
    (
        {"more": '<actuator><general joint="q1" dyntype="user" actdim="2000000000"/></actuator>'},
        r"asks for actdim=.*write less",
    ),
    (
        {"more": '<asset><mesh name="m" builtin="supersphere" params="100000 1 1"/></asset>'},
        r"<mesh> 'm' asks for params=",
    ),
]
MESH = '<asset><mesh name="a" file="a.stl"/></asset>'
FLEXIBLE = """<mujoco><worldbody><flexcomp name="f" type="grid" count="3 1 1" spacing="1 1 1" radius="0.1"
dim="1" mass="1"><edge equality="true"/></flexcomp></worldbody></mujoco>"""


def test_equalities_of_flexible_parts_are_refused_by_name() -> None:
    with pytest.raises(rg.ModelError, match=r"equality <flex> '.*' cannot be read; only connect, weld"):
        read_mjcf(FLEXIBLE)
    parts = read_mjcf(FLEXIBLE.replace('<edge equality="true"/>', ""))
    assert parts.model.nv == 9
    assert "deformables (f)" in parts.left_out


@pytest.mark.parametrize(("changed", "message"), REFUSED)
def test_what_would_be_lost_is_refused_by_name(changed: dict[str, str], message: str) -> None:
    with pytest.raises(rg.ModelError, match=message):
        read_mjcf(document(**changed))


def test_faults_of_the_file_itself(tmp_path: Path) -> None:
    with pytest.raises(rg.ModelError, match=r"absent\.xml: cannot be read"):
        rg.load(tmp_path / "absent.xml")
    with pytest.raises(rg.ModelError, match=r"not well-formed XML"):
        read_mjcf("<mujoco>")
    with pytest.raises(rg.ModelError, match=r"<robot>, a MJCF file starts with <mujoco>"):
        read_mjcf("<robot/>")
    with pytest.raises(rg.ModelError, match=r"no keyframe 'strat'; did you mean 'start'"):
        rg.Mechanism.from_mjcf(document(), ["q1"], home="strat")


def test_joint_lists_are_for_urdf(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(document(), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(
        "{name_mot: [q1], joint_name: [q2], joint_type: [SPHERICAL]}", encoding="utf-8"
    )
    with pytest.raises(rg.ModelError, match=r"joint_name is for URDF"):
        rg.load(tmp_path)


# --------------------------------------------------------------------------- files that nobody vouches for


def test_attached_models_are_read_from_the_folder_alone(tmp_path: Path) -> None:
    """With their defaults, loops and names; what MuJoCo would find outside is not read."""
    folder = tmp_path / "model"
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / "r.xml").write_text(document(f'<body name="b">{BODIES}</body>'), encoding="utf-8")
    text = """<mujoco><asset><model name="r" file="FILE"/></asset><worldbody><frame pos="0 0 1">
    <attach model="r" body="b" prefix="p_"/></frame></worldbody></mujoco>"""
    file = folder / "robot.xml"
    file.write_text(text.replace("FILE", "parts/r.xml"), encoding="utf-8")
    (tmp_path / "r.xml").write_text((folder / "parts" / "r.xml").read_text(), encoding="utf-8")
    parts, theirs = read_mjcf(file), mujoco.MjModel.from_xml_path(str(file))
    assert list(parts.model.names)[1:] == ["p_q1", "p_q2", "p_q3"]
    assert len(parts.closures) == theirs.neq == 1
    np.testing.assert_allclose(parts.keyframes["p_start"], theirs.key_qpos[0])
    lost = (folder / "parts" / "r.xml").read_text().replace("<worldbody>", MESH + "<worldbody>")
    lost = lost.replace('<site name="r"', '<geom type="mesh" mesh="a"/><site name="r"').replace(ROD, "")
    (folder / "parts" / "r.xml").write_text(
        lost.replace("<joint", "<geom size='1'/><joint"), encoding="utf-8"
    )
    with pytest.raises(rg.ModelError, match=r"mass of 'p_rocker' comes from meshes .*'a' \(there is no such"):
        read_mjcf(file)
    for outside in ("../r.xml", str(tmp_path / "r.xml")):
        file.write_text(text.replace("FILE", outside), encoding="utf-8")
        with pytest.raises(
            rg.ModelError, match=r"<model file=.*r.xml'> cannot be read: it is outside the folder"
        ):
            read_mjcf(file)
        assert read_mjcf(file, root=tmp_path).model.nv == 3
    file.write_text(text.replace("FILE", "robot.xml"), encoding="utf-8")
    with pytest.raises(rg.ModelError, match="more than 100 files"):
        read_mjcf(file)


@pytest.mark.parametrize(
    "outside",
    [
        '<include file="../secret"/>',
        '<asset><model file="../secret"/></asset>',
        '<worldbody><flexcomp name="f" type="mesh" file="../secret"/></worldbody>',
        '<worldbody><body><include file="link"/></body></worldbody>',
    ],
)
def test_paths_out_of_the_folder_are_refused(outside: str, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(document(), encoding="utf-8")
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "robot.xml").write_text(document(more=outside), encoding="utf-8")
    with pytest.raises(rg.ModelError, match=r"cannot be read: it is outside the folder .*root="):
        read_mjcf(folder / "robot.xml")


def test_included_files_may_name_others(tmp_path: Path) -> None:
    """From the main file's folder, else from their own, as MuJoCo has it; each once."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "bodies.xml").write_text(
        '<mujoco><worldbody><include file="b.xml"/></worldbody></mujoco>', encoding="utf-8"
    )
    (tmp_path / "sub" / "b.xml").write_text(f"<mujocoinclude>{BODIES}</mujocoinclude>", encoding="utf-8")
    file = tmp_path / "robot.xml"
    file.write_text(document("", more='<include file="sub/bodies.xml"/>'), encoding="utf-8")
    assert list(read_mjcf(file).model.names)[1:] == ["q1", "q2", "q3"]
    (tmp_path / "b.xml").write_text(
        f"<mujocoinclude><body><joint/>{ROD}</body></mujocoinclude>", encoding="utf-8"
    )
    with pytest.raises(rg.ModelError, match="unknown element 'coupler'"):
        read_mjcf(file)
    file.write_text(document(more='<include file="b.xml"/><include file="b.xml"/>'), encoding="utf-8")
    with pytest.raises(rg.ModelError, match=r"<include file='b.xml'> is there twice"):
        read_mjcf(file)


def test_mujoco_prints_nothing_and_writes_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its warnings go elsewhere while a file is read; whoever takes them otherwise still does."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(rg.ModelError, match="NaN"):
        read_mjcf(document(BODIES.replace('pos="0 1 0"', 'pos="0 nan(1) 0"')))
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() is None


def test_muscles_do_not_keep_a_file_from_being_read() -> None:
    """MuJoCo simulates how far a muscle goes, which may not converge, or never end."""
    parts = read_mjcf(document(more='<actuator><muscle name="m" joint="q1"/></actuator>'))
    assert parts.actuated == ("q1",)
    assert "actuators (m)" in parts.left_out


def test_without_mujoco_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        rg.MissingExtraError, match=r"MJCF is compiled by MuJoCo.*pip install mujoco.*\[mjcf\]"
    ):
        read_mjcf(document())
