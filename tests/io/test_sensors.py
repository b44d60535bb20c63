"""Keyframes and sensors of MJCF files: MuJoCo's `sensordata` at the same states, or a name in `left_out`."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import null_space

import robust_gcp as rg

Array = NDArray[np.float64]

FRAMES = ("framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis", "framelinvel", "frameangvel")
OWN = ("accelerometer", "gyro", "velocimeter", "magnetometer", "force", "torque")
AMISS = "torque.mast"
"""MuJoCo adds the torques of several trees up about different points."""

ENDS = (("body", "wrist"), ("xbody", "fly"), ("geom", "blade"), ("site", "palm"), ("camera", "eye"))


def every_sensor() -> str:
    """All kinds, on all kinds of objects, with and without a reference, some cut off."""
    made = []
    for k, (what, name) in enumerate(ENDS):
        other = ENDS[(k + 1) % len(ENDS)]
        for kind in FRAMES:
            made.append(f'<{kind} name="{kind}.{what}" objtype="{what}" objname="{name}"/>')
            end = f'reftype="{other[0]}" refname="{other[1]}"'
            made.append(f'<{kind} name="{kind}.{what}.in" objtype="{what}" objname="{name}" {end}/>')
        accelerations = ("framelinacc", "frameangacc")
        made += [f'<{k} name="{k}.{what}" objtype="{what}" objname="{name}"/>' for k in accelerations]
    for site in ("palm", "tip", "shelf", "mast", "own"):
        made += [f'<{kind} name="{kind}.{site}" site="{site}"/>' for kind in OWN]
    for body in ("world", "crank", "coupler", "wrist", "hand", "fly", "lamp", "foot"):
        made += [f'<{k} name="{k}.{body}" body="{body}"/>' for k in ("subtreecom",)]
        made += [f'<{k} name="{k}.{body}" body="{body}"/>' for k in ("subtreelinvel", "subtreeangmom")]
    for joint in ("q1", "q2", "q3", "slide"):
        kinds = ("jointpos", "jointvel", "jointlimitpos", "jointlimitvel")
        made += [f'<{kind} name="{kind}.{joint}" joint="{joint}"/>' for kind in kinds]
    made += [f'<{kind} name="{kind}.ball" joint="ball"/>' for kind in ("ballquat", "ballangvel")]
    made += ['<e_potential name="e_potential"/><e_kinetic name="e_kinetic"/><clock name="clock"/>']
    made += ['<gyro name="cut" site="palm" cutoff="0.3"/><gyro site="tip"/><gyro site="palm"/>']
    return "".join(made)


ROD = '<geom type="capsule" size="0.05" fromto="0 0 0 0 {0} 0.1"/>'
MACHINE = f"""<mujoco model="machine"><compiler angle="radian"/><option magnetic="0.1 -0.2 -0.5">
  <flag contact="disable"/></option>
<worldbody><geom type="box" size="1 1 0.1"/><site name="mast" pos="0 0 1" euler="0.1 0.2 0.3"/>
  <body name="stand" pos="0 0.2 0.3"><geom size="0.2"/><site name="shelf" pos="0.1 0 0" euler="1 0 0"/></body>
  <body name="crank"><joint name="q1" axis="1 0 0" range="-0.5 0.4" stiffness="3" springref="0.2"/>
    {ROD.format(1)}
    <body name="coupler" pos="0 1 0">
      <joint name="q2" axis="1 0 0" armature="0.1" range="-0.3 0.3" margin="0.1"/>
      {ROD.format(1.2)}<site name="tip" pos="0 0.5 0.1" euler="0.4 0.5 0.6"/>
      <body name="wrist" pos="0.1 0.5 0.2" euler="0.3 0.2 0.1">
        <geom name="blade" type="box" size="0.1 0.2 0.3" pos="0.05 0 0.1" euler="0.2 0.3 0.4"/>
        <site name="palm" pos="0.1 0.2 0" euler="0.5 0.1 0.7"/>
        <camera name="eye" pos="0 0.1 0" euler="0.1 0.1 0.2"/>
        <body name="hand" pos="0.2 0 0"><joint name="ball" type="ball" range="0 0.4" damping="0.1"/>
          <geom type="box" size="0.1 0.05 0.2" pos="0.1 0 0.1"/><site name="own" pos="0.1 0.1 0.1"/>
        </body></body></body></body>
  <body name="rocker" pos="0 1.1 0"><joint name="q3" axis="1 0 0" range="-2 2"/>{ROD.format(1.1)}</body>
  <body name="fly" pos="1 2 3" euler="0.4 0.5 0.6"><freejoint name="root"/>
    <geom type="box" size="0.1 0.2 0.3"/>
    <body name="lamp" pos="0 0 0.4" euler="0.1 0 0"><geom size="0.1"/>
      <body name="foot" pos="0.1 0 0"><joint name="slide" type="slide" axis="1 2 3" range="-0.1 0.1"/>
      <joint name="swing" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body></body></body></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="0 1.1 0.1"/>
  <connect body1="hand" body2="fly" anchor="0.1 0.2 0.1"/></equality>
