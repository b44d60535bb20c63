"""All actuators of a mechanism at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import ModelError
from ..tree.tree import Array, Tree
from .actuators import Actuator, clipped
from .muscle import Range
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
    sharing : tuple of (list of int, (float, float))
        Actuators along one path of which the sum has a range.

    Raises
    ------
    ModelError
        For paths that are none in the tree, and actuators that give one path two such ranges.
    """

    def __init__(self, tree: Tree, actuators: Sequence[Actuator]) -> None:
        self.actuators, self._tree = tuple(actuators), tree
        self.paths = [a.along.on(tree, f"Actuator {a.name!r}") for a in self.actuators]
        high = np.array(tree.model.upperEffortLimit)
        self.high = np.where((high > 0.0) & (high < ENDLESS), high, np.inf)
        low = np.array(tree.model.lowerEffortLimit)
        self.low = np.where((low < 0.0) & (low > -ENDLESS), low, -np.inf)
        along: dict[Path, list[int]] = {}
        for i, actuator in enumerate(self.actuators):
            along.setdefault(actuator.along, []).append(i)
        shared = [
            (members, _shared_range([self.actuators[i] for i in members])) for members in along.values()
        ]
        self.sharing = tuple((members, ends) for members, ends in shared if ends is not None)

    def forces_at(self, q: Array, v: Array, u: Array) -> tuple[Array, Array]:
        """Forces (n,) and τ (nv,) for the controls or activations u (n,)."""
        forces, tau = np.empty(len(self.actuators)), np.zeros(self._tree.nv)
        self._tree.jacobians(q)
        moments = []
        for i, (actuator, path) in enumerate(zip(self.actuators, self.paths, strict=True)):
            length, moment = path.length_at(q)
            moments.append(actuator.gear * moment)
            forces[i] = actuator.force(float(u[i]), actuator.gear * length, float(moments[i] @ v))
        # The sum along a path, then each actuator, then each joint: where several bind the order counts.
        for group, most in self.sharing:
            total = float(forces[group].sum())
            if total != clipped(total, most):
                forces[group] *= clipped(total, most) / total  # alike: their shares stay
        for i, actuator in enumerate(self.actuators):
            forces[i] = clipped(float(forces[i]), actuator.force_range)
            tau += forces[i] * moments[i]
        return forces, np.clip(tau, self.low, self.high)


def _shared_range(actuators: list[Actuator]) -> Range | None:
    """Of the sum of all actuators along one path."""
    given = {actuator.shared_range: actuator.name for actuator in actuators if actuator.shared_range}
    if len(given) > 1:
        named = ", ".join(f"{name!r} {ends}" for ends, name in given.items())
        raise ModelError(f"actuators along one path have one shared_range, not several: {named}")
    return next(iter(given), None)
