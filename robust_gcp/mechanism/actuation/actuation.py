"""All actuators of a mechanism at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..tree.tree import Array, Tree
from .actuators import Actuator, clipped
from .paths import Path

ENDLESS = 1e300
"""N m or N: efforts that Pinocchio's models have for none."""


class Actuation:
    """All actuators of a mechanism at once.

    Parameters
    ----------
    tree : Tree
    actuators : sequence of Actuator

    Attributes
    ----------
    actuators : tuple of Actuator
    paths : list of BoundPath
    low, high : ndarray (nv,)
        What all actuators of a joint do together at most: the model's effort limits, where they are finite.
    """

    def __init__(self, tree: Tree, actuators: Sequence[Actuator]) -> None:
        self.actuators, self._tree = tuple(actuators), tree
        self.paths = [a.along.on(tree, f"Actuator {a.name!r}") for a in self.actuators]
        high = np.array(tree.model.upperEffortLimit)
        self.high = np.where((high > 0.0) & (high < ENDLESS), high, np.inf)
        low = np.array(tree.model.lowerEffortLimit)
        self.low = np.where((low < 0.0) & (low > -ENDLESS), low, -np.inf)
        sharing: dict[Path, list[int]] = {}
        for i, actuator in enumerate(self.actuators):
            if actuator.shared_range is not None:
                sharing.setdefault(actuator.along, []).append(i)
        self.sharing = tuple(sharing.values())

    def forces_at(self, q: Array, v: Array, u: Array) -> tuple[Array, Array]:
        """Forces (n,) and τ (nv,) for the controls or activations u (n,)."""
        forces, tau = np.empty(len(self.actuators)), np.zeros(self._tree.nv)
        self._tree.jacobians(q)
        moments = []
        for i, (actuator, path) in enumerate(zip(self.actuators, self.paths, strict=True)):
            length, moment = path.length_at(q)
            moments.append(actuator.gear * moment)
            forces[i] = actuator.force(float(u[i]), actuator.gear * length, float(moments[i] @ v))
        for group in self.sharing:
            total, most = float(forces[group].sum()), self.actuators[group[0]].shared_range
            if total != clipped(total, most):
                forces[group] *= clipped(total, most) / total
        for i, actuator in enumerate(self.actuators):
            forces[i] = clipped(float(forces[i]), actuator.force_range)
            tau += forces[i] * moments[i]
        return forces, np.clip(tau, self.low, self.high)
