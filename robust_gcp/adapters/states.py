"""Many states (q, v) by their independent entries y and u, forwards and for cotangents."""

from __future__ import annotations

import numpy as np

from ..kernel.assembling import closed, lifted
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from ..simulation.derivatives.accelerations import derivatives
from .turning import normalised, rates


def closed_states(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Loops closed with y held, and v = G u; v as given where K_d is singular: u does not tell it.

    Raises
    ------
    StateError
        For states that are not finite, or whose loops do not close.
    """
    if mechanism.nq != mechanism.nv:
        q = normalised(mechanism, q)
    q, done = closed(mechanism, q, mechanism.iv_dependent)
    if not np.all(done):
        q[~done] = mechanism.assemble(q[~done])
    fast = np.array(v, order="C")
    known = lifted(mechanism, q, fast, mechanism.iv_dependent)
    if known is None:
        return q, mechanism.lift(q, v[:, mechanism.iv_independent])
    return q, np.where(known[:, None], fast, v)


def to_independent(mechanism: Mechanism, q: Array, v: Array, on_q: Array, on_v: Array) -> Array:
    """Cotangents (N, 2m) of (y, u) by those of q and v: δq = G δy along velocities, δv = ∂v/∂y δy + G δu."""
    own, others = mechanism.iv_independent, mechanism.iv_dependent
    along = on_q if mechanism.nq == mechanism.nv else times(on_q, rates(mechanism, q))
    found = np.concatenate([along[:, own], on_v[:, own]], axis=1)
    some = np.flatnonzero(np.any(along[:, others], axis=1) | np.any(on_v[:, others], axis=1))
    if len(some):
        at = derivatives(mechanism, q[some], v[some])
        on_y = times(along[some], at.G) + times(on_v[some], at.dv_dy)
        found[some] = np.concatenate([on_y, times(on_v[some], at.G)], axis=1)
    return found


def to_state(mechanism: Mechanism, q: Array, rows: Array) -> tuple[Array, Array]:
    """Cotangents of q and v by those of (y, u): zero for dependent entries."""
    m, own = mechanism.m, mechanism.iv_independent
    along, on_v = np.zeros((2, len(rows), mechanism.nv))
    along[:, own], on_v[:, own] = rows[:, :m], rows[:, m:]
    if mechanism.nq == mechanism.nv:
        return along, on_v
    by = rates(mechanism, q)
    return times(along / np.sum(by * by, axis=1), by.transpose(0, 2, 1)), on_v


def times(rows: Array, matrices: Array) -> Array:
    """Each row (N, n) times its matrix (N, n, k)."""
    product: Array = np.matmul(rows[:, None], matrices)[:, 0]
    return product
