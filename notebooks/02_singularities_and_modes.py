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
# # 2. Singularities and modes
#
# What a mechanism can do at a configuration, and how the ways it can move hang together.
#
# **Look at** the picture of the configuration space: three closed curves that meet in three points.

# %%
import warnings

import numpy as np

import robust_gcp as rg
from robust_gcp.drawing.show import show

rhombus = rg.load("rhombus")

# %% [markdown]
# ## The whole configuration space
#
# Each curve is an operation mode: the parallelogram, and two modes in which a pair of links is folded and
# turns as one. A motion stays on its curve, unless something pushes it over at a point where curves meet.

# %%
show(rg.plot_modes(rhombus), "02_modes")

# %% [markdown]
# ## One configuration at a time
#
# There are four answers, never a guess: `regular`, `redundant` (more closure rows than needed, everywhere),
# `singular` with its modes, and `not certified` where second-order terms do not decide.

# %%
for name, q in (
    ("crank_rocker", None),
    ("rhombus", [np.pi, -np.pi, np.pi]),
    ("change_point", [np.pi, -np.pi, np.pi]),
    ("bricard", None),
):
    mechanism = rg.load(name)
    q = mechanism.home if q is None else mechanism.assemble(q)
    here = rg.analyse(mechanism, q)
    print(f"{name:13} {here.kind:10} rank {here.rank} of {mechanism.nc} rows, freedom {here.local_dof}")

# %% [markdown]
# ## Starting at a singular configuration
#
# At q* itself the velocity may be zero and the constraint cannot say where to go. Name a mode.

# %%
here = rg.analyse(rhombus, [np.pi, -np.pi, np.pi])
for mode in here.modes:
    run = rg.simulate(rhombus, here.q, mode=mode, duration=0.3)
    print("mode", mode.round(3), "-> q =", run.q[-1].round(4))

# %% [markdown]
# ## A near miss
#
# One link longer by 1e-4 m, and the modes pass each other instead of crossing. The run follows the true
# curve and says what it saw; a gap of 1e-11 m is taken for a crossing, with a warning.

# %%
from robust_gcp.examples.linkages import four_bar

for gap in (1e-4, 1e-11):
    near = four_bar(4.0, 2.0, 3.0, 3.0 + gap, y=2.5)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = rg.simulate(near, duration=1.0)
    kinds = [crossing.kind for crossing in run.crossings]
    print(
        f"gap {gap:.0e} m: crossings {kinds}, refined steps {run.stats.refined_steps}, warnings {len(caught)}"
    )

# %% [markdown]
# ## A toggle
#
# Where the coordinate itself turns back, K has full rank but y cannot describe the motion. The error names
# joints that can.

# %%
kite = rg.load("kite")
try:
    rg.simulate(kite, duration=3.0)
except rg.ToggleError as error:
    print(error)
run = rg.simulate(kite, duration=3.0, on_toggle="repartition")
print("changed coordinates:", [(round(t, 3), names) for t, names in run.stats.repartitions])
assert run.closure_error().max() < 1e-12

# %% [markdown]
# Next: [03](03_your_own_mechanism.py), your own mechanism from a URDF.
