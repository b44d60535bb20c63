"""RNEA and its derivatives by q and v, also where Pinocchio's own are wrong."""

from __future__ import annotations

import threading

import numpy as np
import pinocchio as pin

from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.columns import with_simple_joints
from ..mechanism.tree.tree import Array
from ..mechanism.tree.workspace import whole_workspace


class RigidDerivatives(threading.local):
    """∂RNEA/∂q, ∂RNEA/∂v and M of a mechanism's tree; one workspace a thread.

    `pin.computeRNEADerivatives` is wrong for joints whose motion subspace depends on q: these are spelt as
    chains of revolute and prismatic joints, with the same q and v.

    Parameters
    ----------
    mechanism : Mechanism

    Raises
    ------
    ModelError
        Where the workspace does not fit into the memory that is left.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._model = with_simple_joints(mechanism.near, mechanism.joints)
        self._data = whole_workspace(self._model)

    def derivatives_at(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """∂RNEA/∂q, ∂RNEA/∂v and M at (q, v, a), (nv, nv) each; q along the velocities' components."""
        by_q, by_v, M = pin.computeRNEADerivatives(self._model, self._data, q, v, a)
        return np.array(by_q), np.array(by_v), np.array(M)
