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
# # 8. Identification: what the links weigh
#
# A crank-rocker swings under a known torque, and its crank angle is measured with noise. What do crank,
# coupler and rocker weigh? The sum of squares between motion and measurement is a cost along the motion; its
# derivatives by the links' inertias come from one reverse sweep, whatever their number.
#
# **Look at** the masses, found within what the noise allows, and at the two ways: derivatives of the
# measurement (which noise spoils) and derivatives of the motion (which it does not).

# %%
import matplotlib.pyplot as plt
import numpy as np
import scipy

import robust_gcp as rg
from robust_gcp.drawing.show import show
from robust_gcp.examples.linkages import four_bar

LINKS = (1.6, 0.6, 1.4, 1.2)  # ground, crank, coupler, rocker, m
TRUE = np.array([1.5, 0.8, 2.2])  # crank, coupler, rocker, kg
STEP, DURATION = 0.01, 1.5


def torque(t, q, v):
    return np.array([6.0 * np.sin(5.0 * t), 0.0, 0.0])


def linkage(masses):
    return four_bar(*LINKS, y=1.0, masses=masses)


def motion(masses):
    return rg.simulate(linkage(masses), duration=DURATION, step=STEP, torque=torque)


noise = 2e-3  # rad
run = motion(TRUE)
measured = run["q1"] + noise * np.random.default_rng(8).normal(size=len(run.t))
print(f"{len(run.t)} angles, noise {noise} rad; the crank moves by {np.ptp(run['q1']):.2f} rad")

# %% [markdown]
# ## From derivatives of the measurement
#
# The equations are linear in the inertial parameters: Gᵀ Y(q, v, a) π = Gᵀ τ (`rg.regressor`). With
# velocities and accelerations taken from the noisy angle this is linear least squares.


# %%
def rods(columns, names):
    """Columns of a regressor, or entries of a gradient, by mass in place of by m, m c and I."""
    total = np.zeros((*np.shape(columns)[:-1], 3))
    for k, length in enumerate(LINKS[1:]):
        joint = f"q{k + 1}"
        for name, share in rod_shares(length).items():
            total[..., k] += share * np.asarray(columns)[..., names.index(f"{joint}.{name}")]
    return total


def rod_shares(length):
    """∂(inertial parameters)/∂mass of a rod along its body's y axis."""
    return {"m": 1.0, "my": length / 2.0, "Ixx": length**2 / 3.0, "Izz": length**2 / 3.0}


def smooth(order):
    return scipy.signal.savgol_filter(measured, 21, 5, deriv=order, delta=STEP)


mech = linkage([1.0, 1.0, 1.0])
rows, right = [], []
q = mech.home
for t, y, u, udot in zip(run.t, smooth(0), smooth(1), smooth(2), strict=True):
    q = mech.assemble({**dict(zip(("q1", "q2", "q3"), q, strict=True)), "q1": y}, hold=["q1"])
    d = rg.derivatives(mech, q)
    found = rg.regressor(mech, q, d.G @ [u], [udot])
    rows.append(rods(found.matrix, list(found.names))[0])
    right.append(d.G[:, 0] @ torque(t, q, None))
from_measurement = scipy.linalg.lstsq(np.array(rows), np.array(right))[0]
print("masses:", from_measurement.round(3), "errors:", (from_measurement - TRUE).round(3), "kg")

# %% [markdown]
# ## From derivatives of the motion
#
# scipy's L-BFGS with `rg.gradient`, from where linear least squares came to.

# %%
NAMES = [f"q{k}.{name}" for k in (1, 2, 3) for name in rod_shares(1.0)]


def distance(t, q, v, tau):
    return 0.5 * ((q[0] - measured[round(t / STEP)]) / noise) ** 2 / STEP


def slopes(t, q, v, tau):
    along = np.array([(q[0] - measured[round(t / STEP)]) / noise**2 / STEP, 0.0, 0.0])
    return along, np.zeros(3), np.zeros(3)


COST = rg.Cost(running=distance, running_slopes=slopes)
history = []


def value_and_slope(masses):
    g = rg.gradient(motion(masses), COST, torque, NAMES)
    history.append((masses.copy(), g.value))
    return g.value, rods([g.parameters[name] for name in NAMES], NAMES)


best = scipy.optimize.minimize(
    value_and_slope,
    from_measurement,
    jac=True,
    method="L-BFGS-B",
    bounds=[(0.1, 10.0)] * 3,
    options={"maxiter": 60},
)
print(f"{best.nfev} motions with gradients; cost {history[0][1]:.0f} → {best.fun:.1f} (half of {len(run.t)})")
print("masses:", best.x.round(3), "errors:", (best.x - TRUE).round(3), "kg")

# %%
figure, axes = plt.subplots(1, 2, figsize=(8.5, 3.4), layout="constrained")
axes[0].plot(run.t, measured, ".", markersize=2, label="measured")
axes[0].plot(run.t, motion(from_measurement)["q1"], "--", label="first guess")
axes[0].plot(run.t, motion(best.x)["q1"], label="identified")
axes[0].set_xlabel("t in s")
axes[0].set_ylabel("q1 in rad")
axes[0].legend(frameon=False)
for k, name in enumerate(("crank", "coupler", "rocker")):
    (line,) = axes[1].plot([masses[k] for masses, _ in history], label=name)
    axes[1].axhline(TRUE[k], color=line.get_color(), linewidth=0.8, linestyle=":")
axes[1].set_xlabel("evaluation")
axes[1].set_ylabel("mass in kg")
axes[1].legend(frameon=False)
show(figure, "08_masses")
