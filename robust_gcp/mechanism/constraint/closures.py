"""Loop closures: which frames meet, and the rows that this makes.

A cut joint is a pair of frames. `Closure` is the contract: a kind states its rows as data, and φ, K, k, the
compiled kernel, reactions and pictures follow. Rows are of three sorts:

- position rows along an axis of the world: p₁ − p₂ there, m;
- position rows along a direction n fixed in body 2: n · (p₁ − p₂), m;
- rotation rows: sums of w (u · n) with u fixed in body 1 and n fixed in body 2, rad for small angles.
  A dot product of two body-fixed vectors is polynomial in the rotations, so φ, K and k are exact
  everywhere, not only where the loop is closed (Haug, *Computer Aided Kinematics and Dynamics of
  Mechanical Systems*, 1989, the "dot-1" and "dot-2" constraints).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...checks import check_text, hint, real_array
from ...errors import ModelError

Direction = tuple[float, float, float]
"""In the axes of a frame."""

Term = tuple[int, float, Direction, Direction]
"""A rotation row's term: row within the closure's rotation rows, weight w, u in frame 1, n in frame 2."""

AXES: tuple[Direction, Direction, Direction] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Of a frame, in itself."""

_X, _Y, _Z = AXES


@dataclass(frozen=True)
class Closure:
    """What every kind of cut joint states: two frames, and the rows that hold them together.

    As it stands it holds nothing back but the rows that its methods list; see docs/extending.md.

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.

    Attributes
    ----------
    kind : str
        Its name in the files of model folders.
    """

    frame1: str
    frame2: str
    kind: ClassVar[str] = ""

    def position_rows(self) -> Sequence[int | Direction]:
        """A position row each: an axis of the world, 0 to 2, or a unit vector fixed in frame 2."""
        return (0, 1, 2)

    def rotation_terms(self) -> list[Term]:
        """The terms of all rotation rows."""
        return []

    def is_proper(self, turn: NDArray[Any]) -> bool:
        """Whether the rotation (3, 3) from frame 1 to frame 2 is the one meant, where all rows are zero.

        Rotation rows vanish for half a turn too.
        """
        return True

    @property
    def holds(self) -> bool:
        """Whether the two frames share their origin, by rows along the world's axes."""
        return tuple(self.position_rows()) == (0, 1, 2)

    @property
    def joins(self) -> bool:
        """Whether the two frames share their origin, by whatever rows, up to a file's rounding."""
        return len(self.position_rows()) == 3


@dataclass(frozen=True)
class PointClosure(Closure):
    """Two frames share their origin: three rows, φ = p₁ − p₂ (a spherical cut joint).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    """

    kind: ClassVar[str] = "3d"


@dataclass(frozen=True)
class FrameClosure(Closure):
    """Two frames coincide: six rows, p₁ − p₂ and the axial part of R₂ᵀ R₁ (a cut weld).

    The rotation rows are sin θ times the axis of the rotation from frame 2 to frame 1.
    """

    kind: ClassVar[str] = "6d"

    def rotation_terms(self) -> list[Term]:
        """½ (R₃₂ − R₂₃, R₁₃ − R₃₁, R₂₁ − R₁₂) of R = R₂ᵀ R₁, whose entry ij is n_i · u_j."""
        return WELDED

    def is_proper(self, turn: NDArray[Any]) -> bool:
        """Whether the angle is below a right angle: sin θ vanishes at π too."""
        return float(np.trace(turn)) > 1.0  # 1 + 2 cos θ


WELDED: list[Term] = [
    (0, 0.5, _Y, _Z),
    (0, -0.5, _Z, _Y),
    (1, 0.5, _Z, _X),
    (1, -0.5, _X, _Z),
    (2, 0.5, _X, _Y),
    (2, -0.5, _Y, _X),
]
"""No rotation against each other: three rows."""


@dataclass(frozen=True)
class AxisClosure(Closure):
    """A cut joint with an axis.

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis : tuple of float
        With the same components in both frames; z unless given.
    """

    axis: Direction = _Z

    def across(self) -> tuple[Direction, Direction, Direction]:
        """The axis as a unit vector, and two that span the plane normal to it.

        Raises
        ------
        ModelError
            Where the axis is no direction.
        """
        try:
            axis = real_array(self.axis)
        except TypeError:
            axis = np.zeros(0)
        norm = float(np.linalg.norm(axis))
        if axis.shape != (3,) or not np.isfinite(norm) or norm == 0.0:
            name = type(self).__name__
            raise ModelError(f"{name}: axis {self.axis!r} is not a direction in space, (x, y, z)")
        axis = axis / norm
        first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])  # at least √⅔ long
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        return tuple(axis.tolist()), tuple(first.tolist()), tuple(second.tolist())


