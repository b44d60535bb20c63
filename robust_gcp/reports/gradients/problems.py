"""The problems: reading them, and the mechanism of one as a Pinocchio model."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ...mechanism.closures import PointClosure
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from . import PROBLEMS


@dataclass(frozen=True)
class Problem:
    """A linkage at a state, and the derivatives there.

    Bodies move on hinges (`RX`, `RY`, `RZ`) and slides (`PX`, `PY`, `PZ`) about and along an axis of the
    joint's frame; each closure holds two points of bodies together, −1 the ground; torques act on all
    joints. In the y-z plane points have two numbers, inertia and gravity (along z) one; in space three,
    three by three and three, and a joint's frame is turned in its parent's by `turn`.

    Attributes
    ----------
    name, kind : str
        "regular", "near" (0.1 to 1e-4 rad from a singular configuration) or "at" one.
    linkage : dict
        `joints` (name, parent, kind, place, turn, mass, centre, inertia about the centre), `closures`,
        `gravity`, `independent`; m, kg, kg m².
    q, u, tau : ndarray (nv,), (m,), (nv,)
        q to the last digit of a double; its independent entries are meant exactly.
    mode : ndarray (nv, m) or None
        At a singular configuration the mode that is meant, v in its span.
    udot, da_dy, da_dv, da_dtau : ndarray (m,), (m, m), (m, m), (m, nv)
        Of the independent accelerations: Gᵀ M G u̇ = Gᵀ (τ − C − M g).
    """

    name: str
    kind: str
    linkage: dict[str, Any]
    q: Array
    u: Array
    tau: Array
    mode: Array | None
    udot: Array
    da_dy: Array
    da_dv: Array
    da_dtau: Array

    def model(self) -> pin.Model:
        """The spanning tree, with a frame at each end of a closure."""
        model = pin.Model()
        gravity = self.linkage["gravity"]
        model.gravity.linear = _vector(gravity if isinstance(gravity, list) else [0.0, gravity])
        for joint in self.linkage["joints"]:
            made = getattr(pin, f"JointModel{joint['kind']}")()
            frame = pin.SE3(np.array(joint.get("turn", np.eye(3))), _vector(joint["place"]))
            index = model.addJoint(joint["parent"] + 1, made, frame, joint["name"])
            inertia = np.array(joint["inertia"]) * (np.eye(3) if np.ndim(joint["inertia"]) == 0 else 1.0)
            body = pin.Inertia(joint["mass"], _vector(joint["centre"]), inertia)
            model.appendBodyToJoint(index, body, pin.SE3.Identity())
        for k, pair in enumerate(self.linkage["closures"]):
            for end, (body, place) in enumerate(pair, start=1):
                kind = pin.FrameType.OP_FRAME
                at = pin.SE3(np.eye(3), _vector(place))
                model.addFrame(pin.Frame(f"closure {k} end {end}", body + 1, at, kind))
        return model

    def mechanism(self) -> Mechanism:
        """The same, with its loops closed."""
        count = len(self.linkage["closures"])
        closures = [PointClosure(f"closure {k} end 1", f"closure {k} end 2") for k in range(count)]
        return Mechanism.from_pinocchio(self.model(), closures, self.linkage["independent"], self.q)


def problems() -> list[Problem]:
    """All of them."""
    arrays = ("q", "u", "tau", "udot", "da_dy", "da_dv", "da_dtau")
    found = []
    for given in json.loads(PROBLEMS.read_text()):
        numbers = {key: np.array(given[key], dtype=float) for key in arrays}
        mode = None if given["mode"] is None else np.array(given["mode"], dtype=float)
        found.append(Problem(given["name"], given["kind"], given["linkage"], mode=mode, **numbers))
    return found


def _vector(numbers: list[float]) -> Array:
    return np.array([0.0, *numbers] if len(numbers) == 2 else numbers)
