"""What acted on a run besides gravity and the mechanism's own forces, as its trajectory remembers it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.loads import Wrench
from ...dynamics.prescribed.control import Actuated
from ...dynamics.prescribed.motion import Motion
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array


@dataclass(frozen=True, eq=False)
class Acted:
    """What acted on a run.

    Attributes
    ----------
    torque : callable (t, q, v), ndarray (nv,) or None
        Torques and wrenches as one.
    wrenches : tuple of Wrench
        Those that are part of it.
    held : ndarray (N, nv) or None
        What was held over the step that begins at each output but the last; None where nothing was.
    drive : tuple of str
        Joints that moved as prescribed.
    motions : mapping of str to Motion
        How these move; files and pickles do not hold it.
    lost : bool
        Whether `torque` was a function and is not kept any more: files and pickles hold no code.
    pushed : bool
        Whether wrenches were part of what is lost.
    """

    torque: Torque | ArrayLike | None = None
    wrenches: tuple[Wrench, ...] = ()
    held: Array | None = None
    drive: tuple[str, ...] = ()
    lost: bool = False
    pushed: bool = False
    motions: Mapping[str, Motion] = field(default_factory=dict)

    def without_code(self) -> Acted:
        """What files and pickles hold of it."""
        if not callable(self.torque):
            return self
        pushed = self.pushed or bool(self.wrenches)
        return replace(self, torque=None, wrenches=(), lost=True, pushed=pushed)

    def arrays(self) -> dict[str, Array | None]:
        """Its numbers by name, for a file; the rest is in `told`."""
        kept = self.without_code()
        torque = None if kept.torque is None else np.asarray(kept.torque, dtype=float)
        return {"acted_torque": torque, "acted_held": kept.held}

    def told(self) -> dict[str, Any]:
        """The rest of what a file holds."""
        kept = self.without_code()
        return {"drive": kept.drive, "lost": kept.lost, "pushed": kept.pushed}

    def __reduce__(self) -> tuple[type[Acted], tuple[Any, ...]]:
        """Pickle without code."""
        kept = self.without_code()
        return Acted, (kept.torque, kept.wrenches, kept.held, kept.drive, kept.lost, kept.pushed)

    def __copy__(self) -> Acted:
        """Itself: nothing changes it."""
        return self

    def __deepcopy__(self, memo: object) -> Acted:
        """Itself."""
        return self


KINDS = ("actuator", "activation", "tendon")
"""What columns of these begin with: a force, N or N m; an activation; a length, m or rad."""


def controls_along(acting: Actuated, t: Array, q: Array, v: Array) -> Array:
    """u of the actuators at each output, (N, n)."""
    control = acting.control
    if control.constant is not None:
        return np.tile(control.constant, (len(t), 1))
    if not control.asks:
        return control.over(t)
    return np.array([control.controls_at(*state) for state in zip(t.tolist(), q, v, strict=True)])


def powered_columns(mechanism: Mechanism, q: Array, v: Array, u: Array | None) -> dict[str, Array]:
    """Forces and activations of actuators, and lengths of tendons, each (N,).

    Parameters
    ----------
    q, v, u : ndarray (N, nq), (N, nv), (N, n); u None without power
    """
    columns: dict[str, Array] = {}
    actuation = mechanism.actuation
    if actuation is not None and u is not None:
        forces = np.array([actuation.forces_at(*state)[0] for state in zip(q, v, u, strict=True)])
        for i, actuator in enumerate(mechanism.actuators):
            columns[f"actuator.{actuator.name}"] = forces[:, i]
            if actuator.dynamics != "none":
                columns[f"activation.{actuator.name}"] = u[:, i]
    if mechanism.tendons:
        tree, lengths = mechanism.tree, np.empty((len(q), len(mechanism.tendons)))
        paths = [path.on(tree, f"tendon {name!r}") for name, path in mechanism.tendons.items()]
        for k, state in enumerate(q):
            tree.jacobians(state)
            lengths[k] = [path.length_at(state)[0] for path in paths]
        columns |= {f"tendon.{name}": lengths[:, i] for i, name in enumerate(mechanism.tendons)}
    return columns
