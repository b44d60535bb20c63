"""Named parameters of a mechanism, and how u̇ changes with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks import hint, listed, shown
from ..errors import OptionError
from ..mechanism.forces import JointDamper, JointSpring
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .derivatives import Derivatives
from .equations import Evaluation
from .regressor import inertial_names, torque_regressor


class Parameters:
    """Some parameters of a mechanism by name.

    `joint.m`, `joint.mx`, …, `joint.Izz` and `joint.armature` as in `Regressor`; `joint.stiffness` and
    `joint.rest` of a joint's spring, `joint.damping` of its damper.

    Parameters
    ----------
    mechanism : Mechanism
    names : sequence of str

    Raises
    ------
    OptionError
        For a name that is none, with near ones.
    """

    def __init__(self, mechanism: Mechanism, names: Sequence[str]) -> None:
        self._mechanism = mechanism
        self.names = tuple(listed(names, "parameters", "names such as 'q1.m'", OptionError))
        inertial = inertial_names(mechanism)
        forces = _forces(mechanism)
        for name in self.names:
            if not isinstance(name, str) or (name not in inertial and name not in forces):
                known = [*inertial, *forces]
                raise OptionError(
                    f"parameters: {shown(name)} is none{hint(str(name), known)}; they are called joint.m, "
                    "joint.mx, …, joint.Izz, joint.armature, joint.stiffness, joint.rest, joint.damping"
                )
        self._inertial = [(i, inertial.index(n)) for i, n in enumerate(self.names) if n in inertial]
        self._forces = [(i, forces[n]) for i, n in enumerate(self.names) if n in forces]

    def slopes(self, now: Evaluation, found: Derivatives) -> Array:
        """∂u̇/∂p, (m, parameters): ∂τ/∂p of forces, −Y of inertias, lifted by (Gᵀ M G)⁻¹ Gᵀ."""
        mechanism, q = self._mechanism, now.point.q
        v = found.G @ now.point.ydot
        moved = np.zeros((mechanism.nv, len(self.names)))
        if self._inertial:
            Y = torque_regressor(mechanism).at(q, v, found.G @ now.ydd + now.point.g)
            for i, column in self._inertial:
                moved[:, i] = -Y[:, column]
        for i, (what, force) in self._forces:
            joint = force.place(mechanism.joints)
            if isinstance(force, JointDamper):
                moved[joint.v, i] = -v[joint.v]
            else:
                moved[joint.idx_v, i] = (
                    force.rest - q[joint.idx_q] if what == "stiffness" else force.stiffness
                )
        return found.da_dtau @ moved


def _forces(mechanism: Mechanism) -> dict[str, tuple[str, JointSpring | JointDamper]]:
    """Joint springs and dampers by the names of their numbers; joints with several of a kind are left out."""
    found: dict[str, tuple[str, JointSpring | JointDamper]] = {}
    twice: set[str] = set()
    for force in () if mechanism.applied is None else mechanism.applied.known:
        if not isinstance(force, JointSpring | JointDamper):
            continue
        for what in ("damping",) if isinstance(force, JointDamper) else ("stiffness", "rest"):
            name = f"{force.joint}.{what}"
            twice |= {name} & set(found)
            found[name] = what, force
    return {name: entry for name, entry in found.items() if name not in twice}
