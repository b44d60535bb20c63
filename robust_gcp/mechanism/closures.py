"""Loop closures: which frames meet, and the rows that this makes.

A cut joint is a pair of frames. Each closure contributes rows of two kinds:

- position rows: p₁ − p₂, the difference of the two frames' origins in world axes, m;
- rotation rows: sums of w (u · n) with u fixed in body 1 and n fixed in body 2, rad for small angles.
  A dot product of two body-fixed vectors is polynomial in the rotations, so φ, K and k are exact
  everywhere, not only where the loop is closed (Haug, *Computer Aided Kinematics and Dynamics of
  Mechanical Systems*, 1989, the "dot-1" constraint).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..checks import hint, real_array
from ..errors import ModelError

Index = NDArray[np.int64]

Term = tuple[int, float, tuple[float, float, float], tuple[float, float, float]]
"""A rotation row's term: row within the closure, weight w, u in frame 1, n in frame 2."""

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class PointClosure:
    """Two frames share their origin: three rows, φ = p₁ − p₂ (a spherical cut joint).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    """

    frame1: str
    frame2: str
    kind: ClassVar[str] = "3d"

    def rotation_terms(self) -> list[Term]:
        """No rotation is constrained."""
        return []


@dataclass(frozen=True)
class FrameClosure:
    """Two frames coincide: six rows, p₁ − p₂ and the axial part of R₂ᵀ R₁ (a cut weld).

    The rotation rows are sin θ times the axis of the rotation from frame 2 to frame 1.
    """

    frame1: str
    frame2: str
    kind: ClassVar[str] = "6d"

    def rotation_terms(self) -> list[Term]:
        """½ (R₃₂ − R₂₃, R₁₃ − R₃₁, R₂₁ − R₁₂) of R = R₂ᵀ R₁, whose entry ij is n_i · u_j."""
        return [
            (0, 0.5, _Y, _Z),
            (0, -0.5, _Z, _Y),
            (1, 0.5, _Z, _X),
            (1, -0.5, _X, _Z),
            (2, 0.5, _X, _Y),
            (2, -0.5, _Y, _X),
        ]


@dataclass(frozen=True)
class RevoluteClosure:
    """Two frames share their origin and an axis: five rows (a cut hinge).

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis : tuple of float
        The hinge axis, with the same components in both frames; z unless given.
    """

    frame1: str
    frame2: str
    axis: tuple[float, float, float] = _Z
    kind: ClassVar[str] = "revolute"

    def rotation_terms(self) -> list[Term]:
        """The axis in frame 1 is normal to two directions of frame 2."""
        try:
            axis = real_array(self.axis)
        except TypeError:
            axis = np.zeros(0)
        norm = float(np.linalg.norm(axis))
        if axis.shape != (3,) or not np.isfinite(norm) or norm == 0.0:
            raise ModelError(f"RevoluteClosure: axis {self.axis!r} is not a direction in space, (x, y, z)")
        axis = axis / norm
        first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        u: tuple[float, float, float] = tuple(axis.tolist())
        return [(0, 1.0, u, tuple(first.tolist())), (1, 1.0, u, tuple(second.tolist()))]


Closure = PointClosure | FrameClosure | RevoluteClosure


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


def row_places(closures: Sequence[Closure], rows: Index) -> list[tuple[int, int]]:
    """Closure and row within it of each of these rows of the full constraint; 0, 1, 2 are positions.

    Rows beyond those of these closures are passed over.
    """
    counts = [3 + len({term[0] for term in closure.rotation_terms()}) for closure in closures]
    places = [(i, row) for i, count in enumerate(counts) for row in range(count)]
    return [places[row] for row in rows if row < len(places)]


def frame_of(model: pin.Model, name: str, owner: str) -> pin.Frame:
    """The frame of that name, or a ModelError by `owner` that names near ones.

    A joint and a link of the same name share one place, and either will do.
    """
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
