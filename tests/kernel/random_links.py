"""Links as random mechanisms have them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin


def anywhere(rng: np.random.Generator) -> pin.SE3:
    """A placement."""
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))


def carry(model: pin.Model, joint: int, rng: np.random.Generator) -> None:
    """A body on a joint."""
    A = rng.normal(size=(3, 3))
    inertia = pin.Inertia(rng.uniform(0.5, 4.0), 0.3 * rng.normal(size=3), 0.1 * A @ A.T + np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
