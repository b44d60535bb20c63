"""URDF beyond trees: loops and couplings of several dialects, bases, and what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.io.urdf.reader import read_urdf

from ..decompositions import turn_decompositions

ROD = """<inertial><origin xyz="0 0.5 0"/><mass value="1"/>
  <inertia ixx="0.0833" ixy="0" ixz="0" iyy="0" iyz="0" izz="0.0833"/></inertial>"""


def joint(name: str, parent: str, child: str, xyz: str = "0 0 0", more: str = "", mark: str = "") -> str:
    return (
        f'<joint name="{name}" type="revolute" {mark}><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="1 0 0"/>{more}</joint>'
    )


def four_bar(loop: str = "", marks: str = "", root: str = "robot", more: str = "") -> str:
    """The rhombus, cut at the coupler's end; its joints have no limits."""
    links = "".join(f'<link name="{n}">{ROD}</link>' for n in ("crank", "coupler", "rocker"))
    return (
        f'<{root} name="r" {marks}><link name="ground"/>{links}{joint("q1", "ground", "crank", more=more)}'
        f"{joint('q2', 'crank', 'coupler', '0 1 0')}{joint('q3', 'ground', 'rocker', '0 1 0')}"
        f"{loop}</{root.split()[0]}>"
    )


DIALECTS = {
    "URDF+": """<loop name="l" type="revolute"><predecessor link="coupler"><origin xyz="0 1 0"/></predecessor>
      <successor link="rocker"><origin xyz="0 1 0"/></successor><axis xyz="1 0 0"/></loop>""",
    "URDF+, early": """<loop_constraint name="l"><parent link="coupler"/><parent_origin xyz="0 1 0"/>
      <child link="rocker"/><child_origin xyz="0 1 0"/></loop_constraint>""",
    "RigidBodyDynamics": """<loop_joint name="l" type="continuous">
      <link1 link="coupler" xyz="0 1 0" rpy="0 0 0"/><link2 link="rocker" xyz="0 1 0"/></loop_joint>""",
    "Isaac": """<loop_joint name="l" type="spherical"><link1 link="coupler" xyz="0 1 0"/>
      <link1 link="rocker" xyz="0 1 0"/></loop_joint>""",
    "Drake": """<drake:ball_constraint><drake:ball_constraint_body_A name="coupler"/>
      <drake:ball_constraint_p_AP value="0 1 0"/><drake:ball_constraint_body_B name="rocker"/>
      <drake:ball_constraint_p_BQ value="0 1 0"/></drake:ball_constraint>""",
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_loop_in_every_dialect(dialect: str) -> None:
    """The same φ and K as of the folder's rhombus; prefixes need not be declared."""
    mech = rg.Mechanism.from_urdf(four_bar(DIALECTS[dialect]), independent=["q1"])
    reference = rg.load("rhombus")
    q = np.array([0.3, 0.7, -0.4])
    np.testing.assert_allclose(mech.phi(q), reference.phi(q), atol=1e-15)
    np.testing.assert_allclose(mech.K(q), reference.K(q), atol=1e-15)


@pytest.mark.parametrize(
    ("marks", "root"),
    [
        ('xmlns="http://www.ros.org" xmlns:drake="http://drake.mit.edu"', "robot"),
        ('xmlns:u="http://www.ros.org"', "robot"),
    ],
)
def test_namespaces_of_the_root(marks: str, root: str) -> None:
    text = four_bar(DIALECTS["Drake"], marks, root)
    assert len(rg.Mechanism.from_urdf(text, independent=["q1"]).closures) == 1
    prefixed = (
        text.replace("<", "<u:").replace("<u:/", "</u:").replace("<u:u:", "<u:").replace("u:drake:", "drake:")
    )
    if "xmlns:u" in marks:
        assert len(rg.Mechanism.from_urdf(prefixed, independent=["q1"]).closures) == 1


UNKNOWN = {
    "<closing_joint a='coupler' b='rocker'/>": "<closing_joint>",
    "<bond><from>coupler</from><to>rocker</to></bond>": "<bond>",
    "<drake:linear_bushing_rpy/>": "<drake:linear_bushing_rpy>",
    "<joint_constraint><parent link='crank'/><child link='rocker'/></joint_constraint>": "<joint_constraint>",
    "<gazebo><joint name='bond'><parent>coupler</parent><child>rocker</child></joint></gazebo>": "'bond'",
    "<xacro:macro name='m'/>": "<xacro:macro> is not expanded",
    "<loop name='l' type='gear'><predecessor link='coupler'/><successor link='rocker'/></loop>": "'gear'",
    "<loop name='l' type='fixed'><predecessor link='coupler'/></loop>": "lacks <successor",
    "<loop_joint name='l' type='fixed'><link1 link='coupler'/></loop_joint>": "lacks <link2",
    "<drake:ball_constraint/>": "lacks drake:ball_constraint_body_A",
    "<coupling name='c'><predecessor link='crank'/><successor link='rocker'/></coupling>": "lacks <ratio",
    "<coupling><predecessor link='crank'/><successor link='crank'/><ratio value='1'/></coupling>": "either",
    DIALECTS["URDF+"].replace(
        '"coupler"', '"couple"'
    ): "'couple', which is not there; did you mean 'coupler'",
}


@pytest.mark.parametrize("loop", UNKNOWN)
def test_no_loop_is_lost_without_a_word(loop: str) -> None:
    with pytest.raises(rg.ModelError) as caught:
        rg.Mechanism.from_urdf(four_bar(loop))
    assert UNKNOWN[loop] in str(caught.value)


def test_harmless_elements_are_passed_over() -> None:
    more = "<material name='red'/><gazebo reference='crank'/><sensor name='s'/><transmission name='t'/>"
    contents = read_urdf(four_bar(more))
    assert contents.closures == []
    assert contents.left_out == ["<gazebo> (crank)", "<sensor> (s)", "<transmission> (t)"]


def test_damping_acts_and_friction_is_told() -> None:
    """q̇ = −c q̇ / I about the axis through the end, without gravity's lever: decay by exp(−c t / I)."""
    text = (
        f'<robot name="r"><link name="g"/><link name="a">{ROD}</link>'
        + joint("q", "g", "a", more='<dynamics damping="0.2" friction="0.3"/><limit lower="-1" upper="2"/>')
        + "</robot>"
    ).replace('axis xyz="1 0 0"', 'axis xyz="0 0 1"')  # turning about the vertical
    with pytest.warns(
        rg.ModelWarning, match=r"URDF text: not simulated: dry friction of joints \(q\); limits"
    ):
        mech = rg.Mechanism.from_urdf(text)
    assert mech.left_out == ("dry friction of joints (q)", "limits of joints (q)")
    assert mech.forces == (rg.JointDamper("q", 0.2),)
    traj = rg.simulate(mech, [0.0], [1.0], duration=1.0, step=1e-3)
    assert traj.v[-1, 0] == pytest.approx(np.exp(-0.2 / (0.0833 + 0.25)), rel=1e-10)
    with pytest.raises(rg.ModelError, match=r"strict=True.*dry friction"):
        rg.Mechanism.from_urdf(text, strict=True)


def test_mimic_joints_follow() -> None:
    mimic = '<mimic joint="q1" multiplier="-2" offset="0.5"/>'
    text = four_bar().replace('<origin xyz="0 1 0"/><axis', f'<origin xyz="0 1 0"/>{mimic}<axis', 1)
    mech = rg.Mechanism.from_urdf(text, independent=["q1", "q3"])
    assert mech.closures == (rg.CouplingClosure("q2", "q1", -2.0, 0.5),)
    q = mech.assemble({"q1": 0.3})
    assert q[1] == pytest.approx(-0.1, abs=1e-14)


def test_couplings_of_urdf_plus() -> None:
    """Σ successors = ratio Σ predecessors, below the common ancestor: rocker = 3 (crank + coupler)."""
    coupling = """<coupling name="c"><predecessor link="coupler"/><successor link="rocker"/>
      <ratio value="3"/></coupling>"""
    mech = rg.Mechanism.from_urdf(four_bar(coupling), independent=["q1", "q2"])
    assert mech.m == 2
    np.testing.assert_allclose(mech.K(np.zeros(3)), [[-3.0, -3.0, 1.0]], atol=1e-15)


def test_couplings_of_early_urdf_plus() -> None:
    """A rotor turns by the gear ratio times its link: q3 = 6 (q1 + q2), both seen from the ground."""
    coupling = """<joint_constraint name="c"><parent link="coupler"/><child link="rocker"/>
      <gear_ratio value="6"/></joint_constraint>"""
    mech = rg.Mechanism.from_urdf(four_bar(coupling), independent=["q1", "q2"])
    np.testing.assert_allclose(mech.K(np.zeros(3)), [[-6.0, -6.0, 1.0]], atol=1e-15)
    with pytest.raises(rg.ModelError, match="lacks <gear_ratio"):
        rg.Mechanism.from_urdf(four_bar(coupling.replace("gear_ratio", "ratio")))


def test_marks_of_urdf_plus_choose_coordinates(tmp_path: Path) -> None:
    text = four_bar(DIALECTS["URDF+"])
    for name, mark in (("q1", "false"), ("q2", "False"), ("q3", "true")):
        text = text.replace(
            f'name="{name}" type="revolute" ', f'name="{name}" type="revolute" independent="{mark}" '
        )
    file = tmp_path / "r.urdf"
    file.write_text(text, encoding="utf-8")
    assert rg.load(file).independent == ("q3",)
    assert rg.load(file, independent=["q1"]).independent == ("q1",)
    file.write_text(text.replace('"False"', '"no"'), encoding="utf-8")
    with pytest.raises(rg.ModelError, match=r"'q2': independent='no' is neither true nor false"):
        rg.load(file)


# --------------------------------------------------------------------------- bases


def test_bases_of_a_tree() -> None:
    """The ground may be a link that the file does not declare; other roots beside it float."""
    tree = four_bar()
    assert read_urdf(tree).model.nv == read_urdf(tree, "fixed").model.nv == 3
    free = read_urdf(tree, "free").model
    assert (free.nv, free.names[1]) == (9, "root_joint")
    stand = '<joint name="stand" type="fixed"><parent link="world"/><child link="ground"/></joint>'
    for text in (four_bar(stand), four_bar(stand + '<link name="world"/>')):
        assert read_urdf(text).model.nv == 3
        loose = read_urdf(text, "free").model
        assert (loose.nv, loose.names[1]) == (9, "stand")
    beside = four_bar('<link name="floor"/>' + stand.replace("ground", "floor"))
    assert read_urdf(beside).model.nv == 9
    assert read_urdf(beside, "fixed").model.nv == 3
    with pytest.raises(rg.ModelError, match="2 links have no parent joint"):
        read_urdf(four_bar('<link name="floor"/>'))
    with pytest.raises(rg.OptionError, match="base = 'float' is unknown"):
        read_urdf(tree, "float")


def test_a_floating_base_has_components_as_coordinates() -> None:
    mech = rg.Mechanism.from_urdf(four_bar(DIALECTS["Drake"]), independent=["root_joint", "q1"], base="free")
    assert (mech.nv, mech.m) == (9, 7)
    q = mech.assemble({"root_joint": [1, 2, 3, 0, 0, 0, 1], "q1": 0.2, "q2": -0.2, "q3": 0.2})
    inner = rg.load("rhombus")
    G = mech.G(q)
    np.testing.assert_array_equal(G[:6, :6], np.eye(6))
    np.testing.assert_allclose(G[6:, 6:], inner.G(inner.home), atol=1e-12)
    np.testing.assert_allclose(G[6:, :6], 0.0, atol=1e-12)
    part = rg.Mechanism.from_urdf(
        four_bar(DIALECTS["Drake"]), independent=[*mech.independent[:0], "root_joint", "q2"], base="free"
    )
    assert (
        part.with_independent([f"root_joint.{c}" for c in ("x", "y", "z", "rx", "ry", "rz")] + ["q1"]).m == 7
    )
    run = rg.simulate(mech, q, duration=0.01)
    assert run.closure_error().max() < 1e-12


def test_numbers_by_name() -> None:
    mech = rg.load("rhombus")
    traj = rg.simulate(mech, {"q1": 0.2}, {"q1": 1.0, "q2": -1.0, "q3": 1.0}, duration=0.1, step=1e-2)
    same = rg.simulate(mech, mech.home, [1.0, -1.0, 1.0], duration=0.1, step=1e-2)
    np.testing.assert_array_equal(traj.q, same.q)
    q = mech.assemble({"q1": 0.5, "q2": -0.45})
    assert q[0] == 0.5
    assert mech.closure_residual(q) < 1e-12


# --------------------------------------------------------------------------- loops known by names of links


def ends(first: str, second: str) -> str:
    """Massless links where the rhombus is cut."""
    fixed = (
        '<joint name="{0}_at" type="fixed"><parent link="{1}"/><child link="{0}"/>'
        '<origin xyz="0 1 0"/></joint>'
    )
    return "".join(
        f'<link name="{end}"/>' + fixed.format(end, link)
        for end, link in ((first, "coupler"), (second, "rocker"))
    )


def test_pairs_of_links_that_name_a_cut_are_held_together(tmp_path: Path) -> None:
    """As onshape-to-robot writes them; the same φ as of the folder's rhombus, once."""
    text = four_bar(ends("closing_tip_1", "closing_tip_2"))
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    mech = rg.load(tmp_path / "arm.urdf")
    assert (mech.m, mech.closures) == (1, (rg.PointClosure("closing_tip_1", "closing_tip_2"),))
    q = np.array([0.3, 0.7, -0.4])
    np.testing.assert_allclose(mech.phi(q), rg.load("rhombus").phi(q), atol=1e-15)
    own = rg.RevoluteClosure("closing_tip_2", "closing_tip_1", axis=(1.0, 0.0, 0.0))
    assert rg.Mechanism.from_urdf(text, [own], ["q1"]).closures == (own,)
    alone = four_bar(ends("closing_tip_1", "closing_other_2"))
    assert rg.Mechanism.from_urdf(alone, independent=["q1", "q2", "q3"]).closures == ()


def test_a_file_is_read_with_the_robot_yaml_that_closes_it(tmp_path: Path) -> None:
    """Beside none, ends named as in example-parallel-robots are not left open without a word."""
    (tmp_path / "robot.urdf").write_text(four_bar(ends("closedloop1_A_3D", "closedloop1_B_3D")), "utf-8")
    with pytest.raises(rg.ModelError, match=r"'closedloop1_A_3D' and 'closedloop1_B_3D' are named as"):
        rg.load(tmp_path / "robot.urdf")
    yaml = "closed_loop: [[closedloop1_A_3D, closedloop1_B_3D]]\ntype: [3d]\nname_mot: [q1]\n"
    (tmp_path / "robot.yaml").write_text(yaml, encoding="utf-8")
    for path in (tmp_path / "robot.urdf", tmp_path):
        assert (rg.load(path).m, rg.load(path).independent) == (1, ("q1",))


def test_a_urdf_may_be_called_xml(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(four_bar(DIALECTS["URDF+"]), encoding="utf-8")
    assert rg.load(tmp_path / "arm.xml").m == rg.load(tmp_path).m == 1


@pytest.mark.parametrize(
    ("suffix", "message"), [("mjb", "compiled models"), ("osim", "OpenSim"), ("xacro", "run")]
)
def test_other_formats_are_refused_by_name(suffix: str, message: str, tmp_path: Path) -> None:
    (tmp_path / f"robot.{suffix}").write_text("<sdf/>", encoding="utf-8")
    with pytest.raises(rg.ModelError, match=message):
        rg.load(tmp_path / f"robot.{suffix}")


def test_words_that_only_look_like_ties_are_passed_over() -> None:
    text = four_bar(DIALECTS["URDF+"] + '<properties arm="0.1" kf="3e-10"/>')
    contents = read_urdf(text)
    assert len(contents.closures) == 1
    assert "<properties> (unnamed)" in contents.left_out


def test_a_robot_that_nothing_moves_is_refused_by_name() -> None:
    still = f'<robot name="r"><link name="a">{ROD}</link></robot>'
    with pytest.raises(rg.ModelError, match="no joint moves"):
        rg.Mechanism.from_urdf(still)
    assert rg.Mechanism.from_urdf(still, independent="auto", base="free").m == 6


def test_moments_of_inertia_may_be_zero_up_to_rounding() -> None:
    """As exporters write those of links without any."""
    rounded = four_bar(DIALECTS["URDF+"]).replace('iyy="0"', 'iyy="-5.4e-20"')
    assert rg.Mechanism.from_urdf(rounded, independent=["q1"]).m == 1
    with pytest.raises(rg.ModelError, match=r"iyy='-5\.4e-09'> is negative"):
        rg.Mechanism.from_urdf(rounded.replace("e-20", "e-09"), independent=["q1"])


def test_the_links_without_mass_are_named() -> None:
    """Of three joints the last alone moves none."""
    text = four_bar(DIALECTS["URDF+"] + '<link name="flag"/>' + joint("q4", "rocker", "flag", "0 1 0"))
    mech = rg.Mechanism.from_urdf(text, independent=["q1", "q4"])
    with pytest.raises(rg.SimulationError, match="a motion of q4 moves no mass"):
        rg.simulate(mech, mech.assemble({"q1": 0.5, "q2": -0.5, "q3": 0.5}), duration=0.01, step=1e-3)


def test_a_mechanism_is_called_as_its_file_calls_it() -> None:
    """So that errors name it."""
    mech = rg.Mechanism.from_urdf(four_bar(DIALECTS["URDF+"]), independent=["q1"])
    assert mech.name == "r"
    weld = DIALECTS["URDF+"].replace("revolute", "fixed")
    rigid = rg.Mechanism.from_urdf(four_bar(weld), independent=[])
    with pytest.raises(rg.PartitionError, match="'r' is rigid"):
        rg.simulate(rigid, duration=0.01)


CONSTRAINT = """<constraint name="l" type="{kind}"><parent link="coupler"/><parent_origin xyz="0 1 0"/>
  {one}<child link="rocker"/><child_origin xyz="0 1 0" rpy="{rpy}"/>{two}</constraint>"""


@pytest.mark.parametrize(
    ("kind", "one", "two", "rpy"),
    [
        ("spherical", "", "", "0 0 0"),
        ("revolute", "", "", "0 0 0"),
        ("revolute", '<parent_axis xyz="1 0 0"/>', '<child_axis xyz="0 -1 0"/>', "0 0 1.5707963267948966"),
        ("universal", '<parent_axis xyz="1 0 0"/>', '<child_axis xyz="0 1 0"/>', "0 0 0"),
    ],
)
def test_a_constraint_with_an_axis_on_either_link(kind: str, one: str, two: str, rpy: str) -> None:
    """The axis of the child's place is that of the parent's, in whatever frame it is written."""
    mech = rg.Mechanism.from_urdf(
        four_bar(CONSTRAINT.format(kind=kind, one=one, two=two, rpy=rpy)), independent=["q1"]
    )
    wanted = rg.Mechanism.from_urdf(four_bar(DIALECTS["Drake"]), independent=["q1"])
    q = wanted.assemble({"q1": 0.5, "q2": -0.5, "q3": 0.5})
    assert mech.closure_residual(q) < 1e-14
    runs = [rg.simulate(m, q, duration=0.3, step=1e-3) for m in (mech, wanted)]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-12)


def test_constraints_without_an_axis_or_of_unknown_types_are_refused() -> None:
    zero = CONSTRAINT.format(kind="revolute", one='<parent_axis xyz="0 0 0"/>', two="", rpy="0 0 0")
    with pytest.raises(rg.ModelError, match="its parent_axis is no direction"):
        read_urdf(four_bar(zero))
    with pytest.raises(rg.ModelError, match="is of type 'screw'"):
        read_urdf(four_bar(CONSTRAINT.format(kind="screw", one="", two="", rpy="0 0 0")))


GAZEBO = """<gazebo><joint name="l" type="{kind}"><parent>coupler</parent><child>rocker</child>
  <pose>0 1 0 0 0 0</pose>{axis}</joint></gazebo>"""


@pytest.mark.parametrize(("kind", "axis"), [("ball", ""), ("revolute", "<axis><xyz>1 0 0</xyz></axis>")])
def test_a_joint_that_gazebo_adds_closes_the_loop(kind: str, axis: str) -> None:
    """At zero the rhombus is drawn with its coupler beside its rocker's end: there the joint is."""
    text = four_bar(GAZEBO.format(kind=kind, axis=axis))
    text = text.replace('<joint name="q2" type="revolute" ', '<joint name="q2" type="revolute" ')
    mech = rg.Mechanism.from_urdf(text, independent=["q1"])
    assert type(mech.closures[0]) is (rg.PointClosure if kind == "ball" else rg.RevoluteClosure)
    assert mech.closure_residual(np.zeros(3)) < 1e-15  # closed at zero by definition
    run = rg.simulate(mech, [0.3, *mech.assemble({"q1": 0.3})[1:]], duration=0.2)
    assert run.closure_error().max() < 1e-13


def test_transmissions_name_the_motors() -> None:
    """As ROS writes them; of one with a reduction the rest is told."""
    drive = """<transmission name="t"><type>transmission_interface/SimpleTransmission</type>
      <joint name="q3"/><actuator name="m"><mechanicalReduction>{}</mechanicalReduction></actuator>
      </transmission>"""
    contents = read_urdf(four_bar(DIALECTS["URDF+"] + drive.format(1)))
    assert (contents.actuated, contents.left_out) == (("q3",), [])
    assert read_urdf(four_bar(DIALECTS["URDF+"] + drive.format(50))).left_out == ["<transmission> (t)"]
    control = (
        '<ros2_control name="c"><joint name="q1"><command_interface name="effort"/></joint></ros2_control>'
    )
    assert read_urdf(four_bar(DIALECTS["URDF+"] + control)).actuated == ("q1",)


@pytest.mark.parametrize("joint", ("q1", "q2", "q3"))
def test_beside_a_flat_pose_home_is_where_the_motor_serves(
    joint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two modes meet in the flat pose, each with another joint at rest; the same home on any machine."""
    (tmp_path / "robot.urdf").write_text(four_bar(ends("closedloop1_A_3D", "closedloop1_B_3D")), "utf-8")
    yaml = f"closed_loop: [[closedloop1_A_3D, closedloop1_B_3D]]\ntype: [3d]\nname_mot: [{joint}]\n"
    (tmp_path / "robot.yaml").write_text(yaml, encoding="utf-8")
    usual = rg.load(tmp_path)
    assert usual.independent == (joint,)
    assert np.linalg.cond(usual.K(usual.home)[:, usual.iv_dependent]) < 1e3
    for seed in range(4):
        with monkeypatch.context() as patch:
            turn_decompositions(patch, seed)
            np.testing.assert_allclose(rg.load(tmp_path).home, usual.home, rtol=0, atol=1e-9)
