"""Spatial tendons: the shortest line over sites, with pulleys and round spheres and cylinders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from ...checks import check_finite, check_text, checked_rows, checked_vector, listed, shown
from ...errors import ModelError
from ..frames import place_of
from ..tree.tree import Array, Tree
from .paths import BoundPath, Load, Path, PathOnBodies
from .wrapping import CYLINDER, SPHERE, Wrapped, wrapped

SAME = 1e-9
"""m: points so near to each other are the same."""


@dataclass(frozen=True)
class Pulley:
    """What follows runs over a pulley: its length counts by 1 / divisor, and begins a new branch."""

    divisor: float

    def __post_init__(self) -> None:
        check_finite("Pulley: divisor", self.divisor)
        if self.divisor <= 0.0:
            raise ModelError(f"Pulley: divisor = {self.divisor} must be positive")


@dataclass(frozen=True)
class Wrap:
    """A sphere or cylinder round which a tendon goes between two sites, where it is in the way.

    Parameters
    ----------
    frame : str
        That carries it.
    radius : float
        m.
    shape : {"sphere", "cylinder"}
    position, rotation : array_like (3,), (3, 3)
        Of its centre, and of its axes (a cylinder is along its z), in the frame.
    side : str, optional
        A site on whose side the tendon goes round; inside of the surface, the tendon goes through it.
    """

    frame: str
    radius: float
    shape: str = SPHERE
    position: Sequence[float] = (0.0, 0.0, 0.0)
    rotation: Sequence[Sequence[float]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    side: str | None = None

    def __post_init__(self) -> None:
        check_text("Wrap: frame", self.frame)
        check_finite("Wrap: radius", self.radius)
        check_text("Wrap: shape", self.shape)
        if self.shape not in (SPHERE, CYLINDER):
            raise ModelError(f"Wrap on {self.frame!r}: shape = {shown(self.shape)} is no sphere or cylinder")
        if self.side is not None:
            check_text("Wrap: side", self.side)
        place = checked_vector(self.position, 3, "Wrap: position", "3").tolist()
        turn = checked_rows(self.rotation, 3, 3, "Wrap: rotation", "3")
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6:
            raise ModelError(f"Wrap on {self.frame!r}: rotation is no rotation matrix")
        object.__setattr__(self, "position", tuple(place))
        object.__setattr__(self, "rotation", tuple(map(tuple, turn.tolist())))  # hashable, as paths are keys


@dataclass(frozen=True)
class SpatialTendon(Path):
    """The shortest line over sites, with pulleys and round what it wraps.

    Parameters
    ----------
    elements : sequence of str, Pulley, Wrap
        Sites by their frames; a Wrap is between two of them.
    """

    in_kernel: ClassVar[bool] = True
    elements: Sequence[str | Pulley | Wrap]

    def __post_init__(self) -> None:
        given = listed(self.elements, "SpatialTendon: elements", "sites, Pulleys and Wraps", kind=Pulley)
        object.__setattr__(self, "elements", tuple(given))
        before: object = None
        for element, after in zip(given, [*given[1:], None], strict=False):
            if not isinstance(element, str | Pulley | Wrap):
                raise ModelError(f"SpatialTendon: {shown(element)} is no site, Pulley or Wrap")
            if isinstance(element, Wrap) and not (isinstance(before, str) and isinstance(after, str)):
                raise ModelError(f"SpatialTendon: the Wrap on {element.frame!r} must be between two sites")
            before = element

    def on(self, tree: Tree, owner: str) -> BoundPath:
        """See `Path`."""
        return Line(tree, self.elements, owner)


@dataclass(frozen=True)
class Round:
    """A wrap between two points."""

    joint: int
    place: pin.SE3
    radius: float
    cylinder: bool
    side: tuple[int, Array] | None


Piece = tuple[float, int, Array, int, Array, tuple[str, str]]
"""A share of a length, and its ends: joints that carry them, points in world axes; frames of these."""


class Line(PathOnBodies):
    """A spatial tendon: stretches between points, 1 / divisor of each, and what they wrap."""

    def __init__(self, tree: Tree, elements: Sequence[str | Pulley | Wrap], owner: str) -> None:
        super().__init__(tree)
        self.stretches: list[tuple[float, int, Array, int, Array, Round | None]] = []
        self._frames: list[tuple[str, str, str]] = []
        share, before, wrap, names = 1.0, None, None, ("", "")
        for element in elements:
            if isinstance(element, Pulley):
                share, before = 1.0 / element.divisor, None  # the line begins anew behind a pulley
            elif isinstance(element, Wrap):
                wrap, names = self._round(element, owner), (names[0], element.frame)
            else:
                here = self._point(element, owner)
                # points held together have no direction between them, but round a wrap
                if before is not None and (wrap is not None or not self._joined(before, here)):
                    self.stretches.append((share, *before, *here, wrap))
                    self._frames.append((*names, element))
                before, wrap, names = here, None, (element, "")

    def _joined(self, *ends: tuple[int, Array]) -> bool:
        """Whether a closure holds two points together: between them is no length and no direction."""
        pairs = (pair[::way] for pair in self._tree.joined for way in (1, -1))
        return any(
            all(
                a == b and np.abs(place.translation - at).max() <= SAME
                for (a, place), (b, at) in zip(pair, ends, strict=True)
            )
            for pair in pairs
        )

    def _point(self, frame: str, owner: str) -> tuple[int, Array]:
        joint, place = place_of(self._tree.model, frame, owner)
        return joint, np.array(place.translation)

    def _round(self, wrap: Wrap, owner: str) -> Round:
        joint, placement = place_of(self._tree.model, wrap.frame, owner)
        place = placement * pin.SE3(np.array(wrap.rotation, dtype=float), np.array(wrap.position))
        side = None if wrap.side is None else self._point(wrap.side, owner)
        return Round(joint, place, float(wrap.radius), wrap.shape == CYLINDER, side)

    def _world(self, joint: int, at: Array) -> Array:
        tree = self._tree
        return np.asarray(tree.p[joint] + tree.R[joint] @ at)

    def _pieces(self) -> tuple[list[Piece], float]:
        """Straight pieces between points of bodies, among them points of wraps, and the length of arcs."""
        pieces, arcs = list[Piece](), 0.0
        for (share, a, at_a, b, at_b, wrap), names in zip(self.stretches, self._frames, strict=True):
            start, end = self._world(a, at_a), self._world(b, at_b)
            touched = None if wrap is None else self._touched(wrap, start, end)
            if wrap is None or touched is None:
                pieces.append((share, a, start, b, end, (names[0], names[2])))
                continue
            # no pull of its own: the length of a shortest line changes by its ends alone
            arcs += share * touched.length
            pieces.append((share, a, start, wrap.joint, touched.first, names[:2]))
            pieces.append((share, wrap.joint, touched.last, b, end, names[1:]))
        return pieces, arcs

    def _touched(self, wrap: Round, start: Array, end: Array) -> Wrapped | None:
        tree = self._tree
        R = tree.R[wrap.joint] @ wrap.place.rotation
        centre = self._world(wrap.joint, wrap.place.translation)
        side = None if wrap.side is None else self._world(*wrap.side)
        return wrapped(start, end, centre, R, wrap.radius, wrap.cylinder, side)

    def pulled(self) -> tuple[float, list[Load]]:
        """See `PathOnBodies`."""
        pieces, length = self._pieces()
        loads, none = list[Load](), np.zeros(3)
        for share, a, start, b, end, names in pieces:
            size = float(np.linalg.norm(end - start))
            length += share * size
            if size > 0.0 and a != b:  # within one body a pull does no work
                pull = share * (end - start) / size
                loads += [(names[0], a, start, -pull, none), (names[1], b, end, pull, none)]
        return length, loads
