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
# # 6. A real robot with closed loops
#
# The quadruped solo12 stands on four feet that are pinned to the ground: a free body, twelve joints and
# four loops through the ground. Six independent coordinates remain. Then Baxter, which holds a bar with
# both hands.
#
# **Look at** the closure error: four loops in space, closed to rounding while the robot sways.
#
# The robots come from the package example-robot-data, the extra `robots`.

# %%
import numpy as np

import robust_gcp as rg
from robust_gcp.drawing.show import show
from robust_gcp.examples.robots import baxter_bar, shapes, solo12_pinned

solo = solo12_pinned(stiffness=10.0)
print(solo)
print("independent joints:", ", ".join(solo.independent))

# %% [markdown]
# ## Pushed
#
# Springs hold the legs. The base is given a push, within what the loops allow: `lift` turns rates of the
# independent joints into velocities of all joints.

# %%
push = solo.lift(solo.home, [0.5, -1.0, 0.5, 0.5, -1.0, 0.5])
run = rg.simulate(solo, v0=push, duration=0.5, step=2e-3, record=("energy",))
print(f"loops open by at most {run.closure_error().max():.1e} m, {run.velocity_error().max():.1e} m/s")
print(f"energy drifts by {np.abs(run.energy_error()).max():.1e} J of {run.energy[0]:.2f} J")
show(run.plot(what=("energy", "closure")), "06_errors")
# %%
show(rg.replay(run, visual=shapes(solo)), "06_solo")

# %% [markdown]
# ## What the motors have to do
#
# Inverse dynamics in minimal coordinates: forces on the independent joints for a wanted ÿ. Here, to start
# from rest without moving: what the legs' springs leave for six motors to hold.

# %%
hold = rg.inverse_dynamics(solo, solo.home, np.zeros(solo.nv), np.zeros(solo.m))
for name, torque in zip(solo.independent, hold, strict=True):
    print(f"  {name}: {torque:7.3f} N m")

# %% [markdown]
# ## Two arms and a bar
#
# The bar is welded to the left hand, and a frame closure (6 rows) welds it to the right one: mobility 13.

# %%
baxter = baxter_bar()
run = rg.simulate(baxter, duration=0.2, step=2e-3)
print(baxter)
print(f"loop open by at most {run.closure_error().max():.1e}")
here = rg.analyse(baxter, baxter.home)
print(here.kind, "- freedom", here.local_dof)
show(rg.replay(run, visual=shapes(baxter)), "06_baxter")
# %%
assert run.closure_error().max() < 1e-12
