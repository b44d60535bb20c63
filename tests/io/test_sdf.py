"""SDF: poses by frames, loops, old and new spellings, and what is refused."""

from __future__ import annotations

import contextlib
import os
import random
import re
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.io.sdf.reader import read_sdf

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))
LENGTHS = {"crank": 1.0, "coupler": 3.0, "rocker": 2.5}


def link(name: str, pose: str, more: str = "") -> str:
    length = LENGTHS[name]
    moment = length**2 / 12.0
    return f"""<link name="{name}">{pose}<inertial><pose>{length / 2} 0 0 0 0 0</pose><mass>1</mass><inertia>
      <ixx>0.001</ixx><iyy>{moment}</iyy><izz>{moment}</izz></inertia></inertial>{more}</link>"""


def about(x: float, y: float, z: float, more: str = "", tag: str = "axis") -> str:
    return f"<{tag}><xyz>{x} {y} {z}</xyz>{more}</{tag}>"


def joint(name: str, kind: str, parent: str, child: str, more: str = about(0, 0, 1)) -> str:
    ends = f"<parent>{parent}</parent><child>{child}</child>"
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


def model(inside: str, version: str = "1.9", world: str = "<gravity>0 -9.81 0</gravity>") -> str:
    return f'<sdf version="{version}"><world name="w">{world}<model name="bar">{inside}</model></world></sdf>'


C, S = np.cos(0.4), np.sin(0.4)
TIP = f"{C} {S} 0"
"""Drawn with the crank at 0.4 rad, the coupler and the rocker where they meet by the closed form below."""


def closed_form() -> tuple[float, float]:
    """Directions of coupler and rocker where the crank is at 0.4 rad."""
    reach = np.array([2.5 - C, -S])
    d = np.hypot(*reach)
    at = np.arccos((d**2 + 9.0 - 6.25) / (6.0 * d))
    coupler = np.arctan2(reach[1], reach[0]) + at
    tip = np.array([C, S]) + 3.0 * np.array([np.cos(coupler), np.sin(coupler)])
    return float(coupler), float(np.arctan2(tip[1], tip[0] - 2.5))


COUPLER, ROCKER = closed_form()

BY_WORLD = (
    link("crank", "<pose>0 0 0 0 0 0.4</pose>")
    + link("coupler", f"<pose>{TIP} 0 0 {COUPLER}</pose>")
    + link("rocker", f"<pose>2.5 0 0 0 0 {ROCKER}</pose>")
)
BY_FRAMES = (
    link("crank", "<pose degrees='true'>0 0 0 0 0 22.918311805232928</pose>")
    + '<frame name="tip" attached_to="crank"><pose>1 0 0 0 0 0</pose></frame>'
    + '<frame name="foot"><pose rotation_format="quat_xyzw">2.5 0 0 0 0 '
    + f"{np.sin(ROCKER / 2)} {np.cos(ROCKER / 2)}</pose></frame>"
    + link("coupler", f"<pose relative_to='tip'>0 0 0 0 0 {COUPLER - 0.4}</pose>")
    + link("rocker", "<pose relative_to='foot'/>")
)
JOINTS = (
    joint("q1", "revolute", "world", "crank")
    + joint("q2", "continuous", "crank", "coupler")
    + joint("q3", "revolute", "world", "rocker")
)
CLOSING = {
    "revolute": joint("q4", "revolute", "coupler", "rocker", "<pose>2.5 0 0 0 0 0</pose>" + about(0, 0, 1)),
    "ball": joint("q4", "ball", "coupler", "rocker", "<pose>2.5 0 0 0 0 0</pose>"),
    "named": joint(
        "q4",
        "revolute",
        "coupler",
        "end",
        "<axis><xyz expressed_in='__model__'>0 0 2</xyz></axis>",
    )
    + '<frame name="end" attached_to="rocker"><pose>2.5 0 0 0 0 0</pose></frame>',
    "old": joint(
        "q4",
        "revolute",
        "coupler",
        "rocker",
        "<pose>2.5 0 0 0 0 0</pose>" + about(0, 0, 1, "<use_parent_model_frame>1</use_parent_model_frame>"),
    ),
    "Drake's": """<drake:ball_constraint><drake:ball_constraint_body_A>coupler</drake:ball_constraint_body_A>
      <drake:ball_constraint_p_AP>3 0 0</drake:ball_constraint_p_AP>
      <drake:ball_constraint_body_B>rocker</drake:ball_constraint_body_B>
      <drake:ball_constraint_p_BQ>2.5 0 0</drake:ball_constraint_p_BQ></drake:ball_constraint>""",
}


