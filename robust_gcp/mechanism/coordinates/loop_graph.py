"""The graph of joints and closures: which joints close which loops, and how large the loops are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..constraint.closures import frame_of
from ..constraint.couplings import AnyClosure, CouplingClosure
from ..tree.tree import Array


@dataclass(frozen=True)
class LoopGroup:
    """Closures that share joints, and those joints: a biconnected component of the mechanism's graph.

    Attributes
    ----------
    joints : tuple of int
        Joint indices in the model, depth first.
    closures : tuple of int
        Positions in the list of closures, ascending.
    roots : tuple of int
        The joint whose body carries them all, 0 for the ground: the lowest common ancestor. Several
        where couplings tie joints that do not meet: each carries a part of them.
    """

    joints: tuple[int, ...]
    closures: tuple[int, ...]
    roots: tuple[int, ...]


def loop_groups(model: pin.Model, closures: Sequence[AnyClosure]) -> list[LoopGroup]:
    """The groups of closures that share a joint, in the order of their first joint.

    A closure's joints are the symmetric difference of the two frames' supports: the two paths below the
    lowest common ancestor of their bodies; a coupling's are its two. Two trees of one mechanism, or two
    choices of the cut joints, give the same groups of bodies, since a joint and a cut are both edges of
    the same graph.
    """
    found: list[tuple[set[int], list[int]]] = []
    for i, closure in enumerate(closures):
        joints = _path(model, closure)
        members = [i]
        apart = []
        for other in found:
            if other[0] & joints:
                joints = joints | other[0]
                members = other[1] + members
            else:
                apart.append(other)
        found = [*apart, (joints, members)]
    groups = []
    for joints, members in found:
        roots = {int(model.parents[j]) for j in joints} - joints
        # depth first in the part's own tree, where what hangs beyond a joint of no loop hangs on the ground
        ordered = sorted(joints, key=lambda j: _chain(model, joints, j))
        groups.append(LoopGroup(tuple(ordered), tuple(sorted(members)), tuple(sorted(roots))))
    return sorted(groups, key=lambda group: group.joints)


def characteristic_length(model: pin.Model, closures: Sequence[AnyClosure]) -> float:
    """The largest distance on one body between its own joint and the next joints or cut points, m.

    On the body that carries a group of loops it is the largest distance between two of its points, so
    that it does not count where the group stands. Joints that are in no loop count where there is none.
    """
    groups = loop_groups(model, closures)
    if not groups:
        everything = LoopGroup(tuple(range(1, model.njoints)), (), (0,))
        return _size(model, closures, everything) or 1.0
    # all points in one: any unit will do
    return max(_size(model, closures, group) for group in groups) or 1.0


def _size(model: pin.Model, closures: Sequence[AnyClosure], group: LoopGroup) -> float:
    points: dict[int, list[Array]] = {body: [] for body in (*group.roots, *group.joints)}
    for joint in group.joints:
        points[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for closure in (closures[i] for i in group.closures):
        for name in () if isinstance(closure, CouplingClosure) else (closure.frame1, closure.frame2):
            frame = frame_of(model, name, "closure")
            points[frame.parentJoint].append(frame.placement.translation)
    carried = [points.pop(root) for root in group.roots]
    lengths = [float(np.linalg.norm(a - b)) for places in carried for a in places for b in places]
    lengths += [float(np.linalg.norm(p)) for found in points.values() for p in found]
    return max(lengths, default=0.0)


def _chain(model: pin.Model, joints: set[int], joint: int) -> list[int]:
    """The joints of a set that carry a joint without a gap, from the lowest on, itself included."""
    chain = [joint]
    while int(model.parents[chain[-1]]) in joints:
        chain.append(int(model.parents[chain[-1]]))
    return chain[::-1]


def _path(model: pin.Model, closure: AnyClosure) -> set[int]:
    """The joints between the closure's two bodies, or those that it couples."""
    if isinstance(closure, CouplingClosure):
        return {int(model.getJointId(name)) for name in closure.joints}
    ends = (closure.frame1, closure.frame2)
    first, second = (set(model.supports[frame_of(model, name, "closure").parentJoint]) for name in ends)
    return {int(joint) for joint in first ^ second}  # the ground, in both, drops out


def part_of(
    model: pin.Model, closures: Sequence[AnyClosure], joints: Sequence[int], roots: Sequence[int] = (0,)
) -> pin.Model:
    """Some joints as a model of their own, with the frames of closures.

    Parameters
    ----------
    joints : sequence of int
        Depth first; all others are held in their neutral position.
    roots : sequence of int
        Joints whose bodies are the part's ground.
    """
    part, still = pin.Model(), pin.SE3.Identity()
    part.name, part.gravity = model.name, model.gravity
    carried = dict.fromkeys(roots, (0, still))

    def at(j: int) -> tuple[int, pin.SE3]:
        """By which joint of the part a joint's body is carried, and where on it."""
        if j not in carried:
            parent, on = at(model.parents[j])
            carried[j] = parent, on * model.jointPlacements[j]  # in neutral every joint's own motion is none
        return carried[j]

    for j in joints:
        parent, on = at(model.parents[j])
        index = int(part.addJoint(parent, model.joints[j], on * model.jointPlacements[j], model.names[j]))
        part.appendBodyToJoint(index, model.inertias[j], still)
        carried[j] = index, still
    cut = [c for c in closures if not isinstance(c, CouplingClosure)]
    for name in dict.fromkeys(name for c in cut for name in (c.frame1, c.frame2)):
        frame = frame_of(model, name, "closure")
        parent, on = at(frame.parentJoint)
        part.addFrame(pin.Frame(name, parent, on * frame.placement, pin.FrameType.OP_FRAME))
    return part
