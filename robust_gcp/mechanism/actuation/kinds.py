"""Everything here that is made of numbers, words and each other, for files."""

from __future__ import annotations

from typing import Any

from .actuators import Actuator
from .muscle import Muscle
from .paths import FixedTendon, TurningJoint
from .site_paths import SiteForce, SliderCrank
from .spatial_tendon import Pulley, SpatialTendon, Wrap

PARTS: tuple[type[Any], ...] = (
    *(FixedTendon, TurningJoint, SiteForce, SliderCrank, SpatialTendon, Pulley, Wrap),
    *(Muscle, Actuator),
)
