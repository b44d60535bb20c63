"""The graph of joints and closures: which joints close which loops, and how large the loops are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .closures import Closure, frame_of
from .tree import Array


@dataclass(frozen=True)
class LoopGroup:
    """Closures that share joints, and those joints: a biconnected component of the mechanism's graph.

    Attributes
    ----------
    joints : tuple of int
        Joint indices in the model, ascending.
    closures : tuple of int
        Positions in the list of closures, ascending.
    root : int
        The joint whose body carries them all, 0 for the ground: the lowest common ancestor.
    """

    joints: tuple[int, ...]
    closures: tuple[int, ...]
    root: int


def loop_groups(model: pin.Model, closures: Sequence[Closure]) -> list[LoopGroup]:
    """The groups of closures that share a joint, in the order of their first joint.

    A closure's joints are the symmetric difference of the two frames' supports: the two paths below the
    lowest common ancestor of their bodies. Two trees of one mechanism, or two choices of the cut joints,
    give the same groups of bodies, since a joint and a cut are both edges of the same graph.
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
        (root,) = {int(model.parents[j]) for j in joints} - joints
        groups.append(LoopGroup(tuple(sorted(joints)), tuple(sorted(members)), root))
    return sorted(groups, key=lambda group: group.joints)


def characteristic_length(model: pin.Model, closures: Sequence[Closure]) -> float:
    """The largest distance on one body between its own joint and the next joints or cut points, m.

    On the body that carries a group of loops it is the largest distance between two of its points, so
    that it does not count where the group stands. Joints that are in no loop count where there is none.
    """
    groups = loop_groups(model, closures)
    if not groups:
        everything = LoopGroup(tuple(range(1, model.njoints)), (), 0)
        return _size(model, closures, everything) or 1.0
    return max(_size(model, closures, group) for group in groups) or 1.0


def _size(model: pin.Model, closures: Sequence[Closure], group: LoopGroup) -> float:
    points: dict[int, list[Array]] = {body: [] for body in (group.root, *group.joints)}
    for joint in group.joints:
        points[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for i in group.closures:
        for name in (closures[i].frame1, closures[i].frame2):
            frame = frame_of(model, name, "closure")
            points[frame.parentJoint].append(frame.placement.translation)
    carried = np.array(points.pop(group.root)).reshape(-1, 3)
    lengths = [float(np.linalg.norm(a - b)) for a in carried for b in carried]
    lengths += [float(np.linalg.norm(p)) for found in points.values() for p in found]
    return max(lengths, default=0.0)


def _path(model: pin.Model, closure: Closure) -> set[int]:
    """The joints between the closure's two bodies."""
    ends = (closure.frame1, closure.frame2)
    first, second = (set(model.supports[frame_of(model, name, "closure").parentJoint]) for name in ends)
    return {int(joint) for joint in first ^ second}
