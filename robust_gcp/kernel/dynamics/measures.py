"""How far loops are open, energies and constraint forces along a motion, measured in the kernel."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.joints import OF_MOMENTS
from ...mechanism.tree.tree import Array
from ..description import describe_all
from ..library import Library, library
from ..loop_arrays import NotNativeError, turn_to_axis
from ..structures import address


def measured(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array] | None:
    """max |φ|, m or rad, and the energy, J, of each state of a motion.

    As `Mechanism.phi` and `Mechanism.energy` have them to rounding, in a fiftieth of the time and without the
    interpreter's lock.

    Parameters
    ----------
    q, v : ndarray (N, nq), (N, nv)
        As a simulation left them: finite, orientations normalised.

    Returns
    -------
    tuple of ndarray (N,), ndarray (N,), or None
        None where there is no kernel, or it does not know a joint.
    """
    described = _described(mechanism)
    if described is None:
        return None
    found, structure = described
    q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
    open_, energy = np.empty(len(q)), np.empty(len(q))
    found.measure(structure, len(q), *map(address, (q, v, open_, energy)))
    return open_, energy


def reactions(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None) -> Array | None:
    """λ (N, nc) of each state as `dynamics.equations.constraint_forces` has it; None as for `measured`.

    Parameters
    ----------
    q, v, a : ndarray (N, nq), (N, nv), (N, nv)
    tau : ndarray (N, nv) or None
        All that acts besides gravity.
    """
    described = _described(mechanism)
    if described is None:
        return None
    found, structure = described
    rows = [None if part is None else np.ascontiguousarray(part) for part in (q, v, a, tau)]
    scales = np.ascontiguousarray(mechanism.row_scale), np.ascontiguousarray(mechanism.column_scale)
    multipliers: Array = np.empty((len(q), mechanism.nc))
    found.react(structure, *map(address, scales), len(q), *map(address, (*rows, multipliers)))
    return multipliers


def weighed(mechanism: Mechanism, q: Array, v: Array, a: Array, weights: Array) -> tuple[Array, Array] | None:
    """Σ λᵀ ∂(M a + C)/∂π over states; None as for `measured`.

    Parameters
    ----------
    q, v, a, weights : ndarray (N, nq), (N, nv), (N, nv), (N, nv)
        The weights are λ.

    Returns
    -------
    by_inertia : ndarray (joints, 10)
        π in the order of `dynamics.regressor.OF_A_BODY`.
    by_gravity : ndarray (3,)
    """
    described = _described(mechanism)
    if described is None:
        return None
    found, structure = described
    rows = [np.ascontiguousarray(part) for part in (q, v, a, weights)]
    sums = np.zeros(10 * len(mechanism.joints) + 3)  # of bodies, then of gravity
    found.weigh(structure, len(q), *map(address, (*rows, sums)))
    turned = mechanism.memo.once("sums by π in own frames", lambda: _turned(mechanism))
    return np.einsum("jab,jb->ja", turned, sums[:-3].reshape(-1, 10)), sums[-3:]


def _turned(mechanism: Mechanism) -> Array:
    """What takes sums by π in the kernel's frames to those in the joints' own, (joints, 10, 10)."""
    turns = np.array([turn_to_axis(joint) for joint in mechanism.joints]).reshape(-1, 3, 3)
    units = (np.tile(unit, (len(turns), 1)) for unit in np.eye(10))  # the map is linear: its columns
    return np.stack([_in_own_frames(turns, each) for each in units], axis=-1)


def _in_own_frames(turns: Array, sums: Array) -> Array:
    """The sums by π in the joints' own frames, (joints, 10), of those in frames that are turned."""
    own = sums.copy()
    own[:, 1:4] = np.einsum("jab,jb->ja", turns, sums[:, 1:4])
    moments: Array = np.zeros((len(sums), 3, 3))
    for k, (i, j) in enumerate(OF_MOMENTS, start=4):  # Ixy stands for two entries of the symmetric matrix
        moments[:, i, j] += 0.5 * sums[:, k]
        moments[:, j, i] += 0.5 * sums[:, k]
    moments = turns @ moments @ turns.transpose(0, 2, 1)
    for k, (i, j) in enumerate(OF_MOMENTS, start=4):
        own[:, k] = moments[:, i, j] * (1.0 if i == j else 2.0)  # sums by π, not π: both entries add up
    return own


def _described(mechanism: Mechanism) -> tuple[Library, Any] | None:
    """The kernel, and the mechanism as it reads it; None where it cannot."""
    found = library()
    if found is None:
        return None
    try:
        return found, ctypes.byref(describe_all(mechanism).structure)
    except NotNativeError:
        return None