<keyframe><key name="stand" qpos="0.3 -0.1 1 0 0 0 0.25 1 2 3 0 1 0 0 0.02 0.1"
  qvel="1 0 0 0 1 0.5 1 2 3 0.1 0.2 0.3 0.4 0.5"/><key/>
  <key name="rest" qpos="0 0 1 0 0 0 0 1 2 3 1 0 0 0 0 0"/></keyframe>
<sensor>{every_sensor()}</sensor></mujoco>"""


def their_state(mech: rg.Mechanism, m: Any, d: Any, q: Array, v: Array, a: Array) -> None:
    """The same state in MuJoCo's numbers: scalars first, a free body's linear velocity in the world."""
    for j in range(m.njnt):
        joint = mech.joints[j]  # in the same order
        at, dof = m.jnt_qposadr[j], m.jnt_dofadr[j]
        numbers, rates, acc = (
            q[joint.idx_q :][: joint.nq].copy(),
            v[joint.idx_v :][: joint.nv].copy(),
            a[joint.idx_v :][: joint.nv].copy(),
        )
        if joint.nq > 1:
            numbers[-4:] = np.roll(numbers[-4:], 1)
        if joint.nv == 6:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, numbers[3:])
            acc[:3] = turn.reshape(3, 3) @ (acc[:3] + np.cross(rates[3:], rates[:3]))
            rates[:3] = turn.reshape(3, 3) @ rates[:3]
        d.qpos[at : at + joint.nq], d.qvel[dof : dof + joint.nv] = numbers, rates
        d.qacc[dof : dof + joint.nv] = acc


def their_answers(
    mech: rg.Mechanism, m: Any, q: Array, v: Array, a: Array, t: float = 0.0
) -> dict[str, Array]:
    """`sensordata` with our accelerations, and the constraint forces that balance them."""
    d = mujoco.MjData(m)
    their_state(mech, m, d, q, v, a)
    d.time = t
    mujoco.mj_forward(m, d)
    their_state(mech, m, d, q, v, a)
    inertial = np.zeros(m.nv)
    mujoco.mj_mulM(m, d, inertial, d.qacc)
    ties = np.flatnonzero(d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    J = d.efc_J.reshape(-1, m.nv)[ties]
    needed = inertial + d.qfrc_bias - d.qfrc_passive
    d.efc_force[:] = 0.0
    d.efc_force[ties] = np.linalg.lstsq(J.T, needed, rcond=1e-10)[0] if len(ties) else 0.0
    assert np.abs(J.T @ d.efc_force[ties] - needed).max() < 1e-7 * (1.0 + np.abs(needed).max())
    mujoco.mj_rnePostConstraint(m, d)
    mujoco.mj_sensorAcc(m, d)
    return {
        m.sensor(i).name: d.sensordata[m.sensor_adr[i] :][: m.sensor_dim[i]].copy() for i in range(m.nsensor)
    }


def closed_states(mech: rg.Mechanism, count: int, seed: int = 0) -> list[tuple[Array, Array, Array]]:
    """Random closed configurations, velocities with K v = 0, and the accelerations of free motion."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        q = mech.tree.integrate(mech.home, rng.uniform(-0.4, 0.4, mech.nv))
        q = mech.assemble(q, hold=()) if mech.nc else q
        free = null_space(mech.K(q), rcond=1e-9) if mech.nc else np.eye(mech.nv)
        v = free @ rng.normal(size=free.shape[1])
        found.append((q, v, rg.implicit_dynamics(mech, q, v)[0]))
    return found


