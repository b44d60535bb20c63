"""Numbers that links are made of: places, directions, masses of rods."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..checks import real_array, shown
from ..errors import ModelError, OptionError
from .tree import Array


def rod(length: float, mass: float, section: float) -> pin.Inertia:
    """A square rod along x from the origin, kg and m; a block about it where it has no length."""
    about, across = mass * section / 6.0, mass * (length**2 + section) / 12.0
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
