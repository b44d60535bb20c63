"""The tasks by MuJoCo's Python interface: loops are soft constraints there, as stiff as the step allows."""

import csv

import mujoco
import numpy as np

# setup
MODEL = """
<mujoco><compiler angle="radian"/>
<option timestep="1e-3" integrator="RK4" gravity="0 0 -9.81"><flag contact="disable"/></option>
<worldbody>
  <body name="crank"><joint name="q1" axis="1 0 0"/>
    <inertial pos="0 0.5 0" mass="1" diaginertia="{a} 1e-9 {a}"/>
    <body name="coupler" pos="0 1 0"><joint name="q2" axis="1 0 0"/>
      <inertial pos="0 1.75 0" mass="1" diaginertia="{b} 1e-9 {b}"/><site name="one" pos="0 3.5 0"/></body></body>
  <body name="rocker" pos="0 4 0"><joint name="q3" axis="1 0 0"/>
    <inertial pos="0 1.5 0" mass="1" diaginertia="{c} 1e-9 {c}"/><site name="two" pos="0 3 0"/></body>
</worldbody>
<equality><connect site1="one" site2="two" solref="-1e5 -6e2" solimp="0.9999 0.9999 1"/></equality>
<actuator><motor joint="q1"/></actuator>
</mujoco>""".format(a=1 / 12, b=3.5**2 / 12, c=0.75)
HOME = [1.0, -0.36105209221293255, 1.7892514033875249]


def started(text=MODEL, q=HOME):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos = q
    mujoco.mj_forward(model, data)
    return model, data


def stepped(model, data, duration=2.0):
    for _ in range(round(duration / model.opt.timestep)):
        mujoco.mj_step(model, data)
        yield data


def simulate():
    *_, data = stepped(*started())
    return data.qpos.copy()


def drive():
    """There is no prescribed motion: a stiff servo follows, and its torque is noisy at first."""
    model, data = started()
    data.qvel = [3, *rates(model, data)]
    torques = []
    for k in range(2001):
        data.ctrl[0] = 1e5 * (1 + 3 * data.time - data.qpos[0]) + 1e3 * (3 - data.qvel[0])
        if k % 10 == 0:
            torques.append(data.ctrl[0])
        mujoco.mj_step(model, data)
    return np.array(torques)


def rates(model, data):
    """The dependent rates for 3 rad/s of the crank."""
    J = data.efc_J.reshape(-1, 3)
    return np.linalg.lstsq(J[:, 1:], -3 * J[:, 0], rcond=None)[0]


def event():
    """There are no events: signs are compared, zeros are interpolated."""
    model, data = started()
    found, before = [], (0.0, 0.0)
    for _ in stepped(model, data):
        if before[1] * data.qvel[2] < 0:
            share = before[1] / (before[1] - data.qvel[2])
            found.append(before[0] + share * (data.time - before[0]))
        before = data.time, data.qvel[2]
    return np.array(found)


def stop():
    before = (0.0, 1.5)
    for data in stepped(*started()):
        here = data.time, data.qpos[0] + 0.5
        if here[1] <= 0:
            share = before[1] / (before[1] - here[1])
            return before[0] + share * (here[0] - before[0])
        before = here
    return np.nan


def pin_force():
    """On the first body of the constraint, in world axes."""
    model, data = started()
    found = [data.efc_force[1:].copy()]
    for k, _ in enumerate(stepped(model, data), start=1):
        if k % 100 == 0:
            mujoco.mj_forward(model, data)
            found.append(data.efc_force[1:].copy())
    return np.array(found)


def frame():
    model, data = started()
    site, found, six = model.site("two").id, [], np.zeros(6)

    def acceleration():
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_SITE, site, six, 0)
        return six[4:] + model.opt.gravity[1:]  # gravity is in it

    found.append(acceleration())
    found += [acceleration() for k, _ in enumerate(stepped(model, data), start=1) if k % 100 == 0]
    return np.array(found)


def export(path):
    model, data = started()
    names = [model.joint(i).name for i in range(3)]
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["t", *names, *(f"v.{name}" for name in names)])
        table.writerow([data.time, *data.qpos, *data.qvel])
        table.writerows([d.time, *d.qpos, *d.qvel] for d in stepped(model, data))


def control():
    model, data = started()
    for _ in range(200):
        data.ctrl[0] = 400 * (2 - data.qpos[0]) - 40 * data.qvel[0]
        mujoco.mj_step(model, data, nstep=10)
    return data.qpos[0]


def sweep():
    """Starts must be closed by the user, here by the closed form."""
    from by_scipy import closed

    found = []
    for crank in np.linspace(0.6, 1.4, 5):
        x = closed(crank)
        *_, data = stepped(*started(q=[x[0], x[1] - x[0], x[2]]))
        found.append(data.qpos[0])
    return np.array(found)


def singular():
    """A rhombus swings through its flat position."""
    unit = MODEL.replace('pos="0 1.75 0"', 'pos="0 0.5 0"').replace('pos="0 1.5 0"', 'pos="0 0.5 0"')
    unit = unit.replace('pos="0 3.5 0"', 'pos="0 1 0"').replace('pos="0 3 0"', 'pos="0 1 0"')
    unit = (
        unit.replace('pos="0 4 0"', 'pos="0 1 0"')
        .replace(f"{3.5**2 / 12}", f"{1 / 12}")
        .replace("0.75", f"{1 / 12}")
    )
    *_, data = stepped(*started(unit, [0.5, -0.5, 0.5]), 5.0)
    return data.qpos[0], abs(data.qpos[0] - data.qpos[2])
