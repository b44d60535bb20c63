"""Derivatives as the compiled kernel returns them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..dynamics.derivatives import Accelerations, Derivatives
from ..mechanism.tree import Array


@dataclass(frozen=True)
class Slopes:
    """What the kernel found at N states; rows of those that are not `good` hold nothing.

    Attributes
    ----------
    good : ndarray of bool (N,)
    udot : ndarray (N, m)
    rows : ndarray (N, m, 2m + nv)
        ∂u̇ by y, u and τ.
    G, dv_dy : ndarray (N, nv, m)
    whole : Accelerations or None
        (N, nv) and (N, nv, m), where they were asked for.
    """

    good: NDArray[np.bool_]
    udot: Array
    rows: Array
    G: Array
    dv_dy: Array
    whole: Accelerations | None = None

    def at(self, i: int | slice | NDArray[np.bool_]) -> Derivatives:
        """Those of a state, or of several with their number as the first axis."""
        m, rows = self.G.shape[2], self.rows[i]
        by_y, by_v, by_tau = rows[..., :m], rows[..., m : 2 * m], rows[..., 2 * m :]
        return Derivatives(self.udot[i], by_y, by_v, by_tau, self.G[i], self.dv_dy[i])
