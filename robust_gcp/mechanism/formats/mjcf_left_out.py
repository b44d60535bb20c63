"""What of a compiled MJCF model acts at joints, and what is not simulated, in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..forces import Force, JointDamper, JointSpring
from .contents import STAYS, named
from .mjcf_equalities import arms_of
from .mjcf_tree import BALL, FREE, LIMITS_OFF, CompiledTree

FRICTION_OFF, CONTACT_OFF, SPRINGS_OFF, DAMPERS_OFF = 1 << 2, 1 << 4, 1 << 5, 1 << 6
"""MuJoCo's mjDSBL_FRICTIONLOSS, _CONTACT, _SPRING and _DAMPER."""

JOINT, IN_PARENT, SLIDER_CRANK, TENDON, SITE, BODY = range(6)
"""MuJoCo's mjtTrn: what an actuator drives."""


def forces_of(m: Any, tree: CompiledTree) -> list[Force]:
    """Springs and dampers of the joints."""
    found: list[Force] = []
    for j, label in enumerate(tree.joints):
        rest = float(m.qpos_spring[m.jnt_qposadr[j]])
        if m.jnt_stiffness[j] and m.jnt_type[j] not in (FREE, BALL) and not m.opt.disableflags & SPRINGS_OFF:
            found.append(JointSpring(label, float(m.jnt_stiffness[j]), rest))
    for j, label in enumerate(tree.joints):
        damping = float(m.dof_damping[m.jnt_dofadr[j]])
        if damping and not tree.is_fixed(j) and not m.opt.disableflags & DAMPERS_OFF:
            found.append(JointDamper(label, damping))
    return found


def actuated_by(m: Any, tree: CompiledTree) -> tuple[str, ...]:
    """Joints that actuators drive, directly or by a fixed tendon."""
    driven: list[int] = []
    for kind, target in zip(m.actuator_trntype, m.actuator_trnid[:, 0], strict=True):
        if kind in (JOINT, IN_PARENT):
            driven.append(int(target))
        elif kind == TENDON:
            driven += arms_of(m, int(target))
    return tuple(tree.joints[j] for j in dict.fromkeys(driven) if not tree.is_fixed(j))


def left_out_of(m: Any, tree: CompiledTree, told: dict[str, list[str]]) -> list[str]:
    """What is there beside bodies and is not simulated, one entry a kind; `told` by the document itself."""
    flags, names = m.opt.disableflags, np.array([*tree.joints, ""])[:-1]
    of_dofs = m.dof_jntid
    round_ones = np.isin(m.jnt_type, (FREE, BALL))
    curved = {int(j) for j in np.flatnonzero(np.any(m.jnt_stiffnesspoly, axis=1))}
    curved |= {int(of_dofs[d]) for d in np.flatnonzero(np.any(m.dof_dampingpoly, axis=1))}
    free = m.jnt_type[of_dofs] == FREE if m.nv else of_dofs
    kinds: dict[str, Iterable[Any]] = {
        "drag of a medium": [key for key in ("density", "viscosity", "wind") if np.any(getattr(m.opt, key))],
        "gravity compensation of bodies": _of(tree.bodies, m.body_gravcomp),
        "motion of mocap bodies": _of(tree.bodies, m.body_mocapid >= 0),
        STAYS: tree.standing,
        "armature of free joints": names[of_dofs[(m.dof_armature != 0.0) & free.astype(bool)]],
        "dry friction of joints": names[of_dofs[m.dof_frictionloss != 0.0]]
        if not flags & FRICTION_OFF
        else (),
        "limits of joints": _of(tree.joints, m.jnt_limited) if not flags & LIMITS_OFF else (),
        "springs of ball and free joints": _of(tree.joints, (m.jnt_stiffness != 0.0) & round_ones),
        "nonlinear parts of springs and dampers": [tree.joints[j] for j in sorted(curved)],
        "actuators": [_actuator(m, tree, a) for a in range(m.nu)],
        "tendons": [m.tendon(t).name or "tendon" for t in range(m.ntendon)],
        "deformables": [_text(m, adr) or "flex" for adr in m.name_flexadr] + told.pop("deformables", []),
        **told,
        "contacts of bodies": [
            tree.bodies[body]
            for body, masks in zip(m.geom_bodyid, m.geom_contype | m.geom_conaffinity, strict=True)
            if body and masks and not flags & CONTACT_OFF
        ],
    }
    return [entry for kind, where in kinds.items() for entry in named(kind, map(str, where))]


def _text(m: Any, at: int) -> str:
    """A name in mjModel, which has no accessor of its own."""
    return bytes(m.names[at:]).split(b"\0", 1)[0].decode(errors="replace")


def _of(names: list[str], which: Any) -> list[str]:
    return [name for name, is_one in zip(names, which, strict=True) if is_one]


def _actuator(m: Any, tree: CompiledTree, actuator: int) -> str:
    kind, target = int(m.actuator_trntype[actuator]), int(m.actuator_trnid[actuator, 0])
    if m.actuator(actuator).name:
        return str(m.actuator(actuator).name)
    if kind in (JOINT, IN_PARENT):
        return tree.joints[target]
    if kind == TENDON:
        return str(m.tendon(target).name)
    return tree.bodies[target] if kind == BODY else str(m.site(target).name)
