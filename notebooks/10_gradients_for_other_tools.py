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
# # 10. Gradients for JAX, PyTorch and Crocoddyl
#
# Three tools ask for derivatives, and get those of the compiled kernel: a rollout as a function of JAX under
# `jit`, `grad` and `vmap` (`robust_gcp.adapters.jax`), the same in PyTorch, and nodes of a shooting problem
# for Crocoddyl, here for model predictive control at 20 knots. All go through the flat pose, in which the
# modes of the rhombus cross.
#
# **Look at** the error of JAX's gradients against differences, at their price beside the kernel's own calls,
# and at the time of an iteration of the controller.
#
# Needs the extras `jax` and `control`, and shows PyTorch where it is installed.

# %%
import time

import crocoddyl
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import robust_gcp as rg
from robust_gcp.adapters.crocoddyl import ClosedLoopAction, state_model
from robust_gcp.adapters.jax import rollout
from robust_gcp.drawing.show import show

jax.config.update("jax_enable_x64", True)
rhombus = rg.load("rhombus")
parallelogram = np.array([1.0, -1.0, 1.0])

# %% [markdown]
# ## 100 motions of 100 steps at once
#
# Each starts on its own side of flat. The cost is what the motor takes, less how high the first link points
# in the end; the gradient is by the torques of all steps.

# %%
STARTS, STEPS, H = 100, 100, 5e-3
y = np.linspace(-0.5, 0.5, STARTS)
q, v = y[:, None] * parallelogram, -2.0 * np.sign(y)[:, None] * parallelogram
motor = jnp.array([1.0, 0.0, 0.0])
forward = rollout(rhombus, H, STEPS)


def cost(torque, q, v):
    """Of one motion under the motor's torques, one a step."""
    Q, _ = forward(q, v, torque[:, None] * motor)
    return 1e-3 * jnp.sum(torque**2) - jnp.sin(Q[-1, 0])


gradients = jax.jit(jax.vmap(jax.grad(cost)))
torque = np.full((STARTS, STEPS), 0.5)
slopes = np.asarray(gradients(torque, q, v))

worst, h = 0.0, 1e-2
for i in (0, 49, 99):
    for k in (0, 50):
        moved = torque[i].copy()
        values = []
        for s in (1, -1, 2, -2):
            moved[k] = torque[i, k] + s * h
            values.append(float(cost(moved, q[i], v[i])))
        exact = (8.0 * (values[0] - values[1]) - values[2] + values[3]) / (12.0 * h)
        worst = max(worst, abs(slopes[i, k] - exact) / np.abs(slopes[i]).max())
crossed = sum(
    bool(rg.simulate(rhombus, a, b, duration=STEPS * H, step=H, torque={"q1": 0.5}).crossings)
    for a, b in zip(q, v, strict=True)
)
print(f"{crossed} of {STARTS} motions pass flat; gradients differ from differences by at most {worst:.0e}")


def least(call, rounds=5):
    """Least time of some calls, s."""
    times = []
    for _ in range(rounds):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return min(times)


def by_the_kernel():
    """The same steps with their derivatives, by `rg.step`."""
    at, fast = q, v
    for _ in range(STEPS):
        after = rg.step(rhombus, at, fast, {"q1": 0.5}, H, jacobians=True)
        at, fast = after.q, after.v


ours, theirs = least(by_the_kernel), least(lambda: jax.block_until_ready(gradients(torque, q, v)))
print(f"{STARTS} x {STEPS} steps with derivatives: kernel {1e3 * ours:.0f} ms, JAX {1e3 * theirs:.0f} ms")

# %% [markdown]
# ## The same in PyTorch

# %%
try:
    import torch
except ImportError:
    print("PyTorch is not installed")
else:
    from robust_gcp.adapters.torch import rollout as torch_rollout

    given = torch.tensor(torque, requires_grad=True)
    held = given[:, :, None] * torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    Q, _ = torch_rollout(rhombus, H, STEPS)(torch.tensor(q), torch.tensor(v), held)
    (1e-3 * (given**2).sum() - torch.sin(Q[:, -1, 0]).sum()).backward()
    print(f"largest difference from JAX: {np.abs(given.grad.numpy() - slopes).max():.0e}")

# %% [markdown]
# ## Model predictive control
#
# At every instant Crocoddyl looks 20 steps of 30 ms ahead, takes one iteration from the plan of the instant
# before, and the motor gets the first torque. The rhombus swings from hanging to upright, through flat.

# %%
STEP, KNOTS, LIMIT = 0.03, 20, 30.0
hanging = np.array([-np.pi / 2, np.pi / 2, -np.pi / 2])
state, upright = state_model(rhombus), np.array([np.pi / 2, 0.0])


def costs(weights, effort):
    total = crocoddyl.CostModelSum(state, 1)
    activation = crocoddyl.ActivationModelWeightedQuad(np.square(weights))
    distance = crocoddyl.ResidualModelState(state, upright, 1)
    total.addCost("state", crocoddyl.CostModelResidual(state, activation, distance), 1.0)
    torques = crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state, 1))
    total.addCost("torque", torques, effort)
    return total


run = ClosedLoopAction(rhombus, costs([2.0, 0.4], 0.1), STEP, q0=hanging)
end = ClosedLoopAction(rhombus, costs([60.0, 12.0], 1e-9), 0.0, q0=hanging)
sim = rg.Simulation(rhombus, hanging, step=STEP)
problem = crocoddyl.ShootingProblem(np.array([sim.y[0], sim.v[0]]), [run] * KNOTS, end)
solver = crocoddyl.SolverFDDP(problem)
plan, torques = [problem.x0] * (KNOTS + 1), [np.zeros(1)] * KNOTS
solver.solve(plan, torques, 20)  # the modes beside flat are looked at once
plan, torques, times = list(solver.xs), list(solver.us), []
for _ in range(100):
    problem.x0 = plan[0] = np.array([sim.y[0], sim.v[0]])
    begun = time.perf_counter()
    solver.solve(plan, torques, 1)
    times.append(time.perf_counter() - begun)
    sim.step({"q1": float(np.clip(solver.us[0][0], -LIMIT, LIMIT))})
    plan, torques = [*list(solver.xs)[1:], solver.xs[-1]], [*list(solver.us)[1:], solver.us[-1]]
print(f"an iteration: {1e3 * np.median(times):.1f} ms; crossings on the way: {len(sim.crossings)}")
print(f"ends {abs(sim.y[0] - np.pi / 2):.1e} rad from upright, at {abs(sim.v[0]):.1e} rad/s")

# %%
trajectory = sim.trajectory
figure, axes = plt.subplots(figsize=(7.0, 3.5), layout="constrained")
axes.plot(trajectory.t, trajectory.q[:, 0], label="q1")
for crossing in sim.crossings:
    axes.axvline(crossing.time, color="C3", lw=0.8, ls="--", label="modes cross")
axes.axhline(np.pi / 2, color="0.7", lw=0.8)
axes.set(xlabel="t [s]", ylabel="q1 [rad]", title="20 knots ahead, one iteration a step")
axes.legend()
show(figure, "10_mpc")
