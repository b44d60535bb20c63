"""What of a compiled MJCF model acts at joints, and what is not simulated, in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..mechanism.contents import STAYS, named
from ..mechanism.forces import Force, JointDamper, JointSpring, JointTorque, PointSpring
from .mjcf_equalities import arms_of
from .mjcf_tree import BALL, FREE, FRICTION_OFF, LIMITS_OFF, CompiledTree

CONTACT_OFF, SPRINGS_OFF, DAMPERS_OFF = 1 << 4, 1 << 5, 1 << 6
"""MuJoCo's mjDSBL_CONTACT, _SPRING and _DAMPER."""

JOINT, IN_PARENT, SLIDER_CRANK, TENDON, SITE, BODY = range(6)
"""MuJoCo's mjtTrn: what an actuator drives."""

AFFINE, WRAP_SITE, ACTUATION_OFF = 1, 3, 1 << 10
"""MuJoCo's mjBIAS_AFFINE, mjWRAP_SITE and mjDSBL_ACTUATION."""

CURVED = ("tendon_stiffnesspoly", "tendon_dampingpoly")


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
    for t in _springs_between_sites(m):
        one, two = (tree.sites[int(m.wrap_objid[m.tendon_adr[t] + end])] for end in (0, 1))
        stiffness = 0.0 if m.opt.disableflags & SPRINGS_OFF else float(m.tendon_stiffness[t])
        damping = 0.0 if m.opt.disableflags & DAMPERS_OFF else float(m.tendon_damping[t])
        found.append(PointSpring(one, two, stiffness, float(m.tendon_lengthspring[t, 0]), damping))
    found += [
        JointTorque(tree.joints[int(m.actuator_trnid[a, 0])], torque) for a, torque in _constant(m).items()
    ]
    return found


def _springs_between_sites(m: Any) -> list[int]:
    """Spatial tendons straight from one site to another with a linear spring or damper."""
    found = []
    for t in range(m.ntendon):
        straight = m.tendon_num[t] == 2 and set(m.wrap_type[m.tendon_adr[t] :][:2].tolist()) == {WRAP_SITE}
        linear = m.tendon_lengthspring[t, 0] == m.tendon_lengthspring[t, 1] and not any(
            np.any(getattr(m, key)[t]) for key in CURVED if hasattr(m, key)
        )
        if straight and linear and (m.tendon_stiffness[t] or m.tendon_damping[t]):
            found.append(t)
    return found


def _constant(m: Any) -> dict[int, float]:
    """Actuators on joints whose force is a constant, N m or N, whatever their control."""
    found = {}
    for a in range(m.nu):
        on_slide = m.actuator_trntype[a] == JOINT and m.jnt_type[m.actuator_trnid[a, 0]] not in (FREE, BALL)
        plain = (
            m.actuator_dyntype[a] == 0 and m.actuator_gaintype[a] == 0 and m.actuator_biastype[a] == AFFINE
        )
        free = not np.any(m.actuator_gainprm[a]) and not np.any(m.actuator_biasprm[a, 1:])
        if on_slide and plain and free and not m.actuator_forcelimited[a]:
            found[a] = float(m.actuator_biasprm[a, 0] * m.actuator_gear[a, 0])
    return {} if m.opt.disableflags & ACTUATION_OFF else found


def _plain_motors(m: Any) -> set[int]:
    """Motors whose control is the torque of a joint, as `torque=` gives it: nothing of them is left out."""
    found = set()
    for a in range(m.nu):
        on_slide = m.actuator_trntype[a] == JOINT and m.jnt_type[m.actuator_trnid[a, 0]] not in (FREE, BALL)
        plain = not (m.actuator_dyntype[a] or m.actuator_gaintype[a] or m.actuator_biastype[a])
        one = m.actuator_gear[a, 0] == 1.0 == m.actuator_gainprm[a, 0]
        if on_slide and plain and one and not (m.actuator_forcelimited[a] or m.actuator_ctrllimited[a]):
            found.add(a)
    return found


