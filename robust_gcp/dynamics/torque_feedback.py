"""How torques that follow the state change with it, at one state of a motion or at many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ..checks import real_array, shown
from ..errors import OptionError
from ..mechanism.differences import CENTRAL, moved_along, torque_differences
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .equations import TorqueFunction, called_torque
from .loads import Wrench, one_torque

TorqueSlopes = Callable[[float, Array, Array], tuple[ArrayLike, ArrayLike]]
"""∂τ/∂q and ∂τ/∂v, (nv, nv) each, at (t, q, v); q along the velocities' components."""


class AppliedSlopes:
    """∂τ/∂q and ∂τ/∂v of the user's torques, (nv, nv) each, at (t, q, v).

    Parameters
    ----------
    mechanism : Mechanism
    torque : callable, array_like (nv,) or None
    given : callable, optional
        What gives them; by central differences when left out.
    """

    def __init__(self, mechanism: Mechanism, torque: object, given: TorqueSlopes | None) -> None:
        self._mechanism, self._tau_slopes = mechanism, given
        self._torque = called_torque(mechanism, torque)
        self.some = given is not None or self._torque is not None

    def __call__(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """At a state."""
        if self._tau_slopes is not None:
            return self._given(self._tau_slopes(t, q.copy(), v.copy()))
        if self._torque is not None:
            tree, units = self._mechanism.tree, self._mechanism.units
            return torque_differences(tree, units, partial(self._torque, t), q, v)
        none = np.zeros((len(v), len(v)))
        return none, none

    def _given(self, slopes: object) -> tuple[Array, Array]:
        """What `tau_slopes` returned, or an OptionError."""
        nv = self._mechanism.nv
        try:
            by_q, by_v = (real_array(part) for part in slopes)  # type: ignore[attr-defined]
        except (TypeError, ValueError) as error:
            raise OptionError(
                f"tau_slopes(t, q, v) returned {shown(slopes)}, expected ∂τ/∂q and ∂τ/∂v, ({nv}, {nv}) each"
            ) from error
        if by_q.shape != (nv, nv) or by_v.shape != (nv, nv):
            raise OptionError(
                f"tau_slopes(t, q, v) returned shapes {by_q.shape} and {by_v.shape}, expected ({nv}, {nv})"
            )
        return by_q, by_v


def slopes_of_all(
    mechanism: Mechanism, given: TorqueSlopes | None, wrenches: Sequence[Wrench]
) -> TorqueSlopes | None:
    """A torque function's slopes that were given, and those of wrenches by differences."""
    if given is None or not wrenches:
        return given
    own, loads = AppliedSlopes(mechanism, None, given), one_torque(mechanism, None, wrenches)
    more = AppliedSlopes(mechanism, loads, None)

    def summed(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        (by_q, by_v), (more_q, more_v) = own(t, q, v), more(t, q, v)
        return by_q + more_q, by_v + more_v

    return summed


def followed(
    mechanism: Mechanism,
    function: TorqueFunction | None,
    slopes: TorqueSlopes | None,
    states: tuple[Array, Array, Array],
    G: Array,
    dv_dy: Array,
) -> tuple[Array, Array]:
    """∂τ/∂y = τ_q G + τ_v V_y, along the velocities G e_j, and ∂τ/∂u = τ_v G, at N states.

    Without slopes by central differences along these directions alone: 4 m values of the function a state.

    Parameters
    ----------
    function : callable (t, q, v) -> (nv,), optional
    slopes : callable, optional
        ∂τ/∂q and ∂τ/∂v, see `derivatives`; where they are left out, the function is needed.
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
    assert function is not None
    (t, q, v), tree = states, mechanism.tree
    units, size = mechanism.units, np.maximum(mechanism.units, np.abs(v))
    for j in range(G.shape[2]):
        along, faster = G[:, :, j], dv_dy[:, :, j]
        for by, dq, dv in ((by_y, along, faster), (by_u, np.zeros(v.shape), along)):
            reach = np.maximum(np.abs(dq / units).max(axis=1), np.abs(dv / size).max(axis=1))
            h = (CENTRAL / reach)[:, None]  # as far as the joint that moves most may go
            ahead, behind = (function.over(t, moved_along(tree, q, s * dq), v + s * dv) for s in (h, -h))
            with np.errstate(all="ignore"):  # whoever asks looks at what is not finite
                by[:, :, j] = (ahead - behind) / (2.0 * h)
    return by_y, by_u
