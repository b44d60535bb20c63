"""A mechanism as what files are written of: joints as chains of plain ones, bodies, frames, names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..errors import ModelError
from ..mechanism.assembly.ranges import WIDE
from ..mechanism.constraint.couplings import AnyClosure
from ..mechanism.constraint.partial_closure import PartialClosure
from ..mechanism.forces.forces import JointDamper, JointSpring
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import Joint, JointKind
from ..mechanism.tree.tree import Array

X, Y, Z = np.eye(3)
CHAINS: dict[JointKind, list[tuple[str, Array]]] = {
    JointKind.SPHERICAL: [("ball", Z)],
    JointKind.FREE_FLYER: [("free", Z)],
    JointKind.TRANSLATION: [("slide", X), ("slide", Y), ("slide", Z)],
    JointKind.PLANAR: [("slide", X), ("slide", Y), ("hinge", Z)],
    JointKind.EULER_ZYX: [("hinge", Z), ("hinge", Y), ("hinge", X)],
}
"""Kinds as plain joints one after the other, each with its axis; those with one axis of their own aside."""


@dataclass(frozen=True, eq=False)
class Part:
    """A joint of the tree with its body.

    Attributes
    ----------
    joint : Joint
    parent : int
        Index of the joint that carries it; 0 is the ground.
    place : pin.SE3
        On the parent's body.
    links : list of (str, str, ndarray)
        Name, sort (hinge, slide, ball or free) and axis of each plain joint that it amounts to.
    body : str
    inertia : pin.Inertia
    frames : list of (str, pin.SE3, str)
        The other frames on the body: name, place, and the fixed joint that holds it, if any.
    range : (float, float) or None
    stiffness, rest, damping, friction : float
        Of its springs together, of its dampers, and dry.
    armature : ndarray (nv,)
    effort : (float, float) or None
        Range of what actuators do in it together.
    """

    joint: Joint
    parent: int
    place: pin.SE3
    links: list[tuple[str, str, Array]]
    body: str
    inertia: pin.Inertia
    frames: list[tuple[str, pin.SE3, str]]
    range: tuple[float, float] | None
    stiffness: float
    rest: float
    damping: float
    friction: float
    armature: Array
    effort: tuple[float, float] | None = None


Lost = dict[str, list[str]]
"""What a format has no place for: names by kind."""


def parts_of(
    mechanism: Mechanism, what: str, lost: Lost
) -> tuple[list[tuple[str, pin.SE3, str]], list[Part]]:
    """Frames on the ground, and the joints in their order with what they carry.

    Raises
    ------
    ModelError
        For a joint that no chain of plain ones amounts to; `what` is the format.
    """
    model, taken = mechanism.own_model, {"world"}
    _, ground = _frames(model, 0, "world", taken)
    made = []
    for joint in mechanism.joints:
        links, i = links_of(model, joint, what), joint.index
        if len(links) > 1:
            note(lost, "joints written as several", [joint.name])
        body, frames = _frames(model, i, joint.name, taken)
        springs = [f for f in mechanism.forces if isinstance(f, JointSpring) and f.joint == joint.name]
        stiffness = float(sum(f.stiffness for f in springs))
        # springs in parallel: k = Σ kᵢ, and no force where Σ kᵢ (q − rᵢ) = 0
        rest = float(sum(f.stiffness * f.rest for f in springs)) / stiffness if stiffness else 0.0
        dampers = [f for f in mechanism.forces if isinstance(f, JointDamper) and f.joint == joint.name]
        damping = float(sum(f.damping for f in dampers))
        above, place, armature = int(model.parents[i]), model.jointPlacements[i], np.asarray(model.armature)
        if joint.kind is JointKind.PLANAR and np.any(armature[joint.v][:2]):  # along axes that turn with it
            note(lost, "armature of joints", [joint.name])
        body_parts = (joint, above, place, links, body, model.inertias[i], frames, _range(model, joint))
        dry = float(model.upperDryFrictionLimit[joint.idx_v]) if joint.single else 0.0
        effort = _effort(mechanism, joint)
        made.append(Part(*body_parts, stiffness, rest, damping, dry, armature[joint.v], effort))
    return ground, made


def _effort(mechanism: Mechanism, joint: Joint) -> tuple[float, float] | None:
    """Where there are actuators, and a limit."""
    actuation = mechanism.actuation
    if actuation is None or not joint.single:
        return None
    low, high = float(actuation.low[joint.idx_v]), float(actuation.high[joint.idx_v])
    return (low, high) if np.isfinite(high - low) else None


def quaternion(rotation: Array) -> str:
    """MuJoCo's order: w, x, y, z."""
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return text((w, x, y, z))


