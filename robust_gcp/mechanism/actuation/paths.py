"""Paths by which actuators and tendons act: a length ℓ(q) and its moment arms ∂ℓ/∂q.

A force f along a path is the generalized force f ∂ℓ/∂q. On the tree's velocities a path reads ℓ̇ = (∂ℓ/∂q) v.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from ...checks import check_finite, check_text, checked_vector, listed, shown
from ...errors import ModelError
from ..tree.joints import JointKind, joint_named, single_joint
from ..tree.tree import Array, Tree


class Path(ABC):
    """What has a length: a tendon, or what an actuator drives.

    Attributes
    ----------
    in_kernel : bool
        Whether the compiled kernel knows its kind.
    """

    in_kernel: ClassVar[bool] = False

    @abstractmethod
    def on(self, tree: Tree, owner: str) -> BoundPath:
        """The path in a tree; a ModelError by `owner` where it names what there is not."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of whose numbers alone its length is a weighted sum; none of other paths."""
        return ()


Load = tuple[str, int, Array, Array, Array]
"""A frame, the joint that carries it, a point of its body, a force and a moment about that, in world axes."""


class BoundPath(ABC):
    """A path in a tree."""

    def loads(self) -> list[Load]:
        """What a unit force does to bodies, where the tree was placed last; none where it acts in joints."""
        return []

    @abstractmethod
    def length_at(self, q: Array) -> tuple[float, Array]:
        """ℓ, m or rad, and ∂ℓ/∂q (nv,), at the configuration that the tree placed last."""


class PathOnBodies(BoundPath):
    """A path that acts on bodies: by virtual work ∂ℓ/∂q is what a unit force along it does in the joints."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree

    @abstractmethod
    def pulled(self) -> tuple[float, list[Load]]:
        """ℓ, m or rad, and what a unit force does to bodies, where the tree was placed last."""

    def loads(self) -> list[Load]:
        """See `BoundPath`."""
        return self.pulled()[1]

    def length_at(self, q: Array) -> tuple[float, Array]:
        """See `BoundPath`."""
        length, loads = self.pulled()
        moment = np.zeros(self._tree.nv)
        for _, joint, point, force, about in loads:
            moment += self._tree.lifted(joint, point, force, about)
        return length, moment


@dataclass(frozen=True, eq=True)
class FixedTendon(Path):
    """ℓ = Σ coefficient q over joints with one number each.

    Parameters
    ----------
    coefficients : mapping of str to float
        m/rad, or as a pure number.
    """

    in_kernel: ClassVar[bool] = True
    coefficients: Mapping[str, float]

    def __hash__(self) -> int:
        return hash(tuple(self.coefficients.items()))

    def __post_init__(self) -> None:
        given: Any = self.coefficients
        if not isinstance(given, Mapping) or not given:
            raise ModelError(f"FixedTendon: coefficients = {shown(given)} must be {{joint: number}}")
        for joint, value in self.coefficients.items():
            check_text("FixedTendon: joint", joint)
            check_finite(f"FixedTendon: coefficient of {joint!r}", value)
        object.__setattr__(self, "coefficients", dict(self.coefficients))

    @property
    def joints(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(self.coefficients)

    def on(self, tree: Tree, owner: str) -> BoundPath:
        """See `Path`."""
        places = [single_joint(tree.joints, name, owner, "choose another") for name in self.coefficients]
        return SumOfJoints(tree, [j.idx_q for j in places], [j.idx_v for j in places], self.coefficients)


class SumOfJoints(BoundPath):
    """A path whose moment arms are constant."""

    def __init__(self, tree: Tree, iq: list[int], iv: list[int], coefficients: Mapping[str, float]) -> None:
        self.iq, self.iv = np.array(iq), np.array(iv)
        self.arms = np.array([float(value) for value in coefficients.values()])
        self.moment: Array = np.zeros(tree.nv)
        np.add.at(self.moment, iv, self.arms)

    def length_at(self, q: Array) -> tuple[float, Array]:
        """See `BoundPath`."""
        return float(self.arms @ q[self.iq]), self.moment


@dataclass(frozen=True)
class TurningJoint(Path):
    """A spherical or free joint along a gear: ℓ̇ = gear · velocity, of a spherical ℓ = gear · rotation vector.

    Parameters
    ----------
    joint : str
    gear : sequence of float
        Three numbers of a spherical joint; of a free joint six, linear along the world's axes, then angular.
    in_parent : bool
        Whether the gear turns with the parent (a spherical joint) or the world, not with the body.
    """

    joint: str
    gear: Sequence[float]
    in_parent: bool = False

    def __post_init__(self) -> None:
        check_text("TurningJoint: joint", self.joint)
        given = listed(self.gear, "TurningJoint: gear", "three or six numbers")
        gear = checked_vector(given, len(given), "TurningJoint: gear", "3 or 6")
        object.__setattr__(self, "gear", tuple(gear.tolist()))
        if not isinstance(self.in_parent, bool | np.bool_):
            raise ModelError(f"TurningJoint: in_parent = {shown(self.in_parent)} must be True or False")

    def on(self, tree: Tree, owner: str) -> BoundPath:
        """See `Path`."""
        joint = joint_named(tree.joints, self.joint, owner)
        sizes = {JointKind.SPHERICAL: 3, JointKind.FREE_FLYER: 6}
        if joint.kind not in sizes:
            raise ModelError(
                f"{owner}: joint {self.joint!r} is neither spherical nor free; use a FixedTendon"
            )
        gear = checked_vector(self.gear, sizes[joint.kind], f"{owner}: gear", str(sizes[joint.kind]))
        return _Turning(tree, joint, gear, self.in_parent)


class _Turning(BoundPath):
    def __init__(self, tree: Tree, joint: Any, gear: Array, in_parent: bool) -> None:
        self._nv, self._joint, self._gear, self._in_parent = tree.nv, joint, gear, in_parent
        self._q = slice(joint.idx_q + len(gear) - 3, joint.idx_q + len(gear) + 1)  # a free joint's comes last

    def length_at(self, q: Array) -> tuple[float, Array]:
        """See `BoundPath`."""
        R = pin.Quaternion(q[self._q]).toRotationMatrix()
        # velocities of the joint are in its body's axes
        turn = R.T @ self._gear[-3:] if self._in_parent else self._gear[-3:]
        moment, length = np.zeros(self._nv), 0.0
        if len(self._gear) == 6:
            turn = np.concatenate([R.T @ self._gear[:3], turn])
        else:
            length = float(pin.log3(R) @ turn)
        moment[self._joint.v] = turn
        return length, moment


def tendons_given(tree: Tree, tendons: Any) -> dict[str, Path]:
    """Paths of this tree by name, or a ModelError."""
    if not isinstance(tendons, Mapping):
        raise ModelError(f"tendons = {shown(tendons)} must be {{name: path}}, such as a FixedTendon")
    for name, path in tendons.items():
        check_text("tendons: name", name)
        if not isinstance(path, Path):
            raise ModelError(f"tendon {name!r} = {shown(path)} is no path, such as a FixedTendon")
        path.on(tree, f"tendon {name!r}")  # refuses what is not there
    return dict(tendons)
