"""Sensors of actuators, tendons and limits: MuJoCo's `sensordata` at the same states, or left out by name."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

from .test_sensors import closed_states, their_state

Array = NDArray[np.float64]

SENSORS = "".join(
    [
        *(
            f'<{kind} name="{kind}.{a}" actuator="{a}"/>'
            for kind in ("actuatorpos", "actuatorvel", "actuatorfrc")
            for a in ("spin", "servo", "winch", "cord", "thrust", "turn", "lag", "muscle")
        ),
        *(
            f'<jointactuatorfrc name="jointactuatorfrc.{j}" joint="{j}"/>'
            for j in ("q1", "q2", "q3", "rail", "wheel")
        ),
        *(
            f'<{kind} name="{kind}.{t}" tendon="{t}"/>'
            for kind in ("tendonpos", "tendonvel", "tendonactuatorfrc")
            for t in ("split", "rope", "bound")
        ),
        *(f'<{kind} name="{kind}" tendon="bound"/>' for kind in ("tendonlimitpos", "tendonlimitvel")),
        '<actuatorfrc name="cut" actuator="spin" cutoff="0.1"/>',
    ]
)
ROD = '<geom type="capsule" size="0.05" fromto="0 0 0 0 {0} 0.1"/>'
BODIES = f"""<worldbody><site name="post" pos="0.2 0 1"/>
  <body name="crank"><joint name="q1" axis="1 0 0" actuatorfrcrange="-0.5 0.5"/>{ROD.format(1)}
    <body name="coupler" pos="0 1 0"><joint name="q2" axis="1 0 0"/>{ROD.format(1.2)}
      <site name="tip" pos="0 0.5 0.1" euler="0.4 0.5 0.6"/>
      <body name="hand" pos="0.2 0 0"><joint name="ball" type="ball"/>
        <geom type="box" size="0.1 0.05 0.2" pos="0.1 0 0.1"/></body></body></body>
  <body name="rocker" pos="0 1.1 0"><joint name="q3" axis="1 0 0"/>{ROD.format(1.1)}</body>
  <body name="cart" pos="0 0 2"><joint name="rail" type="slide" axis="1 0 0"/><geom size="0.1"/>
    <site name="hook" pos="0 0.1 0"/>
    <body name="disc"><joint name="wheel" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/></body></body>
</worldbody>"""
MACHINE = f"""<mujoco model="machine"><compiler angle="radian"/><option><flag contact="disable"/></option>
{BODIES}
<tendon><fixed name="split"><joint joint="rail" coef="0.5"/><joint joint="wheel" coef="-0.2"/></fixed>
  <fixed name="bound" range="-0.05 0.05" margin="0.01"><joint joint="wheel" coef="0.3"/></fixed>
  <spatial name="rope"><site site="post"/><site site="hook"/></spatial></tendon>
<equality><connect body1="coupler" body2="rocker" anchor="0 1.2 0.1"/></equality>
<actuator><motor name="spin" joint="q1" gear="2" ctrlrange="-1 1"/>
  <position name="servo" joint="rail" kp="30" kv="2" forcerange="-5 5"/>
  <velocity name="winch" tendon="split" kv="3" gear="1.5"/><motor name="cord" tendon="rope"/>
  <motor name="thrust" site="tip" gear="1 2 3 0.1 0.2 0.3"/><motor name="turn" joint="ball" gear="1 2 3"/>
  <general name="lag" tendon="split" dyntype="filter" dynprm="0.1" gainprm="4"/>
  <muscle name="muscle" joint="wheel" lengthrange="-1 1" force="30"/></actuator>
