# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3

# %% [markdown]
# # 7. Control through the singularity
#
# A rhombus hangs from its ground link and is to stand upright. On its way every link lies flat: there the
# constraint Jacobian K loses rank, two modes meet, and multipliers and their derivatives have no
# value. In minimal coordinates the derivatives that an optimiser needs exist: along one mode γ is smooth.
#
# **Look at** the derivatives on the way to the flat pose and in it, at the swing that Crocoddyl finds, and at
# what feedback along it does with a wrong start.
#
# Needs the extra `control` (crocoddyl).

# %%
import crocoddyl
import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

import robust_gcp as rg
from robust_gcp.adapters.crocoddyl import ClosedLoopAction, state_model
from robust_gcp.drawing.show import show
from robust_gcp.examples.linkages import add_link

mech = rg.load("rhombus")
hanging = np.array([-np.pi / 2, np.pi / 2, -np.pi / 2])
flat = np.zeros(3)
print(mech)

# %% [markdown]
# ## Derivatives towards the flat pose
#
# On this mode the rhombus is a pendulum, M_r ÿ = −c cos y, so ∂ÿ/∂y = (c/M_r) sin y is known. Beside it,
# what the analytic derivatives of Pinocchio's constrained dynamics give (loop as a 6D contact, for which
# they are right; the hinge at the tip is a joint of the tree with next to no mass; proximal regularisation
# 1e-10), read along the same tangent. Both are good on either side, Pinocchio's until very near to the flat
# pose. There its answer is what regularisation makes of a singular matrix: it knows no mode, and where
# modes are curved it loses digits sooner. A swing at a speed rarely meets that pose to 1e-8 rad; a plan
# that rests or begins there does.

# %%
M_r = 1 / 3 + 1 + 1 / 3
c = (0.5 + 1 + 0.5) * 9.81
parallelogram = np.array([1.0, -1.0, 1.0])


def with_tip_hinge():
    """The rhombus with its fourth hinge as a joint of the tree (joints depth first), closed by a frame."""
    model = pin.Model()
    model.gravity.linear = mech.model.gravity.linear
    coupler = add_link(model, add_link(model, 0, 0.0, "q1", 1.0), 1.0, "q2", 1.0)
    hinge = add_link(model, coupler, 1.0, "q4", 1e-3, mass=1e-9)
    rocker = add_link(model, 0, 1.0, "q3", 1.0)
    here, tip = pin.SE3.Identity(), model.frames[model.getFrameId("q3_tip")].placement
    return model, pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, hinge, here, rocker, tip)


model, loop = with_tip_hinge()
data, part = model.createData(), loop.createData()
settings = pin.ProximalSettings(1e-12, 1e-10, 20)


def of_pinocchio(y):
    """∂q̈₁ along the mode's tangent."""
    q = np.array([y, -y, y, y])
    none = np.zeros(4)
    pin.initConstraintDynamics(model, data, [loop], [part])
    pin.constraintDynamics(model, data, q, none, none, [loop], [part], settings)
    pin.computeConstraintDynamicsDerivatives(model, data, [loop], [part], settings)
    return (data.ddq_dq @ np.array([1.0, -1.0, 1.0, 1.0]))[0]


print("     y        exact      rg.derivatives, error     Pinocchio, error")
for y in (-0.5, -1e-2, -1e-4, -1e-6, -1e-8, 0.0):
    exact = c / M_r * np.sin(y)
    ours = rg.derivatives(mech, y * parallelogram, mode=parallelogram).da_dy[0, 0]
    print(f"{y:9.0e}  {exact:10.6f}  {abs(ours - exact):15.1e}  {abs(of_pinocchio(y) - exact):22.1e}")

# %% [markdown]
# ## The swing
#
# Each node is one step of RK4 with the motor's torque held over it. Crocoddyl's own state and costs are
# used; `ClosedLoopAction` brings the dynamics and their derivatives.

# %%
STEP, NODES, LIMIT = 0.03, 80, 30.0
state = state_model(mech)
upright = np.array([np.pi / 2, 0.0])


