"""The numbers in q and v of each joint, with names and units to show."""

from __future__ import annotations

from typing import NamedTuple

from .loops import ClosedLoops


class Entry(NamedTuple):
    """One number of one joint.

    Attributes
    ----------
    name : str
        The joint's; with [k] where it has several numbers.
    iq, iv : int
        Index in q and in v; −1: none.
    units : str
        Of q and v, such as "rad, rad/s"; empty where the joint mixes them.
    """

    name: str
    iq: int
    iv: int
    units: str


UNITS = {"R": "rad, rad/s", "P": "m, m/s"}


def entries(mechanism: ClosedLoops) -> list[Entry]:
    """List the numbers of all joints in the order of q."""
    found = []
    for name, joint in zip(mechanism.joint_names, list(mechanism.model.joints)[1:], strict=True):
        count = max(joint.nq, joint.nv)
        if count == 1:
            kind = joint.shortname().removeprefix("JointModel")[:1]
            found.append(Entry(name, joint.idx_q, joint.idx_v, UNITS.get(kind, "")))
            continue
        for k in range(count):
            i = joint.idx_q + k if k < joint.nq else -1
            j = joint.idx_v + k if k < joint.nv else -1
            found.append(Entry(f"{name}[{k}]", i, j, ""))
    return found
