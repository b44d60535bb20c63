"""The shapes of a `pin.GeometryModel`, as a page wants them."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ...checks import path_given
from ...errors import OptionError
from ...mechanism.mechanism import Mechanism
from .geometry import Sticks

OFF = 0.25
"""Distance of a cut point from its body's shapes, in characteristic lengths, that nothing shown bridges."""


def shapes_of(mechanism: Mechanism, visual: Any) -> Any:
    """The shapes that are meant: those given, or of a URDF, by its path or the one that was loaded (True).

    Raises
    ------
    OptionError
        Where there is no such file, or Pinocchio cannot read its shapes.
    """
    if visual is True:
        if mechanism.source is None or mechanism.source.suffix != ".urdf":
            raise OptionError(
                f"visual=True: {mechanism.name!r} was not loaded from a URDF; give the path of one, or a "
                "pin.GeometryModel"
            )
        visual = mechanism.source
    if not isinstance(visual, str | Path):
        return visual
    file = path_given("visual", visual)
    if not file.is_file():
        raise OptionError(f"visual: there is no file {file}")
    folders = [str(folder) for folder in (file.parent, *file.resolve().parents[:3])]
    try:
        found = pin.buildGeomFromUrdf(mechanism.own_model, str(file), pin.VISUAL, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        raise OptionError(f"visual: the shapes of {file} cannot be read ({error})") from error
    if not len(found.geometryObjects):
        raise OptionError(
            f"visual: {file} has no <visual> shapes of this mechanism's links; leave visual out"
        )
    return found


def mesh_data(mechanism: Mechanism, made: Sticks, visual: Any) -> list[dict[str, Any]]:
    """Each shape: what it is, its colour, its placement on its body, and that body's three points.

    Adds to the skeleton, for each body that carries a shape, its origin and a point along x and along y:
    a body's pose moves through the page as points do.

    Parameters
    ----------
    mechanism : Mechanism
    made : Sticks
    visual : pin.GeometryModel
        Of the mechanism's model, for instance
        `pin.buildGeomFromUrdf(mechanism.model, urdf, pin.VISUAL, package_dirs=...)`.

    Raises
    ------
    OptionError
        For something else, a shape on a joint that the mechanism does not have, or of an unknown kind.
    """
    if not isinstance(visual, pin.GeometryModel):
        raise OptionError(f"visual is a pin.GeometryModel, not a {type(visual).__name__}")
    found = []
    for item in visual.geometryObjects:
        joint = int(item.parentJoint)
        count = mechanism.own_model.njoints
        if joint >= count:
            raise OptionError(
                f"visual: {item.name!r} is on joint {joint}, and the mechanism has {count}; "
                "build the geometry from mechanism.model"
            )
        if joint not in made.frames:
            first = len(made.points)
            size = mechanism.length or 1.0
            made.points += [
                (joint, size * np.array(at, dtype=float)) for at in ((0, 0, 0), (1, 0, 0), (0, 1, 0))
            ]
            made.frames[joint] = first
        found.append(
            {
                "shape": _shape(item),
                "colour": [round(float(c), 4) for c in item.meshColor],
                "placement": item.placement.homogeneous.T.ravel().tolist(),
                "frame": made.frames[joint],
            }
        )
    return found


def bare_bodies(made: Sticks, visual: pin.GeometryModel) -> list[int]:
    """Bodies whose sticks are shown with the shapes: those without any, and those that end off theirs.

    A bar in a robot's hand is part of the hand's body, and the hand's shapes do not show it; the point where
    a loop is cut, off all shapes of its body, tells.
    """
    boxes: dict[int, list[tuple[pin.SE3, Any, Any]]] = {}
    for item in visual.geometryObjects:
        item.geometry.computeLocalAABB()
        box = item.geometry.aabb_local
        boxes.setdefault(int(item.parentJoint), []).append((item.placement.inverse(), box.min_, box.max_))

    def off(body: int, place: Any) -> bool:
        """Whether a point lies outside the boxes around all shapes of its body."""
        gaps = [np.maximum(low - to * place, to * place - high).max() for to, low, high in boxes[body]]
        return bool(min(gaps) > OFF * made.size)

    ends = [made.points[i] for pair in made.cuts for i in pair]
    without = {body for body, _ in made.points if body not in boxes}
    return sorted((without | {body for body, place in ends if body in boxes and off(body, place)}) - {0})


def _shape(item: Any) -> dict[str, Any]:
    """Sizes of a primitive, m, or corners and triangles; Pinocchio has scaled a mesh's corners already."""
    shape = item.geometry
    kind = type(shape).__name__
    if kind == "Box":
        return {"kind": "box", "size": (2.0 * np.asarray(shape.halfSide)).tolist()}
    if kind == "Sphere":
        return {"kind": "sphere", "radius": float(shape.radius)}
    if kind in ("Cylinder", "Capsule", "Cone"):
        return {"kind": kind.lower(), "radius": float(shape.radius), "length": 2.0 * float(shape.halfLength)}
    if kind.startswith("BVHModel"):
        triangles = [shape.tri_indices(i) for i in range(shape.num_tris)]
        index = packed([[t[0], t[1], t[2]] for t in triangles], "<u4")
        return {"kind": "mesh", "corners": packed(shape.vertices()), "index": index}
    raise OptionError(
        f"visual: {item.name!r} is a {kind}, which a replay cannot draw; take it out of the geometry, or "
        "give a mesh, a box, a sphere, a cylinder, a capsule or a cone"
    )


def packed(values: Any, kind: str = "<f4") -> str:
    """Little-endian 32-bit floats in base 64: a millionth of the size of the scene is not seen."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")
