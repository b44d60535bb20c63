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

    Bodies move in the y-z plane on hinges about x (`RX`) and slides along y or z (`PY`, `PZ`); each closure
    holds two points of bodies together, −1 the ground. Gravity acts along z, torques on all joints.

    Attributes
    ----------
    name, kind : str
        "regular", "near" (0.1 to 1e-4 rad from a singular configuration) or "at" one.
    linkage : dict
        `joints` (name, parent, kind, place, mass, centre, inertia about the centre), `closures`, `gravity`,
        `independent`; m, kg, kg m².
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
        model.gravity.linear = np.array([0.0, 0.0, self.linkage["gravity"]])
        for joint in self.linkage["joints"]:
            made = getattr(pin, f"JointModel{joint['kind']}")()
            index = model.addJoint(joint["parent"] + 1, made, _at(joint["place"]), joint["name"])
            inertia = joint["inertia"] * np.eye(3)
            body = pin.Inertia(joint["mass"], np.array([0.0, *joint["centre"]]), inertia)
            model.appendBodyToJoint(index, body, pin.SE3.Identity())
        for k, pair in enumerate(self.linkage["closures"]):
            for end, (body, place) in enumerate(pair, start=1):
                kind = pin.FrameType.OP_FRAME
                model.addFrame(pin.Frame(f"closure {k} end {end}", body + 1, _at(place), kind))
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


def _at(place: list[float]) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([0.0, *place]))
