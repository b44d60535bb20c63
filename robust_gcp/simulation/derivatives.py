"""Forward dynamics, its first derivatives and those of steps: by the compiled kernel where it can.

What it does not, `serving`, `differentiated` and the reference do, which say what is wrong with a state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_finite, check_mechanism, check_positive, checked_rows
from ..dynamics import linearise as by_reference
from ..dynamics.continuation import circles_of
from ..dynamics.derivatives import Derivatives, TorqueSlopes
from ..dynamics.linearise import Linearisation
from ..dynamics.loads import Torques, Wrench, one_torque
from ..dynamics.motion import Motion
from ..dynamics.problem import set_out
from ..errors import SimulationError
from ..kernel.derivation import Derivation
from ..kernel.derivations import derivation
from ..mechanism.groups import groups_of
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from . import serving
from .differentiated import differentiated
from .moved import Acting


def forward_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    mode: ArrayLike | None = None,
    t: float = 0.0,
) -> Array:
    """u̇ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), Eq. (3), at a state.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,)
        Closed, and K v = 0; at rest when v is left out.
    tau : optional
        Torques as in `simulate`, besides the mechanism's own springs, dampers and drives.
    mode : array_like, optional
        As in `simulate`, where q is singular.
    t : float
        Time for the torques, s.

    Returns
    -------
    ndarray (m,)
        Of the independent velocities, in the order of `mechanism.independent`.

    Raises
    ------
    StateError, SimulationError
        As `simulate` does for a start, NonFiniteError where it is not finite.
    """
    check_mechanism(mechanism, Mechanism, "forward_dynamics")
    check_finite("t", t)
    state = _state(mechanism, q, v, one_torque(mechanism, tau)) if mode is None else None
    if state is not None:
        good, udot = state.kernel.forward_dynamics(state.q, state.v, state.tau)
        if good[0]:
            return np.asarray(udot[0])
    return serving.forward_dynamics(mechanism, q, v, tau, mode, t)


def derivatives(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    mode: ArrayLike | None = None,
    t: float = 0.0,
    tau_slopes: TorqueSlopes | None = None,
    wrenches: Sequence[Wrench] = (),
) -> Derivatives:
    """First derivatives of `forward_dynamics`, also at singular configurations on a mode.

    Parameters
    ----------
    mechanism, q, v, tau, mode, t
        As of `forward_dynamics`; or of many states at once, such as a trajectory's `q` and `v`: arrays
        (N, nq) and (N, nv), tau (nv,) or (N, nv). Then N is the first axis of each result.
    tau_slopes : callable (t, q, v) -> ((nv, nv), (nv, nv)), optional
        ∂τ/∂q and ∂τ/∂v where tau is a function; by central differences when left out.
    wrenches : sequence of Wrench
        As in `simulate`; their slopes by central differences.

    Raises
    ------
    StateError, SimulationError
        As `simulate` does for a start; NotCertifiedError where modes do not part clearly at q, NonFiniteError
        where forces have no finite slope.
    ModelError
        For ellipsoid joints.
    """
    check_mechanism(mechanism, Mechanism, "derivatives")
    check_finite("t", t)
    if getattr(q, "ndim", 1) == 2:
        return _at_many(mechanism, q, v, tau, mode, t, tau_slopes, wrenches)
    if mode is None and tau_slopes is None and not wrenches:
        state = _state(mechanism, q, v, one_torque(mechanism, tau))
        if state is not None:
            found = state.kernel.slopes(state.q, state.v, state.tau)
            if found.good[0]:
                return found.at(0)
    return serving.derivatives(mechanism, q, v, tau, mode, t, tau_slopes, wrenches)


def _at_many(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: Torques | None,
    mode: ArrayLike | None,
    t: float,
    tau_slopes: TorqueSlopes | None,
    wrenches: Sequence[Wrench],
) -> Derivatives:
    """The same at N states; those that the kernel does not do, one by one."""
    states = checked_rows(q, None, mechanism.nq, "q", "nq")
    n = len(states)
    fast = np.zeros((n, mechanism.nv)) if v is None else checked_rows(v, n, mechanism.nv, "v", "nv")
    torques: list[Torques | None] = [tau] * n
    if getattr(tau, "ndim", 1) == 2:
        torques = list(checked_rows(np.asarray(tau), n, mechanism.nv, "tau", "nv"))
    whole, missing = Derivatives.room(n, mechanism.m, mechanism.nv), np.arange(n)
    if n and mode is None and tau_slopes is None and not wrenches:
        held = [one_torque(mechanism, torque) for torque in torques]
        kernel = None if callable(held[0]) else derivation(mechanism, mechanism.configuration(states[0]))
        if kernel is not None:
            acting = None if held[0] is None else np.array(held, dtype=float)
            found = kernel.slopes(states, fast, acting)
            whole, missing = found.at(slice(None)), np.flatnonzero(~found.good)
            while len(missing) > 1 and _learned(kernel, mechanism, states[missing[0]], fast[missing[0]]):
                more = kernel.slopes(
                    states[missing], fast[missing], None if acting is None else acting[missing]
                )
                _fill(whole, missing[more.good], more.at(more.good))
                if not more.good.any():
                    break
                missing = missing[~more.good]
    known = circles_of(mechanism)
    for i in missing:
        one = serving.derivatives(
            mechanism, states[i], fast[i], torques[i], mode, t, tau_slopes, wrenches, known
        )
        _fill(whole, i, one)
    return whole


def _learned(kernel: Derivation, mechanism: Mechanism, q: Array, v: Array) -> bool:
    """Whether the kernel is told of the mode at a state, that was new to it."""
    try:
        return kernel.learn_beside(set_out(mechanism, q, v).start, [q])
    except SimulationError:
        return False


def _fill(whole: Derivatives, i: Any, some: Derivatives) -> None:
    for field in fields(Derivatives):
        getattr(whole, field.name)[i] = getattr(some, field.name)


def step_jacobians(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None,
    tau: ArrayLike | None,
    step: float,
    mode: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Jacobians of one step of RK4, the torques held over it.

    δ(η, u) after the step = A δ(η, u) before it + B δτ, η along the velocities G e_j at either end and u the
    independent velocities.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,)
        Closed, and K v = 0; at rest where v is None.
    tau : array_like (nv,) or mapping {joint: torque}, optional
        N m and N, besides the mechanism's own forces; None: none.
    step : float
        s.
    mode : array_like, optional
        As in `simulate`, where q is singular.

    Returns
    -------
    A : ndarray (2m, 2m)
    B : ndarray (2m, nv)

    Raises
    ------
    StateError, SimulationError, ModelError
        As `derivatives` does.
    """
    check_mechanism(mechanism, Mechanism, "step_jacobians")
    check_positive("step", step)
    held = None if tau is None else mechanism.velocity(tau, "tau")
    state = _state(mechanism, q, v, held) if mode is None else None
    found = None if state is None else state.kernel.step_jacobians(state.q, state.v, state.tau, float(step))
    if found is not None:
        return found
    moved = differentiated(mechanism, (q, v), mode, Acting(held), 0.0, float(step))
    return moved.A, moved.B


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
    if mode is None and drive is None and not wrenches and not mechanism.chart_joints:
        state = _state(mechanism, q, v, one_torque(mechanism, torque))
        if state is not None:
            found = state.kernel.slopes(state.q, state.v, state.tau)
            if found.good[0]:
                by_y, m = _chart_rates(mechanism, state.v[0, mechanism.iv_independent]), mechanism.m
                rest = np.concatenate([by_y, np.eye(m)], axis=1)
                return Linearisation.of(np.concatenate([rest, found.rows[0, :, : 2 * m]]))
    return by_reference.linearise(mechanism, q, v, torque, t, mode, wrenches, drive)


def _chart_rates(mechanism: Mechanism, u: Array) -> Array:
    """∂ẏ/∂y at the origin of the charts, (m, m): ½ [δw, u] of joints on groups."""
    by_y, groups = np.zeros((mechanism.m, mechanism.m)), groups_of(mechanism)
    if groups is not None:
        own = groups.inputs
        by_y[np.ix_(own, own)] = groups.rate_slopes(np.zeros(len(own)), u[own])[0]
    return by_y


@dataclass(frozen=True)
class _State:
    """A state for the kernel, as rows of one."""

    kernel: Derivation
    q: Array
    v: Array
    tau: Array | None


def _state(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None, tau: object) -> _State | None:
    """None where the kernel does not take the mechanism or the torque."""
    if callable(tau):
        return None
    at = mechanism.configuration(q, "q0")
    kernel = derivation(mechanism, at)
    if kernel is None:
        return None
    fast = np.zeros((1, mechanism.nv)) if v is None else mechanism.velocity(v, "v0")[None]
    return _State(kernel, at[None], fast, None if tau is None else np.asarray(tau, dtype=float)[None])
