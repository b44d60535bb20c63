"""Actuators, tendons and passive forces of MJCF files beside MuJoCo's own, at random states."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.io.mjcf.actuators import CompiledActuators, is_constant
from robust_gcp.io.mjcf.compiled import compiled
from robust_gcp.io.mjcf.document import Document
from robust_gcp.io.mjcf.reader import read_mjcf
from robust_gcp.io.mjcf.tendons import CompiledTendons
from robust_gcp.io.mjcf.tree import FREE, CompiledTree
from robust_gcp.io.xml_text import is_xml_text, parsed_xml

Array = NDArray[np.float64]


class Beside:
    """A MJCF file as this package reads it, without its loops, and the same in MuJoCo, meshes left out alike.

    Attributes
    ----------
    m, d : MjModel, MjData
    open : Mechanism
    joints : list of pin.JointModel
        By MuJoCo's numbers.
    ids : list of int
        Of the actuators that are simulated, by MuJoCo's numbers.
    """

    def __init__(self, mjcf: str | Path, root: Path | None = None) -> None:
        xml, name = parsed_xml(mjcf, "MJCF")
        folder = None if is_xml_text(mjcf) else Path(mjcf).parent
        self.m = compiled(Document(xml, name, folder, root), False)
        self.d = mujoco.MjData(self.m)
        self.tree = CompiledTree(self.m, name, None)
        self.contents = read_mjcf(mjcf, root=root)
        tendons = CompiledTendons(self.m, CompiledTree(self.m, name, None))
        self.ids = CompiledActuators(self.m, CompiledTree(self.m, name, None), tendons).ids
        c = self.contents
        self.open = rg.Mechanism.from_pinocchio(
            c.model, forces=c.forces, actuators=c.actuators, tendons=c.tendons
        )
        self.joints = [c.model.joints[c.model.getJointId(label)] for label in self.tree.joints]

    def to_mujoco(self, x: Array) -> Array:
        """Forces in the order of MuJoCo, those of free bodies along the world's axes."""
        found = np.empty(self.m.nv)
        for j, joint in enumerate(self.joints):
            at = slice(self.m.jnt_dofadr[j], self.m.jnt_dofadr[j] + joint.nv)
            found[at] = x[joint.idx_v : joint.idx_v + joint.nv]
            if self.m.jnt_type[j] == FREE:
                found[at][:3] = self.d.xmat[self.m.jnt_bodyid[j]].reshape(3, 3) @ found[at][:3]
        return found

    def velocity(self) -> Array:
        """MuJoCo's velocity in the order of the model."""
        v = np.empty(self.m.nv)
        for j, joint in enumerate(self.joints):
            at = slice(joint.idx_v, joint.idx_v + joint.nv)
            v[at] = self.d.qvel[self.m.jnt_dofadr[j] : self.m.jnt_dofadr[j] + joint.nv]
            if self.m.jnt_type[j] == FREE:
                v[at][:3] = self.d.xmat[self.m.jnt_bodyid[j]].reshape(3, 3).T @ v[at][:3]
        return v

    def random(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """q, v and u at a random state, controls beyond their ranges among them; MuJoCo is there too."""
        m, d = self.m, self.d
        d.qpos[:] = m.qpos0 + 0.3 * rng.normal(size=m.nq)
        mujoco.mj_normalizeQuat(m, d.qpos)
        d.qvel[:], d.act[:] = rng.normal(size=m.nv), rng.uniform(0.0, 1.0, m.na)
        low, high = m.actuator_ctrlrange[: m.nu].T if m.nu else np.zeros((2, 0))
        wide = low + (high - low) * rng.uniform(-0.2, 1.2, m.nu)
        d.ctrl[:] = np.where(m.actuator_ctrllimited[: m.nu] > 0, wide, rng.normal(size=m.nu))
        mujoco.mj_forward(m, d)
        u = np.empty(len(self.ids))
        for i, (a, actuator) in enumerate(zip(self.ids, self.contents.actuators, strict=True)):
            u[i] = d.act[m.actuator_actadr[a]] if m.actuator_dyntype[a] else d.ctrl[a]
            if not m.actuator_dyntype[a] and actuator.ctrl_range is not None:
                u[i] = np.clip(u[i], *actuator.ctrl_range)
        return self.tree.configuration(d.qpos), self.velocity(), u


class Differences(NamedTuple):
    """Largest relative differences to MuJoCo; NaN where not everything of a kind is simulated."""

    forces: float
    actuators: float
    passive: float
    tendons: float


def differences(beside: Beside, seed: int, count: int = 3) -> Differences:
    """Forces of actuators, what they do to the joints, passive forces, lengths and moments of tendons."""
    m, d, mech, rng = beside.m, beside.d, beside.open, np.random.default_rng(seed)
    worst = np.zeros(4)
    paths = [path.on(mech.tree, "tendon") for path in mech.tendons.values()]
    told = {entry.partition(" (")[0] for entry in beside.contents.left_out}
    for _ in range(count):
        q, v, u = beside.random(rng)
        found = [0.0] * 4
        if mech.actuation is not None:
            forces, tau = mech.actuation.forces_at(q, v, u)
            found[0] = _off(forces, d.actuator_force[beside.ids])
            found[1] = _off(beside.to_mujoco(tau), d.qfrc_actuator - _constant(m))
        passive = np.zeros(m.nv) if mech.applied is None else beside.to_mujoco(mech.applied.tau(q, v))
        found[2] = _off(passive - _constant(m), d.qfrc_passive)
        mech.tree.jacobians(q)
        for t, path in enumerate(paths):
            length, moment = path.length_at(q)
            row = slice(m.ten_J_rowadr[t], m.ten_J_rowadr[t] + m.ten_J_rownnz[t])
            theirs = np.zeros(m.nv)
            theirs[m.ten_J_colind[row]] = np.ravel(d.ten_J)[row]
            found[3] = max(found[3], abs(length - d.ten_length[t]), _off(beside.to_mujoco(moment), theirs))
        worst = np.maximum(worst, found)
    if told & {"actuators", "gravity compensation of bodies"}:
        worst[1] = np.nan
    if told & NOT_PASSIVE:
        worst[2] = np.nan
    return Differences(*worst.tolist())


NOT_PASSIVE = {
    "drag of a medium", "gravity compensation of bodies", "springs of free joints",
    "nonlinear parts of springs and dampers", "tendons", "deformables", "plugins",
}  # fmt: skip
"""Kinds of `left_out` that MuJoCo counts among passive forces."""


def _off(ours: Array, theirs: Array) -> float:
    return float(np.abs(ours - theirs).max(initial=0.0) / max(1.0, np.abs(theirs).max(initial=0.0)))


def _constant(m: Any) -> Array:
    """What actuators do whose force is a constant: forces of the mechanism here."""
    found = np.zeros(m.nv)
    for a in range(len(m.actuator_trntype)):
        if is_constant(m, a):
            found[m.jnt_dofadr[m.actuator_trnid[a, 0]]] += m.actuator_biasprm[a, 0] * m.actuator_gear[a, 0]
    return found


def hard_loops(beside: Beside, mech: rg.Mechanism, q: Array, v: Array, u: Array) -> Array:
    """a (nv,) by MuJoCo's M, bias, passive and actuators' forces, its loops hard: [[M, Kᵀ], [K, 0]].

    Parameters
    ----------
    mech : Mechanism
        With the loops; no joint of it is free.
    """
    m, d = beside.m, beside.d
    for j, joint in enumerate(beside.joints):
        numbers = q[joint.idx_q : joint.idx_q + joint.nq]
        d.qpos[m.jnt_qposadr[j] : m.jnt_qposadr[j] + joint.nq] = np.roll(numbers, int(joint.nq == 4))
        d.qvel[m.jnt_dofadr[j] : m.jnt_dofadr[j] + joint.nv] = v[joint.idx_v : joint.idx_v + joint.nv]
    for i, a in enumerate(beside.ids):
        assert not m.actuator_dyntype[a]
        d.ctrl[a] = u[i]
    mujoco.mj_forward(m, d)
    at = np.concatenate([np.arange(joint.idx_v, joint.idx_v + joint.nv) for joint in beside.joints])
    M = np.zeros((m.nv, m.nv))
    for row, unit in zip(M, np.eye(m.nv), strict=True):
        mujoco.mj_mulM(m, d, row, unit)
    inertia, force = np.empty((m.nv, m.nv)), np.empty(m.nv)
    inertia[np.ix_(at, at)] = M
    force[at] = d.qfrc_actuator + d.qfrc_passive - d.qfrc_bias
    K, k = mech.K(q), mech.k(q, v)
    U, s, Vt = np.linalg.svd(K)
    rank = int(np.sum(s > 1e-9 * s[0]))
    p = Vt[:rank].T @ (U[:, :rank].T @ k / s[:rank])
    N = Vt[rank:].T
    return p + N @ np.linalg.solve(N.T @ inertia @ N, N.T @ (force - inertia @ p))  # type: ignore[no-any-return]
