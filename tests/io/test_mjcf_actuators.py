"""Actuators and tendons of MJCF files: MuJoCo's own forces to rounding, accelerations with hard loops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import robust_gcp as rg
from tests.io.drives import Beside, differences, hard_loops
from tests.io.test_robot_files import ROBOTS

EVERYTHING = """
<mujoco><compiler angle="radian"/>
<worldbody>
  <site name="hook" pos="0.3 0.2 1"/>
  <body name="base" pos="0 0 1"><freejoint name="float"/><geom size="0.1"/><site name="a" pos="0.1 0 0.1"/>
    <body name="arm" pos="0.3 0 0"><joint name="hinge" axis="0 1 0.2" damping="0.1"/>
      <geom name="drum" type="cylinder" size="0.12 0.2" euler="0.5 0.3 0"/><geom name="knob" size="0.09"/>
      <site name="b" pos="0.2 0.1 0"/><site name="beside" pos="0 0 0.5"/>
      <body name="hand" pos="0.4 0 0"><joint name="ball" type="ball"/><geom size="0.1" pos="0.1 0 0"/>
        <site name="c" pos="0.1 0.2 0.1" euler="0.4 0.1 0.7"/>
        <body name="rod" pos="0.2 0 0"><joint name="slide" type="slide" axis="1 0 0" actuatorfrcrange="-2 3"/>
          <geom size="0.05"/><site name="d" pos="0.1 0 0.3"/>
        </body>
      </body>
    </body>
  </body>
</worldbody>
<tendon>
  <fixed name="sum" stiffness="20" damping="2" springlength="0.1 0.3" actuatorfrclimited="true"
    actuatorfrcrange="-4 4"><joint joint="hinge" coef="0.7"/><joint joint="slide" coef="-2"/></fixed>
  <spatial name="cord" stiffness="30" damping="1" springlength="0.2"><site site="hook"/><site site="b"/>
    <pulley divisor="2"/><site site="b"/><geom geom="drum" sidesite="beside"/><site site="d"/>
    <pulley divisor="3"/><site site="a"/><geom geom="knob"/><site site="c"/></spatial>
  <spatial name="string" stiffness="5" springlength="0.1 0.9"><site site="a"/><site site="d"/></spatial>
</tendon>
<actuator>
  <motor name="plain" joint="hinge" gear="3" ctrllimited="true" ctrlrange="-1 1"/>
  <position name="servo" joint="slide" kp="50" kv="3" forcelimited="true" forcerange="-4 6"/>
  <velocity name="pace" tendon="sum" kv="4" gear="2"/>
  <general name="affine" tendon="sum" gainprm="3 0.5 0.2" gaintype="affine"
    biastype="affine" biasprm="1 -2 -0.3"/>
  <intvelocity name="integrated" joint="hinge" kp="20" actrange="-1 1"/>
  <general name="lag" tendon="cord" gear="1.5" dyntype="filter" dynprm="0.1" gainprm="-9"/>
  <cylinder name="piston" tendon="cord" timeconst="0.2" area="2" bias="0.5 0.1 0.2"/>
  <muscle name="muscle" tendon="cord" lengthrange="0.5 2" force="60" timeconst="0.02 0.05"/>
  <muscle name="scaled" tendon="string" lengthrange="0.3 1.4" scale="3"/>
  <general name="turn" joint="ball" gear="0.5 1 -2 0 0 0" gainprm="2"/>
  <motor name="turned" jointinparent="ball" gear="0.5 1 -2 0 0 0"/>
  <motor name="push" joint="float" gear="1 2 3 0.5 0.4 0.3"/>
  <motor name="thrust" site="c" gear="1 2 3 0.5 0.4 0.3"/>
  <general name="reach" site="c" refsite="a" gear="1 2 3 0 0 0" biastype="affine" biasprm="0 -3 -1"/>
  <general name="crank" cranksite="b" slidersite="c" cranklength="0.9" gear="2" biastype="affine"
    biasprm="0 -3 0"/>