def actuated_by(m: Any, tree: CompiledTree) -> tuple[str, ...]:
    """Joints that actuators drive, directly or by a fixed tendon."""
    driven: list[int] = []
    constant = _constant(m)
    for a, (kind, target) in enumerate(zip(m.actuator_trntype, m.actuator_trnid[:, 0], strict=True)):
        if a in constant:
            continue
        if kind in (JOINT, IN_PARENT):
            driven.append(int(target))
        elif kind == TENDON:
            driven += arms_of(m, int(target))
    return tuple(tree.joints[j] for j in dict.fromkeys(driven) if not tree.is_fixed(j))


def left_out_of(m: Any, tree: CompiledTree, told: dict[str, list[str]]) -> list[str]:
    """What is there beside bodies and is not simulated, one entry a kind; `told` by the document itself."""
    flags, at = m.opt.disableflags, m.jnt_dofadr  # a joint's velocities are alike in what is asked here
    round_ones, moved = np.isin(m.jnt_type, (FREE, BALL)), [not tree.is_fixed(j) for j in range(m.njnt)]
    known = {*_constant(m), *_plain_motors(m)}
    sprung = (m.jnt_stiffness != 0.0) & (not flags & SPRINGS_OFF)
    kinds: dict[str, Iterable[str]] = {
        "drag of a medium": [key for key in ("density", "viscosity", "wind") if np.any(getattr(m.opt, key))],
        "gravity compensation of bodies": _of(tree.bodies, m.body_gravcomp),
        "motion of mocap bodies": _of(tree.bodies, (m.body_mocapid >= 0) & tree.stays()),
        STAYS: tree.standing,
        "armature of free joints": _of(
            tree.joints, (m.dof_armature[at] != 0.0) & (m.jnt_type == FREE) & moved
        ),
        "dry friction of joints": _of(
            tree.joints, (m.dof_frictionloss[at] != 0.0) & moved, flags & FRICTION_OFF
        ),
        "limits of joints": _of(tree.joints, m.jnt_limited, flags & LIMITS_OFF),
        "springs of ball and free joints": _of(tree.joints, sprung & round_ones & moved),
        "nonlinear parts of springs and dampers": _of(tree.joints, _curved(m) & moved),
        "actuators": [_actuator(m, tree, a) for a in range(m.nu) if a not in known],
        "tendons": [m.tendon(t).name or "tendon" for t in range(m.ntendon) if _acts(m, t)],
        "deformables": [_text(m, at) or "flex" for at in m.name_flexadr],
        **told,
        "contacts of bodies": _of(
            [tree.bodies[b] for b in m.geom_bodyid],
            (m.geom_bodyid > 0) & ((m.geom_contype | m.geom_conaffinity) != 0),
            flags & CONTACT_OFF,
        ),
    }
    return [entry for kind, where in kinds.items() for entry in named(kind, where)]


def _acts(m: Any, t: int) -> bool:
    """Whether a tendon does more than what is simulated: springs between two sites, and equalities."""
    pulls = (m.tendon_stiffness[t] or m.tendon_damping[t]) and t not in _springs_between_sites(m)
    return bool(pulls or m.tendon_limited[t] or m.tendon_frictionloss[t] or m.tendon_armature[t])


def _curved(m: Any) -> Any:
    """Joints whose springs or dampers are more than linear, or yield; MuJoCo 3 has none."""
    if not hasattr(m, "jnt_stiffnesspoly"):
        return np.zeros(m.njnt, dtype=bool)
    curved = np.any(m.jnt_stiffnesspoly, axis=1) | np.any(m.dof_dampingpoly[m.jnt_dofadr], axis=1)
    return curved | (m.jnt_plasticadr >= 0)


def _text(m: Any, at: int) -> str:
    """A name in mjModel, which has no accessor of its own."""
    return bytes(m.names[at:]).split(b"\0", 1)[0].decode(errors="replace")


def _of(names: list[str], which: Any, switched_off: int = 0) -> list[str]:
    return [name for name, is_one in zip(names, which, strict=True) if is_one and not switched_off]


def _actuator(m: Any, tree: CompiledTree, actuator: int) -> str:
    kind, target = int(m.actuator_trntype[actuator]), int(m.actuator_trnid[actuator, 0])
    if m.actuator(actuator).name:
        return str(m.actuator(actuator).name)
    if kind in (JOINT, IN_PARENT):
        return tree.joints[target]
    if kind == TENDON:
        return str(m.tendon(target).name)
    return tree.bodies[target] if kind == BODY else str(m.site(target).name)