@dataclass(frozen=True)
class RevoluteClosure(AxisClosure):
    """Two frames share their origin and an axis: five rows (a cut revolute joint).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis : tuple of float
        The revolute axis, with the same components in both frames; z unless given.
    """

    kind: ClassVar[str] = "revolute"

    def rotation_terms(self) -> list[Term]:
        """The axis in frame 1 is normal to two directions of frame 2."""
        axis, first, second = self.across()
        return [(0, 1.0, axis, first), (1, 1.0, axis, second)]

    def is_proper(self, turn: NDArray[Any]) -> bool:
        """Whether the axes point the same way."""
        axis = np.array(self.across()[0])
        return float(axis @ turn @ axis) > 0.0


@dataclass(frozen=True)
class PrismaticClosure(AxisClosure):
    """Frame 1 slides along an axis of frame 2 and does not turn against it: five rows (a cut slide).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis : tuple of float
        The direction of sliding, with the same components in both frames; z unless given.
    """

    kind: ClassVar[str] = "prismatic"

    def position_rows(self) -> Sequence[int | Direction]:
        """The origins do not come apart across the axis."""
        return self.across()[1:]

    def rotation_terms(self) -> list[Term]:
        """As of a weld."""
        return WELDED

    def is_proper(self, turn: NDArray[Any]) -> bool:
        """As of a weld."""
        return float(np.trace(turn)) > 1.0


@dataclass(frozen=True)
class UniversalClosure(AxisClosure):
    """Two frames share their origin, an axis of each stays normal to the other's: four rows (a cut cross).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis, axis2 : tuple of float
        The axis that is fixed in frame 1, z unless given, and the one in frame 2, x unless given.
    """

    axis2: Direction = _X
    kind: ClassVar[str] = "universal"

    def rotation_terms(self) -> list[Term]:
        """The axis in frame 1 is normal to that of frame 2."""
        # Every zero is proper: a cross whose axis points the other way is the same cross.
        return [(0, 1.0, self.across()[0], AxisClosure("", "", self.axis2).across()[0])]


def closure_kinds() -> list[type[Closure]]:
    """All kinds of cut joints that there are, those of other programs too."""
    found, more = list[type[Closure]](), [Closure]
    while more:
        kind = more.pop(0)
        found.append(kind)
        more += kind.__subclasses__()
    return [kind for kind in found if kind.kind]  # bases such as `AxisClosure` have no name


def closure_frames(model: pin.Model, closures: Sequence[Closure]) -> list[tuple[int, pin.SE3]]:
    """Parent joint and placement of every closure's first frame, then of every second frame.

    Raises
    ------
    ModelError
        For a frame that the model does not have, or two frames on one body.
    """
    firsts, seconds = [], []
    for closure in closures:
        label = f"closure {closure.frame1} – {closure.frame2}"
        first, second = (frame_of(model, name, label) for name in (closure.frame1, closure.frame2))
        if first.parentJoint == second.parentJoint:
            joint = model.names[first.parentJoint]
            where = f"the body of joint {joint!r}" if first.parentJoint else "the ground"
            raise ModelError(
                f"{label}: both frames are fixed to {where}, so there is no loop to close; "
                "name a frame of another body"
            )
        firsts.append(first)
        seconds.append(second)
    return [(int(frame.parentJoint), frame.placement) for frame in (*firsts, *seconds)]


def frame_of(model: pin.Model, name: str, owner: str) -> pin.Frame:
    """The frame of that name, or a ModelError by `owner` that names near ones.

    A joint and a link of the same name share one place, and either will do.
    """
    check_text(owner, name)
    found = [frame for frame in model.frames if frame.name == name]
    if not found:
        near = hint(name, {f.name for f in model.frames})
        raise ModelError(f"{owner}: the model has no frame {name!r}{near}")
    first = found[0]
    for other in found[1:]:
        if other.parentJoint != first.parentJoint or other.placement != first.placement:
            raise ModelError(
                f"{owner}: the model has {len(found)} frames {name!r} "
                f"({', '.join(str(f.type) for f in found)}) in different places; rename all but one"
            )
    return first