</actuator>
</mujoco>
"""


def test_everything_that_drives_is_mujocos() -> None:
    beside = Beside(EVERYTHING)
    names = [a.name for a in beside.contents.actuators]
    assert names == [beside.m.actuator(a).name for a in range(beside.m.nu)]
    found = differences(beside, seed=1, count=200)
    assert max(found) < 1e-12
    kinds = {a.name: a.kind for a in beside.contents.actuators}
    assert kinds["plain"] == "motor" and kinds["servo"] == "position" and kinds["pace"] == "velocity"
    assert kinds["muscle"] == "muscle" and kinds["affine"] == "general"


def test_what_has_no_path_here_is_told(tmp_path: Path) -> None:
    """Muscles whose length MuJoCo would find by simulating, adhesion, delays; the rest acts."""
    body = '<body name="b"><joint name="j"/><geom name="g" size="0.1" pos="0.1 0 0"/></body>'
    more = '<muscle name="unmeasured" joint="j"/><adhesion name="sticky" body="b" ctrlrange="0 1"/>'
    more += '<motor name="m" joint="j"/>'
    with pytest.warns(rg.ModelWarning, match=r"actuators \(unmeasured, sticky\)"):
        mech = rg.Mechanism.from_mjcf(
            f"<mujoco><worldbody>{body}</worldbody><actuator>{more}</actuator></mujoco>"
        )
    assert [a.name for a in mech.actuators] == ["m"]


@pytest.mark.parametrize("flag", ["actuation", "spring", "damper", "clampctrl"])
def test_flags_switch_off_what_they_name(flag: str) -> None:
    option = f'<option><flag {flag}="disable"/></option>'
    beside = Beside(EVERYTHING.replace("<worldbody>", option + "<worldbody>"))
    assert np.nanmax(differences(beside, seed=2)) < 1e-12


def test_groups_of_actuators_that_are_switched_off_are_not_there() -> None:
    """What damps without a control stays, as it does there."""
    beside = Beside(
        """<mujoco><option actuatorgroupdisable="2 4"><flag contact="disable"/></option><worldbody>
        <body><joint name="q" axis="0 1 0"/><geom size="0.1" pos="1 0 0"/></body></worldbody>
        <actuator><motor name="a" joint="q"/><position name="b" joint="q" kp="3" kv="1" group="2"/>
        <motor name="c" joint="q" gear="3" group="3"/></actuator></mujoco>"""
    )
    assert [actuator.name for actuator in beside.contents.actuators] == ["a", "c"]
    assert beside.contents.left_out == [] and max(differences(beside, seed=2)) < 1e-12


def test_names_that_the_file_gives_are_kept_whatever_others_without_one_are_called() -> None:
    still = """<geom size="0.1" contype="0" conaffinity="0"/>"""
    xml = f"""<mujoco><worldbody><body><joint name="j"/>{still}</body></worldbody>
      <tendon><fixed><joint joint="j" coef="1"/></fixed>
        <fixed name="tendon0"><joint joint="j" coef="2"/></fixed></tendon>
      <actuator><motor joint="j" gear="3"/><motor name="j" joint="j" gear="4"/></actuator></mujoco>"""
    mech = rg.Mechanism.from_mjcf(xml)
    assert {a.name: a.gear for a in mech.actuators} == {"j1": 3.0, "j": 4.0}
    arms = {name: path.coefficients for name, path in mech.tendons.items()}
    assert arms == {"tendon01": {"j": 1.0}, "tendon0": {"j": 2.0}}


def test_the_flag_of_filtered_contacts_is_not_that_of_actuators() -> None:
    option = '<option><flag filterparent="disable"/></option>'
    assert len(Beside(EVERYTHING.replace("<worldbody>", option + "<worldbody>")).ids) == 15


def test_limits_and_friction_of_fixed_tendons_act_where_asked_for(tmp_path: Path) -> None:
    """0.7 hinge − 2 slide between limits: a stop on hinge − 2/0.7 slide."""
    file = tmp_path / "a.xml"
    file.write_text(
        EVERYTHING.replace(
            '<fixed name="sum"', '<fixed name="sum" range="-1 2" limited="true" frictionloss="3"'
        )
    )
    with pytest.warns(
        rg.ModelWarning, match=r"dry friction of tendons \(sum\); limits of tendons|limits of tendons"
    ):
        rg.load(file)
    with pytest.warns(rg.ModelWarning) as told:
        mech = rg.load(file, limits=True, friction=True)
    assert not any("tendons" in str(w.message) for w in told)
    stop, rubs = mech.parts
    assert isinstance(stop, rg.Stop) and isinstance(rubs, rg.JointFriction)
    assert (stop.lower, stop.upper) == pytest.approx((-1 / 0.7, 2 / 0.7)) and rubs.bound == pytest.approx(2.1)
    assert stop.joints == ("hinge", "slide") and stop.weights == pytest.approx((1.0, -2.0 / 0.7))


def test_arms_of_zero_have_no_part_in_limits_and_friction(tmp_path: Path) -> None:
    """0 j + 2 k between limits is a stop on k; 0 j is none."""
    file, still = tmp_path / "a.xml", '<geom size="0.1" contype="0" conaffinity="0"/>'
    limits = 'range="-1 2" limited="true" frictionloss="3"'
    file.write_text(f"""<mujoco><worldbody><body><joint name="j"/>{still}
      <body pos="1 0 0"><joint name="k"/>{still}</body></body></worldbody><tendon>
      <fixed {limits}><joint joint="j" coef="0"/><joint joint="k" coef="2"/></fixed>
      <fixed {limits}><joint joint="j" coef="0"/></fixed></tendon></mujoco>""")
    mech = rg.load(file, limits=True, friction=True)
    assert mech.left_out == ()
    assert [part.joint for part in mech.parts] == ["k", "k"] and not any(part.more for part in mech.parts)


def test_a_constant_force_stays_within_the_range_of_its_joint(tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    still = '<geom size="0.1" pos="1 0 0" contype="0" conaffinity="0"/>'
    file.write_text(f"""<mujoco><worldbody>
      <body><joint name="q" actuatorfrcrange="-1 1"/>{still}</body></worldbody><actuator>
      <general joint="q" gear="2" biastype="affine" gainprm="0" biasprm="3"/></actuator></mujoco>""")
    mech = rg.load(file)
    assert mech.forces == (rg.JointTorque("q", 1.0),) and not mech.actuators


def test_they_are_written_and_read_back(tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    file.write_text(EVERYTHING)
    with pytest.warns(rg.ModelWarning):
        one = rg.load(file)
        two = rg.load(one.write(tmp_path / "b.xml"))
    assert [a.name for a in one.actuators] == [a.name for a in two.actuators]
    rng = np.random.default_rng(3)
    assert one.actuation is not None and two.actuation is not None
    for _ in range(20):
        q = one.tree.integrate(one.home, 0.3 * rng.normal(size=one.nv))
        v, u = rng.normal(size=one.nv), rng.uniform(0.0, 1.0, len(one.actuators))
        for ours, again in zip(
            one.actuation.forces_at(q, v, u), two.actuation.forces_at(q, v, u), strict=True
        ):
            assert again == pytest.approx(ours, rel=1e-9, abs=1e-9)


def test_tendons_to_the_ground_are_written_and_read_back(tmp_path: Path) -> None:
    """The ground's own frame, which is a name that no site may have."""
    shipped, cord = rg.load("rhombus"), rg.SpatialTendon(["universe", "coupler_tip"])
    one = rg.Mechanism.from_pinocchio(
        shipped.model, shipped.closures, shipped.independent, shipped.home,
        forces=[rg.PointSpring("universe", "rocker_tip", 5.0, 0.5)],
        actuators=[rg.Actuator.motor("winch", cord)],
    )  # fmt: skip
    two = rg.load(one.write(tmp_path / "b.xml"))
    ends = [rg.simulate(mech, duration=0.1, step=1e-3, ctrl={"winch": -3.0}).q[-1] for mech in (one, two)]
    assert ends[1] == pytest.approx(ends[0], abs=1e-10)


