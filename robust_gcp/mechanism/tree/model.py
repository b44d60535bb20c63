"""Pinocchio's model: its numbers checked, seen from near, and unchanged where it was handed out.

φ, K, M and C do not depend on where a mechanism stands, but positions far from the origin are rounded there,
and bodies have inertias about it that only cancel. So the model is seen from a point of the ground near its
joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ...checks import shown
from ...errors import ModelError
from .tree import Array

OVERFLOWING = 1e100
"""SI units: products of three such numbers are no longer finite."""

NOT_TURNED = 1e-6
"""Largest entry of R Rᵀ − I of a rotation: rounded input."""

UNPHYSICAL = 1e-6
"""Negative principal moment, relative to the body's inertia at the model's size, taken for rounding."""

LIGHTEST = float(np.finfo(float).eps)
"""kg: Pinocchio divides by no smaller sum of masses, so that lighter bodies get a wrong centre."""


def check_model(model: Any) -> None:
    """Refuse what is not a `pin.Model`, and a model whose numbers no body in space can have.

    Raises
    ------
    ModelError
        Naming the joint or frame.
    """
    if not isinstance(model, pin.Model):
        what = shown(model) if model is None or isinstance(model, str) else type(model).__name__
        raise ModelError(
            f"model: {what} is not a pin.Model; use robust_gcp.load(...) for a shipped model or a folder, "
            "Mechanism.from_urdf(...) for a URDF file"
        )
    if model.nv != model.nvExtended:
        raise ModelError("model: it has mimic joints, which cannot be simulated; build it without mimic=True")
    for what in ("armature", "rotorInertia"):
        values = np.asarray(getattr(model, what))
        if not _is_finite(values) or np.any(values < 0.0):
            raise ModelError(f"model.{what} = {shown(values.tolist())} must be finite and not negative")
    if not _is_finite(model.gravity.vector):
        raise ModelError(f"model.gravity = {model.gravity.vector.tolist()} must be finite")
    if np.any(model.gravity.angular):
        turn = shown(model.gravity.angular.tolist())
        raise ModelError(f"model.gravity.angular = {turn} must be zero; drive= a joint instead")
    labels = [f"joint {name!r} has a placement" for name in model.names]
    labels += [f"frame {frame.name!r} has a placement" for frame in model.frames]
    poses = [p.homogeneous for p in model.jointPlacements] + [f.placement.homogeneous for f in model.frames]
    _check_placements(labels, np.array(poses))
    size = float(np.abs(np.array(poses)[: model.njoints, :3, 3]).max())
    for name, inertia in list(zip(model.names, model.inertias, strict=True))[1:]:
        _check_inertia(name, inertia, size)


def _is_finite(values: Array) -> bool:
    """Finite, and so are products of a few of them."""
    return bool(np.abs(values).max(initial=0.0) <= OVERFLOWING)  # False for NaN


def _check_placements(labels: Sequence[str], poses: Array) -> None:
    """Finite translations, and rotations that are some."""
    for label, pose in zip(labels, poses, strict=True):
        if not _is_finite(pose):
            raise ModelError(f"{label} that is not finite, or beyond {OVERFLOWING:g} m; correct it")
    R = poses[:, :3, :3]
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    worst = int(np.argmax(off))
    if off[worst] > NOT_TURNED or np.any(np.linalg.det(R) < 0.0):  # R Rᵀ = I for reflections too
        raise ModelError(f"{labels[worst]} whose 3 × 3 matrix is no rotation; make it orthonormal")


def _check_inertia(joint: str, inertia: pin.Inertia, size: float) -> None:
    """Mass not negative and principal moments neither, or kinetic energy would be."""
    if not _is_finite(inertia.toDynamicParameters()):
        raise ModelError(
            f"the body that joint {joint!r} carries has mass {inertia.mass:g} kg and centre "
            f"{inertia.lever.tolist()} m: mass, centre and inertia must be finite"
        )
    if 0.0 < inertia.mass < LIGHTEST:
        raise ModelError(
            f"the body that joint {joint!r} carries has mass {inertia.mass:g} kg: Pinocchio misplaces the "
            f"centre of bodies below {LIGHTEST:g} kg when it adds them up; give it no mass at all or, where "
            "all bodies are as light, take a larger unit of mass for masses, inertias and forces"
        )
    moments = np.linalg.eigvalsh(inertia.inertia)
    arm = size**2 + float(inertia.lever @ inertia.lever)
    scale = float(np.abs(moments).max()) + abs(inertia.mass) * arm
    if inertia.mass < 0.0 or moments[0] < -UNPHYSICAL * scale:
        raise ModelError(
            f"the body that joint {joint!r} carries has mass {inertia.mass:g} kg and principal moments of "
            f"inertia {moments.tolist()} kg m²: none may be negative, correct them"
        )


def standpoint(model: pin.Model) -> Array:
    """Where the first joint stands on the ground, (3,), m."""
    return np.array(model.jointPlacements[1].translation) if model.njoints > 1 else np.zeros(3)


def seen_from(model: pin.Model, point: Array) -> pin.Model:
    """The model with its ground's origin moved to a point (3,); the model itself where that is the origin."""
    if not np.any(point):
        return model
    moved = model.copy()
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            moved.jointPlacements[joint] = _seen(model.jointPlacements[joint], point)
    for frame in moved.frames:
        if frame.parentJoint == 0:
            frame.placement = _seen(frame.placement, point)
    # what hangs on other joints has not moved against them
    return moved


def _seen(place: pin.SE3, point: Array) -> pin.SE3:
    return pin.SE3(place.rotation, place.translation - point)


CHANGEABLE = (
    *("gravity", "inertias", "jointPlacements", "armature", "joints", "frames", "nframes"),
    *("lowerPositionLimit", "upperPositionLimit", "damping", "friction", "names"),
)
"""Parts of a model that one may have changed, as an error names them."""


def require_equal(shown: pin.Model, own: pin.Model) -> None:
    """Refuse to go on where the model that was handed out is not the mechanism's own any more.

    Raises
    ------
    ModelError
        Naming what is no more as it was.
    """
    if shown == own:
        return
    changed = [what for what in CHANGEABLE if not _same(getattr(shown, what), getattr(own, what))]
    if not changed and own != own.copy():  # it holds what is no number, such as a limit, and equals nothing
        return
    raise ModelError(
        f"the model of this mechanism was changed ({', '.join(changed) or 'in other parts'}), which its "
        "motion would not know of; change a copy, model = mech.model.copy(), and make another mechanism: "
        "Mechanism.from_pinocchio(model, mech.closures, mech.independent, mech.home, forces=mech.forces)"
    )


def _same(one: Any, other: Any) -> bool:
    """Whether two parts of models are equal: numbers, arrays, or Pinocchio's vectors of either."""
    if isinstance(one, np.ndarray):
        return bool(np.array_equal(one, other, equal_nan=True))
    if hasattr(one, "__len__"):
        return len(one) == len(other) and all(a == b for a, b in zip(one, other, strict=True))
    return bool(one == other)