def require_equal(mech: rg.Mechanism, m: Any, states: list[tuple[Array, Array, Array]]) -> dict[str, float]:
    """Each sensor at each state; the largest relative difference by what the kind depends on."""
    largest: dict[str, float] = {}
    for q, v, a in states:
        theirs = their_answers(mech, m, q, v, a, 1.5)
        for name, sensor in mech.sensors.items():
            if name not in theirs or name == AMISS:  # unnamed ones
                continue
            ours, expected = mech.sense(name, q, v, a, t=1.5), theirs[name]
            if sensor.kind == "framequat":
                expected = expected * np.sign(expected @ ours)
            size = 1.0 + np.abs(expected).max()
            error = float(np.abs(ours - expected).max() / size)
            assert error < (1e-10 if sensor.needs in "qva" else 1e-8), (name, ours, expected)
            largest[sensor.needs] = max(largest.get(sensor.needs, 0.0), error)
    return largest


@pytest.fixture(scope="module")
def machine() -> rg.Mechanism:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return rg.Mechanism.from_mjcf(MACHINE)


def test_sensors_read_what_mujoco_reads(machine: rg.Mechanism) -> None:
    m = mujoco.MjModel.from_xml_string(MACHINE)
    assert len(machine.sensors) == m.nsensor
    assert not any(part.startswith("sensors") for part in machine.left_out)
    require_equal(machine, m, closed_states(machine, 5))


WALKER = """<mujoco model="walker"><compiler angle="degree" autolimits="true"/>
<option timestep="0.0025"><flag contact="disable"/></option><statistic extent="2"/>
<default><joint damping="0.1" armature="0.01" limited="true"/><geom density="1000" friction="0.7"/>
  <default class="leg"><joint axis="0 -1 0" range="-30 100"/><geom type="capsule" size="0.05"/></default>
</default>
<worldbody><light name="light" pos="0 0 2"/><geom name="floor" type="plane" size="40 40 0.2"/>
  <body name="torso" pos="0 0 1.3">
    <joint name="rootz" type="slide" axis="0 0 1" limited="false" armature="0"/>
    <joint name="rootx" type="slide" axis="1 0 0" limited="false" armature="0"/>
    <joint name="rooty" type="hinge" axis="0 1 0" limited="false" armature="0"/>
    <geom name="torso" type="capsule" size="0.07 0.3"/><site name="torso_site"/>
    <body name="right_thigh" pos="0 -0.05 -0.3" childclass="leg"><joint name="right_hip"/>
      <geom name="right_thigh" fromto="0 0 0 0 0 -0.45"/>
      <body name="right_leg" pos="0 0 -0.7"><joint name="right_knee" pos="0 0 0.25" range="-150 0"/>
        <geom name="right_leg" fromto="0 0 0.25 0 0 -0.25"/><site name="right_foot" pos="0 0 -0.25"/>
      </body></body>
    <body name="left_thigh" pos="0 0.05 -0.3" childclass="leg"><joint name="left_hip"/>
      <geom name="left_thigh" fromto="0 0 0 0 0 -0.45"/></body></body></worldbody>
<actuator><motor name="hip" joint="right_hip" gear="100" ctrlrange="-1 1"/></actuator>
<sensor><subtreelinvel name="torso_subtreelinvel" body="torso"/><framezaxis objtype="xbody" objname="torso"
    name="upright"/><velocimeter name="v" site="torso_site"/><gyro name="w" site="right_foot"/>
  <accelerometer name="a" site="right_foot"/><subtreeangmom name="h" body="right_thigh"/>
  <jointlimitpos name="knee" joint="right_knee"/><force name="ground" site="right_foot"/><e_kinetic name="T"/>
  <framelinvel name="foot" objtype="site" objname="right_foot" reftype="body" refname="torso"/>
  <touch name="sole" site="right_foot"/><actuatorpos name="drive" actuator="hip"/></sensor></mujoco>"""


def test_a_walker_as_reinforcement_learning_has_it() -> None:
    """Classes of defaults, degrees, joints off their bodies' origins; what needs contacts is told."""
    with pytest.warns(rg.ModelWarning, match=r"sensors \(sole\)"):
        mech = rg.Mechanism.from_mjcf(WALKER)
    require_equal(mech, mujoco.MjModel.from_xml_string(WALKER), closed_states(mech, 5))


