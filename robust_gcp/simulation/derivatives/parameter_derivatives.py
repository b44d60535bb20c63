"""Derivatives of accelerations and of steps by parameters, geometry included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_finite, check_mechanism, check_positive
from ...dynamics.discrete import Stage
from ...dynamics.loads import Torques, one_torque
from ...dynamics.parameters import Parameters
from ...errors import OptionError
from ...mechanism.building.lengths import Along, in_parts
from ...mechanism.building.variable_geometry import is_geometry, varied
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .accelerations import derivatives
from .at_states import AtStates
from .geometry_gradient import beside_singular, torque_of_all
from .one_step import step
from .step_derivatives import differentiated
from .step_of_motion import Acting


def by_parameters(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    parameters: Sequence[str | Along] = (),
    h: float | None = None,
    t: float = 0.0,
) -> Array:
    """How accelerations, or a step, change with parameters: ∂u̇/∂p, or ∂(η, u)/∂p after a step of h.

    y and u of the state are held; dependent joints follow where the geometry changes.

    Parameters
    ----------
    mechanism, q, v, tau, t
        As of `forward_dynamics`, one state or many; with h torques are held over the step.
    parameters : sequence of str
        As of `gradient`.
    h : float, optional
        s; without it accelerations are asked for.

    Returns
    -------
    ndarray (m, k) or (2m, k); (N, m, k) or (N, 2m, k) at many states

    Raises
    ------
    OptionError
        For names that are none, and loops that do not stay closed when a placement changes.
    StateError, SimulationError
        As `derivatives` and `step`; where modes that meet come apart when a placement changes.
    """
    check_mechanism(mechanism, Mechanism, "by_parameters")
    check_finite("t", t)
    if h is not None:
        check_positive("h", h)
    states = AtStates.of(mechanism, q, v, tau)
    if h is not None and states.function is not None:
        raise OptionError("by_parameters: with h, torques are held over the step; give tau as numbers")
    parts = in_parts(mechanism, parameters)
    names = list(dict.fromkeys(name for part in parts for name in part))
    placements = [name for name in names if is_geometry(name)]
    others = [name for name in names if not is_geometry(name)]
    size = mechanism.m if h is None else 2 * mechanism.m
    if not len(states):
        return np.zeros((0, size, len(parts)))
    by: dict[str, Array] = {}
    if placements:
        by |= dict(zip(placements, np.moveaxis(_by_placements(states, placements, h, t), -1, 0), strict=True))
    if others:
        of_others = _by_numbers(states, others, t) if h is None else _of_steps(states, others, h)
        by |= dict(zip(others, np.moveaxis(of_others, -1, 0), strict=True))
    found: Array = np.zeros((len(states), size, len(parts)))
    for k, part in enumerate(parts):
        for name, weight in part.items():
            found[:, :, k] += weight * by[name]
    return found[0] if states.one else found


def _by_placements(states: AtStates, names: list[str], h: float | None, t: float) -> Array:
    """In the coordinates of the mechanism that can change, (N, m or 2m, k)."""
    wide = varied(states.mechanism, names)
    wide.require_closed(states.q[[0, len(states) // 2, -1]])
    tau: Any = states.tau
    if states.function is not None:
        tau = one_torque(states.mechanism, states.given[0])
    acting = tau if tau is None else torque_of_all(wide, tau)
    at = wide.mechanism, wide.q(states.q), wide.v(states.v), acting
    with beside_singular(wide, "by_parameters"):
        if h is None:
            # there placements are coordinates: ∂u̇ by them is some columns of ∂u̇/∂y
            return derivatives(*at, t=t).da_dy[:, wide.own][:, :, wide.more]
        A = step(*at, h, jacobians=True).A
    assert A is not None  # it was asked for
    return A[:, np.concatenate([wide.own, wide.mechanism.m + wide.own])][:, :, wide.more]


def _by_numbers(states: AtStates, names: list[str], t: float) -> Array:
    """∂u̇/∂p of masses and the like, (N, m, k)."""
    parameters, tau = Parameters(states.mechanism, names), states.given[0]
    found = derivatives(states.mechanism, states.q, states.v, tau, t=t)
    # a = G u̇ + g with g = ∂v/∂y u; a parameter then acts as torques ∂(τ − M a − C)/∂p do
    a = np.einsum("nij,nj->ni", found.G, found.udot)
    a += np.einsum("nij,nj->ni", found.dv_dy, states.v[:, states.mechanism.iv_independent])
    moved = [parameters.torques(*state) for state in zip(states.q, states.v, a, strict=True)]
    return found.da_dtau @ np.array(moved)


def _of_steps(states: AtStates, names: list[str], h: float) -> Array:
    """∂(η, u)/∂p after a step, of masses and the like, (N, 2m, k)."""
    mechanism, kernel = states.mechanism, states.kernel()
    parameters, found = Parameters(mechanism, names), []

    def by_stage_slopes(stage: Stage) -> Array:
        return parameters.slopes(stage.now, stage.slopes)

    for i, (q, v) in enumerate(zip(states.q, states.v, strict=True)):
        tau = None if states.tau is None else states.tau[i : i + 1]
        if kernel is not None:
            at, fast = (np.vstack([part, np.full_like(part, np.nan)]) for part in (q, v))
            taken = kernel.take(np.array([0.0, h]), at, fast, tau, np.inf, staged=True)
            if taken.good.all():
                stages = taken.stages
                by_stage = kernel.pull(0, 1, np.eye(2 * mechanism.m), staged=True).by_stage
                assert stages is not None and by_stage is not None  # they were asked for
                moved = [parameters.torques(*s) for s in zip(stages.q, stages.v, stages.a, strict=True)]
                found.append(np.einsum("rsn,snk->rk", by_stage[0], np.array(moved)))
                continue
        torque = None if tau is None else tau[0]
        acting = Acting(torque, by_more=by_stage_slopes)
        with states.naming(i):
            found.append(differentiated(mechanism, (q, v), None, acting, 0.0, h).P)
    return np.array(found)