def wanted() -> rg.Mechanism:
    linkage = rg.Linkage("bar")
    inertias = {}
    for name, length in LENGTHS.items():
        import pinocchio as pin

        moments = np.diag([0.001, length**2 / 12.0, length**2 / 12.0])
        inertias[name] = pin.Inertia(1.0, np.array([length / 2, 0, 0]), moments)
    linkage.point("ground.D", (2.5, 0.0))
    linkage.link("crank", 1.0, at="ground", inertia=inertias["crank"])
    linkage.link("coupler", 3.0, at="crank.end", inertia=inertias["coupler"])
    linkage.link("rocker", 2.5, at="ground.D", inertia=inertias["rocker"])
    linkage.revolute("coupler.end", "rocker.end")
    return linkage.mechanism({"crank": 0.4, "coupler": COUPLER - 0.4})


@pytest.mark.parametrize("closing", CLOSING)
@pytest.mark.parametrize("links", [BY_WORLD, BY_FRAMES])
def test_a_second_parent_closes_the_loop(links: str, closing: str) -> None:
    made = rg.Mechanism.from_contents(read_sdf(model(links + JOINTS + CLOSING[closing])), ["q1"])
    one = wanted()
    assert made.joint_names == ("q1", "q2", "q3")
    np.testing.assert_allclose(made.home, 0.0)  # as it is drawn
    assert made.closure_residual(made.home) < 1e-14
    run = rg.simulate(one, v0=one.lift(one.home, [1.5]), duration=0.5, step=1e-3)
    twin = rg.simulate(made, v0=made.lift(made.home, [1.5]), duration=0.5, step=1e-3)
    np.testing.assert_allclose(twin["q1"] + 0.4, run["crank"], atol=1e-12)
    np.testing.assert_allclose(twin["q3"] + ROCKER, run["rocker"], atol=1e-12)


def test_models_in_models_have_scopes() -> None:
    arm = f"<model name='arm'><pose>0.5 0 0 0 0 0</pose>{link('crank', '')}</model>"
    text = model(arm + joint("q", "revolute", "world", "arm::crank"))
    contents = read_sdf(text)
    assert contents.model.existFrame("arm::crank")
    np.testing.assert_allclose(contents.model.jointPlacements[1].translation, [0.5, 0, 0])


def test_springs_ranges_mimics_and_kinds() -> None:
    axis = about(
        *(0, 0, 1),
        "<limit><lower>-1</lower><upper>2</upper></limit><dynamics><damping>0.3</damping>"
        "<friction>0.1</friction><spring_stiffness>4</spring_stiffness>"
        "<spring_reference>0.2</spring_reference></dynamics><mimic joint='q2'><multiplier>2</multiplier>"
        "<offset>0.1</offset><reference>0.5</reference></mimic>",
    )
    text = model(
        BY_WORLD
        + joint("q1", "revolute", "world", "crank", axis)
        + joint("q2", "prismatic", "crank", "coupler")
        + joint(
            "q3",
            "universal",
            "world",
            "rocker",
            about(0, 0, 1) + about(1, 0, 0, tag="axis2"),
        )
    )
    contents = read_sdf(text)
    assert contents.forces == [rg.JointSpring("q1", 4.0, 0.2), rg.JointDamper("q1", 0.3)]
    (tied,) = contents.closures
    assert (tied.joint1, tied.joint2, tied.ratio) == ("q1", "q2", 2.0)
    assert tied.offset == pytest.approx(0.1 - 2.0 * 0.5)
    assert list(contents.model.names)[1:] == ["q1", "q2", "q3_1", "q3_2"]
    assert contents.left_out == ["limits of joints (q1)", "dry friction of joints (q1)"]
    assert (contents.model.lowerPositionLimit[0], contents.model.upperPositionLimit[0]) == (-1.0, 2.0)


