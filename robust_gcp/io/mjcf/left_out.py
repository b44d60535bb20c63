"""What of a compiled MJCF model acts at joints, and what is not simulated, in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...mechanism.actuation.paths import FixedTendon
from ...mechanism.contents import STAYS, named
from ...mechanism.forces.ball_springs import BallSpring
from ...mechanism.forces.forces import Force, JointDamper, JointSpring
from ...mechanism.forces.lifted_weights import GravityCompensation
from .actuators import IN_PARENT, JOINT, TENDON, is_constant
from .compiled import is_off
from .tendons import CompiledTendons
from .tree import BALL, FREE, CompiledTree


def forces_of(m: Any, tree: CompiledTree) -> list[Force]:
    """Springs and dampers of the joints, and what lifts weights."""
    found: list[Force] = []
    for j, label in enumerate(tree.joints):
        rest = float(m.qpos_spring[m.jnt_qposadr[j]])
        if m.jnt_stiffness[j] and m.jnt_type[j] not in (FREE, BALL) and not is_off(m, "SPRING"):
            found.append(JointSpring(label, float(m.jnt_stiffness[j]), rest))
    for j, label in enumerate(tree.joints):
        damping = float(m.dof_damping[m.jnt_dofadr[j]])
        if damping and not tree.is_fixed(j) and not is_off(m, "DAMPER"):
            found.append(JointDamper(label, damping))
    return [*found, *_ball_springs(m, tree), *_lifts(m, tree)]


def _ball_springs(m: Any, tree: CompiledTree) -> list[Force]:
    found: list[Force] = []
    for j, label in enumerate(tree.joints):
        if m.jnt_type[j] == BALL and m.jnt_stiffness[j] and not is_off(m, "SPRING"):
            w, *vector = m.qpos_spring[m.jnt_qposadr[j] :][:4].tolist()
            found.append(BallSpring(label, float(m.jnt_stiffness[j]), (*vector, w)))
    return found


def _lifts(m: Any, tree: CompiledTree) -> list[Force]:
    """Gravity compensation of the bodies that move."""
    if not _is_lifted(m) or not _lifts_all(m):
        return []
    weights = [
        (tree.bodies[b], float(m.body_gravcomp[b] * m.body_mass[b]), tuple(m.body_ipos[b].tolist()))
        for b in np.flatnonzero(m.body_gravcomp).tolist()
        if tree.carrier(b) and m.body_mass[b] > 0.0
    ]
    return [GravityCompensation(weights)] if weights else []


def _is_lifted(m: Any) -> bool:
    """Whether MuJoCo lifts at all."""
    # MuJoCo's passive forces end before it where springs and dampers are both off
    return not (is_off(m, "GRAVITY") or (is_off(m, "SPRING") and is_off(m, "DAMPER")))


def _lifts_all(m: Any) -> bool:
    """Whether none pushes down, and none is by actuators that are not there or whose range bounds it."""
    by_actuators = m.jnt_actgravcomp.astype(bool)
    if not len(m.actuator_trntype) or is_off(m, "ACTUATION"):
        bounded = by_actuators
    else:
        bounded = by_actuators & m.jnt_actfrclimited.astype(bool)
    return not np.any(m.body_gravcomp < 0.0) and not np.any(bounded)


def actuated_by(m: Any, tree: CompiledTree, tendons: CompiledTendons) -> tuple[str, ...]:
    """Joints that actuators drive, directly or by a fixed tendon."""
    driven: list[str] = []
    for a, (kind, target) in enumerate(zip(m.actuator_trntype, m.actuator_trnid[:, 0], strict=True)):
        if is_constant(m, a):
            continue
        if kind in (JOINT, IN_PARENT):
            driven += [] if tree.is_fixed(target) else [tree.joints[target]]
        elif kind == TENDON and isinstance(tendons.paths[target], FixedTendon):
            driven += tendons.paths[target].joints
    return tuple(dict.fromkeys(driven))


def left_out_of(m: Any, tree: CompiledTree, told: dict[str, list[str]]) -> list[str]:
    """What is there beside bodies and is not simulated, one entry a kind; `told` by other readers."""
    at = m.jnt_dofadr  # a joint's velocities are alike in what is asked here
    moved = [not tree.is_fixed(j) for j in range(m.njnt)]
    sprung = (m.jnt_stiffness != 0.0) & (not is_off(m, "SPRING"))
    kinds: dict[str, Iterable[str]] = {
        "drag of a medium": [key for key in ("density", "viscosity", "wind") if np.any(getattr(m.opt, key))],
        "gravity compensation of bodies": _of(
            tree.bodies, m.body_gravcomp, _lifts_all(m) or not _is_lifted(m)
        ),
        "motion of mocap bodies": _of(tree.bodies, (m.body_mocapid >= 0) & tree.stays()),
        STAYS: tree.standing,
        "armature of free joints": _of(
            tree.joints, (m.dof_armature[at] != 0.0) & (m.jnt_type == FREE) & moved
        ),
        "dry friction of joints": _of(
            tree.joints, (m.dof_frictionloss[at] != 0.0) & moved, is_off(m, "FRICTIONLOSS")
        ),
        "limits of joints": _of(tree.joints, m.jnt_limited, is_off(m, "LIMIT")),
        "springs of free joints": _of(tree.joints, sprung & (m.jnt_type == FREE) & moved),
        "nonlinear parts of springs and dampers": _of(tree.joints, _curved(m) & moved),
        "deformables": [_text(m, at) or "flex" for at in m.name_flexadr],
        **told,
        "contacts of bodies": _of(
            [tree.bodies[b] for b in m.geom_bodyid],
            (m.geom_bodyid > 0) & ((m.geom_contype | m.geom_conaffinity) != 0),
            is_off(m, "CONTACT"),
        ),
    }
    return [entry for kind, where in kinds.items() for entry in named(kind, where)]


def _curved(m: Any) -> Any:
    """Joints whose springs or dampers are more than linear, or yield; MuJoCo 3 has none."""
    if not hasattr(m, "jnt_stiffnesspoly"):
        return np.zeros(m.njnt, dtype=bool)
    curved = np.any(m.jnt_stiffnesspoly, axis=1) | np.any(m.dof_dampingpoly[m.jnt_dofadr], axis=1)
    return curved | (m.jnt_plasticadr >= 0)


def _text(m: Any, at: int) -> str:
    """A name in mjModel, which has no accessor of its own."""
    return bytes(m.names[at:]).split(b"\0", 1)[0].decode(errors="replace")


def _of(names: list[str], which: Any, switched_off: bool = False) -> list[str]:
    return [name for name, is_one in zip(names, which, strict=True) if is_one and not switched_off]
