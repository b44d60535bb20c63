"""Numbers in URDF attributes: finite ones, as many as there should be."""

from __future__ import annotations

from math import isfinite
from xml.etree.ElementTree import Element

from ...errors import ModelError


def number_in(element: Element, key: str, owner: str) -> float:
    """The finite number of an attribute, or a ModelError by `owner`."""
    return _parsed(element, key, owner, 1)[0]


def numbers_in(element: Element, key: str, owner: str, count: int = 3) -> list[float]:
    """So many finite numbers of an attribute, or a ModelError by `owner`."""
    return _parsed(element, key, owner, count)


def finite_numbers(text: str, count: int) -> list[float] | None:
    """So many finite numbers between spaces; None for anything else."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return None
    return values if len(values) == count and all(map(isfinite, values)) else None


def _parsed(element: Element, key: str, owner: str, count: int) -> list[float]:
    text = element.get(key)
    wanted = "a number" if count == 1 else f"{count} numbers"
    if text is None:
        raise ModelError(f"{owner}: <{element.tag}> lacks {key}; give {wanted}")
    values = finite_numbers(text, count)
    if values is None:
        raise ModelError(f"{owner}: <{element.tag} {key}={text!r}> is not {wanted}; write {wanted}, finite")
    return values