def costs(weights, torque):
    total = crocoddyl.CostModelSum(state, 1)
    activation = crocoddyl.ActivationModelWeightedQuad(np.square(weights))
    distance = crocoddyl.ResidualModelState(state, upright, 1)
    total.addCost("state", crocoddyl.CostModelResidual(state, activation, distance), 1.0)
    effort = crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state, 1))
    total.addCost("torque", effort, torque)
    return total


run = ClosedLoopAction(mech, costs([2.0, 0.4], 0.1), STEP, q0=hanging, limits=LIMIT)
end = ClosedLoopAction(mech, costs([60.0, 12.0], 1e-9), 0.0, q0=hanging)
x0 = np.array([-np.pi / 2, 0.0])
solver = crocoddyl.SolverBoxFDDP(crocoddyl.ShootingProblem(x0, [run] * NODES, end))
solver.th_stop = 1e-6
solved = solver.solve([x0] * (NODES + 1), [np.zeros(1)] * NODES, 100)
x, torque = np.array(solver.xs), np.array(solver.us)[:, 0]
print(f"solved: {solved}, {solver.iter + 1} iterations, |torque| at most {np.abs(torque).max():.1f} N m")
print(f"ends at y = {x[-1, 0]:.5f} rad (upright: {np.pi / 2:.5f}), {x[-1, 1]:.1e} rad/s")

# %% [markdown]
# ## The same torques in `Simulation`
#
# Step by step, and the flat pose is logged as a crossing with its certificate.


# %%
def played(u, v0=0.0, feedback=None):
    """y and ẏ after each step."""
    sim = rg.Simulation(mech, hanging, v0 * parallelogram, step=STEP)
    states = []
    for k, held in enumerate(u):
        here = np.array([sim.y[0], sim.v[0]])
        states.append(here)
        extra = 0.0 if feedback is None else -float(feedback[k] @ (here - x[k]))
        sim.step({"q1": held + extra})
    return np.array([*states, [sim.y[0], sim.v[0]]]), sim


again, sim = played(torque)
print(f"largest difference from the plan: {np.abs(again - x).max():.1e}")
for crossing in sim.crossings:
    where = f"t = {crossing.time:.4f} s, y = {crossing.y[0]:+.1e}"
    print(f"  {crossing.kind} at {where}, φ ≤ {crossing.certificate:.0e}")

# %% [markdown]
# ## Feedback along the swing
#
# Discrete LQR along the plan: A and B of every step come from `rg.step_jacobians`, the Riccati recursion runs
# backwards through the singularity. A start that is wrong by 0.3 rad/s, with and without it.

# %%
Q, R, P = np.diag([40.0, 4.0]), np.array([[0.05]]), np.diag([400.0, 40.0])
gains = []
for k in reversed(range(NODES)):
    q, v = x[k, 0] * parallelogram, x[k, 1] * parallelogram
    A, B = rg.step_jacobians(mech, q, v, {"q1": torque[k]}, STEP, mode=parallelogram)
    b = B[:, :1]
    K = np.linalg.solve(R + b.T @ P @ b, b.T @ P @ A)
    P = Q + A.T @ P @ (A - b @ K)
    gains.append(K[0])
gains.reverse()

free, _ = played(torque, v0=0.3)
held, _ = played(torque, v0=0.3, feedback=gains)
print(f"without feedback: ends {abs(free[-1, 0] - np.pi / 2):.2f} rad from upright")
print(f"with feedback:    ends {abs(held[-1, 0] - np.pi / 2):.4f} rad from upright")

# %%
t = STEP * np.arange(NODES + 1)
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.0), layout="constrained")
axes[0].plot(t, x[:, 0], label="plan")
axes[0].plot(t, free[:, 0], "--", label="0.3 rad/s off, no feedback")
axes[0].plot(t, held[:, 0], ":", label="0.3 rad/s off, LQR")
axes[0].axhline(0.0, color="0.7", linewidth=0.8)
axes[0].annotate("flat: two modes meet", (t[-1], 0.0), ha="right", va="bottom", color="0.4")
axes[0].set_ylabel("q1 in rad")
axes[0].legend(frameon=False)
axes[1].step(t[:-1], torque, where="post")
axes[1].set_ylabel("torque in N m")
axes[1].set_xlabel("t in s")
show(figure, "07_swing")
