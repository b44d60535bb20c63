"""Limits and dry friction of robots' files, simulated where they are asked for."""

from __future__ import annotations

import json
import pickle
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import robust_gcp as rg
from robust_gcp.__main__ import main
from robust_gcp.io.mjcf.stops import restitution_of, solref_of

Array = NDArray[np.float64]

URDF = """<robot name="p"><link name="world"/><link name="arm"><inertial><origin xyz="0 0 -0.5"/>
  <mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="q" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="1 0 0"/>
  <limit lower="-0.4" upper="0.6" effort="1" velocity="1"/><dynamics damping="0.0" friction="0.3"/></joint>
  </robot>"""
MJCF = """<mujoco><compiler autolimits="true" angle="radian"/><worldbody><body><joint name="q" axis="1 0 0"
  range="-0.4 0.6" frictionloss="0.3" solreflimit="0.02 1e7"/>
  <inertial pos="0 0 -0.5" mass="1" diaginertia="0.1 0.1 0.1"/></body>
  </worldbody></mujoco>"""
SDF = """<sdf version="1.9"><world name="w"><gravity>0 0 -9.81</gravity><model name="p"><link name="arm">
  <inertial><pose>0 0 -0.5 0 0 0</pose><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz>
  </inertia></inertial></link><joint name="q" type="revolute"><parent>world</parent><child>arm</child>
  <axis><xyz>1 0 0</xyz><limit><lower>-0.4</lower><upper>0.6</upper></limit>
  <dynamics><friction>0.3</friction></dynamics></axis></joint></model></world></sdf>"""
FILES = {"p.urdf": URDF, "p.xml": MJCF, "p.sdf": SDF}
PARTS = (rg.Stop("q", lower=-0.4, upper=0.6), rg.JointFriction("q", 0.3))


@pytest.mark.parametrize("name", FILES)
def test_the_parts_of_a_file_act_where_they_are_asked_for(name: str, tmp_path: Path) -> None:
    """As stops and friction that are written out; a format makes no difference."""
    (tmp_path / name).write_text(FILES[name])
    with pytest.warns(rg.ModelWarning, match="limits of joints"):
        plain = rg.load(tmp_path / name)
    assert plain.parts == ()
    mech = rg.load(tmp_path / name, limits=True, friction=True, strict=True)  # nothing is left out
    assert mech.parts == PARTS
    with pytest.warns(rg.ModelWarning, match=r"dry friction of joints \(q\)$"):
        assert rg.load(tmp_path / name, limits=True).parts == PARTS[:1]
    run = rg.simulate(mech, [0.2], [3.0], duration=1.0)
    by_hand = rg.simulate(plain, [0.2], [3.0], duration=1.0, joints=list(PARTS))
    np.testing.assert_array_equal(run.q, by_hand.q)
    assert "impact" in {h.kind for h in run.happenings}
    assert run.q.max() <= 0.6 + 1e-12
    assert np.abs(run.energy_error()).max() < 1e-8
    free = rg.simulate(mech, [0.2], [3.0], duration=1.0, joints=[])
    assert free.q.max() > 0.7


@pytest.mark.parametrize("upper", ["-0.4", "-0.5"])
def test_a_range_without_inside_stops_nothing_and_is_told(upper: str, tmp_path: Path) -> None:
    (tmp_path / "p.urdf").write_text(URDF.replace('upper="0.6"', f'upper="{upper}"'))
    with pytest.warns(rg.ModelWarning, match=r"limits of joints \(q\)$"):
        assert rg.load(tmp_path / "p.urdf", limits=True, friction=True).parts == PARTS[1:]
    with pytest.raises(rg.ModelError, match="limits of joints"):
        rg.load(tmp_path / "p.urdf", limits=True, friction=True, strict=True)


@pytest.mark.parametrize("kind", ["universal", "closing"])
def test_limits_that_do_not_act_are_told_where_others_do(kind: str, tmp_path: Path) -> None:
    """Of a joint with two axes, and of one that closes a loop."""
    ranges = (
        "<limit><lower>-0.4</lower><upper>0.6</upper></limit><dynamics><friction>0.3</friction></dynamics>"
    )
    axis = f"<axis><xyz>1 0 0</xyz>{ranges}</axis>"
    end, sort = ("<link name='end'/>", kind) if kind == "universal" else ("", "revolute")
    more = f"""{end}<joint name="r" type="{sort}"><parent>arm</parent>
      <child>{"end" if end else "tip"}</child>{axis}<axis2><xyz>0 1 0</xyz></axis2></joint>"""
    if not end:
        more = (
            "<link name='tip'/><joint name='p' type='revolute'><parent>world</parent><child>tip</child>"
            f"{axis.replace(ranges, '')}</joint>" + more
        )
    (tmp_path / "p.sdf").write_text(SDF.replace("</model>", more + "</model>"))
    with pytest.warns(rg.ModelWarning):
        mech = rg.load(tmp_path / "p.sdf", limits=True, friction=True)
    assert mech.parts == PARTS
    assert {"limits of joints (r)", "dry friction of joints (r)"} <= set(mech.left_out)


