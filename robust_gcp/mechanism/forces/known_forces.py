"""Which forces are known by their numbers: to `AppliedForces`, to the compiled kernel and to files."""

from __future__ import annotations

from typing import Any

from ...checks import shown
from ...errors import ModelError
from ..actuation.tendon_springs import TendonSpring
from .ball_springs import BallSpring
from .forces import Force, JointDamper, JointSpring, JointTorque, PointSpring
from .lifted_weights import GravityCompensation

KINDS: tuple[type[Force], ...] = (JointSpring, JointDamper, JointTorque, PointSpring, TendonSpring)
"""What is known by its numbers."""

STORED: tuple[type[Force], ...] = (*KINDS, BallSpring, GravityCompensation)
"""What files hold: these two are asked, as forces of a user's own are."""


def is_known(force: Force) -> bool:
    """Whether its numbers say all: one of `KINDS`, derived from or not, that does what its kind does."""
    made = type(force)
    kind = next((kind for kind in KINDS if isinstance(force, kind)), None)
    if isinstance(force, TendonSpring) and not force.path.in_kernel:
        return False
    return kind is not None and made.tau is kind.tau and made.energy is kind.energy


def checked_force(force: Any) -> Force:
    """A force, or a ModelError."""
    if isinstance(force, Force):
        return force
    kinds = ", ".join(kind.__name__ for kind in KINDS)
    raise ModelError(f"forces: {shown(force)} is not a {kinds} or another rg.Force")
