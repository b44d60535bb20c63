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
# # 4. Error against run time
#
# How much time does an accuracy cost, and does a crossing spoil the order of the integrator?
#
# **Look at** the slopes: on log-log axes a method of order 4 falls by a factor of 16 for each halving of
# the step, or more where its first error terms nearly cancel, as in this motion. The bridge does, through
# three crossings, and lies on the floor. The others stop falling.

# %%
import time
import warnings

import matplotlib.pyplot as plt
import numpy as np

import robust_gcp as rg
from robust_gcp.drawing.show import show

linkage = rg.load("change_point")
duration, outputs = 5.0, 400

# %% [markdown]
# ## The truth
#
# For a planar four-bar γ, G and g are known in closed form, on the mode, singular or not. The reduced
# equation is then an ordinary one, and an integrator of high order at tight tolerance gives the reference.

# %%
truth = rg.simulate(
    linkage,
    duration=duration,
    step=duration / outputs,
    method="closed_form",
    stepper="DOP853",
    rtol=1e-13,
    atol=1e-13,
)

# %% [markdown]
# ## A ladder of steps

# %%
steps = duration / outputs / np.array([1, 2, 4, 8, 16])
ladders = {
    "closed form (the floor)": {"method": "closed_form"},
    "bridge": {"method": "bridge"},
    "Eq. (7)": {"method": "projection"},
    "classical GCP": {"method": "classical"},
}
fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4), constrained_layout=True, sharey=True)
error_of = {}
for name, method in ladders.items():
    seconds, errors = [], []
    for h in steps:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.SingularityWarning)
            begun = time.perf_counter()
            run = rg.simulate(linkage, duration=duration, step=h, **method)
            seconds.append(time.perf_counter() - begun)
        every = round((len(run.t) - 1) / outputs)
        errors.append(np.abs(run.q[::every] - truth.q).max())
    error_of[name] = np.array(errors)
    floor = name.startswith("closed")
    left.loglog(steps, errors, "k--" if floor else "o-", label=name, zorder=3 if floor else 2)
    right.loglog(seconds, errors, "k--" if floor else "o-", label=name)
left.set(xlabel="step [s]", ylabel="largest error of any joint [rad]")
right.set(xlabel="run time [s]")
_ = left.legend()
show(fig, "04_error_against_run_time")

# %%
order = np.log2(error_of["bridge"][:-1] / error_of["bridge"][1:])
print("observed order of the bridge:", order.round(2))
print("error over the floor:", (error_of["bridge"] / error_of["closed form (the floor)"]).round(3))
assert np.all(error_of["bridge"] <= 1.1 * error_of["closed form (the floor)"] + 1e-11)

# %% [markdown]
# ## The whole report
#
# Here each run is timed once, start included; the bridge runs in the compiled kernel where there is one, the
# other three in Python, which is why the floor, with the same steps and no loop to close, takes longer. So
# the left picture is what to trust, the right one what to expect. The command line measures with care, on
# many motions, planar and spatial, with error-controlled steppers and other tools beside ours, tuned as
# [docs/peers.md](../docs/peers.md) states:
#
# ```
# python -m robust_gcp reports work-precision --out report
# ```
#
# [docs/work-precision.md](../docs/work-precision.md) shows what it found.
#
# Next: [05](05_stiff_and_extreme.py), stiff and extreme cases.
