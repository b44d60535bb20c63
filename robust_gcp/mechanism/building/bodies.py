"""Bodies and joints between them, and the numbers that they are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...checks import real_array, shown
from ...errors import ModelError, OptionError
from ..tree.tree import Array


def rod(length: float, mass: float, section: float) -> pin.Inertia:
    """A square rod along x from the origin, kg and m; a block about it where it has no length."""
    about, across = mass * section / 6.0, mass * (length**2 + section) / 12.0  # side² = section
    return pin.Inertia(mass, np.array([length / 2.0, 0.0, 0.0]), np.diag([about, across, across]))


def required(check: Any, what: str, value: Any) -> None:
    """A check of a number, its refusal one of the model."""
    try:
        check(what, value)
    except OptionError as error:
        raise ModelError(str(error)) from error


def vector(value: ArrayLike, what: str) -> Array:
    """Two or three finite numbers, as (x, y, z)."""
    try:
        given = real_array(value)
    except TypeError:
        given = np.zeros(0)
    if given.shape not in ((2,), (3,)) or not np.all(np.isfinite(given)):
        raise ModelError(f"{what} is {shown(value)}; give (x, y) or (x, y, z), finite numbers")
    return np.append(given, np.zeros(3 - len(given)))


def direction(value: ArrayLike, what: str) -> Array:
    """The same as a unit vector."""
    given = vector(value, what)
    size = float(np.linalg.norm(given))
    if size == 0.0:
        raise ModelError(f"{what} is zero; give a direction")
    return np.asarray(given / size)


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
