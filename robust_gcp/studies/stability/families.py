"""All families of the stability study by name."""

from __future__ import annotations

from . import extreme_bodies, extreme_motion, extreme_starts, stiff
from .case import Families


def families() -> Families:
    """Name → function of `quick` that lists the family's cases, in the order of the report."""
    modules = (stiff, extreme_bodies, extreme_motion, extreme_starts)
    return {name: cases for module in modules for name, cases in module.FAMILIES.items()}