def links_of(model: pin.Model, joint: Joint, what: str) -> list[tuple[str, str, Array]]:
    """The plain joints that a joint amounts to."""
    if joint.axis is not None and joint.kind is not JointKind.SCREW:
        return [(joint.name, "slide" if joint.kind is JointKind.PRISMATIC else "hinge", joint.axis)]
    if joint.kind is JointKind.UNIVERSAL:
        made = model.joints[joint.index].extract()
        chain = [("hinge", np.asarray(made.axis1)), ("hinge", np.asarray(made.axis2))]
    elif joint.kind in CHAINS:
        chain = CHAINS[joint.kind]
    else:
        raise ModelError(
            f"joint {joint.name!r} ({joint.type}) cannot be written as {what}; split it into plain ones"
        )
    if len(chain) == 1:
        return [(joint.name, *chain[0])]
    return [(f"{joint.name}_{i + 1}", *link) for i, link in enumerate(chain)]


def whole_closures(mechanism: Mechanism) -> list[AnyClosure]:
    """The closures with all their rows: those that others imply are found again on reading."""
    return [c.all_rows() if isinstance(c, PartialClosure) else c for c in mechanism.closures]


def plain_numbers(joint: Joint, q: Array) -> Array:
    """The numbers in q of the plain joints: angles in place of cosines and sines."""
    numbers = q[joint.idx_q : joint.idx_q + joint.nq]
    if joint.kind in (JointKind.CONTINUOUS, JointKind.PLANAR):
        return np.append(numbers[:-2], np.arctan2(numbers[-1], numbers[-2]))
    return numbers


def text(numbers: Iterable[float]) -> str:
    """Numbers to the last digit, a space between."""
    return " ".join(repr(float(x)) for x in numbers)


def note(lost: Lost, what: str, names: Iterable[str]) -> None:
    """Note what a format has no place for."""
    found = list(names)
    if found:
        lost.setdefault(what, []).extend(found)


def _range(model: pin.Model, joint: Joint) -> tuple[float, float] | None:
    if not joint.single:
        return None
    low = float(model.lowerPositionLimit[joint.idx_q])
    high = float(model.upperPositionLimit[joint.idx_q])
    return (low, high) if min(abs(low), abs(high)) < WIDE and low <= high else None


def _frames(
    model: pin.Model, index: int, joint: str, taken: set[str]
) -> tuple[str, list[tuple[str, pin.SE3, str]]]:
    """The name of a body, after the link that is where its joint is, and its other frames."""
    body, others, held = "", [], {}
    for frame in list(model.frames)[1:]:  # the first is the ground itself
        of_joint = frame.type == pin.FrameType.JOINT and model.existJointName(frame.name)
        if frame.parentJoint != index or of_joint or frame.name in taken:
            continue
        if frame.type == pin.FrameType.FIXED_JOINT:
            held[model.getFrameId(frame.name, frame.type)] = frame
            continue
        if frame.type == pin.FrameType.BODY and not body and index and frame.placement.isIdentity(0.0):
            body = frame.name
        else:
            joint_above = held.pop(frame.parentFrame, None)
            others.append((frame.name, frame.placement, joint_above.name if joint_above else ""))
        taken.add(frame.name)
    for frame in held.values():
        if frame.name not in taken:
            others.append((frame.name, frame.placement, ""))
            taken.add(frame.name)
    if not body:
        body = joint if joint not in taken else f"{joint}_body"
        taken.add(body)
    return body, others
