"""The equations of motion as linear ones about a state: by the compiled kernel where it can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_finite, check_mechanism
from ...dynamics import linearise as by_reference
from ...dynamics.linearise import Linearisation
from ...dynamics.loads import Torques, Wrench
from ...dynamics.prescribed.motion import Motion
from ...errors import SimulationError
from ...kernel.derivatives.derivations import left_to_python
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .accelerations import derivatives


def linearise(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    torque: Torques | None = None,
    t: float = 0.0,
    mode: ArrayLike | None = None,
    wrenches: Sequence[Wrench] = (),
    drive: Mapping[str, Motion] | None = None,
) -> Linearisation:
    """Linearise ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g) at a state.

    By the analytic `derivatives`, at a singular configuration on a mode; by central differences of the
    right-hand side where there are none: for ellipsoid joints, and beside modes that pass each
    other; beside joints that are driven.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,)
        Closed, and K v = 0; at rest when v is left out.
    torque, wrenches : optional
        As in `simulate`.
    t : float
        Time for torques and prescribed motions, s.
    mode : array_like, optional
        As in `simulate`, where q is singular.
    drive : mapping of str to Motion, optional
        Joints that move as prescribed, which q and v agree with at time t; left out, v is with the free
        joints at rest. Linearised are the free ones: A is (2f, 2f) for f of them, in the order of y.

    Returns
    -------
    Linearisation

    Raises
    ------
    StateError, SimulationError
        As `simulate` does for a start, NonFiniteError where A is not finite.
    """
    check_mechanism(mechanism, Mechanism, "linearise")
    check_finite("t", t)
    q = mechanism.configuration(q)
    if drive is None and not mechanism.chart_joints:
        with suppress(SimulationError):  # which the reference may do by differences
            slopes = derivatives(mechanism, q, v, torque, mode, t, wrenches=wrenches)
            u = np.zeros(mechanism.m) if v is None else mechanism.velocity(v)[mechanism.iv_independent]
            rest = np.concatenate([_chart_rates(mechanism, u), np.eye(mechanism.m)], axis=1)
            rates = np.concatenate([slopes.da_dy, slopes.da_dv], axis=1)
            return Linearisation.of(np.concatenate([rest, rates]))
    found = by_reference.linearise(mechanism, q, v, torque, t, mode, wrenches, drive)
    if drive is not None:
        left_to_python(mechanism, "linearisations", "joints are driven; linearise about free ones")
    else:
        left_to_python(mechanism, "linearisations")
    return found


def _chart_rates(mechanism: Mechanism, u: Array) -> Array:
    """∂ẏ/∂y at the origin of the charts, (m, m): ½ [δw, u] of joints on groups."""
    by_y, groups = np.zeros((mechanism.m, mechanism.m)), groups_of(mechanism)
    if groups is not None:
        own = groups.inputs
        by_y[np.ix_(own, own)] = groups.rate_slopes(np.zeros(len(own)), u[own])[0]
    return by_y
