"""Numbers of q and v by the names of joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import checked_vector, hint, real_array, shown
from ..errors import StateError
from .tree.joints import Array, Joint

Named = Mapping[str, float | Sequence[float]]
"""Numbers by joint, or by component of a joint."""


def with_numbers(
    joints: Sequence[Joint], start: Array, given: Mapping[str, Any], letter: str, what: str
) -> Array:
    """q or v with the numbers of some joints, or components of joints, replaced.

    Parameters
    ----------
    start : ndarray (nq,) or (nv,)
    given : dict
        A number, or as many as the joint has in q (or v), by the joint's name or the component's.
    letter : "q" or "v"
    what : str
        What to call it in errors.

    Raises
    ------
    StateError
        For a name that is not there, numbers that are none or not as many, and those that are given twice.
    """
    made = start.copy()
    for name, place in places_of(joints, given, letter, what).items():
        value, label = given[name], f"{what}[{name!r}]"
        if len(place) == 1 and not np.ndim(value):
            try:
                value = real_array(value).reshape(1)
            except TypeError as error:
                raise StateError(f"{label} = {shown(value)} is not a number") from error
        made[place] = checked_vector(value, len(place), label, f"n{letter}")
    return made


def places_of(joints: Sequence[Joint], names: Iterable[str], letter: str, what: str) -> dict[str, list[int]]:
    """Where the numbers of some joints, or components of joints, are in q or v; see `with_numbers`."""
    places: dict[str, list[int]] = {}
    for joint in joints:
        first, count = (joint.idx_q, joint.nq) if letter == "q" else (joint.idx_v, joint.nv)
        for component in joint.components:
            at = component.iq if letter == "q" else component.iv
            if at >= 0:
                places[component.name] = [at]
        places[joint.name] = list(range(first, first + count))
    by_place: dict[int, str] = {}
    for name in names:
        if name not in places:
            near = hint(name, places)
            raise StateError(f"{what}: the model has no joint {name!r}, only {', '.join(places)}{near}")
        for place in places[name]:
            other = by_place.setdefault(place, name)
            if other != name:
                raise StateError(f"{what}: {other!r} and {name!r} have a number in common; give it once")
    return {name: places[name] for name in names}