def test_a_gearbox_ties_two_hinges_on_one_body() -> None:
    """θ of the child is −ratio θ of the parent, each about its own axis, against the reference body."""
    gear = "<gearbox_reference_body>crank</gearbox_reference_body><gearbox_ratio>0.04</gearbox_ratio>"
    hinges = joint("q1", "revolute", "world", "crank") + joint("rotor", "revolute", "crank", "coupler")
    backwards = joint("arm", "revolute", "crank", "rocker", about(0, 0, -1))
    box = joint("g", "gearbox", "coupler", "rocker", gear + about(0, 0, 1) + about(0, 0, 1, tag="axis2"))
    (tied,) = read_sdf(model(BY_WORLD + hinges + backwards + box)).closures
    assert (tied.joint1, tied.joint2) == ("arm", "rotor")
    assert tied.ratio == pytest.approx(0.04)  # −0.04, about an axis that points the other way
    with pytest.raises(rg.ModelError, match="need a revolute joint each, along its axes"):
        read_sdf(model(BY_WORLD + JOINTS + box))


def test_a_joint_that_a_mimic_names_is_in_the_tree() -> None:
    """Whichever joint is listed last: a closure has no number to follow, or to be followed."""
    follows = about(0, 0, 1, "<mimic joint='q1'><multiplier>1</multiplier></mimic>")
    last = joint("q3", "revolute", "world", "rocker", follows)
    closing = CLOSING["named"].replace("q4", "q2b")
    order = JOINTS[: JOINTS.index('<joint name="q3"')] + closing + last
    contents = read_sdf(model(BY_FRAMES + order))
    assert {"q1", "q3"} <= set(contents.model.names)
    assert rg.mechanism.loops.ClosedLoops(contents.model, contents.closures).nc == 2 + 1


def test_a_joint_that_is_drawn_stays_where_sdf_has_it() -> None:
    """A parent's frame elsewhere is a name of its link there; it is told."""
    odd = '<frame name="odd" attached_to="crank"><pose>0.3 0.2 0 0 0 0</pose></frame>'
    text = model(
        BY_WORLD + odd + joint("q1", "revolute", "world", "crank") + joint("q2", "revolute", "odd", "coupler")
    )
    with pytest.warns(rg.ModelWarning, match=r"odd \(0\.7\d+ m, left there\)"):
        moved = read_sdf(text)
    plain = read_sdf(text.replace("<parent>odd</parent>", "<parent>crank</parent>"))
    for one, other in zip(moved.model.jointPlacements, plain.model.jointPlacements, strict=True):
        np.testing.assert_allclose(one.homogeneous, other.homogeneous, atol=1e-15)


def test_bases() -> None:
    chain = (
        BY_WORLD + joint("q2", "continuous", "crank", "coupler") + joint("q4", "ball", "coupler", "rocker")
    )
    assert read_sdf(model(chain)).model.nv == 6 + 1 + 3
    assert read_sdf(model(chain), base="fixed").model.nv == 1 + 3