<sensor>{SENSORS}</sensor></mujoco>"""
CTRL = {"spin": 1.7, "servo": -0.3, "winch": 0.2, "cord": -2.0, "thrust": 0.7, "turn": 1.1}
ACTIVE = {"lag": 0.35, "muscle": 0.6}


@pytest.fixture(scope="module")
def machine() -> rg.Mechanism:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return rg.Mechanism.from_mjcf(MACHINE)


def theirs(mech: rg.Mechanism, m: Any, q: Array, v: Array, ctrl: dict[str, float]) -> dict[str, Array]:
    d = mujoco.MjData(m)
    their_state(mech, m, d, q, v, np.zeros(mech.nv))
    for name, value in ctrl.items():
        a = m.actuator(name).id
        if m.actuator_dyntype[a]:
            d.act[m.actuator_actadr[a]] = value
        else:
            d.ctrl[a] = value
    mujoco.mj_forward(m, d)
    return {
        m.sensor(i).name: d.sensordata[m.sensor_adr[i] :][: m.sensor_dim[i]].copy() for i in range(m.nsensor)
    }


def test_they_read_what_mujoco_reads(machine: rg.Mechanism) -> None:
    m = mujoco.MjModel.from_xml_string(MACHINE)
    assert list(machine.sensors) == [m.sensor(i).name for i in range(m.nsensor)]
    read: dict[str, float] = {}
    for q, v, _ in closed_states(machine, 6):
        expected = theirs(machine, m, q, v, CTRL | ACTIVE)
        for name in machine.sensors:
            ours = machine.sense(name, q, v, ctrl=CTRL | ACTIVE)
            np.testing.assert_allclose(ours, expected[name], rtol=1e-10, atol=1e-10, err_msg=name)
            read[name] = max(read.get(name, 0.0), float(np.abs(ours).max()))
    idle = {"actuatorpos.thrust", "tendonactuatorfrc.bound", "jointactuatorfrc.q3"}  # zero in MuJoCo too
    assert {name for name, most in read.items() if most == 0.0} == idle


def test_along_a_run_and_at_a_step(machine: rg.Mechanism, tmp_path: Path) -> None:
    """Each by name, in other coordinates, from a pickle and from a file: the same numbers."""
    q, v, _ = closed_states(machine, 1)[0]
    ctrl = CTRL | {"lag": 0.5, "muscle": 1.0}
    run = rg.simulate(machine, q, v, duration=0.01, step=1e-3, ctrl=ctrl)
    sim = rg.Simulation(machine, q, v, step=1e-3, ctrl=ctrl).step(n=10)
    other = rg.simulate(
        machine.with_independent(["q2", *machine.independent[1:]]), q, v, duration=0.01, step=1e-3, ctrl=ctrl
    )
    m, back = mujoco.MjModel.from_xml_string(MACHINE), rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert run.u is not None
    active = {name: run[f"activation.{name}"] for name in ACTIVE}
    for k in (0, 4, 10):
        now = ctrl | {name: values[k] for name, values in active.items()}
        expected = theirs(machine, m, run.q[k], run.v[k], now)
        for name, sensor in machine.sensors.items():
            along = run[f"sensor.{name}"]
            assert along.shape == (11, sensor.dim)
            np.testing.assert_allclose(along[k], expected[name], rtol=1e-10, atol=1e-10, err_msg=name)
            np.testing.assert_array_equal(back[f"sensor.{name}"], along)
            np.testing.assert_allclose(other[f"sensor.{name}"], along, rtol=1e-8, atol=1e-8)
    run = rg.simulate(machine, q, v, duration=0.01, step=1e-3, ctrl=ctrl, hold=True)
    for name in machine.sensors:
        np.testing.assert_allclose(sim[f"sensor.{name}"], run[f"sensor.{name}"][-1], rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(run["sensor.actuatorfrc.cord"][:, 0], run["actuator.cord"])
    assert pickle.loads(pickle.dumps(machine)).sensors == machine.sensors
    with pytest.raises(rg.OptionError, match=r"controls .* are known at the times of the run"):
        run.at(0.0015)["sensor.actuatorfrc.spin"]
    assert run.at(0.004)["sensor.tendonpos.rope"] == pytest.approx(run["tendon.rope"][4], abs=1e-12)


def test_actuators_without_power_push_nothing(machine: rg.Mechanism) -> None:
    run = rg.simulate(machine, duration=2e-3, step=1e-3)
    assert not run["sensor.actuatorfrc.servo"].any() and not run["sensor.jointactuatorfrc.rail"].any()
    assert not machine.sense("tendonactuatorfrc.split", machine.home).any()


def test_what_depends_on_the_motion_feels_the_controls() -> None:
    sensors = '<accelerometer name="a" site="s"/><torque name="t" site="s"/>'
    mech = rg.Mechanism.from_mjcf(
        f"""<mujoco><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>
        <body><joint name="q" axis="0 1 0"/><geom size="0.1" pos="1 0 0" mass="2"/><site name="s"/></body>
        </worldbody><actuator><motor name="m" joint="q"/></actuator><sensor>{sensors}</sensor></mujoco>"""
    )
    inertia = 2.0 * (1.0 + 0.4 * 0.1**2)
    np.testing.assert_allclose(mech.sense("t", [0.0], ctrl={"m": 3.0}), [0.0, 3.0, 0.0], atol=1e-12)
    a = mech.sense("t", [0.0], a=[3.0 / inertia], ctrl=[3.0])
    np.testing.assert_allclose(a, [0.0, 3.0, 0.0], atol=1e-12)
    with pytest.raises(rg.OptionError, match="no actuator 'n'"):
        mech.sense("t", [0.0], ctrl={"n": 1.0})


STOPPED = """<mujoco><compiler angle="radian"/><option><flag contact="disable"/></option><worldbody>
<body><joint name="q" axis="0 1 0" range="-4 {upper}" limited="true" solreflimit="0.002 1" {margin}/>
  <geom size="0.1" pos="1 0 0"/></body>
