"""Pinocchio's constraint models as closures between named frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from .closures import Closure, FrameClosure, PointClosure
from .couplings import AnyClosure, CouplingClosure

OWN = Closure | CouplingClosure
ANCHORS = (pin.PointAnchorConstraintModel, pin.FrameAnchorConstraintModel)

UNUSED = 1e-12
"""Largest entry, in SI units, of a desired offset, velocity or acceleration that counts as zero."""


def with_named_frames(model: pin.Model, closures: Iterable[Any]) -> tuple[pin.Model, list[AnyClosure]]:
    """Closures between frames for a list that may hold Pinocchio's constraint models too.

    A constraint model says where it acts by two joints and a placement on each; here each such place
    becomes a frame of a copy of the model, `<name>_1` and `<name>_2`. What a constraint model
    holds for Pinocchio's solvers (Baumgarte gains, reference frame) has no bearing on φ = 0; rows
    and signs are those of the closures: position frame 1 − frame 2 in world axes.

    Parameters
    ----------
    model : pin.Model
        Copied when frames are to be added; never written to.
    closures : iterable
        Closures of this package, and of Pinocchio `RigidConstraintModel`
        (CONTACT_3D, CONTACT_6D), `PointAnchorConstraintModel`, `FrameAnchorConstraintModel` and
        `ConstraintModel` around one of the last two.

    Returns
    -------
    pin.Model, list of closures
        The same model when there was nothing to add.

    Raises
    ------
    ModelError
        For another kind of constraint, a joint that the model does not have, a motion or compliance
        asked of the constraint.
    """
    listed = list(closures)
    if all(isinstance(c, OWN) for c in listed):
        return model, listed
    extended = model.copy()  # the caller's model stays as it is
    named: list[AnyClosure] = []
    for i, item in enumerate(listed):
        if isinstance(item, OWN):
            named.append(item)
        else:
            named.append(_closure(extended, item, i))
    return extended, named


Kind = TypeVar("Kind", bound=Closure)


def close_between(
    model: pin.Model,
    kind: Callable[[str, str], Kind],
    name: str,
    ends: tuple[tuple[int, pin.SE3], tuple[int, pin.SE3]],
) -> Kind:
    """Add the frames `<name>_1` and `<name>_2` to the model; the closure between them.

    Parameters
    ----------
    kind : callable
        Makes the closure of the two frames' names.
    ends : pair of (joint index, placement)
    """
    taken = {frame.name for frame in model.frames}
    unique, count = name, 1
    while f"{unique}_1" in taken or f"{unique}_2" in taken:
        count += 1
        unique = f"{name}_{count}"
    for number, (joint, placement) in enumerate(ends, start=1):
        frame = pin.Frame(f"{unique}_{number}", joint, placement, pin.FrameType.OP_FRAME)
        model.addFrame(frame, False)
    return kind(f"{unique}_1", f"{unique}_2")


def _closure(model: pin.Model, item: Any, position: int) -> Closure:
    constraint = item.extract() if isinstance(item, pin.ConstraintModel) else item
    label = f"closures[{position}]"
    if not isinstance(constraint, (pin.RigidConstraintModel, *ANCHORS)):
        raise ModelError(
            f"{label}: {type(constraint).__name__} does not close a loop; use PointClosure, FrameClosure, "
            "RevoluteClosure, or of Pinocchio RigidConstraintModel, PointAnchorConstraintModel, "
            "FrameAnchorConstraintModel"
        )
    if constraint.name:
        label += f" ({constraint.name!r})"
    joints = (int(constraint.joint1_id), int(constraint.joint2_id))
    for joint in joints:
        if joint >= model.njoints:
            raise ModelError(
                f"{label} is attached to joint {joint}, and the model has {model.njoints - 1}: "
                "it was made for another model"
            )
    kind, first = _kind_and_first(constraint, label)
    return close_between(
        model,
        kind,
        constraint.name or f"constraint_{position}",
        ((joints[0], first), (joints[1], constraint.joint2_placement.copy())),
    )


def _kind_and_first(constraint: Any, label: str) -> tuple[type[PointClosure] | type[FrameClosure], pin.SE3]:
    """Which closure it is, and the placement on the first joint with the desired offset in it."""
    first = constraint.joint1_placement.copy()
    if isinstance(constraint, pin.RigidConstraintModel):
        _require_none(constraint.desired_contact_velocity.vector, "desired_contact_velocity", label)
        _require_none(constraint.desired_contact_acceleration.vector, "desired_contact_acceleration", label)
        # constraintDynamics of Pinocchio 4 computes the same error whatever this placement is
        offset = pin.log6(constraint.desired_contact_placement).vector
        _require_none(offset, "desired_contact_placement", label)
        _require_rigid(constraint, label)
        if constraint.type == pin.ContactType.CONTACT_3D:
            return PointClosure, first
        if constraint.type == pin.ContactType.CONTACT_6D:
            return FrameClosure, first
        raise ModelError(f"{label}: its type is {constraint.type}; give CONTACT_3D or CONTACT_6D")
    _require_none(constraint.desired_constraint_velocity, "desired_constraint_velocity", label)
    _require_none(constraint.desired_constraint_acceleration, "desired_constraint_acceleration", label)
    _require_rigid(constraint, label)
    offset = np.asarray(constraint.desired_constraint_offset)
    if isinstance(constraint, pin.FrameAnchorConstraintModel):
        # its own calc of Pinocchio 4 leaves this offset out
        _require_none(offset, "desired_constraint_offset", label)
        return FrameClosure, first
    # φ of the anchor is R₁ᵀ (p₂ − p₁) − offset
    return PointClosure, first * pin.SE3(np.eye(3), offset)


def _require_none(value: Any, what: str, label: str) -> None:
    if np.abs(np.asarray(value)).max(initial=0.0) > UNUSED:
        raise ModelError(
            f"{label}: {what} = {np.asarray(value).tolist()} is not zero; a closure holds two places "
            "together: put an offset into joint1_placement, and leave motions to the joints"
        )


def _require_rigid(constraint: Any, label: str) -> None:
    compliance = np.asarray(constraint.retrieveCompliance(), dtype=float)
    if np.abs(compliance).max(initial=0.0) > 0.0:
        raise ModelError(
            f"{label}: its compliance is {compliance.tolist()}; closures are rigid: set it to zero, "
            "or leave the constraint out and put a PointSpring in its place"
        )
