"""What a joint is: its kind, its axis, and its numbers in q and v with their names and units.

All other files ask here. A number is called by its joint where the joint has one of that sort, and
`joint.component` else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...checks import hint, shown
from ...errors import ModelError

Array = NDArray[np.floating[Any]]
Index = NDArray[np.int64]

OF_MOMENTS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Where second moments stand in their matrix, in Pinocchio's order: Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""


class JointKind(IntEnum):
    """Kinds of joints; the kernel knows the first seven by these numbers, see kernel/tree/joints.h."""

    REVOLUTE = 0
    PRISMATIC = 1
    CONTINUOUS = 2
    SPHERICAL = 3
    TRANSLATION = 4
    FREE_FLYER = 5
    PLANAR = 6
    SCREW = 7
    UNIVERSAL = 8
    EULER_ZYX = 9
    ELLIPSOID = 10
    COMPOSITE = 11


IN_KERNEL = frozenset(JointKind(number) for number in range(7))
"""Kinds that the compiled kernel knows; mechanisms with others run in Python."""

MOVING_SUBSPACE = frozenset(
    (JointKind.UNIVERSAL, JointKind.EULER_ZYX, JointKind.ELLIPSOID, JointKind.COMPOSITE)
)
"""Kinds whose motion subspace depends on q: Pinocchio's RNEA derivatives are wrong for them."""

_XYZ = ("X", "Y", "Z")
_KINDS = {
    **dict.fromkeys([*(f"R{a}" for a in _XYZ), "RevoluteUnaligned"], JointKind.REVOLUTE),
    **dict.fromkeys([*(f"P{a}" for a in _XYZ), "PrismaticUnaligned"], JointKind.PRISMATIC),
    **dict.fromkeys([*(f"RUB{a}" for a in _XYZ), "RevoluteUnboundedUnaligned"], JointKind.CONTINUOUS),
    **dict.fromkeys([*(f"H{a}" for a in _XYZ), "HelicalUnaligned"], JointKind.SCREW),
    "Spherical": JointKind.SPHERICAL,
    "Translation": JointKind.TRANSLATION,
    "FreeFlyer": JointKind.FREE_FLYER,
    "Planar": JointKind.PLANAR,
    "Universal": JointKind.UNIVERSAL,
    "SphericalZYX": JointKind.EULER_ZYX,
    "Ellipsoid": JointKind.ELLIPSOID,
    "Composite": JointKind.COMPOSITE,
}
"""Pinocchio's types, without their common prefix."""


class Component(NamedTuple):
    """One number of a joint.

    Attributes
    ----------
    name : str
        `joint`, or `joint.component` where the joint has several numbers of that sort.
    iq, iv : int
        Index in q and in v; −1: none. A quaternion's numbers are in q alone, an angular velocity's in
        v alone.
    unit : str
        "rad" or "m", per second in v; empty for numbers of a quaternion, and cosine and sine.
    periodic : bool
        Whether it is an angle in q, so that a whole turn leads to the same place.
    """

    name: str
    iq: int
    iv: int
    unit: str
    periodic: bool = False


_Spec = tuple[str, str, str, bool]
"""Name, where it is ("q", "v" or both), unit, whether periodic."""

_QUATERNION: tuple[_Spec, ...] = tuple((f"q{a}", "q", "", False) for a in "xyzw")
_ROTATION: tuple[_Spec, ...] = tuple((f"r{a}", "v", "rad", False) for a in "xyz")
_POSITION: tuple[_Spec, ...] = tuple((a, "qv", "m", False) for a in "xyz")
_COSINE: tuple[_Spec, ...] = (("cos", "q", "", False), ("sin", "q", "", False))

_NUMBERS: dict[JointKind, tuple[_Spec, ...]] = {
    JointKind.REVOLUTE: (("", "qv", "rad", True),),
    JointKind.PRISMATIC: (("", "qv", "m", False),),
    JointKind.SCREW: (("", "qv", "rad", False),),  # a whole turn moves it on by its pitch
    JointKind.CONTINUOUS: (*_COSINE, ("", "v", "rad", False)),
    JointKind.SPHERICAL: (*_QUATERNION, *_ROTATION),
    JointKind.TRANSLATION: _POSITION,
    JointKind.FREE_FLYER: (*_POSITION, *_QUATERNION, *_ROTATION),
    JointKind.PLANAR: (*_POSITION[:2], *_COSINE, ("rz", "v", "rad", False)),
    JointKind.UNIVERSAL: (("r1", "qv", "rad", True), ("r2", "qv", "rad", True)),
    JointKind.EULER_ZYX: tuple((f"r{a}", "qv", "rad", True) for a in "zyx"),
    JointKind.ELLIPSOID: tuple((f"r{a}", "qv", "rad", True) for a in "xyz"),
}
"""The numbers of each kind, those in q and those in v each in Pinocchio's order.

Of a free or planar joint, x, y and z in q are the position in the parent's axes, in v the velocity in
the joint's own; of a spherical or free joint, rx, ry and rz are the angular velocity in its own axes.
"""

