"""The running term of a cost at many states of a motion, with its slopes in minimal coordinates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...checks import real_array
from ...mechanism.differences import moved_along
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .cost import NUDGE, Cost, number, vectors

ORDER_4 = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))
"""Places and weights of the central difference of order 4."""

LIKE = 1e-12
"""Relative difference that rounding makes between values one by one and at once."""


class Along(NamedTuple):
    """The running term at N states: its values (N,), and slopes by y and u (N, m) and by τ (N, nv)."""

    values: Array
    by_y: Array
    by_u: Array
    by_tau: Array


def running_along(
    cost: Cost, mechanism: Mechanism, states: tuple[Array, Array, Array, Array], G: Array, dv_dy: Array
) -> Along:
    """The running term and its slopes; without those of the user by differences of order 4.

    Where the user's function takes arrays (nq, N), (nv, N) and gives the same for them as one by one, all
    differences are one call.

    Parameters
    ----------
    states : (t, q, v, tau)
        (N,), (N, nq), (N, nv) and (N, nv).
    G, dv_dy : ndarray (N, nv, m)
    """
    t, q, v, tau = states
    running = cost.running
    assert running is not None  # asked only where there is one

    def value(t: float, q: Array, v: Array, tau: Array) -> float:
        return number(running(t, q.copy(), v.copy(), tau.copy()), "Cost: running(t, q, v, tau)")

    def one_by_one(t: Array, q: Array, v: Array, tau: Array) -> Array:
        return np.array([value(*state) for state in zip(t.tolist(), q, v, tau, strict=True)])

    values = one_by_one(*states)
    if cost.running_slopes is not None:
        by_q, by_v, by_tau = (np.empty(v.shape) for _ in range(3))
        for i, (at, *state) in enumerate(zip(t.tolist(), q, v, tau, strict=True)):
            given = cost.running_slopes(at, *(part.copy() for part in state))
            label = "Cost: running_slopes(t, q, v, tau)"
            by_q[i], by_v[i], by_tau[i] = vectors(given, 3, mechanism.nv, label)
        by_y = np.einsum("sn,snm->sm", by_q, G) + np.einsum("sn,snm->sm", by_v, dv_dy)
        return Along(values, by_y, np.einsum("sn,snm->sm", by_v, G), by_tau)
    again = at_once(running, states)
    same = again is not None and np.abs(again - values).max() <= LIKE * np.abs(values).max()

    def many(*parts: Array) -> Array:
        found = at_once(running, parts) if same else None
        return one_by_one(*parts) if found is None else found

    units, size = mechanism.units, np.maximum(1.0, np.abs(v))
    m = G.shape[2]
    found = np.zeros((len(t), 2 * m + mechanism.nv))
    for k in range(found.shape[1]):
        dq, dv, dtau = np.zeros((3, *v.shape))
        if k < m:
            dq, dv = G[:, :, k], dv_dy[:, :, k]
        elif k < 2 * m:
            dv = G[:, :, k - m]
        else:
            dtau[:, k - 2 * m] = np.maximum(1.0, np.abs(tau[:, k - 2 * m]))
        reach = np.maximum(np.abs(dq / units).max(axis=1), np.abs(dv / size).max(axis=1))
        h = np.full(len(t), NUDGE) if k >= 2 * m else NUDGE / reach
        for place, weight in ORDER_4:
            step = (place * h)[:, None]
            moved = moved_along(mechanism.tree, q, step * dq) if k < m else q
            found[:, k] += weight / h * many(t, moved, v + step * dv, tau + step * dtau)
    by_tau = found[:, 2 * m :] / np.maximum(1.0, np.abs(tau))
    return Along(values, found[:, :m], found[:, m : 2 * m], by_tau)


def at_once(function: Callable[..., Any], states: tuple[Array, ...]) -> Array | None:
    """Values of a function at many states, the number of the state last in its arrays; None where it refuses.

    Whatever it raises it is asked one by one then, and raises it there.
    """
    t, *rest = states
    if len(t) <= max(part.shape[1] for part in rest):  # arrays that it could take for one state's
        return None
    try:
        with np.errstate(all="ignore"):
            found = real_array(function(t.copy(), *(part.T.copy() for part in rest)))
    except Exception:
        return None
    return found if found.shape == t.shape and np.all(np.isfinite(found)) else None
