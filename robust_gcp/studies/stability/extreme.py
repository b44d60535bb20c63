"""All extreme families: bodies, motions, and what lies beside the singular configuration."""

from __future__ import annotations

from . import extreme_bodies, extreme_motion, extreme_starts
from .case import Families

FAMILIES: Families = {**extreme_bodies.FAMILIES, **extreme_motion.FAMILIES, **extreme_starts.FAMILIES}