_WITH_AXIS = (JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.CONTINUOUS, JointKind.SCREW)


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint of a spanning tree.

    Attributes
    ----------
    name : str
    index : int
        In the model; 0 is the ground.
    kind : JointKind
    type : str
        Pinocchio's name of it, for messages.
    idx_q, nq, idx_v, nv : int
        Where its numbers are in q and in v, and how many.
    components : tuple of Component
        Its numbers, those in q in their order, those in v in theirs.
    axis : ndarray (3,) or None
        Unit vector along a revolute, prismatic or helical joint in its own frame.
    """

    name: str
    index: int
    kind: JointKind
    type: str
    idx_q: int
    nq: int
    idx_v: int
    nv: int
    components: tuple[Component, ...]
    axis: Array | None

    @property
    def single(self) -> bool:
        """Whether it has one number in q and one in v, the rate of the other."""
        return self.nq == 1 == self.nv

    @property
    def flat(self) -> bool:
        """Whether v is the rate of q: no quaternion, no cosine and sine."""
        return self.nq == self.nv

    @property
    def v(self) -> slice:
        """Where its entries are in v."""
        return slice(self.idx_v, self.idx_v + self.nv)

    @property
    def iv(self) -> range:
        """The places in v one by one."""
        return range(self.idx_v, self.idx_v + self.nv)

    @property
    def constant_subspace(self) -> bool:
        """Whether its motion subspace is constant in its own frame."""
        return self.kind not in MOVING_SUBSPACE

    @property
    def in_kernel(self) -> bool:
        """Whether the compiled kernel knows it."""
        return self.kind in IN_KERNEL


def joints_of(model: pin.Model) -> tuple[Joint, ...]:
    """All joints of a model but the ground, in the order of q and v.

    Raises
    ------
    ModelError
        For a joint of a type that is not known here, by name.
    """
    return tuple(_joint(model, index) for index in range(1, model.njoints))


def joint_named(joints: Sequence[Joint], name: str, owner: str = "") -> Joint:
    """The joint of that name, or a ModelError, by `owner` if given, that names near ones."""
    given: object = name
    for joint in joints if isinstance(given, str) else ():
        if joint.name == given:
            return joint
    names = [joint.name for joint in joints]
    label = f"{owner}: " if owner else ""
    raise ModelError(
        f"{label}the model has no joint {shown(name)}, only {', '.join(names)}{hint(name, names)}"
    )


def single_joint(joints: Sequence[Joint], name: str, owner: str, remedy: str) -> Joint:
    """The joint of that name if it has one number in q and in v, else a ModelError with the remedy."""
    joint = joint_named(joints, name, owner)
    if not joint.single:
        raise ModelError(
            f"{owner}: joint {name!r} ({joint.type}) has {joint.nq} numbers in q and {joint.nv} "
            f"velocities; it needs a joint with one of each: {remedy}"
        )
    return joint


def components_of(joints: Sequence[Joint]) -> list[Component]:
    """The numbers of all joints, joint by joint."""
    return [component for joint in joints for component in joint.components]


def in_q(joints: Sequence[Joint]) -> list[Component]:
    """What the entries of q are, (nq,)."""
    return [c for c in components_of(joints) if c.iq >= 0]


def in_v(joints: Sequence[Joint]) -> list[Component]:
    """What the entries of v are, (nv,)."""
    return [c for c in components_of(joints) if c.iv >= 0]


def carrying(model: pin.Model, joint: int) -> Array:
    """1 for the velocities of all joints between the root and this joint, itself included, else 0, (nv,)."""
    mask = np.zeros(model.nv)
    for ancestor in list(model.supports[joint])[1:]:  # less the ground
        mask[model.idx_vs[ancestor] :][: model.nvs[ancestor]] = 1.0
    return mask


def _joint(model: pin.Model, index: int) -> Joint:
    joint, name = model.joints[index], str(model.names[index])
    kind = _kind(joint, name)
    components = tuple(_components(joint, name, joint.idx_q, joint.idx_v))
    axis = _axis(model, joint) if kind in _WITH_AXIS else None
    return Joint(
        name, index, kind, joint.shortname(), joint.idx_q, joint.nq, joint.idx_v, joint.nv, components, axis
    )


def _kind(joint: Any, name: str) -> JointKind:
    written = str(joint.shortname())
    try:
        return _KINDS[written.removeprefix("JointModel")]
    except KeyError:
        raise ModelError(
            f"joint {name!r} is of type {written}, which is not served; use one of "
            f"{', '.join(_KINDS)} in its place"
        ) from None


def _components(joint: Any, name: str, iq: int, iv: int) -> list[Component]:
    """The numbers of a joint, or of a part of a composite one, that begin at iq and iv."""
    kind = _kind(joint, name)
    if kind is JointKind.COMPOSITE:
        made = []
        for number, part in enumerate(joint.extract().joints):
            made += _components(part, f"{name}.{number}", iq, iv)
            iq, iv = iq + part.nq, iv + part.nv
        return made
    made = []
    for short, where, unit, periodic in _NUMBERS[kind]:
        here = iq if "q" in where else -1
        moving = iv if "v" in where else -1
        made.append(Component(f"{name}.{short}" if short else name, here, moving, unit, periodic))
        iq, iv = iq + (here >= 0), iv + (moving >= 0)
    return made


def along(letter: str, axis: Array) -> pin.JointModel:
    """Pinocchio's joint, revolute ("R") or prismatic ("P"), along a unit vector: the simplest there is."""
    for unit, name in zip(np.eye(3), _XYZ, strict=True):
        if np.array_equal(axis, unit):
            return getattr(pin, f"JointModel{letter}{name}")()
    return {"R": pin.JointModelRevoluteUnaligned, "P": pin.JointModelPrismaticUnaligned}[letter](axis.copy())


def _axis(model: pin.Model, joint: pin.JointModel) -> Array:
    """From the motion subspace, which is constant in the joint's frame."""
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    linear, angular = np.split(np.asarray(data.S, dtype=float).ravel(), 2)
    along: Array = angular if np.any(angular) else linear  # a screw's are parallel
    return along
