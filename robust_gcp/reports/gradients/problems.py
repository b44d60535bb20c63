"""The problems: reading them, and the mechanism of one at its state."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ... import Mechanism
from ...mechanism.tree.tree import Array
from ..linkages import mechanism_of

PROBLEMS = Path(__file__).with_name("problems.json")


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

    def mechanism(self) -> Mechanism:
        """The linkage, with its loops closed."""
        return mechanism_of(self.linkage, self.q)

    @cached_property
    def state(self) -> tuple[Mechanism, Array, Array]:
        """The mechanism, q closed to its own rounding where that can be done, and v."""
        mech, q, mode = self.mechanism(), self.q, self.mode
        if mode is not None:
            return mech, q, mode @ np.linalg.solve(mode[mech.iv_independent], self.u)
        q = mech.assemble(q, hold=mech.independent)
        return mech, q, mech.lift(q, self.u)


def problems() -> list[Problem]:
    """All of them."""
    arrays = ("q", "u", "tau", "udot", "da_dy", "da_dv", "da_dtau")
    found = []
    for given in json.loads(PROBLEMS.read_text()):
        numbers = {key: np.array(given[key], dtype=float) for key in arrays}
        mode = None if given["mode"] is None else np.array(given["mode"], dtype=float)
        found.append(Problem(given["name"], given["kind"], given["linkage"], mode=mode, **numbers))
    return found
