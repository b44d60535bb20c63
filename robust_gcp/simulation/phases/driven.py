"""Joints that move as prescribed, in the decisions of phases: what they leave free, and what they take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array

TURNS = 1e-6
"""Share of the most that a driven joint can be moved below which it turns back: nothing leads it there."""


class Driven(NamedTuple):
    """Joints that move as prescribed: their places in v, (k,), and their accelerations now."""

    iv: NDArray[np.int64]
    a: Array

    def restricted(self, N: Array, p: Array) -> tuple[Array, Array]:
        """N and p of motions that keep to what is prescribed."""
        D = N[self.iv]
        Q, R = np.linalg.qr(D.T, mode="complete")
        k = len(self.iv)
        # R loses rank where a driven joint turns back: what moves it at first order no more is left alone
        p = p + N @ (Q[:, :k] @ np.linalg.lstsq(R[:k].T, self.a - p[self.iv], rcond=TURNS)[0])
        return N @ Q[:, k:], p

    def effort(self, N: Array, need: Array) -> Array:
        """What drives take, (k,), where motions along N (nv, m) need the forces `need` (nv,)."""
        # m equations for k forces: along the motions that are free `need` is balanced already
        return np.asarray(np.linalg.lstsq(N[self.iv].T, N.T @ need, rcond=TURNS)[0])
