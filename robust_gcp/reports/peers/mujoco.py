"""MuJoCo on the same spanning tree, loops closed by `connect` between sites.

Springs and dampers are MuJoCo's own (joints and spatial tendons), as are stops (limits of joints), dry
friction (`frictionloss`) and couplings; a constant drive is `qfrc_applied`.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from mujoco import rollout

from ... import JointFriction, Mechanism
from ...io.mjcf.stops import solref_of
from ...io.mjcf.writer import mjcf_text
from ...mechanism.tree.joints import JointKind
from ...mechanism.tree.tree import Array
from ..contender import BOUND, Contender, Kind, Outcome, Scene, clock, division, reached
from .parts import has_simple_joints

HARDEST = 0.9999
"""Largest `solimp` that MuJoCo does not clip: 1 − d = 1e-4 of softness is left."""

SHORTEST = 2.0
"""Steps of the constraints' time constant; MuJoCo clips smaller ones (`refsafe`)."""

REBOUND = 10.0
"""Time constant of stops in that of closures: a rebound has to be resolved; of 1 to 100 this erred least."""

APPLIED = mujoco.mjtState.mjSTATE_QFRC_APPLIED

ORDER = [0, 1, 2, 6, 3, 4, 5]
"""Of a place's numbers in MuJoCo, as they stand in Pinocchio's."""

EVALUATIONS = {"Euler": 1, "implicitfast": 1, "RK4": 4}
"""Forward dynamics in a step of each integrator."""


@dataclass
class Connect:
    """MuJoCo with `connect` constraints."""

    name: str
    tuning: str
    stepper: str  # MuJoCo's integrator
    # (step) -> float: makes the constraints as stiff as MuJoCo allows, with this time constant (`solref`), s;
    # its defaults when left out
    time_constant: Callable[[float], float] | None = None
    family: str = "MuJoCo"
    kind: Kind = "fixed"

    def refuses(self, scene: Scene) -> str:
        """Why not: other joints, closures of whole frames, or what MuJoCo itself does not compile."""
        if not has_simple_joints(scene.mechanism, floating=True):
            return "the adapter knows revolute and prismatic joints and floating bases only"
        if any(c.kind not in ("3d", "revolute", "coupling") for c in scene.mechanism.closures):
            return "connect holds points together, and a closure here holds whole frames"
        massless = any(body.mass == 0.0 for body in list(scene.mechanism.own_model.inertias)[1:])
        return "MuJoCo takes no moving bodies without mass" if massless else ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        """MuJoCo's integrator with the step nearest to `setting`, s."""
        substeps, h = division(scene, setting)
        model = compiled(scene.mechanism, self.stepper, self.time_constant is not None)
        model.opt.timestep = h
        if self.time_constant is not None:
            model.eq_solref[:] = (self.time_constant(h), 1.0)
        model = _with_parts(model, scene, self.time_constant and self.time_constant(h))
        data = mujoco.MjData(model)
        bases = Bases(scene.mechanism)
        data.qpos[:], data.qvel[:] = bases.theirs(scene.q0, scene.v0)
        start, applied = (
            _state(model, data, kind) for kind in (mujoco.mjtState.mjSTATE_FULLPHYSICS, APPLIED)
        )
        steps = substeps * (len(scene.times) - 1)
        before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda message: None)  # else written to a file
        try:
            begun = clock()
            states, _ = rollout.rollout(
                model, data, start, applied[None, None], control_spec=APPLIED, nstep=steps
            )
            seconds = clock() - begun
        finally:
            mujoco.set_mju_user_warning(before)
        told = states[0, substeps - 1 :: substeps, 1:]  # the first number is the time
        ours = (bases.ours(x[: model.nq], x[model.nq : model.nq + model.nv]) for x in told)
        return reached(scene, ours, seconds, EVALUATIONS[self.stepper] * steps)


class Bases:
    """States with floating bases in MuJoCo's numbers: places in the world, velocities along its axes.

    There the quaternion comes scalar first. All other joints have the same numbers here and there.

    Parameters
    ----------
    mechanism : Mechanism
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._bases = [
            (joint.idx_q, joint.idx_v, mechanism.own_model.jointPlacements[joint.index])
            for joint in mechanism.joints
            if joint.kind is JointKind.FREE_FLYER
        ]

    def theirs(self, q: Array, v: Array) -> tuple[Array, Array]:
        """qpos and qvel of q and v."""
        qpos, qvel = q.copy(), v.copy()
        for i, j, placement in self._bases:
            place = placement * pin.XYZQUATToSE3(q[i : i + 7])
            qpos[i : i + 7] = pin.SE3ToXYZQUAT(place)[ORDER]
            qvel[j : j + 3] = place.rotation @ v[j : j + 3]
        return qpos, qvel

    def ours(self, qpos: Array, qvel: Array) -> tuple[Array, Array]:
        """q and v of qpos and qvel; its quaternion goes on as theirs does."""
        q, v = qpos.copy(), qvel.copy()
        for i, j, placement in self._bases:
            x, y, z, w = pin.Quaternion(placement.rotation.T).coeffs()
            turn, now = pin.Quaternion(w, x, y, z), pin.Quaternion(*qpos[i + 3 : i + 7])
            q[i : i + 3] = placement.actInv(qpos[i : i + 3])
            q[i + 3 : i + 7] = (turn * now).coeffs()
            v[j : j + 3] = now.matrix().T @ qvel[j : j + 3]
        return q, v


def _with_parts(model: Any, scene: Scene, time_constant: float | None) -> Any:
    """A copy with the scene's stops and friction, where it has any; restitution as the damping ratio."""
    if not scene.joints:
        return model
    made = copy.copy(model)
    for part in scene.joints:
        k = made.joint(part.joint).id
        if isinstance(part, JointFriction):
            made.dof_frictionloss[made.jnt_dofadr[k]] = part.bound
            continue
        usual, ratio = solref_of(part.restitution)
        made.jnt_limited[k] = True
        made.jnt_range[k] = [
            limit if limit is not None else far for limit, far in ((part.lower, -BOUND), (part.upper, BOUND))
        ]
        made.jnt_solref[k] = REBOUND * time_constant if time_constant else usual, ratio
        if time_constant is not None:
            made.jnt_solimp[k, :2] = HARDEST
    return made


def _state(model: Any, data: Any, kind: int) -> Array:
    """A part of the state as an array."""
    found = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, found, kind)
    return found


@functools.lru_cache(maxsize=16)
def compiled(mechanism: Mechanism, integrator: str, hard: bool) -> Any:
    """The MjModel with one of MuJoCo's integrators, its constraints as hard as can be or as they come."""
    model = mujoco.MjModel.from_xml_string(mjcf_text(mechanism, {}))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    if hard:
        model.opt.tolerance = 1e-15
        model.eq_solimp[:, :2] = HARDEST
    return model


STIFF = (
    f"connect with solimp {HARDEST} (the hardest), solref = {SHORTEST:g} steps at critical damping, "
    "tolerance 1e-15"
)


def contenders() -> list[Contender]:
    """MuJoCo's defaults, and stiff constraints with its integrators of order 4 and for stiff dampers."""

    def stiff(name: str, integrator: str) -> Contender:
        return Connect(name, f"{STIFF}, {integrator}", integrator, lambda step: SHORTEST * step)

    return [
        Connect("MuJoCo connect, defaults", "connect, semi-implicit Euler, no option touched", "Euler"),
        stiff("MuJoCo connect, tuned", "RK4"),
        stiff("MuJoCo connect, implicitfast", "implicitfast"),
    ]
