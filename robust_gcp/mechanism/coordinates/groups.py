"""Joints whose velocities are all independent and no rates of numbers in q, such as a floating base."""

from __future__ import annotations

import numpy as np

from ..mechanism import Mechanism
from ..tree.tree import Array
from .joint_charts import JointCharts, places
from .loop_graph import part_of


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
                part_of(mechanism.own_model, mechanism.closures, [joint.index for joint in others]),
                mechanism.closures,
                chosen,
                mechanism.home[self.rest_iq],
                mechanism.name,
            ),
        )
        # kept with the loops, whatever the coordinates, so it may have been made for others
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
