"""Where a frame is: the joint that carries it, and its placement there."""

from __future__ import annotations

import pinocchio as pin

from ..checks import check_text
from .constraint.closures import frame_of


def place_of(model: pin.Model, name: str, owner: str = "frame") -> tuple[int, pin.SE3]:
    """The joint that carries a frame, and where; a joint is a frame of its own also where none is listed.

    Raises
    ------
    ModelError
        By `owner`, for a frame that the model does not have.
    """
    check_text(f"{owner}: frame" if owner != "frame" else owner, name)
    if model.existJointName(name) and not model.existFrame(name):
        return int(model.getJointId(name)), pin.SE3.Identity()
    frame = frame_of(model, name, owner)
    return int(frame.parentJoint), frame.placement
