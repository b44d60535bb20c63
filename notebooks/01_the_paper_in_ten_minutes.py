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
# ---

# %% [markdown]
# # 1. The paper in ten minutes
#
# Four links of equal length, joined to a loop, fall from rest. Whenever they lie in one line, two ways of
# moving meet, and the coordinates that describe one of them break down. This notebook shows what classical
# generalized coordinate partitioning (GCP) does there, and what the robust method does.
#
# **Look at** the page in the third section: two linkages start alike, and after 0.95 s one of them has
# locked.

# %%
import warnings

import matplotlib.pyplot as plt
import numpy as np

import robust_gcp as rg
from robust_gcp.drawing.show import show
from robust_gcp.maps.closed_form import parallelogram_pendulum, pendulum

rhombus = rg.load("rhombus")
q = np.array([0.2, -0.2, 0.2])
print(rhombus)

# %% [markdown]
# ## The constraint
#
# A linkage with a loop is a tree (here three hinges q1, q2, q3) and a cut joint that closes it: φ(q) = 0.
# Velocities satisfy K v = 0, accelerations K a = k. These are the values that the paper prints for q =
# (0.2, −0.2, 0.2). (The linkage moves in the world's y–z plane: the paper's x, y are y, z here.)

# %%
K = rhombus.K(q)
print(K.round(4))
print("rank", np.linalg.matrix_rank(K), " G =", rhombus.G(q).ravel())

# %% [markdown]
# With all links in one line, at q* = (0, 0, 0), one row of K is zero. Its kernel has two dimensions instead
# of one, although the linkage still has one degree of freedom on each of its modes. `analyse` tells the
# modes apart by second-order terms: the parallelogram (1, −1, 1), and links 2 and 3 folded together, (0, 1,
# 1).

# %%
here = rg.analyse(rhombus, [0.0, 0.0, 0.0])
print(rhombus.K(np.zeros(3)).round(12))
print(here.kind, "- rank", here.rank, "where", here.generic_rank, "is usual")
print("modes that meet:", *(mode.round(6) for mode in here.modes), sep="\n  ")

# %% [markdown]
# ## Falling through
#
# Minimal coordinates: y = q1 is integrated, q2 and q3 follow from the loop. Classical GCP finds them by
# Newton's method, started from where they were. The robust run crosses each singular configuration on a
# bridge: it interpolates the mode between places where K is good, and certifies that the loop stays closed
# on it.

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", rg.SingularityWarning)
    classical = rg.simulate(rhombus, q, duration=3.0, method="classical", newton_start="previous")
robust = rg.simulate(rhombus, q, duration=3.0)
for crossing in robust.crossings:
    where = f"{crossing.time:.3f} s: q1 = {crossing.y[0]:7.4f}"
    print(f"{where}, {crossing.kind}, loop open by {crossing.certificate:.0e} m")

# %%
page = rg.replay([classical, robust], labels=["classical GCP", "robust GCP"], layout="side by side")
show(page, "01_replay")

# %% [markdown]
# ## How exact is it?
#
# On the parallelogram mode the motion is that of a pendulum, known in closed form. The robust method stays
# at the accuracy of its integrator. The classical one is as exact, until it locks.

# %%
A, B = parallelogram_pendulum(l1=1.0, l3=1.0, m1=1.0, m2=1.0, m3=1.0)
exact, _, _ = pendulum(robust.t, y0=0.2, ydot0=0.0, A=A, B=B)
fig, axes = plt.subplots(2, 1, sharex=True, figsize=(8, 5), constrained_layout=True)
for run, label in ((classical, "classical GCP"), (robust, "robust GCP")):
    axes[0].plot(run.t, run.q[:, 1], label=label)
    axes[1].semilogy(run.t, np.abs(run.q[:, 0] - exact) + 1e-17, label=label)
for crossing in robust.crossings:
    axes[0].axvline(crossing.time, color="0.8", zorder=0)
axes[0].set_ylabel("q2 [rad]")
_ = axes[0].legend()
_ = axes[1].set(ylabel="|q1 − exact| [rad]", xlabel="t [s]")
show(fig, "01_error")
# %%
assert np.abs(robust.q[:, 0] - exact).max() < 1e-9
assert np.ptp(classical.q[-500:, 1]) < 1e-9  # q2 is frozen: links 1 and 2 turn as one

# %% [markdown]
# Next: [02](02_singularities_and_modes.py), what a mechanism can do at a singular configuration.
