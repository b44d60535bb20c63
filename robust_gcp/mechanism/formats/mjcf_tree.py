"""The spanning tree of a compiled MJCF model: mjModel to pin.Model, configurations and frames."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ..tree import Array

FREE, BALL, SLIDE, HINGE = range(4)
RESERVED = ("universe", "world")
ROOT_JOINT = "root_joint"
AXES = (
    {SLIDE: pin.JointModelPX, HINGE: pin.JointModelRX},
    {SLIDE: pin.JointModelPY, HINGE: pin.JointModelRY},
)
AXES += ({SLIDE: pin.JointModelPZ, HINGE: pin.JointModelRZ},)
UNALIGNED = {SLIDE: pin.JointModelPrismaticUnaligned, HINGE: pin.JointModelRevoluteUnaligned}


class CompiledTree:
    """A pin.Model made of a mjModel; joints, bodies and sites keep their names, unnamed ones get some.

    Parameters
    ----------
    compiled : mjModel
    name : str
        What to call it in errors.
    base : "fixed", "free" or None
        As in `mjcf.read_mjcf`.

    Attributes
    ----------
    model : pin.Model
    home : ndarray (nq,)
        MuJoCo's qpos0.
    bodies, joints, sites : list of str
        Names, by MuJoCo's numbers.
    places : list of (joint, pin.SE3)
        Where each body is, on which joint.
    standing : list of str
        Bodies that stay on the ground though base="free" asks for another base.
    """

    def __init__(self, compiled: Any, name: str, base: str | None) -> None:
        self._from, self.name, self._fixed = compiled, name, base == "fixed"
        m = compiled
        self.bodies = _named([m.body(b).name for b in range(m.nbody)], ["body"] * m.nbody)
        owners = [self.bodies[b] for b in m.jnt_bodyid]
        endings = ["_free" if kind == FREE else "_joint" for kind in m.jnt_type]
        wanted = [owner + ending for owner, ending in zip(owners, endings, strict=True)]
        self.joints = _named([m.joint(j).name for j in range(m.njnt)], wanted)
        self.sites = [m.site(s).name for s in range(m.nsite)]
        for kind, names in (("body", self.bodies[1:]), ("joint", self.joints), ("site", self.sites)):
            for taken in RESERVED:
                if taken in names:
                    raise ModelError(f"{name}: a {kind} is named {taken!r}, which is the ground; rename it")
        self.standing: list[str] = []
        root = self._root() if base == "free" else 0
        self.model = pin.Model()
        self.model.gravity.linear = m.opt.gravity.copy()
        self._armature: list[float] = []
        self.places = [(0, pin.SE3.Identity())]
        self._frame("world", pin.FrameType.BODY, *self.places[0])
        for b in range(1, m.nbody):
            self._body(b, b == root)
        self.model.armature = np.array(self._armature)
        for site, label in enumerate(self.sites):
            if label:
                self._frame(label, pin.FrameType.OP_FRAME, *self.site(site))
        self.home = pin.neutral(self.model)
        if root:
            start = self.model.joints[self.model.getJointId(self._root_joint)].idx_q
            self.home[start : start + 7] = pin.SE3ToXYZQUAT(_pose(m.body_pos[root], m.body_quat[root]))
        self.home = self.configuration(m.qpos0)

    def configuration(self, qpos: Array) -> Array:
        """MuJoCo's numbers in the order of the model, quaternions with their scalar last."""
        q = self.home.copy()
        for j, label in enumerate(self.joints):
            if not self.is_fixed(j):
                joint = self.model.joints[self.model.getJointId(label)]
                at = int(self._from.jnt_qposadr[j])
                numbers = qpos[at : at + joint.nq].copy()
                if joint.nq > 1:
                    numbers[-4:] = np.roll(numbers[-4:], -1)
                q[joint.idx_q : joint.idx_q + joint.nq] = numbers
        return q

    def is_fixed(self, joint: int) -> bool:
        """Whether it is a free joint that base="fixed" takes away."""
        return self._fixed and self._from.jnt_type[joint] == FREE

    def on(
        self, body: int, position: Array, quaternion: Iterable[float] = (1, 0, 0, 0)
    ) -> tuple[int, pin.SE3]:
        """Joint that carries a body, and the placement on it of a place in body axes."""
        joint, place = self.places[body]
        return joint, place * _pose(position, quaternion)

    def site(self, site: int) -> tuple[int, pin.SE3]:
        """Joint that carries a site, and the placement on it."""
        m = self._from
        return self.on(int(m.site_bodyid[site]), m.site_pos[site], m.site_quat[site])

    def _root(self) -> int:
        """The body that floats by base="free"; 0 where others float already."""
        m = self._from
        tops = [b for b in range(1, m.nbody) if m.body_parentid[b] == 0]
        floating = [b for b in tops if m.body_jntnum[b] and m.jnt_type[m.body_jntadr[b]] == FREE]
        if floating:
            jointed = {int(m.body_rootid[b]) for b in m.jnt_bodyid}
            self.standing = [self.bodies[b] for b in tops if b not in floating and b in jointed]
            return 0
        tied = [b for b in tops if m.body_jntnum[b]]
        if len(tops) != 1 or tied:
            raise ModelError(
                f"{self.name}: base='free' needs one body that stands on the ground by itself, and there "
                f"are {len(tops)} ({len(tied)} on joints); put them into one body"
            )
        self._root_joint = _named([*self.joints, ""], [*self.joints, ROOT_JOINT])[-1]
        return tops[0]

    def _body(self, b: int, floats: bool) -> None:
        m = self._from
        joint, place = self.on(int(m.body_parentid[b]), m.body_pos[b], m.body_quat[b])
        if floats:
            place = pin.SE3.Identity()
            joint = self._joint(0, pin.JointModelFreeFlyer(), place, self._root_joint)
        for j in range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b]):
            kind, at, axis = int(m.jnt_type[j]), m.jnt_pos[j], m.jnt_axis[j]
            start = m.qpos0[m.jnt_qposadr[j] :]
            if self.is_fixed(j):
                place = _pose(start[:3], start[3:7])
                continue
            anchor = place * pin.SE3(np.eye(3), at) if kind != FREE else pin.SE3.Identity()
            made = {FREE: pin.JointModelFreeFlyer, BALL: pin.JointModelSpherical}.get(kind)
            if kind == HINGE:  # the file draws its bodies where the joint stands at qpos0
                anchor.rotation = anchor.rotation @ pin.exp3(-start[0] * axis)
            elif kind == SLIDE:
                anchor.translation = anchor.act(-start[0] * axis)
            jointed = made() if made else _along(kind, axis)
            armature = 0.0 if kind == FREE else float(m.dof_armature[m.jnt_dofadr[j]])
            joint = self._joint(joint, jointed, anchor, self.joints[j], armature)
            place = pin.SE3(np.eye(3), -at) if kind != FREE else pin.SE3.Identity()
            if m.jnt_limited[j] and kind in (HINGE, SLIDE) and not m.opt.disableflags & LIMITS_OFF:
                idx = self.model.joints[joint].idx_q
                self.model.lowerPositionLimit[idx], self.model.upperPositionLimit[idx] = m.jnt_range[j]
        self.places.append((joint, place))
        self._frame(self.bodies[b], pin.FrameType.BODY, joint, place)
        if joint:
            turn = pin.Quaternion(*map(float, m.body_iquat[b])).toRotationMatrix()
            inertia = turn @ np.diag(m.body_inertia[b]) @ turn.T
            mass = pin.Inertia(float(m.body_mass[b]), m.body_ipos[b].copy(), inertia)
            self.model.appendBodyToJoint(joint, mass, place)

    def _joint(self, parent: int, kind: Any, place: pin.SE3, name: str, armature: float = 0.0) -> int:
        endless, turns = np.full(kind.nv, np.inf), np.full(kind.nq, np.inf)
        if kind.nq > kind.nv:  # quaternions: a little more than one, as Pinocchio's readers have it
            turns[-4:] = 1.01
        joint = self.model.addJoint(parent, kind, place, name, endless, endless, -turns, turns)
        self.model.addJointFrame(joint)
        self._armature += [armature] * self.model.joints[joint].nv
        return int(joint)

    def _frame(self, name: str, kind: Any, joint: int, place: pin.SE3) -> None:
        self.model.addFrame(pin.Frame(name, joint, place, kind), False)


LIMITS_OFF = 1 << 3
"""MuJoCo's mjDSBL_LIMIT."""


def _pose(position: Array, quaternion: Iterable[float]) -> pin.SE3:
    w, x, y, z = map(float, quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix(), np.array(position))


def _along(kind: int, axis: Array) -> Any:
    """A joint along an axis: the simplest there is."""
    for unit, along in zip(np.eye(3), AXES, strict=True):
        if np.array_equal(axis, unit):
            return along[kind]()
    return UNALIGNED[kind](axis.copy())


def _named(given: list[str], wanted: list[str]) -> list[str]:
    """The names that are given; in place of empty ones the wanted ones, numbered where they are taken."""
    taken, made = set(given), []
    for name, unique in zip(given, wanted, strict=True):
        label, count = name or unique, 0
        while not name and label in taken:
            count += 1
            label = f"{unique}{count}"
        taken.add(label)
        made.append(label)
    return made