REFUSED = {
    "<sdf version='1.9'/>": r"it has 0 models \(none that moves\)",
    "<mujoco/>": "the root element is <mujoco>",
    model("<include><uri>model://x</uri></include>"): "<include> names other models",
    model(BY_WORLD + joint("q", "screw", "world", "crank")): "is of type 'screw'",
    model(
        BY_WORLD + joint("q", "revolute", "world", "crankk")
    ): "names 'crankk', which is not there; did you",
    model(BY_WORLD + joint("q", "revolute", "world", "crank", about(0, 0, 0))): "no direction",
    model(
        BY_WORLD + joint("q", "revolute", "world", "crank", "<axis><xyz>0 0</xyz></axis>")
    ): "3 finite numbers",
    model(BY_WORLD + "<drake:linear_bushing_rpy/>"): "<drake:linear_bushing_rpy> ties parts",
    model(
        "<frame name='a' attached_to='b'/><frame name='b' attached_to='a'/>"
        + BY_WORLD
        + JOINTS.replace("world", "a")
    ): ("in a circle"),
    model(BY_WORLD + BY_WORLD): "two frames are called 'crank'",
    model(
        "<link name='a'><inertial auto='true'/></link>" + joint("q", "revolute", "world", "a")
    ): "auto='true'",
    model(
        "<link name='a'><inertial><mass>-1</mass></inertial></link>" + joint("q", "fixed", "world", "a")
    ): "negative",
    model("<link/>"): "a <link> has no name of its own",
    model("<static>true</static>" + BY_WORLD): "none that moves",
    model(BY_WORLD + JOINTS + "<frame name='B_bushing' attached_to='coupler'/><frame name='C_bushing'/>"): (
        "named as ends of a loop"
    ),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_wrong_is_named(text: str) -> None:
    with pytest.raises(rg.ModelError, match=REFUSED[text]):
        read_sdf(text)


@pytest.mark.parametrize("name", ["four_bar_loop", "four_bar_weld"])
def test_drakes_loops_are_assembled(name: str) -> None:
    """Lengths 1, 4.8, 2 and 4 m, in the x, y plane; their comments are no XML."""
    path = ROBOTS / "drake_four_bar" / f"{name}.sdf"
    if not path.exists():
        pytest.skip("the robots' files are not here")
    with pytest.warns(
        rg.ModelWarning, match=r"frames that joints name as parents .*Wd \(2 m, brought together\)"
    ):
        mechanism = rg.load(path, independent=["world_driver"])
    rng = np.random.default_rng(0)
    q = mechanism.assemble({"world_driver": 0.7})
    run = rg.simulate(mechanism, q, mechanism.lift(q, rng.normal(size=1)), duration=0.3)
    assert run.closure_error().max() < 1e-13
    assert np.abs(run.energy_error()).max() < 1e-12
    one = rg.examples.linkages.four_bar(4.0, 1.0, 4.8, 2.0, y=1.0)
    assert len(mechanism.assemblies(q)) == len(one.assemblies()) == 2
    with pytest.raises(rg.ModelError, match="'Bc_bushing' and 'Cb_bushing' are named as ends of a loop"):
        rg.load(path.with_name("four_bar.sdf"))


def test_spoilt_files_are_refused_by_typed_errors() -> None:
    rng, base = random.Random(0), model(BY_FRAMES + JOINTS + CLOSING["named"]).replace("><", ">\n<")
    for count in range(300):
        lines = base.split("\n")
        at = rng.randrange(len(lines))
        if count % 3 == 0:
            del lines[at]
        elif count % 3 == 1:
            values = ("nan", "-1", "1e300", "0", "inf", "x")
            lines[at] = re.sub(r"-?\d+\.?\d*", lambda m, v=values: rng.choice((m.group(), *v)), lines[at])
        else:
            lines[at] = re.sub(
                "crank|rocker|tip|foot|q1|link|joint|pose", rng.choice(("crank", "link", "")), lines[at]
            )
        with contextlib.suppress(rg.RobustGcpError):
            rg.Mechanism.from_contents(read_sdf("\n".join(lines)))
