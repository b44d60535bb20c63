"""Numbers in URDF attributes: finite ones, as many as there should be."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...errors import ModelError


def number_in(element: Element, key: str, owner: str, default: float | None = None) -> float:
    """The finite number of an attribute, the default where there is none, or a ModelError by `owner`."""
    return numbers_in(element, key, owner, 1, None if default is None else [default])[0]


def numbers_in(
    element: Element, key: str, owner: str, count: int = 3, default: Sequence[float] | None = None
) -> list[float]:
    """So many finite numbers of an attribute, the default where there are none, or a ModelError."""
    text = element.get(key)
    wanted = "a number" if count == 1 else f"{count} numbers"
    if text is None:
        if default is not None:
            return list(default)
        raise ModelError(f"{owner}: <{element.tag}> lacks {key}; give {wanted}")
    values = finite_numbers(text, count)
    if values is None:
        raise ModelError(f"{owner}: <{element.tag} {key}={text!r}> is not {wanted}; write {wanted}, finite")
    return values


def place_in(element: Element, owner: str) -> pin.SE3:
    """The place that the attributes `xyz`, m, and `rpy`, rad, give; each is zero where it is left out."""
    xyz, rpy = (numbers_in(element, key, owner, default=(0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))


def finite_numbers(text: str, count: int) -> list[float] | None:
    """So many finite numbers between spaces; None for anything else."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return None
    return values if len(values) == count and all(map(isfinite, values)) else None