def test_a_cut_through_welded_bodies_is_part_of_a_body(machine: rg.Mechanism) -> None:
    """The palm's force carries the wrist and the hand, not the coupler that the wrist is welded to."""
    branch = machine.sensors["force.palm"].branch
    assert branch is not None
    assert (branch.joint, branch.joints, branch.frames) == ("q2", ("ball",), ("wrist", "palm"))
    assert branch.inertia[0] == pytest.approx(8 * 0.1 * 0.2 * 0.3 * 1000.0)


def test_the_ground_carries_all(machine: rg.Mechanism) -> None:
    """Its force is the rate of all momentum less all weight, its torque about the world's origin alike."""
    q, v, _ = closed_states(machine, 1)[0]
    h = 1e-5
    run = rg.simulate(machine, q, v, duration=4 * h, step=h, record=("multipliers", "a"))
    m = mujoco.MjModel.from_xml_string(MACHINE)
    mass = m.body_mass.sum()
    force, torque = (run[f"sensor.{kind}.mast"][2] for kind in ("force", "torque"))
    momentum = mass * run["sensor.subtreelinvel.world"]
    spin = run["sensor.subtreeangmom.world"] + np.cross(run["sensor.subtreecom.world"], momentum)
    weight = np.array([0.0, 0.0, -9.81]) * mass
    at, R = m.site("mast").pos, np.zeros(9)
    mujoco.mju_quat2Mat(R, m.site("mast").quat)
    R = R.reshape(3, 3)
    needed = (momentum[3] - momentum[1]) / (2 * h) - weight
    about = (spin[3] - spin[1]) / (2 * h) - np.cross(run["sensor.subtreecom.world"][2], weight)
    np.testing.assert_allclose(R @ force, needed, atol=1e-4)
    np.testing.assert_allclose(R @ torque, about - np.cross(at, needed), atol=1e-4)


def test_along_a_run_and_at_a_step(machine: rg.Mechanism) -> None:
    """Each sensor by name, in other coordinates, from a pickle and from a file: the same numbers."""
    q, v, _ = closed_states(machine, 1)[0]
    record = ("multipliers", "a")
    run = rg.simulate(machine, q, v, duration=0.01, step=1e-3, record=record)
    sim = rg.Simulation(machine, q, v, step=1e-3).step(n=10)
    other = machine.with_independent(["q1", *machine.independent[1:]])
    again = rg.simulate(other, q, v, duration=0.01, step=1e-3, record=record)
    copy = pickle.loads(pickle.dumps(machine))
    for name, sensor in machine.sensors.items():
        along = run[f"sensor.{name}"]
        assert along.shape == (11, sensor.dim)
        size = 1e-8 * (1.0 + np.abs(along).max())
        np.testing.assert_allclose(again[f"sensor.{name}"], along, atol=size, err_msg=name)
        np.testing.assert_allclose(sim[f"sensor.{name}"], along[-1], atol=size, err_msg=name)
        np.testing.assert_allclose(copy.sense(name, run.q[-1], run.v[-1], t=run.t[-1]), along[-1], atol=size)
        if sensor.needs == "q":
            np.testing.assert_allclose(run.at(run.t[3])[f"sensor.{name}"], along[3], atol=1e-12)
    assert run.at([0.001, 0.002])["sensor.clock"].tolist() == [[0.001], [0.002]]


def test_a_file_of_a_run_keeps_sensors_and_keyframes(machine: rg.Mechanism, tmp_path: Path) -> None:
    run = rg.simulate(machine, duration=0.003, step=1e-3, record=("multipliers", "a"))
    back = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert back.mechanism.sensors == machine.sensors
    for name in machine.sensors:
        np.testing.assert_allclose(back[f"sensor.{name}"], run[f"sensor.{name}"], atol=1e-12)
    for name, key in machine.keyframes.items():
        kept = back.mechanism.keyframes[name]
        np.testing.assert_array_equal(kept.q, key.q)
        np.testing.assert_array_equal(kept.v, key.v)
        assert (kept.closed, kept.open) == (key.closed, key.open)