<body pos="0 1 0"><joint name="free" axis="0 1 0"/><geom size="0.1" pos="1 0 0"/></body>
<body pos="0 2 0"><joint name="rail" type="slide" axis="0 0 1"/><geom size="0.1" mass="2"/></body>
<body pos="0 3 0"><joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1" mass="1"/></body></worldbody>
<tendon><fixed name="t" range="0.1 4" limited="true" solreflimit="0.002 1"><joint joint="rail" coef="0.5"/>
  <joint joint="lift" coef="0.25"/></fixed></tendon>
<sensor><jointlimitfrc name="stop" joint="q"/>
<tendonlimitfrc name="taut" tendon="t"/></sensor></mujoco>"""


def test_forces_of_limits_are_those_of_rigid_stops(tmp_path: Path) -> None:
    """At rest at them MuJoCo's soft limits push as the rigid stops do."""
    path = tmp_path / "stopped.xml"
    path.write_text(STOPPED.format(upper=0.3, margin=""))
    mech = rg.load(path, limits=True)
    assert not any("sensors" in part for part in mech.left_out)
    run = rg.simulate(mech, [0.3, 0.0, 0.2, 0.0], duration=0.5, step=1e-3)
    sim = rg.Simulation(mech, [0.3, 0.0, 0.2, 0.0], step=1e-3).step(n=500)
    m = mujoco.MjModel.from_xml_path(str(path))
    weight = m.body_mass[1] * 9.81
    np.testing.assert_allclose(run["sensor.stop"][1:, 0], weight * np.cos(0.3), rtol=1e-10)
    np.testing.assert_allclose(run["sensor.taut"][1:, 0], 2.0 * 9.81 / 0.5, rtol=1e-10)
    np.testing.assert_allclose(sim["sensor.taut"], run["sensor.taut"][-1], rtol=1e-6)
    d = mujoco.MjData(m)
    d.qpos[:] = [0.3, 0.0, 0.2, 0.0]
    m.opt.timestep = 1e-4
    for _ in range(5000):
        mujoco.mj_step(m, d)
    mujoco.mj_forward(m, d)
    theirs = dict(zip(("stop", "taut"), d.sensordata, strict=True))
    for name in theirs:
        assert run[f"sensor.{name}"][-1, 0] == pytest.approx(theirs[name], rel=2e-3, abs=1e-9)
    back = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(back["sensor.stop"], run["sensor.stop"])


def test_a_limit_that_no_stop_stands_for_has_no_force(tmp_path: Path) -> None:
    path = tmp_path / "stopped.xml"
    path.write_text(STOPPED.format(upper=0.3, margin=""))
    with pytest.warns(rg.ModelWarning, match="limits of joints"):
        mech = rg.load(path)
    run = rg.simulate(mech, duration=2e-3, step=1e-3)
    with pytest.raises(rg.OptionError, match=r"'stop'.*limits=True"):
        run["sensor.stop"]
    with pytest.raises(rg.OptionError, match=r"'stop'.*limits=True"):
        mech.sense("stop", mech.home)
    stopped = rg.load(path, limits=True)
    run = rg.simulate(stopped, duration=2e-3, step=1e-3, joints=[])
    with pytest.raises(rg.OptionError, match=r"'stop'.*joints="):
        run["sensor.stop"]
    with pytest.raises(rg.OptionError, match="along a run"):
        stopped.sense("stop", stopped.home)
    path.write_text(STOPPED.format(upper=0.3, margin="").replace("<flag", '<flag limit="disable"'))
    run = rg.simulate(rg.load(path), duration=2e-3, step=1e-3)
    assert not run["sensor.stop"].any() and not run["sensor.taut"].any()
    path.write_text(STOPPED.format(upper=0.3, margin='margin="0.1"'))
    with pytest.warns(rg.ModelWarning, match=r"sensors \(stop\)"):
        rg.load(path, limits=True)


def test_what_left_out_actuators_do_is_left_out() -> None:
    """Of an adhesion nothing is known, nor what acts on joints beside it, nor limits of ropes and balls."""
    adhesive = MACHINE.replace(
        "</actuator>", '<adhesion name="glue" body="hand" ctrlrange="0 1"/></actuator>'
    )
    adhesive = adhesive.replace("<sensor>", '<sensor><actuatorfrc name="stuck" actuator="glue"/>')
    adhesive = adhesive.replace('name="rope"', 'name="rope" range="0 9" limited="true"')
    adhesive = adhesive.replace("</sensor>", '<tendonlimitfrc name="slack" tendon="rope"/></sensor>')
    with pytest.warns(rg.ModelWarning, match="sensors"):
        mech = rg.Mechanism.from_mjcf(adhesive)
    (told,) = (part for part in mech.left_out if part.startswith("sensors"))
    assert told == "sensors (stuck, jointactuatorfrc.q1, jointactuatorfrc.q2, jointactuatorfrc.q3, " + (
        "jointactuatorfrc.rail, jointactuatorfrc.wheel, slack)"
    )
