"""How forces along a motion change with parameters, summed in the kernel."""

from __future__ import annotations

import numpy as np

from ..dynamics.parameters import Parameters, torques_by
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .measures import weighed
from .slopes import Stages


def by_parameters(mechanism: Mechanism, parameters: Parameters, stages: Stages, weights: Array) -> Array:
    """Σ λᵀ ∂(τ − M a − C)/∂p over stages of steps, (parameters,).

    Parameters
    ----------
    weights : ndarray (N, nv)
        λ.
    """
    by = np.zeros(len(parameters.names))
    if parameters.bodies or parameters.gravity:
        found = weighed(mechanism, stages.q, stages.v, stages.a, weights)
        assert found is not None  # the stages are the kernel's
        for i, joint, share in parameters.bodies:
            by[i] = -found[0][joint] @ share
        for i, k in parameters.gravity:
            by[i] = -found[1][k]
    for i, k in parameters.armature:
        by[i] = -weights[:, k] @ stages.a[:, k]
    for i, (what, force) in parameters.forces:
        at, torque = torques_by(mechanism, what, force, stages.q, stages.v)
        by[i] = np.einsum("nk,nk->", weights[:, at], torque)
    return by
