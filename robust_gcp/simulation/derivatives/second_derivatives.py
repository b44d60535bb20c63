"""Second derivatives of accelerations and of steps, as products with a direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_mechanism, check_positive, checked_rows, checked_vector, is_table
from ...errors import RobustGcpError, SimulationError, StateError
from ...mechanism.differences import moved_along
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .accelerations import derivatives
from .at_states import AtStates
from .one_step import step

EIGHTH = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
SIXTH = np.array([3 / 4, -3 / 20, 1 / 60, 0.0])
"""Σ w_k (f(kh) − f(−kh)) / h: central differences of order 8, and of order 6 at the same places."""

LONGEST = 0.02
"""Of the step of differences, without units."""

HALVINGS = 9  # to steps of 8e-5, where rounding makes some 3e-11 of the result

ENOUGH = 1e-9
"""Relative difference of both orders at which the step serves."""

AGREE = 1e-6
"""Relative difference of both orders that is refused; that of order 8 errs by less."""


def second_derivatives(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    dy: ArrayLike | None = None,
    du: ArrayLike | None = None,
    dtau: ArrayLike | None = None,
    h: float | None = None,
) -> Array:
    """How the derivatives of u̇, or of a step of h, change along a direction: Hessian times vector.

    d/ds [∂u̇/∂y, ∂u̇/∂u, ∂u̇/∂τ], or d/ds [A, B], at y + s dy, u + s du, τ + s dτ; y moves along the velocities
    G e_j, which for numbers in q is the Hessian's product. By differences of order 8 of the analytic first
    derivatives, whose step is halved until they agree with those of order 6: to 1e-10 or so of the largest.

    Parameters
    ----------
    mechanism, q, v
        As of `derivatives`, one state or N; closed.
    tau : array_like (nv,) or (N, nv), optional
    dy, du, dtau : array_like (m,), (m,), (nv,), or rows of N, optional
        The direction; zero where left out.
    h : float, optional
        s; without it accelerations are asked for.

    Returns
    -------
    ndarray (m, 2m + nv) or (2m, 2m + nv); N first at many states

    Raises
    ------
    StateError
        For what is no state, direction or torque.
    SimulationError
        As `derivatives` and `step`; where differences do not settle, beside singular configurations.
    """
    check_mechanism(mechanism, Mechanism, "second_derivatives")
    if h is not None:
        check_positive("h", h)
    if callable(tau):
        raise StateError(
            "second_derivatives: tau is held; give numbers, such as what the function says there"
        )
    states = AtStates.of(mechanism, q, v, tau)
    n, m, nv = len(states), mechanism.m, mechanism.nv
    along = [
        _rows(part, n, size, what, letter)
        for part, size, what, letter in ((dy, m, "dy", "m"), (du, m, "du", "m"), (dtau, nv, "dtau", "nv"))
    ]
    tau_now = np.zeros((n, nv)) if states.tau is None else states.tau
    found: Array = np.zeros((n, m if h is None else 2 * m, 2 * m + nv))
    apart, left = np.full(n, np.inf), np.arange(n)
    G = derivatives(mechanism, q, v, tau).G.reshape(n, nv, m)  # which refuses what is no state
    scale = LONGEST / np.maximum(_size(mechanism, states, G, along), 1e-300)
    for _ in range(HALVINGS):
        if not len(left):
            break
        at = [part[left] for part in (states.q, states.v, tau_now, G, *along)]
        eighth, sixth = _each_or_all(mechanism, at, scale[left], h)
        with np.errstate(invalid="ignore"):  # none where both are infinite
            size = np.maximum(np.abs(eighth).max(axis=(1, 2)), 1e-300)
            error = np.abs(eighth - sixth).max(axis=(1, 2)) / size
        nearer = error < apart[left]
        found[left[nearer]], apart[left[nearer]] = eighth[nearer], error[nearer]
        # until rounding grows again; infinite where a neighbour has no derivatives, as nearer ones may have
        left = left[(nearer & (error > ENOUGH)) | ~np.isfinite(error)]
        scale[left] *= 0.5
    bad = np.flatnonzero(~(apart < AGREE))
    if len(bad):
        raise SimulationError(
            f"second_derivatives: at q = {states.q[bad[0]]} differences do not settle (orders 6 and 8 differ "
            f"by {apart[bad[0]]:.1e}): it is too near to a singular configuration"
        )
    return found[0] if states.one else found


def _rows(given: ArrayLike | None, n: int, size: int, what: str, letter: str) -> Array:
    """A direction at each of n states."""
    if given is None:
        return np.zeros((n, size))
    if is_table(given):
        return checked_rows(given, n, size, what, letter)
    return np.tile(checked_vector(given, size, what, letter), (n, 1))


def _size(mechanism: Mechanism, states: AtStates, G: Array, along: list[Array]) -> Array:
    """How far a direction goes at s = 1, without units, (N,)."""
    dy, du, dtau = along
    units = mechanism.units
    moved = np.abs(np.einsum("nij,nj->ni", G, dy) / units).max(axis=1)
    faster = np.abs(np.einsum("nij,nj->ni", G, du) / units).max(axis=1)
    speed = np.abs(states.v / units).max(axis=1)
    pushed = np.abs(dtau).max(axis=1)
    return np.maximum(np.maximum(moved, faster / np.maximum(1.0, speed)), pushed / _torque_size(states))


def _torque_size(states: AtStates) -> Array:
    """Of which torques are steps of differences, N m: derivatives are linear in them, or nearly."""
    acting = 0.0 if states.tau is None else np.abs(states.tau).max(axis=1)
    return np.maximum(acting, np.ones(len(states)))


def _each_or_all(mechanism: Mechanism, at: list[Array], scale: Array, h: float | None) -> tuple[Array, Array]:
    """Both differences; infinite at a state beside which there is one that has no derivatives."""
    try:
        return _differences(mechanism, at, scale, h)
    except RobustGcpError:
        if len(scale) == 1:
            m = mechanism.m
            none: Array = np.full((1, m if h is None else 2 * m, 2 * m + mechanism.nv), np.inf)
            return none, none
    parts = ([part[i : i + 1] for part in at] for i in range(len(scale)))
    found = [_each_or_all(mechanism, part, scale[i : i + 1], h) for i, part in enumerate(parts)]
    return np.concatenate([one for one, _ in found]), np.concatenate([other for _, other in found])


def _differences(mechanism: Mechanism, at: list[Array], scale: Array, h: float | None) -> tuple[Array, Array]:
    """Both differences at some states, (N, …) each."""
    q, v, tau, G, dy, du, dtau = at
    n = len(q)
    shares = np.concatenate([np.arange(1, 5), -np.arange(1, 5)])
    s = (shares[:, None] * scale).ravel()[:, None]
    many = [np.tile(part, (len(shares), 1)) for part in (q, v, tau, dy, du, dtau)]
    q, v, tau, dy, du, dtau = many
    moves = s * np.einsum("nij,nj->ni", np.tile(G, (len(shares), 1, 1)), dy)
    # along G the loops open at second order: closed with y held, and v made anew from u
    q = moved_along(mechanism.tree, q, moves)
    if mechanism.nc:
        q = mechanism.assemble(q, hold=mechanism.independent)
    v = mechanism.lift(q, v[:, mechanism.iv_independent] + s * du)
    if h is None:
        first = derivatives(mechanism, q, v, tau + s * dtau)
        rows = np.concatenate([first.da_dy, first.da_dv, first.da_dtau], axis=2)
    else:
        after = step(mechanism, q, v, tau + s * dtau, h, jacobians=True)
        assert after.A is not None and after.B is not None  # they were asked for
        rows = np.concatenate([after.A, after.B], axis=2)
    rows = rows.reshape(2, 4, n, *rows.shape[1:])
    pairs = (rows[0] - rows[1]) / scale[:, None, None]
    return np.tensordot(EIGHTH, pairs, 1), np.tensordot(SIXTH, pairs, 1)
