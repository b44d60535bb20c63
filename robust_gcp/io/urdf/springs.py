"""Springs between points in URDF, as Drake writes them."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ...errors import ModelError
from ...mechanism.forces.forces import PointSpring
from .loops import SPRING, on_link
from .numbers import number_in, numbers_in


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
        parts = {part.tag.removeprefix(f"{SPRING}_"): part for part in element}
        for body, point in (("body_A", "p_AP"), ("body_B", "p_BQ")):
            lacking = [
                key for key in (body, point, "free_length", "stiffness", "damping") if key not in parts
            ]
            if lacking:
                raise ModelError(f"{where} lacks {SPRING}_{lacking[0]}; add it")
            link, at = parts[body].get("name", ""), np.array(numbers_in(parts[point], "value", where))
            joint, place = on_link(model, link, pin.SE3(np.eye(3), at), where)
            frames.append(link if not np.any(at) else f"spring_{i + 1}_{body}")
            if np.any(at):
                model.addFrame(pin.Frame(frames[-1], joint, place, pin.FrameType.OP_FRAME), False)
        stiffness, rest, damping = (
            number_in(parts[key], "value", where) for key in ("stiffness", "free_length", "damping")
        )
        try:
            found.append(PointSpring(frames[0], frames[1], stiffness, rest, damping))
        except ModelError as error:
            raise ModelError(f"{where}: {error}") from error
    return found
