"""Where a mechanism from a file begins: poses that are singular, and poses outside the ranges of joints."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.mechanism.assembly.ranges import ranges_of

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))
FLAT = [(1.5, 1, 2.5, 2), (1, 2, 3, 4), (2, 1, 2, 1), (1, 1, 1, 1), (1, 2, 1, 2), (4, 2, 5, 3)]
"""Ground, crank, coupler and rocker, m: all close in one line at q = 0, where two modes meet."""


def mjcf(lengths: tuple[float, ...], by: str = "site") -> str:
    ground, crank, coupler, rocker = lengths
    ties = {
        "site": '<connect site1="a" site2="b"/>',
        "body": f'<connect body1="coupler" body2="rocker" anchor="0 {coupler} 0"/>',
    }

    def part(joint: str, length: float) -> str:
        rod = f'<geom type="capsule" fromto="0 0 0 0 {length} 0" size="0.05" mass="{length}"/>'
        return f'<joint name="{joint}" axis="1 0 0"/>{rod}'

    return f"""<mujoco><option><flag contact="disable"/></option><worldbody>
    <body name="crank">{part("q1", crank)}<body name="coupler" pos="0 {crank} 0">{part("q2", coupler)}
      <site name="a" pos="0 {coupler} 0"/></body></body>
    <body name="rocker" pos="0 {ground} 0">{part("q3", rocker)}<site name="b" pos="0 {rocker} 0"/></body>
    </worldbody><equality>{ties[by]}</equality></mujoco>"""


def urdf_link(name: str, length: float) -> str:
    about = length**2 / 12.0
    return f"""<link name="{name}"><inertial><origin xyz="0 {length / 2} 0"/><mass value="1"/>
    <inertia ixx="{about}" iyy="0.001" izz="{about}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def urdf(lengths: tuple[float, ...], ranges: dict[str, tuple[float, float]] | None = None) -> str:
    ground, crank, coupler, rocker = lengths
    ranges = ranges or {}

    def joint(name: str, parent: str, child: str, at: float) -> str:
        kind, limit = "continuous", ""
        if name in ranges:
            low, high = ranges[name]
            kind, limit = "revolute", f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>'
        return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
        <origin xyz="0 {at} 0"/><axis xyz="1 0 0"/>{limit}</joint>"""

    def fixed(tip: str, parent: str, at: float) -> str:
        ends = f'<parent link="{parent}"/><child link="{tip}"/><origin xyz="0 {at} 0"/>'
        return f'<joint name="{tip}_joint" type="fixed">{ends}</joint>'

    return f"""<robot name="r"><link name="base"/>{urdf_link("crank", crank)}{urdf_link("coupler", coupler)}
    {urdf_link("rocker", rocker)}{joint("q1", "base", "crank", 0)}{joint("q2", "crank", "coupler", crank)}
    {joint("q3", "base", "rocker", ground)}<link name="tip1"/><link name="tip2"/>
    {fixed("tip1", "coupler", coupler)}{fixed("tip2", "rocker", rocker)}</robot>"""


YAML = "closed_loop: [[tip1, tip2]]\ntype: [3d]\n"


# --------------------------------------------------------------------------- singular poses


@pytest.mark.parametrize("lengths", FLAT)
@pytest.mark.parametrize("form", ["site", "body", "yaml", "model"])
def test_a_flat_four_bar_loads_names_its_modes_and_runs_on_each(
    lengths: tuple[float, ...], form: str, tmp_path: Path
) -> None:
    """The pose is kept; its mobility is that of the modes that meet there, not the one of first order."""
    if form == "yaml":
        (tmp_path / "robot.urdf").write_text(urdf(lengths), encoding="utf-8")
        flat = "robust_gcp: {guess: {q1: 0, q2: 0, q3: 0}}\n"
        (tmp_path / "robot.yaml").write_text(YAML + flat, encoding="utf-8")
        mech = rg.load(tmp_path)
    else:
        (tmp_path / "flat.xml").write_text(
            mjcf(lengths, form if form != "model" else "site"), encoding="utf-8"
        )
        mech = rg.load(tmp_path / "flat.xml")
        if form == "model":
            mech = rg.Mechanism.from_pinocchio(mech.model, mech.closures)
    assert mech.m == 1
    np.testing.assert_array_equal(mech.home, np.zeros(3))
    modes = rg.analyse(mech, mech.home).modes
    assert len(modes) == 2
    with pytest.raises(rg.SingularStartError, match=r"2 modes meet at q0.*modes\[1\]"):
        rg.simulate(mech, duration=0.01)
    for mode in modes:
        run = rg.simulate(mech, mode=mode, duration=0.05, step=1e-3)
        assert run.closure_error().max() < 1e-12
        assert np.abs(run.energy_error()).max() < 1e-8


def test_a_flat_urdf_with_a_loop_of_its_own(tmp_path: Path) -> None:
    loop = """<loop name="l" type="continuous"><predecessor link="coupler"><origin xyz="0 1 0"/></predecessor>
    <successor link="rocker"><origin xyz="0 2 0"/></successor><axis xyz="1 0 0"/></loop></robot>"""
    mech = rg.Mechanism.from_urdf(urdf((2, 1, 1, 2)).replace("</robot>", loop), home=np.zeros(3))
    assert mech.m == 1


def test_too_many_coordinates_at_a_flat_pose_are_told_from_rigidity(tmp_path: Path) -> None:
    (tmp_path / "flat.xml").write_text(mjcf((1, 1, 1, 1)), encoding="utf-8")
    mech = rg.load(tmp_path / "flat.xml", independent=["q1", "q2"])
    with pytest.raises(
        rg.PartitionError, match="beside it K has a higher rank and the mobility is 1"
    ) as caught:
        rg.simulate(mech, duration=0.01)
    assert ("q1",) in caught.value.choices


# --------------------------------------------------------------------------- ranges of joints


LEG = (2.0, 2.0, 2.5, 2.0)
"""Its coupler and rocker may be bent to either side."""


def leg(tmp_path: Path, ranges: dict[str, tuple[float, float]], own: str = "") -> rg.Mechanism:
    (tmp_path / "robot.urdf").write_text(urdf(LEG, ranges), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(YAML + own, encoding="utf-8")
    return rg.load(tmp_path)


@pytest.mark.parametrize("side", [(0.2, 3.0), (-3.0, -0.2)])
@pytest.mark.parametrize(
    "own", ["", "robust_gcp: {guess: {q1: 1.5, q2: 0.1}}", "robust_gcp: {guess: {q1: -1}}"]
)
@pytest.mark.filterwarnings("ignore:.*limits of joints:robust_gcp.ModelWarning")
def test_the_loops_are_closed_with_joints_in_their_ranges(
    side: tuple[float, float], own: str, tmp_path: Path
) -> None:
    mech = leg(tmp_path, {"q1": (-2.0, 2.0), "q2": side}, own)
    assert mech.closure_residual(mech.home) < 1e-12
    assert -2.0 <= mech.home[0] <= 2.0
    assert side[0] - 1e-6 <= mech.home[1] <= side[1] + 1e-6


@pytest.mark.filterwarnings("ignore:.*limits of joints:robust_gcp.ModelWarning")
def test_a_home_inside_the_ranges_stays_the_first_choice(tmp_path: Path) -> None:
    free = leg(tmp_path, {}, "robust_gcp: {guess: {q1: 1.5, q2: -0.5, q3: 2.0}}")
    inside = {"q2": (float(free.home[1]) - 0.1, 3.0), "q1": (-2.0, 2.0)}
    bound = leg(tmp_path, inside, "robust_gcp: {guess: {q1: 1.5, q2: -0.5, q3: 2.0}}")
    np.testing.assert_allclose(bound.home, free.home, atol=1e-12)


def test_a_home_outside_is_kept_and_told_by_joint(tmp_path: Path) -> None:
    free = leg(tmp_path, {}, "robust_gcp: {guess: {q1: 1.5, q2: -0.5, q3: 2.0}}")
    home = dict(zip(("q1", "q2", "q3"), free.home.tolist(), strict=True))
    low, high = home["q2"] + 0.5, home["q2"] + 0.7
    with pytest.warns(rg.ModelWarning) as told:
        kept = leg(tmp_path, {"q2": (low, high)}, f"robust_gcp: {{home: {home}}}")
    np.testing.assert_allclose(kept.home, free.home, atol=1e-12)
    words = f"home is outside the ranges of joints: q2 at {home['q2']:.4g} rad ({low:.4g} to {high:.4g})"
    assert any(words in str(warning.message) for warning in told)
    with pytest.warns(rg.ModelWarning) as told:
        mech = leg(tmp_path, {"q1": (0.1, 0.2), "q2": (1.9, 2.0)})  # no assembly is inside
    assert any("home is outside the ranges of joints: q" in str(warning.message) for warning in told)
    assert mech.closure_residual(mech.home) < 1e-12


def test_limits_that_are_none_are_no_ranges(tmp_path: Path) -> None:
    """A <limit> without lower and upper, and bounds written for joints without any."""
    text = urdf(LEG, {"q1": (-1e9, 1e9)}).replace('lower="-1000000000.0" upper="1000000000.0"', "")
    mech = rg.Mechanism.from_urdf(text, [rg.PointClosure("tip1", "tip2")], ["q1"])
    assert ranges_of(mech).names == ()
    mech.model.lowerPositionLimit[:] = mech.model.upperPositionLimit[:] = 0.0  # as Pinocchio's reader has it
    assert ranges_of(mech).names == ()


def test_ranges_of_mjcf_count_from_the_files_zero() -> None:
    """Whatever `ref` is; without `limited` and autolimits there is none."""
    joint = '<joint name="q1" axis="1 0 0" ref="30" range="10 50"/>'
    text = f"<mujoco>COMPILER<worldbody><body>{joint}<geom size='1'/></body></worldbody></mujoco>"
    text = text.replace("<worldbody>", "<option><flag contact='disable'/></option><worldbody>")
    with pytest.warns(rg.ModelWarning, match="limits of joints"):
        mech = rg.Mechanism.from_mjcf(text.replace("COMPILER", ""))
    ranges = ranges_of(mech)
    np.testing.assert_allclose([ranges.low[0], ranges.high[0]], np.deg2rad([10.0, 50.0]))
    np.testing.assert_allclose(mech.home, np.deg2rad([30.0]))
    without = text.replace('range="10 50"', 'range="10 50" limited="false"')
    off = rg.Mechanism.from_mjcf(without.replace("COMPILER", '<compiler autolimits="false"/>'))
    assert ranges_of(off).names == ()


@pytest.mark.parametrize("side", [(-1.5, -0.2), (-3.0, -2.0)])
@pytest.mark.parametrize("q3", [0.5, 2.0, -1.0])
def test_assemble_prefers_the_side_that_the_ranges_allow(side: tuple[float, float], q3: float) -> None:
    """At q1 = 0.5 the loop closes with q2 = -0.96 and -2.68."""
    closure = [rg.PointClosure("tip1", "tip2")]
    with pytest.warns(rg.ModelWarning, match="limits of joints"):
        mech = rg.Mechanism.from_urdf(urdf(LEG, {"q2": side}), closure, ["q1"])
    q = mech.assemble([0.5, 0.5 * sum(side), q3])
    assert side[0] <= q[1] <= side[1]
    assert q[0] == 0.5


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="the folder of robots' files is not here")
@pytest.mark.filterwarnings("ignore:.*not simulated:robust_gcp.ModelWarning")
@pytest.mark.parametrize("file", ["kangaroo.xml", "kangaroo_lower_body.xml"])
def test_a_folded_neutral_pose_is_left_for_one_in_the_ranges(file: str) -> None:
    mech = rg.load(ROBOTS / "pal_kangaroo" / file)
    assert ranges_of(mech).outside(mech.home) == []
    assert mech.closure_residual(mech.home) < 1e-12
    run = rg.simulate(mech, duration=0.02, step=1e-3)
    assert run.stats.native_steps == 20


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="the folder of robots' files is not here")
@pytest.mark.filterwarnings("ignore:.*not simulated:robust_gcp.ModelWarning")
def test_a_pose_that_nobody_chose_keeps_away_from_singular_places() -> None:
    """A planar delta robot whose nearest assembly has singular values of K of 2e-4 of the largest."""
    mech = rg.load(ROBOTS / "gepetto" / "robot_delta")
    s = np.linalg.svd(mech.scaled(mech.K(mech.home)), compute_uv=False)
    assert s[-1] > 1e-3 * s[0]
    run = rg.simulate(mech, duration=0.01, step=1e-3)
    assert run.stats.refined_steps == 0
    assert run.closure_error().max() < 1e-12


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="the folder of robots' files is not here")
@pytest.mark.filterwarnings("ignore:.*not simulated:robust_gcp.ModelWarning")
def test_a_step_too_long_names_a_remedy_that_helps() -> None:
    """Heavy cut joints whip the links past a dead point at 320 rad/s, for some tenths of a millisecond."""
    mech = rg.load(ROBOTS / "gepetto" / "5bar_linkage")
    with pytest.raises(rg.BranchError, match='stepper="DOP853"'):
        rg.simulate(mech, duration=0.1, step=1e-3)
    run = rg.simulate(mech, duration=0.1, step=1e-3, stepper="DOP853")
    assert np.abs(run.energy_error()).max() < 1e-8 * abs(mech.energy(mech.home, np.zeros(mech.nv)))
