"""Gravity compensation: weights that something lifts, whatever the pose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ...checks import check_text, checked_vector, shown
from ...errors import ModelError
from ..frames import place_of
from ..tree.columns import with_simple_joints
from ..tree.tree import Array
from ..tree.workspace import workspace
from .forces import Force, Vector, require_number

if TYPE_CHECKING:
    from ..mechanism import Mechanism

Weight = tuple[str, float, tuple[float, ...]]


@dataclass(frozen=True)
class GravityCompensation(Force):
    """τ = −Σ J_pᵀ m g: masses m at points p of bodies weigh nothing; their inertia stays.

    It has no potential energy: what it does is work.

    Parameters
    ----------
    weights : mapping of str to (float, array_like (3,)), or sequence of (str, float, array_like (3,))
        By frame of the tree, such as a link, the mass, kg, not negative, and where it is in that frame, m.

    Raises
    ------
    ModelError
        For what are no weights.
    """

    weights: Mapping[str, Any] | Sequence[tuple[str, float, Sequence[float]]]

    def __post_init__(self) -> None:
        given: Any = self.weights
        if isinstance(given, Mapping):
            given = [(frame, *_pair(value)) for frame, value in given.items()]
        if not isinstance(given, Sequence) or isinstance(given, str) or not given:
            raise ModelError(f"GravityCompensation: weights = {shown(given)}; give {{frame: (mass, point)}}")
        object.__setattr__(self, "weights", tuple(map(_weight, given)))

    def tau(self, mechanism: Mechanism, q: Vector, v: Vector) -> Array:
        """τ(q), (nv,)."""
        model = self._lifted(mechanism)
        # gravity's term on the left of the equations of motion, −Σ J_pᵀ m g, is what holds the weights up
        return np.array(pin.computeGeneralizedGravity(model, workspace(model), q))

    def derivatives(self, mechanism: Mechanism, q: Vector, v: Vector) -> tuple[Array, Array]:
        """∂τ/∂q and ∂τ/∂v, (nv, nv) each, exact; a ModelError where there is an ellipsoid joint."""
        simple = "lifted, by simple joints", self.weights
        model = mechanism.memo.once(
            simple, lambda: with_simple_joints(self._lifted(mechanism), mechanism.joints)
        )
        by_q = np.array(pin.computeGeneralizedGravityDerivatives(model, workspace(model), q))
        return by_q, np.zeros_like(by_q)

    def along(self, mechanism: Mechanism, q: Array, axis: int) -> Array:
        """∂τ/∂g along an axis of the world, (nv,)."""

        def made() -> pin.Model:
            model = self._lifted(mechanism).copy()
            model.gravity.linear = np.eye(3)[axis]
            return model

        model: pin.Model = mechanism.memo.once(("lifted along", axis, self.weights), made)
        return np.array(pin.computeGeneralizedGravity(model, workspace(model), q))

    def _lifted(self, mechanism: Mechanism) -> pin.Model:
        """The tree, with these masses alone."""

        def made() -> pin.Model:
            model = mechanism.tree.model.copy()
            for i in range(model.njoints):
                model.inertias[i] = pin.Inertia.Zero()  # gravity's torque is linear in the masses
            model.armature = np.zeros(model.nv)
            for _, joint, mass, point in self._placed(mechanism):
                model.inertias[joint] += pin.Inertia(mass, point, np.zeros((3, 3)))
            return model

        found: pin.Model = mechanism.memo.once(("lifted", self.weights), made)
        return found

    def _placed(self, mechanism: Mechanism) -> Iterator[tuple[str, int, float, Array]]:
        """Frame, the joint that carries each mass, the mass, and where it is on the joint."""
        given: Any = self.weights
        for name, mass, point in given:
            joint, place = place_of(mechanism.tree.model, name, "GravityCompensation")
            yield name, joint, mass, place.act(np.array(point))

    def pulls(self, mechanism: Mechanism, data: pin.Data) -> Iterator[tuple[str, int, Array, Array]]:
        """Frame, joint that carries it, point and force of each, in world axes, where `data` was placed."""
        for name, joint, mass, point in self._placed(mechanism):
            yield name, joint, data.oMi[joint].act(point), -mass * mechanism.tree.model.gravity.linear


def _pair(value: Any) -> tuple[Any, Any]:
    try:
        mass, point = value
    except (TypeError, ValueError) as error:
        raise ModelError(f"GravityCompensation: {shown(value)} is no mass, kg, and point (3,), m") from error
    return mass, point


def _weight(given: Any) -> Weight:
    try:
        frame, mass, point = given
    except (TypeError, ValueError) as error:
        raise ModelError(
            f"GravityCompensation: {shown(given)} is no frame, mass, kg, and point (3,), m"
        ) from error
    check_text("GravityCompensation: frame", frame)
    label = f"GravityCompensation on {frame!r}"
    require_number(label, "mass", mass, positive=True)
    return frame, float(mass), tuple(checked_vector(point, 3, f"{label}: point", "3").tolist())
