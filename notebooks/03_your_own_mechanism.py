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
# # 3. Your own mechanism, from a URDF
#
# A mechanism is a tree in a URDF and a list of places where its loops close. Here: a crank that drives a
# slider through a rod.
#
# **Look at** the replay at the end, and at how few lines stand between the URDF and it.

# %%
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import robust_gcp as rg
from robust_gcp.drawing.show import show

# %% [markdown]
# ## The tree
#
# URDF knows trees only. So cut the loop at one joint, and put a massless link with a fixed joint at the cut
# on either side: `rod_tip` and `pin`. Hinges turn about x, the mechanism moves in the y–z plane, and
# gravity is −z.


# %%
def body(name: str, mass: float, length: float) -> str:
    """A slender rod along y, from its joint."""
    moment = mass * length**2 / 12
    return f"""
    <link name="{name}">
      <inertial>
        <origin xyz="0 {length / 2} 0"/>
        <mass value="{mass}"/>
        <inertia ixx="{moment}" iyy="1e-6" izz="{moment}" ixy="0" ixz="0" iyz="0"/>
      </inertial>
    </link>"""


def joint(name: str, kind: str, parent: str, child: str, y: float = 0.0, axis: str = "1 0 0") -> str:
    """A joint at distance y along its parent."""
    return f"""
    <joint name="{name}" type="{kind}">
      <parent link="{parent}"/> <child link="{child}"/>
      <origin xyz="0 {y} 0"/> <axis xyz="{axis}"/>
      <limit effort="100" velocity="100"/>
    </joint>"""


urdf = f"""<robot name="press">
    <link name="ground"/>
    {body("crank", 1.0, 0.2)} {body("rod", 0.5, 0.6)} {body("slider", 2.0, 0.1)}
    <link name="rod_tip"/> <link name="pin"/>
    {joint("crank", "continuous", "ground", "crank")}
    {joint("rod", "continuous", "crank", "rod", 0.2)}
    {joint("rod_tip", "fixed", "rod", "rod_tip", 0.6)}
    {joint("slider", "prismatic", "ground", "slider", axis="0 1 0")}
    {joint("pin", "fixed", "slider", "pin")}
</robot>"""

# %% [markdown]
# ## Closing the loop
#
# The two frames' origins shall coincide. The crank's angle is the minimal coordinate. `assemble` closes the
# loop from rough values, and says how far it is open if it cannot.

# %%
press = rg.Mechanism.from_urdf(urdf, [rg.PointClosure("rod_tip", "pin")], independent=["crank"])
q0 = press.assemble([0.5, -0.6, 0.7])
print(press)
print("closed configuration:", q0.round(4))
print("joints that could be independent here:", [names for _, names in press.coordinate_choices(q0)])

# %% [markdown]
# ## Driving it
#
# A torque may depend on time and state. `record` asks for what is wanted besides q and v: here the
# constraint forces, which are the loads on the pin.


# %%
def motor(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Holds the crank near 10 rad/s."""
    tau = np.zeros(3)
    tau[0] = 2.0 * (10.0 - v[0])
    return tau


run = rg.simulate(press, q0, duration=2.0, torque=motor, record=("energy", "multipliers"))
print(f"loop open by at most {run.closure_error().max():.1e} m")
print(f"energy less the motor's work: {np.abs(run.energy_error()).max():.1e} J")
show(run.plot(("q", "v", "multipliers", "energy")), "03_motion")
# %%
show(rg.replay(run), "03_replay")

# %% [markdown]
# ## As a folder
#
# A URDF and a short YAML beside it make a model folder, which `rg.load` and the command line take.

# %%
folder = Path(mkdtemp()) / "press"
folder.mkdir()
(folder / "robot.urdf").write_text(urdf)
(folder / "robot.yaml").write_text(
    f"""
closed_loop: [['rod_tip', 'pin']]
type: ['3d']
name_mot: ['crank']
robust_gcp:
  schema: 1
  home: {{crank: {q0[0]}, rod: {q0[1]}, slider: {q0[2]}}}
"""
)
again = rg.load(folder)
assert np.abs(again.home - q0).max() < 1e-12
print(again)

# %% [markdown]
# Mistakes are named, with the remedy:

# %%
try:
    rg.Mechanism.from_urdf(urdf, [rg.PointClosure("rod_tip", "pn")], independent=["crank"])
except rg.ModelError as error:
    print(error)

# %% [markdown]
# Next: [04](04_error_against_run_time.py), how exact and how fast.
