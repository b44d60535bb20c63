"""Forward dynamics and its first derivatives, at one state or many: by the compiled kernel where it can.

What it does not, `serving_coordinates` and the reference do, which say what is wrong with a state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_callable, check_finite, check_mechanism
from ...dynamics.change_of_coordinates import transformed
from ...dynamics.derivatives import Derivatives
from ...dynamics.loads import Torques, Wrench
from ...dynamics.modes.taylor_series import circles_of
from ...dynamics.problem import initial_value_problem
from ...dynamics.torque_feedback import TorqueSlopes, followed, slopes_of_all
from ...errors import NonFiniteError, RobustGcpError
from ...kernel.derivatives.step_derivatives import Derivation
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from . import serving_coordinates as serving
from .at_states import AtStates

NEAR = 0.02
"""How near to a state beside which no circle could be made none is tried again, dimensionless."""


def forward_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: Torques | None = None,
    mode: ArrayLike | None = None,
    t: float = 0.0,
) -> Array:
    """u̇ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g), Eq. (3), at a state or at many.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like (nq,), (nv,), or (N, nq), (N, nv)
        Closed, and K v = 0; at rest when v is left out.
    tau : optional
        Torques as in `simulate`, besides the mechanism's own springs, dampers and drives; of many states also
        (N, nv).
    mode : array_like, optional
        As in `simulate`, where q is singular.
    t : float
        Time for the torques, s.

    Returns
    -------
    ndarray (m,) or (N, m)
        Of the independent velocities, in the order of `mechanism.independent`.

    Raises
    ------
    StateError, SimulationError
        As `simulate` does for a start, NonFiniteError where it is not finite.
    """
    check_mechanism(mechanism, Mechanism, "forward_dynamics")
    check_finite("t", t)
    states = AtStates.of(mechanism, q, v, tau, mode=mode)
    missing, kernel = np.arange(len(states)), states.kernel()
    udot: Array = np.empty((len(states), mechanism.m))
    if kernel is not None:
        tau = states.total(t)

        def ask(which: NDArray[np.intp]) -> NDArray[np.bool_]:
            acting = None if tau is None else tau[which]
            at = states.q[which], states.v[which], acting
            sound, udot[which] = kernel.forward_dynamics(*at, mode=states.mode)
            return sound

        def by_others(which: NDArray[np.intp]) -> Iterator[int]:
            for i, _, whole in serving.answered_by_others(mechanism, states.q, states.v, tau, which):
                udot[i] = whole.a[mechanism.iv_independent]
                yield i

        missing = answered(kernel, states, ask, by_others)
    for i in missing.tolist():
        state = states.q[i], states.v[i] if v is not None else None
        with states.naming(i):
            udot[i] = serving.forward_dynamics(mechanism, *state, states.torque_at(i), mode, t)
    return np.asarray(udot[0]) if states.one else udot


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
        As of `forward_dynamics`; at many states, such as a trajectory's `q` and `v`, N is the first axis of
        each result.
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
    check_callable("tau_slopes", tau_slopes, "(t, q, v)")
    check_finite("t", t)
    states = AtStates.of(mechanism, q, v, tau, wrenches, mode)
    whole = Derivatives.room(len(states), mechanism.m, mechanism.nv)
    missing = np.arange(len(states))
    tau_slopes, kernel = slopes_of_all(mechanism, tau_slopes, wrenches), states.kernel()
    if kernel is not None:
        missing = _by_kernel(kernel, states, t, whole)
        if states.function is not None:
            _follow(states, t, tau_slopes, whole, np.setdiff1d(np.arange(len(states)), missing))
    known = circles_of(mechanism)
    for i in missing.tolist():
        fast = None if v is None else states.v[i]
        torque = states.torque_at(i)
        with states.naming(i):
            found = serving.derivatives(
                mechanism, states.q[i], fast, torque, mode, t, tau_slopes, wrenches, known
            )
        _fill(whole, i, found)
    if not states.one:
        return whole
    return Derivatives(*(getattr(whole, field.name)[0] for field in fields(Derivatives)))


def answered(
    kernel: Derivation,
    states: AtStates,
    ask: Callable[[NDArray[np.intp]], NDArray[np.bool_]],
    by_others: Callable[[NDArray[np.intp]], Iterable[int]],
    ahead: float = 0.0,
) -> NDArray[np.intp]:
    """Ask the kernel about all states, in other coordinates that served before, and again with more modes.

    Parameters
    ----------
    ask : callable
        About states by number; which of them it answered.
    by_others : callable
        Answers those of them that it can in other coordinates, and yields their numbers.
    ahead : float
        How far the motion is followed from a state, s.

    Returns
    -------
    ndarray of int
        The states that are left.
    """
    missing = np.arange(len(states))
    missing = missing[~ask(missing)]
    # other coordinates first: there K_d is well conditioned, and a series takes 0.1 to 1 s to make
    if len(missing) and states.mode is None:
        missing = np.setdiff1d(missing, list(by_others(missing)))
    # a series about one state serves, as a rule, all that are beside the same singular place
    while len(missing) and learned(
        kernel, states.mechanism, states.q[missing[0]], states.v[missing[0]], ahead, states.mode
    ):
        good = ask(missing)
        if not good.any():
            break
        missing = missing[~good]
    return missing


def _by_kernel(kernel: Derivation, states: AtStates, t: float, whole: Derivatives) -> NDArray[np.intp]:
    """Write what the kernel finds, torques held; which states are missing."""
    tau = states.total(t)

    def ask(which: NDArray[np.intp]) -> NDArray[np.bool_]:
        acting = None if tau is None else tau[which]
        found = kernel.slopes(states.q[which], states.v[which], acting, mode=states.mode)
        _fill(whole, which[found.good], found.of_state(found.good))
        return found.good

    def by_others(which: NDArray[np.intp]) -> Iterator[int]:
        others = serving.answered_by_others(states.mechanism, states.q, states.v, tau, which)
        for i, found, accelerations in others:
            _fill(whole, i, transformed(found, accelerations, states.mechanism.iv_independent))
            yield i

    return answered(kernel, states, ask, by_others)


def _follow(
    states: AtStates, t: float, slopes: TorqueSlopes | None, whole: Derivatives, which: NDArray[np.intp]
) -> None:
    """Add to derivatives at some states that a function's torque changes with them."""
    function, some = states.function, states.some(which)
    assert function is not None  # asked only where there is one
    G, dv_dy, by_tau = whole.G[which], whole.dv_dy[which], whole.da_dtau[which]
    times = np.full(len(which), t)
    by_y, by_u = followed(states.mechanism, function, slopes, (times, some.q, some.v), G, dv_dy)
    # slopes of a user's function may be infinite, which is told by name below
    with np.errstate(all="ignore"):
        whole.da_dy[which] += by_tau @ by_y
        whole.da_dv[which] += by_tau @ by_u
    finite = np.isfinite(whole.da_dy[which]) & np.isfinite(whole.da_dv[which])
    if not finite.all():
        q = some.q[int(np.argmin(finite.all(axis=(1, 2))))]
        raise NonFiniteError(f"the linearisation at q = {q} is not finite")


