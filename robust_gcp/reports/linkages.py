"""Linkages as data of test sets, made into a Pinocchio model and a mechanism.

`joints` in their order (name, parent, −1 the ground, kind `RX` … `PZ`, place in the parent, turn, mass,
centre, inertia about it), `closures` that hold two points of bodies together, `gravity`, `independent`;
m, kg, kg m². In the y-z plane points have two numbers, inertia and gravity (along z) one; in space three,
three by three and three, and a joint's frame is turned in its parent's by `turn`, a matrix or a quaternion
w, x, y, z of any length. Some have more: `couplings` (joint, the one that it follows, coefficients of its
polynomial from the constant on), `stops` (joint, lower or upper, restitution) and `friction` (joint: bound,
N m).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from .. import JointFriction, Mechanism, PointClosure, Stop
from ..mechanism.constraint.couplings import AnyClosure, CouplingClosure
from ..mechanism.tree.tree import Array


def model_of(linkage: dict[str, Any]) -> pin.Model:
    """The spanning tree, with a frame at each end of a closure."""
    model = pin.Model()
    gravity = linkage["gravity"]
    model.gravity.linear = _vector(gravity if isinstance(gravity, list) else [0.0, gravity])
    for joint in linkage["joints"]:
        made = getattr(pin, f"JointModel{joint['kind']}")()
        frame = pin.SE3(_turn(joint.get("turn", np.eye(3))), _vector(joint["place"]))
        index = model.addJoint(joint["parent"] + 1, made, frame, joint["name"])
        inertia = np.array(joint["inertia"]) * (np.eye(3) if np.ndim(joint["inertia"]) == 0 else 1.0)
        body = pin.Inertia(joint["mass"], _vector(joint["centre"]), inertia)
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
    for k, pair in enumerate(linkage["closures"]):
        for end, (body, place) in enumerate(pair, start=1):
            kind = pin.FrameType.OP_FRAME
            at = pin.SE3(np.eye(3), _vector(place))
            model.addFrame(pin.Frame(f"closure {k} end {end}", body + 1, at, kind))
    return model


def mechanism_of(linkage: dict[str, Any], home: ArrayLike) -> Mechanism:
    """The same, with its loops closed."""
    count = len(linkage["closures"])
    closures: list[AnyClosure] = [
        *(PointClosure(f"closure {k} end 1", f"closure {k} end 2") for k in range(count)),
        *(
            CouplingClosure(joint, follows, ratio, offset, tuple(higher))
            for joint, follows, (offset, ratio, *higher) in linkage.get("couplings", [])
        ),
    ]
    return Mechanism.from_pinocchio(model_of(linkage), closures, linkage["independent"], home)


def parts_of(linkage: dict[str, Any]) -> tuple[Stop | JointFriction, ...]:
    """What `simulate` takes as `joints`."""
    stops = [Stop(**stop) for stop in linkage.get("stops", [])]
    friction = linkage.get("friction", {}).items()
    return (*stops, *(JointFriction(joint, bound=bound) for joint, bound in friction))


def rotation(quaternion: NDArray[Any]) -> NDArray[Any]:
    """Of w, x, y, z of any length, in their own kind of numbers."""
    w, x, y, z = quaternion
    square = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
    return np.asarray(square / (quaternion @ quaternion))


def _turn(given: ArrayLike) -> Array:
    numbers = np.array(given, dtype=float)
    return numbers if numbers.ndim == 2 else rotation(numbers)


def _vector(numbers: list[float]) -> Array:
    return np.array([0.0, *numbers] if len(numbers) == 2 else numbers)