@pytest.mark.parametrize("ratio", [0.05, 0.3, 0.72, 1.0, 1.3, 5.0])
def test_limits_of_mjcf_bounce_as_soft_ones_tend_to(ratio: float) -> None:
    """δ̈ = −δ − 2 ζ δ̇ from δ̇ = 1 until its force vanishes, by SciPy; the way back is its inverse."""

    def force(t: float, s: Array) -> float:
        return float(s[0] + 2.0 * ratio * s[1])

    force.terminal, force.direction = True, -1.0  # type: ignore[attr-defined]
    found = solve_ivp(
        lambda t, s: [s[1], -force(t, s)], (0.0, 99.0), [0.0, 1.0], events=force, rtol=1e-11, atol=1e-13
    )
    e = restitution_of((0.01, ratio))
    assert e == pytest.approx(-found.y_events[0][0, 1], rel=1e-9)
    assert restitution_of((-400.0, -40.0 * ratio)) == pytest.approx(e, rel=1e-12)
    assert solref_of(e)[1] == pytest.approx(ratio, rel=1e-6)


def test_mujocos_limits_bounce_so(tmp_path: Path) -> None:
    """Without gravity, whatever their stiffness, to what its steps leave; and the writer keeps it."""
    text = MJCF.replace("0.02 1e7", "-K -B").replace('frictionloss="0.3" ', "")
    speeds = []
    for stiffness in (1e4, 1e6):
        model = mujoco.MjModel.from_xml_string(
            text.replace("-K", f"-{stiffness}").replace("-B", f"-{2.0 * 0.2 * np.sqrt(stiffness)}")
        )
        model.opt.timestep, model.opt.gravity[:], model.jnt_solimp[:] = 2e-6, 0.0, [0.9999, 0.9999, 1, 0.5, 1]
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = 0.6 - 1e-3, 1.0
        mujoco.mj_step(model, data, 25_000)
        speeds.append(-float(data.qvel[0]))
    (tmp_path / "p.xml").write_text(text.replace("-K -B", "-1e6 -400"))
    mech = rg.load(tmp_path / "p.xml", limits=True)
    (stop,) = mech.parts
    assert isinstance(stop, rg.Stop)
    off = [abs(speed - stop.restitution) for speed in speeds]
    assert max(off) < 3e-4
    (again,) = rg.load(mech.write(tmp_path / "again.xml"), limits=True).parts
    assert isinstance(again, rg.Stop) and again.restitution == pytest.approx(stop.restitution, rel=1e-9)


def test_the_command_line_tells_what_happened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "p.urdf").write_text(URDF)
    given = f"simulate {tmp_path / 'p.urdf'} --limits --friction --q0 0.2 --v0 3 --duration 1 --step 1e-3"
    run = rg.simulate(
        rg.load(tmp_path / "p.urdf", limits=True, friction=True), [0.2], [3.0], duration=1.0, step=1e-3
    )
    assert main(given.split()) == 0
    told = capsys.readouterr().out
    assert re.search(r"happenings +\d × impact", told) and f"{run.dissipated[-1]:.4g} J" in told
    assert main([*given.split(), "--json"]) == 0
    happened = json.loads(capsys.readouterr().out)["happenings"]
    assert [h["time"] for h in happened] == [h.time for h in run.happenings]


def test_parts_go_with_their_mechanism(tmp_path: Path) -> None:
    (tmp_path / "p.urdf").write_text(URDF)
    mech = rg.load(tmp_path / "p.urdf", limits=True, friction=True)
    assert pickle.loads(pickle.dumps(mech)).parts == mech.with_independent(["q"]).parts == PARTS
    for file in ("a.urdf", "a.xml", "a"):
        assert rg.load(mech.write(tmp_path / file), limits=True, friction=True).parts == PARTS


@pytest.mark.filterwarnings("ignore::robust_gcp.PerformanceWarning")
def test_rows_of_a_batch_are_simulations_with_them(tmp_path: Path) -> None:
    (tmp_path / "p.urdf").write_text(URDF)
    mech = rg.load(tmp_path / "p.urdf", limits=True, friction=True)
    one = rg.Simulation(mech, [0.1], [2.0]).step(n=500)
    two, free = (rg.Batch(mech, 2, [0.1], [2.0], joints=joints).step(n=500).q for joints in (None, []))
    assert np.abs(two - one.q).max() < 1e-12 and np.abs(free - one.q).min() > 1e-3


@pytest.mark.parametrize("threads", [1, 3])
def test_many_starts_move_as_if_alone(tmp_path: Path, threads: int) -> None:
    (tmp_path / "p.urdf").write_text(URDF)
    mech = rg.load(tmp_path / "p.urdf", limits=True, friction=True)
    starts = [([0.1], [0.3 * i]) for i in range(12)]
    runs = rg.simulate_many(mech, starts, 0.5, 1e-3, threads=threads)
    assert not runs.errors
    for run, start in zip(runs, starts, strict=True):
        one = rg.simulate(mech, *start, 0.5, 1e-3)
        np.testing.assert_array_equal(run.q, one.q)
        assert run.happenings == one.happenings
    assert sum(len(run.happenings) for run in runs) > 5


def test_what_does_not_know_them_says_so(tmp_path: Path) -> None:
    """Never a motion without the stops that were asked for."""
    (tmp_path / "p.urdf").write_text(URDF)
    mech = rg.load(tmp_path / "p.urdf", limits=True, friction=True)
    for call in (
        lambda: rg.forward_dynamics(mech, [0.1], [0.0]),
        lambda: rg.derivatives(mech, [0.1]),
        lambda: rg.linearise(mech, [0.1]),
    ):
        with pytest.raises(rg.OptionError, match="does not know stops and dry friction"):
            call()
    with pytest.raises(rg.OptionError, match="stops, friction and locks do not go with"):
        rg.simulate(mech, duration=0.1, stepper="DOP853")
    with pytest.raises(rg.OptionError, match="limits = 1 must be True or False"):
        rg.load(tmp_path / "p.urdf", limits=1)  # type: ignore[arg-type]
    assert rg.analyse(mech, [0.1]).local_dof == 1
