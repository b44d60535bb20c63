"""What functions of a user's return: the error names the function, what it returned and what was expected."""

from __future__ import annotations

from typing import Any

import numpy as np

from .checks import Array, real_array, shown
from .errors import NonFiniteError, OptionError, RobustGcpError


def returned(
    value: Any,
    shape: tuple[int, ...],
    label: str,
    error_type: type[RobustGcpError] = OptionError,
    named: str = "",
    t: float | None = None,
) -> Array:
    """The finite real numbers that a function of the user's returned, a copy: of this shape, or one number.

    Parameters
    ----------
    shape : tuple of int
        () of one number, which may be in an array of any shape.
    label : str
        The function, with its arguments.
    error_type : type
        Of the error for what is no such array; NonFiniteError for numbers that are not finite.
    named : str
        Before the shape that was expected.
    t : float, optional
        When it was asked, s, which numbers that are not finite are told with.
    """
    wanted = f"{named}{shape} real numbers, none of them masked" if shape else "one real number"
    try:
        array = real_array(value)
    except TypeError as error:
        raise error_type(f"{label} returned {shown(value)}, expected {wanted}") from error
    if array.shape != shape:
        if shape or array.size != 1:
            raise error_type(f"{label} returned shape {array.shape}, expected {wanted}")
        array = array.reshape(())
    if not np.isfinite(array).all():
        when = "" if t is None else f" at t = {t:.6g} s"
        raise NonFiniteError(f"{label} returned {shown(value)}{when}")
    return array