def learned(
    kernel: Derivation, mechanism: Mechanism, q: Array, v: Array, ahead: float, mode: Array | None = None
) -> bool:
    """Whether the kernel is told of the mode at a state, that was new to it."""
    failed = _failed(mechanism)
    if is_alone(kernel, mechanism, q, v):  # a trial takes longest where it comes to nothing
        return False
    try:
        start = initial_value_problem(mechanism, q, v, mode).start
        # other coordinates do, and are known from now on
        if serving.serving(mechanism, start.point) is not None:
            return False
    except RobustGcpError:  # the reference says what is wrong
        return False
    if _is_near(mechanism, start.point.q, start.point.G, failed):
        return False
    # the stages of a step lie between both
    places = [q] if ahead == 0.0 else [q, mechanism.tree.integrate(q, ahead * v)]
    with suppress(RobustGcpError):  # the mode cannot be followed there
        if kernel.learn_beside(start, places):
            return True
    failed.append((start.point.q, start.point.G))
    return False


def is_alone(kernel: Derivation, mechanism: Mechanism, q: Array, v: Array) -> bool:
    """Whether K_d is poor at a state, and beside it neither a series nor other coordinates were found."""
    failed = _failed(mechanism)
    G = kernel.G_where_poor(q, v) if failed else None
    return G is not None and _is_near(mechanism, q, G, failed)


def _failed(mechanism: Mechanism) -> list[tuple[Array, Array]]:
    """Places, with G there, beside which nothing was found."""
    known: list[tuple[Array, Array]] = mechanism.memo.once("no circles beside", list)
    return known


def _is_near(mechanism: Mechanism, at: Array, along: Array, others: list[tuple[Array, Array]]) -> bool:
    """Whether a point, with its G, is beside another one, on the same way."""
    for q, G in others:
        off = np.abs(mechanism.tree.difference(q, at) / mechanism.units).max()
        # modes that meet have the place in common, not G: one may have a series where the other has none
        if off < NEAR and np.abs(G - along).max() < NEAR * np.abs(G).max():
            return True
    return False


def _fill(whole: Derivatives, i: Any, some: Derivatives) -> None:
    for field in fields(Derivatives):
        getattr(whole, field.name)[i] = getattr(some, field.name)