def test_a_force_sensor_on_a_body_reads_its_joints_reaction(machine: rg.Mechanism) -> None:
    """With a wrench from outside: what the joint of the tree transmits, in the sensor's axes."""
    pull = [
        rg.Wrench("palm", [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]),
        rg.Wrench("tip", [5.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
    ]
    run = rg.simulate(machine, duration=0.01, step=1e-3, wrenches=pull, record=("multipliers", "a"))
    place, carried = run.frame("tip"), run.reaction("q2")
    joint = run.frame("q2").position
    turned = np.swapaxes(place.rotation, 1, 2)
    force = np.einsum("nij,nj->ni", turned, carried.force)
    about = carried.moment + np.cross(joint - place.position, carried.force)
    np.testing.assert_allclose(run["sensor.force.tip"], force, atol=1e-9)
    np.testing.assert_allclose(run["sensor.torque.tip"], np.einsum("nij,nj->ni", turned, about), atol=1e-9)
    sim = rg.Simulation(machine, step=1e-3, wrenches=pull).step(n=10)
    force = sim.frame("tip").rotation.T @ sim.reaction("q2").force
    np.testing.assert_allclose(sim["sensor.force.tip"], force, atol=1e-9)
    free = rg.simulate(machine, duration=0.01, step=1e-3, record=("multipliers", "a"))
    assert np.abs(free["sensor.force.palm"] - run["sensor.force.palm"]).max() > 0.5


PENDULUM = """<mujoco><option><flag contact="disable"/></option>
<worldbody><body name="arm"><joint name="q" axis="0 1 0"/>
<geom size="0.1" pos="1 0 0"/><site name="s" pos="0.5 0 0"/></body></worldbody>{}</mujoco>"""


def pendulum(sensors: str, more: str = "") -> rg.Mechanism:
    return rg.Mechanism.from_mjcf(PENDULUM.format(f"<sensor>{sensors}</sensor>{more}"))


def test_what_is_not_answered_is_left_out_by_name() -> None:
    others = '<touch name="skin" site="s"/><rangefinder site="s"/><user name="own" dim="2"/>'
    with pytest.warns(rg.ModelWarning, match=r"sensors \(skin, s, own\)"):
        mech = pendulum('<gyro name="imu" site="s"/>' + others)
    assert list(mech.sensors) == ["imu"]
    assert mech.left_out == ("sensors (skin, s, own)",)
    with pytest.raises(rg.ModelError, match="strict"):
        rg.Mechanism.from_mjcf(PENDULUM.format(f"<sensor>{others}</sensor>"), strict=True)


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "sensor_delay"), reason="MuJoCo without delays of sensors")
def test_a_sensor_that_tells_of_the_past_is_left_out() -> None:
    with pytest.warns(rg.ModelWarning, match=r"sensors \(late\)"):
        mech = pendulum('<gyro name="late" site="s" delay="0.1" nsample="20"/><gyro name="now" site="s"/>')
    assert list(mech.sensors) == ["now"]


def test_names_that_are_not_there_are_told() -> None:
    mech = pendulum('<gyro name="imu" site="s"/><gyro site="s"/><gyro site="s"/>')
    assert list(mech.sensors) == ["imu", "gyro", "gyro2"]
    run = rg.simulate(mech, duration=0.01, step=1e-3)
    with pytest.raises(rg.ModelError, match=r"no sensor 'imo'.*imu"):
        run["sensor.imo"]
    with pytest.raises(rg.OptionError, match="sensors are not drawn"):
        run.plot("sensor.imu")
    with pytest.raises(rg.ModelError, match="no sensor"):
        mech.sense("touch", [0.0])
    with pytest.raises(rg.ModelError, match=r"no keyframe 'home'; it has none"):
        mech.keyframes["home"]


def test_a_force_needs_what_was_recorded(machine: rg.Mechanism) -> None:
    run = rg.simulate(machine, duration=0.003, step=1e-3)
    with pytest.raises(rg.OptionError, match="multipliers"):
        run["sensor.force.tip"]
    with pytest.raises(
        rg.OptionError, match=r'at the times of the run alone: ask run\["sensor\.force\.tip"\]'
    ):
        run.at(0.001)["sensor.force.tip"]
    assert run["sensor.accelerometer.tip"].shape == (4, 3)  # accelerations are estimated


def test_an_accelerometer_at_rest_reads_gravity_upwards() -> None:
    mech = pendulum('<accelerometer name="imu" site="s"/><clock name="t" cutoff="0.5"/>')
    np.testing.assert_allclose(mech.sense("imu", [0.0], a=[0.0]), [0.0, 0.0, 9.81], atol=1e-15)
    assert mech.sense("t", [0.0], t=3.0).tolist() == [0.5]  # cut off


# --------------------------------------------------------------------------- keyframes


