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
# # 9. A swing-up that is learned, through flat
#
# A rhombus hangs folded, and its motor is too weak to lift it: it has to swing, each time through the flat
# pose in which the modes of the linkage cross. 96 of them learn at once, in a vector environment of Gymnasium
# (`robust_gcp.adapters.gymnasium`, extra `gymnasium`) on `rg.Batch`: loops closed exactly, each on its own
# mode through every crossing. The search is the cross-entropy method: try policies around the best so far.
#
# **Look at** how many stand upright after each round, and at one motion of the policy that was found.

# %%
import matplotlib.pyplot as plt
import numpy as np

import robust_gcp as rg
from robust_gcp.adapters.gymnasium import MechanismVectorEnv
from robust_gcp.drawing.show import show

N, ACTIONS, ROUNDS, TORQUE = 96, 500, 28, 4.0  # torque in N m; holding q1 = 0 takes 9.8
rhombus = rg.load("rhombus")


def hanging(rng, n):
    """Folded and at rest, about straight down."""
    poses = [
        rhombus.configuration({"q1": a, "q2": -2 * a, "q3": 2 * a})
        for a in -np.pi / 2 + rng.normal(0, 0.05, n)
    ]
    return np.array([rhombus.assemble(pose) for pose in poses]), None


def features(q, v):
    """What the policy is linear in."""
    a, u = q[:, 0], v[:, 0] / 5
    return np.stack([np.cos(a), np.sin(a) * u, u, u**3, np.cos(a) * np.sin(a)], axis=1)


def reward(q, v, action):
    """Height, and slowness where it is high."""
    height = np.sin(q[:, 0])
    return height - 0.02 * v[:, 0] ** 2 * (height > 0.8)


env = MechanismVectorEnv(
    rhombus, N, {"q1": TORQUE}, reward, max_steps=ACTIONS, start=hanging, observe=features, threads=2
)

# %% [markdown]
# ## Trying policies
#
# A policy is five weights; each of the 96 motions tries its own, for five seconds, 5,000 steps of RK4.


# %%
def tried(weights, seed):
    """The return of each policy, and whether it stood upright over the last half second."""
    seen, _ = env.reset(seed=seed)
    total, upright = np.zeros(N), np.ones(N, bool)
    for k in range(ACTIONS):
        seen, gained, *_ = env.step(np.tanh((weights * seen).sum(axis=1))[:, None])
        total += gained
        if k >= ACTIONS - 50:
            upright &= np.sin(env.batch.q[:, 0]) > 0.95
    return total, upright


rng, mean, spread, standing = np.random.default_rng(0), np.zeros(5), np.full(5, 4.0), []
for round_ in range(ROUNDS):
    weights = mean + spread * rng.normal(size=(N, 5))
    total, upright = tried(weights, round_)
    best = weights[np.argsort(total)[-16:]]
    mean, spread = 0.5 * mean + 0.5 * best.mean(axis=0), 0.5 * spread + 0.5 * best.std(axis=0) + 0.1
    standing.append(int(upright.sum()))
print(f"{ROUNDS * N * ACTIONS * 10:,} steps; of the last policies {standing[-1]} of {N} stand upright")

# %% [markdown]
# ## The policy that was found
#
# The mean of the last round, from starts that it has not seen.

# %%
total, upright = tried(np.tile(mean, (N, 1)), 1000)
crossings = env.batch.crossings
print(f"upright: {upright.sum()} of {N}; crossings passed: {crossings.min()} to {crossings.max()}")
assert upright.mean() > 0.8
assert crossings.min() >= 1
assert max(rhombus.closure_residual(q) for q in env.batch.q) < 1e-12

# %%
simulation = rg.Simulation(rhombus, hanging(np.random.default_rng(5), 1)[0][0])
for _ in range(ACTIONS):
    seen = features(simulation.q[None], simulation.v[None])[0]
    simulation.step({"q1": TORQUE * float(np.tanh(mean @ seen))}, 10)
run = simulation.trajectory

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
left.plot(standing, marker="o", color="#2a6f97")
left.set(xlabel="round", ylabel=f"upright, of {N}", title="learning", ylim=(0, N))
right.plot(run.t, run["q1"], color="#2a6f97")
for crossing in run.crossings:
    right.axvline(crossing.time, color="#e07a5f", lw=0.8)
right.axhline(np.pi / 2, color="0.6", lw=0.8)
right.set(xlabel="t, s", ylabel="q1, rad", title="one motion; lines: singular configurations")
show(figure, "09_learning")
