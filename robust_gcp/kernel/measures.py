"""How far loops are open, and energies, along a motion, measured in the kernel."""

from __future__ import annotations

import ctypes

import numpy as np

from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .description import NotNativeError, describe_all
from .library import library
from .structures import address


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
    found = library()
    if found is None:
        return None
    try:
        arrays = describe_all(mechanism)
    except NotNativeError:
        return None
    q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
    open_, energy = np.empty(len(q)), np.empty(len(q))
    places = map(address, (q, v, open_, energy))
    found.measure(ctypes.byref(arrays.structure), len(q), *places)
    return open_, energy
