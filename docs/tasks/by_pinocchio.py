"""The tasks by Pinocchio's constrained dynamics, with RK4 and Baumgarte's gains of one's own."""

import csv

import numpy as np
import pinocchio as pin


# setup
def closed_loop(urdf):
    model = pin.buildModelFromUrdf(str(urdf))
    one, two = (model.frames[model.getFrameId(name)] for name in ("coupler_tip", "rocker_tip"))
    ends = (one.parentJoint, one.placement, two.parentJoint, two.placement)
    loop = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.LOCAL)
    loop.m_baumgarte_parameters.Kp, loop.m_baumgarte_parameters.Kd = 1e2, 2e1
    loops, kept = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    loops.append(loop)
    kept.append(loop.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, loops, kept)
    return model, data, loops, kept


def acceleration(robot, q, v, tau=None):
    model, data, loops, kept = robot
    settings = pin.ProximalSettings(1e-12, 1e-10, 20)  # mu = 0 is singular on a planar loop
    tau = np.zeros(model.nv) if tau is None else tau
    return pin.constraintDynamics(model, data, q, v, tau, loops, kept, settings).copy()


def step(robot, q, v, h, tau=None):
    a1 = acceleration(robot, q, v, tau)
    a2 = acceleration(robot, q + h / 2 * v, v + h / 2 * a1, tau)
    v3 = v + h / 2 * a2
    a3 = acceleration(robot, q + h / 2 * (v + h / 2 * a1), v3, tau)
    a4 = acceleration(robot, q + h * v3, v + h * a3, tau)
    return q + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


HOME = np.array([1.0, -0.36105209221293255, 1.7892514033875249])


def moved(urdf, duration=2.0, q=HOME, h=1e-3):
    robot, q, v = closed_loop(urdf), np.array(q), np.zeros(3)
    yield robot, 0.0, q, v
    for k in range(round(duration / h)):
        q, v = step(robot, q, v, h)
        yield robot, (k + 1) * h, q, v


def simulate(urdf):
    *_, (_, _, q, _) = moved(urdf)
    return q


def drive(urdf):
    """There is no prescribed motion: positions, rates and forces are solved for by hand."""
    robot, q = closed_loop(urdf), HOME.copy()
    model, data = robot[:2]
    torques = []
    for t in np.linspace(0, 2, 201):
        q[0] = 1 + 3 * t
        for _ in range(20):
            pin.forwardKinematics(model, data, q)
            pin.updateFramePlacements(model, data)
            one, two = (data.oMf[model.getFrameId(name)] for name in ("coupler_tip", "rocker_tip"))
            J = jacobian(robot, q)
            q[1:] -= np.linalg.solve(J[:, 1:], (one.translation - two.translation)[1:])
        v = np.concatenate([[3], -np.linalg.solve(J[:, 1:], 3 * J[:, 0])])
        pin.forwardKinematics(model, data, q, v, np.zeros(3))
        drift = [drift_of(model, data, name) for name in ("coupler_tip", "rocker_tip")]
        a = np.concatenate([[0], -np.linalg.solve(J[:, 1:], drift[0] - drift[1])])
        force = pin.rnea(model, data, q, v, a)
        torques.append(force[0] - J[:, 0] @ np.linalg.solve(J[:, 1:].T, force[1:]))
    return np.array(torques)


def jacobian(robot, q):
    model, data = robot[:2]
    axes = pin.LOCAL_WORLD_ALIGNED
    one, two = (
        pin.computeFrameJacobian(model, data, q, model.getFrameId(name), axes)[1:3].copy()
        for name in ("coupler_tip", "rocker_tip")
    )
    return one - two


def drift_of(model, data, name):
    frame, axes = model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED
    return pin.getFrameClassicalAcceleration(model, data, frame, axes).linear[1:]


def event(urdf):
    """There are no events: signs are compared, zeros are interpolated."""
    found, before = [], (0.0, 0.0)
    for _, t, _, v in moved(urdf):
        if before[1] * v[2] < 0:
            found.append(before[0] + before[1] / (before[1] - v[2]) * (t - before[0]))
        before = t, v[2]
    return np.array(found)


def stop(urdf):
    before = (0.0, 1.5)
    for _, t, q, _ in moved(urdf):
        if q[0] <= -0.5:
            return before[0] + before[1] / (before[1] - q[0] - 0.5) * (t - before[0])
        before = t, q[0] + 0.5
    return np.nan


def pin_force(urdf):
    """The multipliers are in the first body's frame and of either sign: turned to world axes here."""
    found = []
    for k, (robot, _, q, v) in enumerate(moved(urdf)):
        if k % 100 == 0:
            acceleration(robot, q, v)
            model, data, _, kept = robot
            pin.forwardKinematics(model, data, q)
            found.append((data.oMi[2].rotation @ kept[0].contact_force.linear)[1:])
    return np.array(found)


def frame(urdf):
    found = []
    for k, (robot, _, q, v) in enumerate(moved(urdf)):
        if k % 100 == 0:
            a = acceleration(robot, q, v)
            model, data = robot[:2]
            pin.forwardKinematics(model, data, q, v, a)
            found.append(drift_of(model, data, "rocker_tip"))
    return np.array(found)


def export(urdf, path):
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        names = list(pin.buildModelFromUrdf(str(urdf)).names)[1:]
        table.writerow(["t", *names, *(f"v.{name}" for name in names)])
        table.writerows([t, *q, *v] for _, t, q, v in moved(urdf))


def control(urdf):
    robot, q, v = closed_loop(urdf), HOME, np.zeros(3)
    for _ in range(200):
        tau = np.array([400 * (2 - q[0]) - 40 * v[0], 0, 0])
        for _ in range(10):
            q, v = step(robot, q, v, 1e-3, tau)
    return q[0]


def sweep(urdf):
    """Starts must be closed by the user, here by the closed form."""
    from by_scipy import closed

    found = []
    for crank in np.linspace(0.6, 1.4, 5):
        x = closed(crank)
        *_, (_, _, q, _) = moved(urdf, q=[x[0], x[1] - x[0], x[2]])
        found.append(q[0])
    return np.array(found)


def singular(rhombus):
    """A rhombus swings through its flat position."""
    *_, (_, _, q, _) = moved(rhombus, 5.0, [0.5, -0.5, 0.5])
    return q[0], abs(q[0] - q[2])
