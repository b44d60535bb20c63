"""What actuators and tendons do along a motion, by name."""

from __future__ import annotations

import numpy as np

from ...dynamics.prescribed.control import Actuated
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array

KINDS = ("actuator", "activation", "tendon")
"""What columns of these begin with: a force, N or N m; an activation; a length, m or rad."""


def controls_along(acting: object, t: Array, q: Array, v: Array) -> Array | None:
    """u of the actuators at each output, (N, n), of a run under `Actuated`; None of others."""
    if not isinstance(acting, Actuated):
        return None
    control = acting.control
    if control.constant is not None:
        return np.tile(control.constant, (len(t), 1))
    if not control.asks:
        return control.over(t)
    return np.array([control.at(*state) for state in zip(t.tolist(), q, v, strict=True)])


def powered_columns(mechanism: Mechanism, q: Array, v: Array, u: Array | None) -> dict[str, Array]:
    """Forces and activations of actuators, and lengths of tendons, each (N,).

    Parameters
    ----------
    q, v, u : ndarray (N, nq), (N, nv), (N, n); u None without power
    """
    columns: dict[str, Array] = {}
    actuation = mechanism.actuation
    if actuation is not None and u is not None:
        forces = np.array([actuation.at(*state)[0] for state in zip(q, v, u, strict=True)])
        for i, actuator in enumerate(mechanism.actuators):
            columns[f"actuator.{actuator.name}"] = forces[:, i]
            if actuator.dynamics != "none":
                columns[f"activation.{actuator.name}"] = u[:, i]
    if mechanism.tendons:
        tree, lengths = mechanism.tree, np.empty((len(q), len(mechanism.tendons)))
        paths = [path.on(tree, f"tendon {name!r}") for name, path in mechanism.tendons.items()]
        for k, state in enumerate(q):
            tree.jacobians(state)
            lengths[k] = [path.at(state)[0] for path in paths]
        columns |= {f"tendon.{name}": lengths[:, i] for i, name in enumerate(mechanism.tendons)}
    return columns
