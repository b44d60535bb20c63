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
# # 5. Stiff and extreme cases
#
# What a step may be before a run becomes unstable, what to do about it, and what extreme numbers do.
#
# **Look at** how the warning's step agrees with the step at which the run blows up.

# %%
import warnings

import numpy as np

import robust_gcp as rg
from robust_gcp.drawing.show import show
from robust_gcp.examples.linkages import four_bar

# %% [markdown]
# ## How stiff is it?
#
# `linearise` gives the eigenvalues of the reduced equations at a state. RK4 is stable up to h |λ| = 2.785
# on the negative real axis and 2.828 on the imaginary one. The flyball governor has spring-dampers of 8e5
# N/m.

# %%
governor = rg.load("flyball")
spin = np.zeros(governor.nv)
spin[0] = 2 * np.pi
here = rg.linearise(governor, governor.home, spin)
print("fastest eigenvalue:", here.eigenvalues[0].round(1), "1/s")
print(f"largest stable step of RK4: {here.largest_stable_step:.4g} s")

# %% [markdown]
# A run that starts outside the bound says so at once, instead of blowing up later without a word:

# %%
for factor in (0.9, 1.2):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            run = rg.simulate(governor, v0=spin, duration=0.1, step=factor * here.largest_stable_step)
            outcome = f"energy error {np.abs(run.energy_error()).max():.1e} J"
        except rg.SimulationError as error:
            outcome = f"stopped: {error}"
    print(f"h = {factor} of the bound: {outcome}")
    for warning in caught:
        print("   warned:", warning.message)

# %% [markdown]
# ## Larger steps by an implicit method
#
# Radau goes through the same explicit map. Its steps follow the motion instead of the fastest eigenvalue.

# %%
for stepper in ("rk4", "Radau"):
    run = rg.simulate(
        governor, v0=spin, duration=0.2, step=2e-4 if stepper == "rk4" else 2e-2, stepper=stepper, rtol=1e-7
    )
    print(f"{stepper:6} {run.stats.rhs:6} right-hand sides, shaft at {run.v[-1, 0]:.6f} rad/s")

# %% [markdown]
# ## Stiff, and through a singularity
#
# A spring 1e6 times as strong as gravity holds the crank of a change-point linkage near the configuration
# where its links lie in line, and it swings through it fast.

# %%
stiff = rg.Mechanism.from_pinocchio(
    (plain := rg.load("change_point")).model,
    plain.closures,
    ["q1"],
    home=plain.home,
    forces=[rg.JointSpring("q1", 1e7, np.pi)],
)
h = rg.linearise(stiff, stiff.home, np.zeros(3)).largest_stable_step / 100
run = rg.simulate(stiff, duration=2000 * h, step=h)
print(f"h = {h:.1e} s, {len(run.crossings)} crossings, loop open by {run.closure_error().max():.1e} m")
stored = stiff.energy(run.q[0], run.v[0])
print(f"energy error {np.abs(run.energy_error()).max() / stored:.1e} of what the spring stores")
show(run.plot(("q", "v", "closure")), "05_stiff")

# %% [markdown]
# ## Units and sizes
#
# A linkage of kilometres and one of micrometres move alike, when time is scaled with the square root of
# length.

# %%
reference = None
for scale in (1e3, 1.0, 1e-6):
    linkage = four_bar(*(scale * np.array([4.0, 2.0, 3.0, 3.0])), y=2.5)
    unit = np.sqrt(scale)
    run = rg.simulate(linkage, duration=2.0 * unit, step=2e-3 * unit)
    reference = run.q[-1] if reference is None else reference
    apart = np.abs(run.q[-1] - reference).max()
    print(f"{scale:7.0e} m: {len(run.crossings)} crossings, q differs by {apart:.1e} rad")
    assert apart < 1e-9

# %% [markdown]
# ## Wrong input is named
#
# A link without mass is fine as long as the motion moves mass. Where it does not, or where an argument is
# wrong, the error says what and what to do.

# %%
for attempt in (
    lambda: rg.simulate(four_bar(4.0, 2.0, 3.0, 3.0, y=2.5, masses=(0.0, 0.0, 0.0))),
    lambda: rg.simulate(rg.load("rhombus"), q0=[0.2, -0.2, np.nan]),
    lambda: rg.simulate(rg.load("rhombus"), step=-1e-3),
):
    try:
        attempt()
    except rg.RobustGcpError as error:
        print(f"{type(error).__name__}: {error}")

# %% [markdown]
# The whole map of cases: `python -m robust_gcp reports stability --out report`, and
# [docs/stability.md](../docs/stability.md).
#
# Next: [06](06_a_real_robot.py), a real robot with closed loops.
