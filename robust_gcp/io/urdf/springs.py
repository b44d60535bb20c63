"""Springs between points in URDF, as Drake writes them."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.forces.forces import PointSpring
from .loops import SPRING, drake_ends, drake_part, on_link
from .numbers import number_in


def springs_of(root: Element, model: pin.Model, name: str) -> list[PointSpring]:
    """`drake:linear_spring_damper`: between points of two links, whose frames are added to the model.

    Raises
    ------
    ModelError
        Naming the file, the element and what it lacks.
    """
    found = []
    for i, element in enumerate(root.findall(SPRING)):
        where, frames = f"{name}: <{SPRING}> number {i + 1}", []
        for (link, at), letter in zip(drake_ends(element, where), "AB", strict=True):
            joint, place = on_link(model, link, at, where)
            moved = bool(np.any(at.translation))
            frames.append(f"spring_{i + 1}_body_{letter}" if moved else link)
            if moved:
                model.addFrame(pin.Frame(frames[-1], joint, place, pin.FrameType.OP_FRAME), False)
        stiffness, rest, damping = (
            number_in(drake_part(element, key, where), "value", where)
            for key in ("stiffness", "free_length", "damping")
        )
        try:
            found.append(PointSpring(frames[0], frames[1], stiffness, rest, damping))
        except ModelError as error:
            raise ModelError(f"{where}: {error}") from error
    return found
