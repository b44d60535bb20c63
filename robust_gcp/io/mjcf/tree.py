"""The spanning tree of a compiled MJCF model: mjModel to pin.Model, configurations and frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...checks import hint
from ...errors import ModelError
from ...mechanism.tree.joints import along
from ...mechanism.tree.tree import Array
from ..names import RESERVED, all_named, unlike
from .compiled import is_off

FREE, BALL, SLIDE, HINGE = range(4)

AXES = {kind + axis: (sort, i) for kind, sort in (("", "P"), ("r", "R")) for i, axis in enumerate("xyz")}
"""What a standing body may be moved along and about: a slide or a hinge, and its axis."""

ROOT_JOINT = "root_joint"


class CompiledTree:
    """A pin.Model made of a mjModel; joints, bodies and sites keep their names, unnamed ones get some.

    Parameters
    ----------
    compiled : mjModel
    name : str
        What to call it in errors.
    base : "fixed", "free" or None
        As in `reader.read_mjcf`.
    moving : mapping of str to sequence of str
        Standing bodies that move as prescribed, and along which axes: x, y, z, rx, ry, rz.

    Attributes
    ----------
    model : pin.Model
    home : ndarray (nq,)
        MuJoCo's qpos0.
    bodies, joints, sites : list of str
        Names, by MuJoCo's numbers.
    standing : list of str
        Bodies that stay on the ground though base="free" asks for another base.
    moved : list of str
        The joints that move standing bodies.
    """

    def __init__(
        self, compiled: Any, name: str, base: str | None, moving: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        m = self._from = compiled
        self.name, self._fixed = name, base == "fixed"
        self.bodies = all_named([m.body(b).name for b in range(m.nbody)], ["body"] * m.nbody)
        ends = ["_free" if kind == FREE else "_joint" for kind in m.jnt_type]
        wanted = [self.bodies[b] + end for b, end in zip(m.jnt_bodyid, ends, strict=True)]
        self.joints = all_named([m.joint(j).name for j in range(m.njnt)], wanted)
        self.sites = [m.site(s).name for s in range(m.nsite)]
        for kind, names in (("body", self.bodies[1:]), ("joint", self.joints), ("site", self.sites)):
            for label in set(RESERVED).intersection(names):
                raise ModelError(f"{name}: a {kind} is named {label!r}, which is the ground; rename it")
        self.standing: list[str] = []
        self.moved: list[str] = []
        self._moving = self._standing_ones(moving or {})
        floating = self._floating() if base == "free" else 0
        self.model = pin.Model()
        self.model.gravity.linear = m.opt.gravity * (not is_off(m, "GRAVITY"))
        self._places = [(0, pin.SE3.Identity())]  # of bodies: on which joint, and where on it
        self.model.addFrame(pin.Frame("world", *self._places[0], pin.FrameType.BODY), False)
        armature: list[float] = []
        for b in range(1, m.nbody):
            armature += self._add_body(b, b == floating)
        self.model.armature = np.array(armature)
        rubbing = np.zeros(self.model.nv)
        for j, label in enumerate(self.joints):
            if not self.is_fixed(j) and not is_off(m, "FRICTIONLOSS"):
                joint, at = self._joint(label), m.jnt_dofadr[j]
                rubbing[joint.idx_v : joint.idx_v + joint.nv] = m.dof_frictionloss[at : at + joint.nv]
        self.model.upperDryFrictionLimit, self.model.lowerDryFrictionLimit = rubbing, -rubbing
        for j in np.flatnonzero(m.jnt_actfrclimited).tolist():
            at = self._joint(self.joints[j]).idx_v
            if m.jnt_type[j] not in (FREE, BALL):
                self.model.lowerEffortLimit[at], self.model.upperEffortLimit[at] = m.jnt_actfrcrange[j]
        for s in range(m.nsite):
            self._add_site(s)
        self.home = pin.neutral(self.model)
        if floating:
            self.home[:7] = pin.SE3ToXYZQUAT(_pose(m.body_pos[floating], m.body_quat[floating]))
        self.home = self.configuration(m.qpos0)

    def configuration(self, qpos: Array) -> Array:
        """MuJoCo's numbers in the order of the model, quaternions with their scalar last."""
        q = self.home.copy()
        for j, label in enumerate(self.joints):
            if not self.is_fixed(j):
                joint = self._joint(label)
                numbers = qpos[self._from.jnt_qposadr[j] :][: joint.nq].copy()
                if joint.nq > 1:
                    numbers[-4:] = np.roll(numbers[-4:], -1)
                q[joint.idx_q : joint.idx_q + joint.nq] = numbers
        return q

    def velocity(self, qpos: Array, qvel: Array) -> Array:
        """MuJoCo's velocities in the order of the model; of free joints it has v in the world's axes."""
        v = np.zeros(self.model.nv)
        for j, label in enumerate(self.joints):
            if not self.is_fixed(j):
                joint = self._joint(label)
                numbers = qvel[self._from.jnt_dofadr[j] :][: joint.nv].copy()
                if joint.nv == 6:
                    turn = _pose(np.zeros(3), qpos[self._from.jnt_qposadr[j] + 3 :][:4]).rotation
                    numbers[:3] = turn.T @ numbers[:3]
                v[joint.idx_v : joint.idx_v + joint.nv] = numbers
        return v

    def _joint(self, label: str) -> pin.JointModel:
        return self.model.joints[self.model.getJointId(label)]

    def is_fixed(self, joint: int) -> bool:
        """Whether it is a free joint that base="fixed" takes away."""
        return self._fixed and self._from.jnt_type[joint] == FREE

    def stays(self) -> NDArray[np.bool_]:
        """Which bodies do not move as prescribed, (nbody,)."""
        return ~np.isin(np.arange(self._from.nbody), list(self._moving))

    def on(self, body: int, at: Array, turn: Sequence[float] = (1, 0, 0, 0)) -> tuple[int, pin.SE3]:
        """Joint that carries a body, and the placement on it of a place in body axes."""
        joint, place = self._places[body]
        return joint, place * _pose(at, turn)

    def carrier(self, body: int) -> int:
        """Joint that carries a body; 0 is the ground."""
        return self._places[body][0]

    def site(self, site: int) -> tuple[int, pin.SE3]:
        """Joint that carries a site, and the placement on it."""
        m = self._from
        return self.on(int(m.site_bodyid[site]), m.site_pos[site], m.site_quat[site])

    def _add_site(self, site: int) -> None:
        """Its frame; NAME_site where a body elsewhere has its name."""
        label, (joint, place) = self.sites[site], self.site(site)
        if label in self.bodies:
            carrier, there = self._places[self.bodies.index(label)]
            if joint != carrier or place != there:
                label = self.sites[site] = unlike(f"{label}_site", {*self.bodies, *self.joints, *self.sites})
        if label:
            self.model.addFrame(pin.Frame(label, joint, place, pin.FrameType.OP_FRAME), False)

    def _standing_ones(self, moving: Mapping[str, Sequence[str]]) -> dict[int, tuple[str, ...]]:
        """The bodies that are moved, by number, with their axes; names of joints that they get are free."""
        found: dict[int, tuple[str, ...]] = {}
        for body, axes in moving.items():
            label = f"{self.name}: moving, body {body!r}"
            if body not in self.bodies[1:]:
                raise ModelError(f"{label}: there is no such body{hint(body, self.bodies[1:])}")
            b = self.bodies.index(body)
            if self._from.body_parentid[b] or self._from.body_jntnum[b]:
                raise ModelError(f"{label} has joints, or another body carries it; drive its joint (drive=)")
            for axis in axes:
                if axis not in AXES or list(axes).count(axis) > 1:
                    raise ModelError(f"{label}: {axis!r} must be one of {', '.join(AXES)}, each once at most")
                if f"{body}_{axis}" in self.joints:
                    raise ModelError(f"{label}: a joint is named {body}_{axis} already; rename it")
            found[b] = tuple(axes)
        return found

    def _floating(self) -> int:
        """The body that base="free" lets float; 0 where others float already."""
        m = self._from
        tops = [b for b in range(1, m.nbody) if m.body_parentid[b] == 0]
        floating = [b for b in tops if m.body_jntnum[b] and m.jnt_type[m.body_jntadr[b]] == FREE]
        if floating:
            jointed = set(m.body_rootid[m.jnt_bodyid]).difference(floating)
            self.standing = [self.bodies[b] for b in sorted(jointed)]
            return 0
        tied = [b for b in tops if m.body_jntnum[b]]
        if len(tops) != 1 or tied:
            raise ModelError(
                f"{self.name}: base='free' needs one body that stands on the ground by itself, and there "
                f"are {len(tops)} ({len(tied)} on joints); put them into one body"
            )
        return tops[0]

    def _add_body(self, b: int, floats: bool) -> list[float]:
        """A body, its joints before; their armature."""
        m, armature = self._from, []
        joint, place = self.on(int(m.body_parentid[b]), m.body_pos[b], m.body_quat[b])
        if floats:
            label = all_named([*self.joints, ""], [*self.joints, ROOT_JOINT])[-1]
            joint, place = self._add_joint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), label)
            armature += [0.0] * 6
        for axis in self._moving.get(b, ()):  # from where the body stands, along the ground's axes
            sort, i = AXES[axis]
            place = pin.SE3(np.eye(3), place.translation) if joint == 0 else place
            label = f"{self.bodies[b]}_{axis}"
            joint, place = self._add_joint(joint, along(sort, np.eye(3)[i]), place, label)
            self.moved.append(label)
            armature += [0.0]
        if b in self._moving:
            place = pin.SE3(_pose(m.body_pos[b], m.body_quat[b]).rotation, np.zeros(3))
        for j in range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b]):
            kind, at, axis, start = m.jnt_type[j], m.jnt_pos[j], m.jnt_axis[j], m.qpos0[m.jnt_qposadr[j] :]
            if self.is_fixed(j):
                place = _pose(start[:3], start[3:7])
            elif kind == FREE:  # its armature would be that of world axes
                joint, place = self._add_joint(
                    0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), self.joints[j]
                )
                armature += [0.0] * 6
            else:
                anchor = place * pin.SE3(np.eye(3), at)
                if kind == HINGE:  # a file draws its bodies at qpos0
                    anchor.rotation = anchor.rotation @ pin.exp3(-start[0] * axis)
                elif kind == SLIDE:
                    anchor.translation = anchor.act(-start[0] * axis)
                made = pin.JointModelSpherical() if kind == BALL else along("PR"[kind - SLIDE], axis)
                limits = m.jnt_range[j] if m.jnt_limited[j] and kind != BALL else None
                joint, place = self._add_joint(joint, made, anchor, self.joints[j], limits)
                place.translation = -at
                armature += [float(m.dof_armature[m.jnt_dofadr[j]])] * made.nv
        self._places.append((joint, place))
        self.model.addFrame(pin.Frame(self.bodies[b], joint, place, pin.FrameType.BODY), False)
        if joint:  # what stands on the ground moves no mass
            turn = _pose(np.zeros(3), m.body_iquat[b]).rotation
            inertia = turn @ np.diag(m.body_inertia[b]) @ turn.T
            mass = pin.Inertia(float(m.body_mass[b]), m.body_ipos[b].copy(), inertia)
            self.model.appendBodyToJoint(joint, mass, place)
        return armature

    def _add_joint(
        self, parent: int, kind: Any, place: pin.SE3, name: str, limits: Array | None = None
    ) -> tuple[int, pin.SE3]:
        """The joint, and where it is on itself."""
        endless, high = np.full(kind.nv, np.inf), np.full(kind.nq, np.inf)
        if kind.nq > kind.nv:  # quaternions: a little more than one, as Pinocchio's readers have it
            high[-4:] = 1.01
        low = -high
        if limits is not None and not is_off(self._from, "LIMIT"):
            low[0], high[0] = limits
        joint = self.model.addJoint(parent, kind, place, name, endless, endless, low, high)
        self.model.addJointFrame(joint)
        return int(joint), pin.SE3.Identity()


def _pose(position: Array, quaternion: Array | Sequence[float]) -> pin.SE3:
    """A placement of MuJoCo's, quaternions with their scalar first."""
    turn = pin.Quaternion(*map(float, quaternion)).normalized()
    return pin.SE3(turn.toRotationMatrix(), np.array(position))