def test_keyframes_are_closed_states(machine: rg.Mechanism) -> None:
    """Digits of files are closed; what is open by more is given as it is, and says so."""
    assert list(machine.keyframes) == ["stand", "key1", "rest"]
    stand = machine.keyframes["stand"]
    assert not stand.closed and stand.open > 0.01
    m = mujoco.MjModel.from_xml_string(MACHINE)
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    mujoco.mj_kinematics(m, d)
    mujoco.mj_comPos(m, d)
    mujoco.mj_comVel(m, d)
    for name, where in (("lamp", "lamp"), ("foot", "foot")):
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, m.body(where).id, velocity, 0)
        ours = rg.Trajectory(machine, np.zeros(1), stand.q[None], stand.v[None], np.zeros((1, machine.nv)))
        np.testing.assert_allclose(ours.frame(name).velocity[0], velocity[3:], atol=1e-12)
        np.testing.assert_allclose(ours.frame(name).angular_velocity[0], velocity[:3], atol=1e-12)


ROUNDED = """<mujoco><option><flag contact="disable"/></option><worldbody>
<body name="a"><joint name="q1" axis="1 0 0"/><geom type="capsule" size="0.05" fromto="0 0 0 0 1 0"/>
  <body name="b" pos="0 1 0"><joint name="q2" axis="1 0 0"/>
    <geom type="capsule" size="0.05" fromto="0 0 0 0 1 0"/></body></body>
<body name="c" pos="0 1 0"><joint name="q3" axis="1 0 0"/>
  <geom type="capsule" size="0.05" fromto="0 0 0 0 1 0"/></body></worldbody>
<equality><connect body1="b" body2="c" anchor="0 1 0"/></equality>
<keyframe><key name="near" qpos="0.3 -0.301 0.3" qvel="1 0 0"/>
<key name="far" qpos="1 1 1"/></keyframe></mujoco>"""


def test_keyframes_without_names_have_their_own() -> None:
    keys = '<keyframe><key/><key name="key0" qpos="1"/><key qpos="2"/></keyframe>'
    assert {name: key.q[0] for name, key in pendulum("", keys).keyframes.items()} == {
        "key0_0": 0.0, "key0": 1.0, "key2": 2.0,
    }  # fmt: skip


def test_a_keyframe_with_few_digits_is_closed() -> None:
    mech = rg.Mechanism.from_mjcf(ROUNDED, ["q1"], home="near")
    key, far = mech.keyframes["near"], mech.keyframes["far"]
    assert key.closed and 1e-4 < key.open < 1e-2
    assert mech.closure_residual(key.q) < 1e-12
    np.testing.assert_allclose(key.q, [0.3, -0.301, 0.3], atol=2e-3)
    np.testing.assert_allclose(mech.K(key.q) @ key.v, 0.0, atol=1e-12)
    np.testing.assert_allclose(key.v, key.v[0] * np.array([1.0, -1.0, 1.0]), atol=1e-12)  # a parallelogram
    assert 0.3 < key.v[0] < 1.0  # part of the file's (1, 0, 0)
    assert not far.closed and far.q.tolist() == [1.0, 1.0, 1.0]
    run = rg.simulate(mech, key.q, key.v, duration=0.01, step=1e-3)
    assert run.closure_error().max() < 1e-12
    other = mech.with_independent(["q3"])
    assert other.keyframes is mech.keyframes
    assert "open by" in repr(far) and "closed" in repr(key)


def test_keyframes_are_written_and_read_back(machine: rg.Mechanism, tmp_path: Path) -> None:
    """As MJCF with their configurations; velocities and sensors are told to be lost."""
    mech = rg.Mechanism.from_mjcf(ROUNDED, ["q1"], home="near")
    with pytest.warns(rg.ModelWarning, match=r"velocities of keyframes \(near\)"):
        path = mech.write(tmp_path / "rounded.xml")
    back = rg.load(path)
    assert list(back.keyframes) == ["home", "near", "far"]
    for name, key in mech.keyframes.items():
        np.testing.assert_allclose(back.keyframes[name].q, key.q, atol=1e-12)
    with pytest.warns(rg.ModelWarning, match=r"sensors \(.*keyframes \(near, far\)|keyframes \(near, far\)"):
        mech.write(tmp_path / "rounded.urdf")
    with pytest.warns(rg.ModelWarning, match=r"sensors \(framepos.body"):
        machine.write(tmp_path / "machine.xml")
