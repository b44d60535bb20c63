"""How torques that follow the state change with it, at many states of a motion."""

from __future__ import annotations

import numpy as np

from ..mechanism.differences import CENTRAL, moved_along
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .derivatives import AppliedSlopes, TorqueSlopes
from .equations import TorqueFunction


def followed(
    mechanism: Mechanism,
    function: TorqueFunction,
    slopes: TorqueSlopes | None,
    states: tuple[Array, Array, Array],
    G: Array,
    dv_dy: Array,
) -> tuple[Array, Array]:
    """∂τ/∂y = τ_q G + τ_v V_y, along the velocities G e_j, and ∂τ/∂u = τ_v G, at N states.

    Without slopes by central differences along these directions alone: 4 m values of the function a state.

    Parameters
    ----------
    function : callable (t, q, v) -> (nv,)
    slopes : callable, optional
        ∂τ/∂q and ∂τ/∂v, see `derivatives`.
    states : (t, q, v)
        (N,), (N, nq) and (N, nv).
    G, dv_dy : ndarray (N, nv, m)

    Returns
    -------
    tuple of ndarray (N, nv, m), ndarray (N, nv, m)
    """
    by_y, by_u = np.empty(G.shape), np.empty(G.shape)
    if slopes is not None:
        given = AppliedSlopes(mechanism, function, slopes)
        for i, (t, q, v) in enumerate(zip(*states, strict=True)):
            by_q, by_v = given(float(t), q, v)
            by_y[i], by_u[i] = by_q @ G[i] + by_v @ dv_dy[i], by_v @ G[i]
        return by_y, by_u
    (t, q, v), tree = states, mechanism.tree
    units, size = mechanism.units, np.maximum(mechanism.units, np.abs(v))
    for j in range(G.shape[2]):
        along, faster = G[:, :, j], dv_dy[:, :, j]
        for by, dq, dv in ((by_y, along, faster), (by_u, np.zeros(v.shape), along)):
            reach = np.maximum(np.abs(dq / units).max(axis=1), np.abs(dv / size).max(axis=1))
            h = (CENTRAL / reach)[:, None]
            ahead, behind = (function.over(t, moved_along(tree, q, s * dq), v + s * dv) for s in (h, -h))
            with np.errstate(all="ignore"):  # whoever asks looks at what is not finite
                by[:, :, j] = (ahead - behind) / (2.0 * h)
    return by_y, by_u