FILES = [
    "robotiq_2f85/2f85.xml", "ufactory_xarm7/hand.xml", "ufactory_xarm7/xarm7.xml",
    "reachy_mini/reachy_mini.xml", "g1_parallel_ankle/23urdf311.xml", "tiangong_parallel_ankle/TG10-00.xml",
]  # fmt: skip


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="robots' files are not here")
class TestRobots:
    @pytest.mark.parametrize("file", [*FILES, "agility_cassie/cassie.xml", "toddlerbot/toddlerbot.xml"])
    def test_their_forces_are_mujocos(self, file: str) -> None:
        assert np.nanmax(differences(Beside(ROBOTS / file), seed=5)) < 1e-10

    @pytest.mark.parametrize("file", FILES)
    @pytest.mark.filterwarnings("ignore")
    def test_they_accelerate_as_with_hard_loops(
        self, file: str, closed_states: Callable[[rg.Mechanism, int], Any]
    ) -> None:
        mech, beside, rng = rg.load(ROBOTS / file), Beside(ROBOTS / file), np.random.default_rng(6)
        assert mech.actuation is not None
        for q, v in closed_states(mech, 3):
            u = rng.normal(size=len(mech.actuators))
            wanted = hard_loops(beside, mech, q, v, u)
            udot = rg.forward_dynamics(mech, q, v, mech.actuation.forces_at(q, v, _clipped(mech, u))[1])
            a = mech.G(q) @ udot + mech.g(q, v)
            assert np.abs(a - wanted).max() < 1e-9 * max(1.0, np.abs(wanted).max())

    @pytest.mark.filterwarnings("ignore")
    def test_a_gripper_closes_as_in_mujoco_the_stiffer_its_loops_the_nearer(self) -> None:
        """The 2F-85 by its actuator through its tendon, its couplers held by their stops from the start."""
        file = ROBOTS / "robotiq_2f85/2f85.xml"
        mech, span = rg.load(file, limits=True), 0.2
        run = rg.simulate(mech, duration=span, step=1e-3, ctrl={"fingers_actuator": 255.0})
        assert {x.kind for x in run.happenings} == {"hold"}
        errors = []
        for stiffness, step in ((1e5, 2e-4), (1e6, 1e-4), (1e7, 2e-5)):
            m = Beside(file).m
            m.opt.timestep, m.opt.tolerance, m.opt.iterations = step, 1e-14, 200
            m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
            for reference in (m.eq_solref, m.jnt_solref):
                reference[:] = [-stiffness, -2.0 * np.sqrt(stiffness)]
            for impedance in (m.eq_solimp, m.jnt_solimp):
                impedance[:] = [0.9999, 0.9999, 0.001, 0.5, 2.0]
            d, places = mujoco.MjData(m), [m.jnt_qposadr[m.joint(n).id] for n in mech.joint_names]
            d.qpos[places], d.ctrl[:] = run.q[0], 255.0
            mujoco.mj_step(m, d, round(span / step))
            errors.append(np.abs(d.qpos[places] - run.q[-1]).max())
        assert errors[0] > 1.5 * errors[1] > 2.0 * errors[2] and errors[2] < 2e-5


def _clipped(mech: rg.Mechanism, u: Any) -> Any:
    ranges = np.array([a.ctrl_range or (-np.inf, np.inf) for a in mech.actuators])
    return np.clip(u, *ranges.T)
