"""Lengths of links as parameters: sums of placements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...checks import hint, listed, shown
from ...errors import OptionError
from ..mechanism import Mechanism
from ..tree.tree import Array
from .variable_geometry import MARK, frames_used


@dataclass(frozen=True)
class Along:
    """The length of a link as a parameter, see `along`."""

    joint: str
    frame: str

    def __str__(self) -> str:
        """Its name among parameters."""
        return f"along({self.joint}, {self.frame})"

    def weights(self, mechanism: Mechanism) -> dict[str, float]:
        """Parameters that it is made of, with the components of the direction that are not zero.

        Raises
        ------
        OptionError
            See `along`.
        """
        model, joints = mechanism.own_model, [joint.name for joint in mechanism.joints]
        known = [*joints, *frames_used(mechanism)]
        for name in (self.joint, self.frame):
            if name not in known:
                raise OptionError(
                    f"parameters: {self}: {shown(name)} is no joint, nor the frame of a closure or spring"
                    f"{hint(str(name), known)}"
                )
        if self.frame in joints:
            index = mechanism.joint(self.frame).index
            carrier, place = model.parents[index], model.jointPlacements[index]
        else:
            frame = model.frames[model.getFrameId(self.frame)]
            carrier, place = frame.parentJoint, frame.placement
        if self.joint not in joints or carrier != mechanism.joint(self.joint).index:
            raise OptionError(
                f"parameters: {self}: {self.frame!r} is carried by {str(model.names[carrier])!r}; name that"
            )
        away: Array = np.array(place.translation)
        length = float(np.linalg.norm(away))
        if length == 0.0:
            raise OptionError(f"parameters: {self}: both ends are at one place, which gives no direction")
        parts = zip("xyz", (away / length).tolist(), strict=True)
        return {f"{self.frame}{MARK}{axis}": part for axis, part in parts if part != 0.0}


def along(joint: str, frame: str) -> Along:
    """The length of a link as a parameter: a joint or frame moves away from the joint that carries it.

    The derivative by it is the sum of those by `frame.placement.x`, `.y` and `.z` times the components of
    the unit vector between them; masses, centres and inertias of bodies stay.

    Parameters
    ----------
    joint, frame : str
        The joint that carries the link, and a joint, or the frame of a closure or spring, at its other end.

    Raises
    ------
    OptionError
        Where it is used: for names that are none, a joint that does not carry the other, ends that coincide.
    """
    return Along(joint, frame)


def in_parts(mechanism: Mechanism, parameters: Sequence[str | Along]) -> list[dict[str, float]]:
    """What each of some parameters is the sum of, by name."""
    given = listed(parameters, "parameters", "names such as 'q1.m', or rg.along(joint, frame)", OptionError)
    return [part.weights(mechanism) if isinstance(part, Along) else {part: 1.0} for part in given]
