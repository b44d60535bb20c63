"""Bodies and joints between them, as formats list them that say nothing of a tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import pinocchio as pin

from .tree import Array

WORLD = "world"


@dataclass(eq=False)
class Body:
    """A rigid body: its pose in the world where one is drawn, and its inertia in its own frame."""

    name: str
    pose: pin.SE3 | None
    inertia: pin.Inertia = field(default_factory=pin.Inertia.Zero)


@dataclass(eq=False)
class BodyJoint:
    """A joint between two bodies.

    Attributes
    ----------
    name, kind, parent, child : str
        A kind of `body_graph.CHAINS`; `WORLD` for the ground.
    on_parent, on_child : pin.SE3
        The joint's frame in both bodies; they coincide at zero.
    axes : sequence of ndarray (3,)
        In the joint's frame, one for each R and P of the kind; of a cylindrical joint the one axis twice.
    range : (float, float) or None
        Of a joint with one number, rad or m.
    damping, stiffness, rest, friction : float
        Of a joint with one number; the value where its spring is slack; of its dry friction.
    kept, cut : bool
        Whether it must have a number, as a coupling names it; whether the file has it outside the tree.
    """

    name: str
    kind: str
    parent: str
    child: str
    on_parent: pin.SE3
    on_child: pin.SE3
    axes: Sequence[Array] = ()
    range: tuple[float, float] | None = None
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    friction: float = 0.0
    kept: bool = False
    cut: bool = False
