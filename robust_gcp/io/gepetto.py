"""The joint changes of example-parallel-robots' YAML: spherical and universal joints, fixed joints.

URDF has no spherical and no universal joint, so the folders write an ordinary joint in their place
and list, beside it in robot.yaml, what it stands for: `joint_name: [...]` and `joint_type: [...]`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..checks import hint, shown
from ..errors import ModelError
from ..mechanism.forces.forces import Force, JointDamper
from ..mechanism.tree.joints import along
from .robot_yaml import is_list_of_str

AXES = dict(zip("XYZ", np.eye(3), strict=True))
UNIVERSAL = {f"UJOINT_{a}{b}": (a, b) for a, b in itertools.permutations("XYZ", 2)}
"""Universal joints by type: first axis, then second, of the URDF joint's frame."""

SHORT = {"UJOINT": "UJOINT_XY", "CARDAN": "UJOINT_XY"}
"""Names without axes; CARDAN is what older folders write."""

OF_VELOCITIES = (
    *("armature", "damping", "lowerDryFrictionLimit", "upperDryFrictionLimit"),
    *("lowerEffortLimit", "upperEffortLimit", "lowerVelocityLimit", "upperVelocityLimit"),
)
"""What a model holds of a joint that is kept, one number a velocity."""

TYPES = ("SPHERICAL", "UJOINT_XY", "UJOINT_YZ", "UJOINT_ZX", "…", "FIXED")


def joint_changes(settings: dict[str, Any], path: Path) -> dict[str, str]:
    """`joint_name` and `joint_type` of robot.yaml as one mapping, checked.

    Returns
    -------
    dict of str to str
        Joint name to SPHERICAL, FIXED or UJOINT_ab; empty where the keys are absent.
    """
    names = settings.get("joint_name") or []
    kinds = settings.get("joint_type") or []
    for key, value in (("joint_name", names), ("joint_type", kinds)):
        if not is_list_of_str(value):
            raise ModelError(f"{path}: {key} must be a list of names, not {shown(value)}")
    if len(names) != len(kinds):
        raise ModelError(
            f"{path}: joint_name lists {len(names)} joints and joint_type {len(kinds)} types; give one each"
        )
    changes: dict[str, str] = {}
    for name, written in zip(names, kinds, strict=True):
        kind = SHORT.get(written.upper(), written.upper())
        if kind not in UNIVERSAL and kind not in ("SPHERICAL", "FIXED"):
            raise ModelError(
                f"{path}: joint_type {shown(written)} of joint {shown(name)} is unknown; use one of "
                + ", ".join(TYPES)
            )
        if name in changes:
            raise ModelError(f"{path}: joint_name names the joint {shown(name)} twice; leave one out")
        changes[name] = kind
    return changes


def with_joint_changes(model: pin.Model, changes: dict[str, str], path: Path) -> pin.Model:
    """The same tree with some joints replaced.

    Each new joint stands where the old one stood, whatever the old one's axis was:

    - SPHERICAL: a spherical joint of the same name (4 numbers in q, 3 in v);
    - UJOINT_ab: a massless cross between two revolute joints, `<name>_a` about axis a and
      `<name>_b` about axis b, which carries the body;
    - FIXED: the joint is frozen at zero.

    The order of joints stays depth first. Bodies, frames, armature, damping and limits are kept.

    Parameters
    ----------
    model : pin.Model
        Never written to.
    changes : dict of str to str
        From `joint_changes`.

    Raises
    ------
    ModelError
        For a joint that the model does not have.
    """
    if not changes:
        return model
    joint_names = list(model.names)
    for name in changes:
        if name not in joint_names[1:]:
            near = hint(name, joint_names[1:])
            raise ModelError(f"{path}: joint_name names {shown(name)}, which the URDF does not have{near}")
    changed = pin.Model()
    changed.name = model.name
    changed.gravity = model.gravity
    changed.inertias[0] = model.inertias[0]
    index = [0]  # of the new joint that carries the body of each old one
    # in the old order: Pinocchio's CRBA is wrong for joints that are not added depth first
    for old in range(1, model.njoints):
        name, parent = joint_names[old], index[model.parents[old]]
        kind, placement = changes.get(name, ""), model.jointPlacements[old]
        if kind == "SPHERICAL":
            new = changed.addJoint(parent, pin.JointModelSpherical(), placement, name)
        elif kind in UNIVERSAL:
            first, second = UNIVERSAL[kind]
            cross = changed.addJoint(parent, along("R", AXES[first]), placement, f"{name}_{first}")
            new = changed.addJoint(cross, along("R", AXES[second]), pin.SE3.Identity(), f"{name}_{second}")
        else:
            new = changed.addJoint(parent, model.joints[old], placement, name)
            _copy_joint_data(model, old, changed, new)
        changed.appendBodyToJoint(new, model.inertias[old], pin.SE3.Identity())
        index.append(int(new))
    for frame in list(model.frames)[1:]:
        moved = pin.Frame(frame.name, index[frame.parentJoint], frame.placement, frame.type, frame.inertia)
        changed.addFrame(moved, False)
    frozen = [changed.getJointId(name) for name, kind in changes.items() if kind == "FIXED"]
    if frozen:
        changed = pin.buildReducedModel(changed, frozen, pin.neutral(changed))
    return changed


def with_changed_forces(forces: Sequence[Force], changes: dict[str, str]) -> list[Force]:
    """Dampers of the replaced joints on what they are replaced by; a fixed joint has none."""
    found: list[Force] = []
    for force in forces:
        kind = changes.get(getattr(force, "joint", ""), "")
        if not isinstance(force, JointDamper) or kind in ("", "SPHERICAL"):
            found.append(force)
        elif kind in UNIVERSAL:
            found += [JointDamper(f"{force.joint}_{axis}", force.damping) for axis in UNIVERSAL[kind]]
    return found


def _copy_joint_data(model: pin.Model, old: int, changed: pin.Model, new: int) -> None:
    """Limits, damping, friction and armature of a joint that is kept."""
    before, after = model.joints[old], changed.joints[new]
    iq, jq = (slice(j.idx_q, j.idx_q + j.nq) for j in (before, after))
    iv, jv = (slice(j.idx_v, j.idx_v + j.nv) for j in (before, after))
    for name in ("lowerPositionLimit", "upperPositionLimit"):
        getattr(changed, name)[jq] = np.asarray(getattr(model, name))[iq]
    for name in OF_VELOCITIES:
        getattr(changed, name)[jv] = np.asarray(getattr(model, name))[iv]
