"""The problems: reading them, and the mechanism of one as a Pinocchio model."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..linkages import mechanism_of, model_of
from . import PROBLEMS


@dataclass(frozen=True)
class Problem:
    """A linkage at a state, and the derivatives there.

    Torques act on all joints.

    Attributes
    ----------
    name, kind : str
        "regular", "near" (0.1 to 1e-4 rad from a singular configuration) or "at" one.
    linkage : dict
        See `reports.linkages`.
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
        return model_of(self.linkage)

    def mechanism(self) -> Mechanism:
        """The same, with its loops closed."""
        return mechanism_of(self.linkage, self.q)


def problems() -> list[Problem]:
    """All of them."""
    arrays = ("q", "u", "tau", "udot", "da_dy", "da_dv", "da_dtau")
    found = []
    for given in json.loads(PROBLEMS.read_text()):
        numbers = {key: np.array(given[key], dtype=float) for key in arrays}
        mode = None if given["mode"] is None else np.array(given["mode"], dtype=float)
        found.append(Problem(given["name"], given["kind"], given["linkage"], mode=mode, **numbers))
    return found
