"""Joints whose velocities are all independent and no rates of numbers in q, such as a floating base."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..constraint.closures import frame_of
from ..constraint.couplings import CouplingClosure
from ..mechanism import Mechanism
from ..tree.tree import Array
from .joint_charts import JointCharts, places


class Groups(JointCharts):
    """A mechanism taken apart: its joints on groups, which no loop ties, and the rest with these held.

    A closure is expressed in the frame of the lowest common ancestor of its bodies, so q = γ(y), G and g of
    the rest do not depend on where the joints on groups are.

    Parameters
    ----------
    mechanism : Mechanism
        With `group_joints`.

    Attributes
    ----------
    mechanism, rest : Mechanism
        The whole, and the rest as a mechanism of its own.
    model : pin.Model
        The joints on groups alone, side by side.
    iq, iv : ndarray of int
        Where their q and v are in those of the whole.
    inputs : ndarray of int
        Where their velocities are among the independent ones of the whole.
    rest_iq, rest_iv, rest_inputs : ndarray of int
        The same of the rest; `rest_inputs` are those of `rest.iv_independent`, in their order.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        joints = mechanism.group_joints
        names = {joint.name for joint in joints}
        super().__init__(mechanism.own_model, joints)
        others = [joint for joint in mechanism.joints if joint.name not in names]
        self.rest_iq = places([(j.idx_q, j.nq) for j in others])
        self.rest_iv = places([(j.idx_v, j.nv) for j in others])
        position = {int(i): k for k, i in enumerate(mechanism.iv_independent)}
        self.inputs = np.array([position[int(i)] for i in self.iv], dtype=np.int64)
        self.rest_inputs = np.setdiff1d(np.arange(mechanism.m), self.inputs)
        chosen = [n for n in mechanism.independent if n not in names and n.rpartition(".")[0] not in names]
        rest: Mechanism = mechanism.of_loops.once(
            ("rest", *sorted(names)),
            lambda: Mechanism(
                _held(mechanism, {joint.index for joint in joints}),
                mechanism.closures,
                chosen,
                mechanism.home[self.rest_iq],
                mechanism.name,
            ),
        )
        self.rest = rest if rest.independent == tuple(chosen) else rest.with_independent(chosen)

    @property
    def names(self) -> tuple[str, ...]:
        """The joints on groups."""
        return tuple(joint.name for joint in self.mechanism.group_joints)


def groups_of(mechanism: Mechanism) -> Groups | None:
    """The mechanism taken apart, or None where all its coordinates are numbers in q."""
    if not mechanism.group_joints:
        return None
    groups: Groups = mechanism.memo.once("groups", lambda: Groups(mechanism))
    return groups


def coordinate_choices(mechanism: Mechanism, q: Array) -> list[tuple[str, ...]]:
    """Sets of independent joints, best conditioned first; those on groups are in all of them."""
    groups = groups_of(mechanism)
    if groups is None:
        return [names for _, names in mechanism.coordinate_choices(q)]
    kept = [name for name in mechanism.independent if name not in groups.rest.independent]
    return [(*kept, *names) for _, names in groups.rest.coordinate_choices(q[groups.rest_iq])]


def _held(mechanism: Mechanism, held: set[int]) -> pin.Model:
    """The mechanism's model without these joints, which are held in their neutral position."""
    model, part, still = mechanism.own_model, pin.Model(), pin.SE3.Identity()
    part.name, part.gravity = model.name, model.gravity
    carried = [(0, still)]  # by which joint of the part, and where on it
    for j in range(1, model.njoints):
        parent, on = carried[model.parents[j]]
        place = on * model.jointPlacements[j]
        if j in held:
            carried.append((parent, place))
            continue
        index = int(part.addJoint(parent, model.joints[j], place, model.names[j]))
        part.appendBodyToJoint(index, model.inertias[j], still)
        carried.append((index, still))
    cut = [c for c in mechanism.closures if not isinstance(c, CouplingClosure)]
    for name in dict.fromkeys(name for c in cut for name in (c.frame1, c.frame2)):
        frame = frame_of(model, name, "closure")
        parent, on = carried[frame.parentJoint]
        part.addFrame(pin.Frame(name, parent, on * frame.placement, pin.FrameType.OP_FRAME))
    return part
