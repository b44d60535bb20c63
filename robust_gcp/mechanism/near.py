"""A model seen from a point of the ground near its joints: what stands far away keeps its digits.

φ, K, M and C do not depend on where a mechanism stands, but positions far from the origin are rounded there,
and bodies have inertias about it that only cancel.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .tree import Array


def standpoint(model: pin.Model) -> Array:
    """Where the first joint stands on the ground, (3,), m."""
    return np.array(model.jointPlacements[1].translation) if model.njoints > 1 else np.zeros(3)


def seen_from(model: pin.Model, point: Array) -> pin.Model:
    """The model with its ground's origin moved to a point (3,); the model itself where that is the origin."""
    if not np.any(point):
        return model
    moved = model.copy()
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            moved.jointPlacements[joint] = _seen(model.jointPlacements[joint], point)
    for frame in moved.frames:
        if frame.parentJoint == 0:
            frame.placement = _seen(frame.placement, point)
    return moved


def _seen(place: pin.SE3, point: Array) -> pin.SE3:
    return pin.SE3(place.rotation, place.translation - point)
