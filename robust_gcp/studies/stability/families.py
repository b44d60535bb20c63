"""All families of the stability study by name."""

from __future__ import annotations

from . import extreme, stiff
from .case import Families


def families() -> Families:
    """Name → function of `quick` that lists the family's cases, in the order of the report."""
    return {**stiff.FAMILIES, **extreme.FAMILIES}
