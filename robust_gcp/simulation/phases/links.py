"""Steps and jumps of a run through phases, by which small changes of the state are taken on.

Changes of the state are kept along all velocities, (δq, δv) (2nv,), on the tangent of each phase. A step
reads those of the independent velocities, takes them on, and gives all of them:
δq = G δη, δv = ∂v/∂y δη + G δu.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...dynamics.change_of_coordinates import Slope
from ...mechanism.tree.joints import Array, Index
from .saltation import Jump


@dataclass(frozen=True)
class Link:
    """A step that begins at output `first`, and ends at output `last`, or at a turn (None).

    Attributes
    ----------
    first : int
    last : int or None
    own : ndarray of int (m,)
        Independent velocities that it is told in.
    A, B : ndarray (2m, 2m), (2m, nv)
        As of `Moved`.
    end : Slope
    """

    first: int
    last: int | None
    own: Index
    A: Array
    B: Array
    end: Slope

    def onward(self, changes: Array) -> Array:
        """Changes (2nv, k) after the step from those before."""
        nv, own = len(self.end.G), self.own
        return self.end.whole @ (self.A @ np.vstack([changes[:nv][own], changes[nv:][own]]))

    def backward(self, row: Array) -> tuple[Array, Array]:
        """What multiplies changes before it from what multiplies those after it, and the slope by torques."""
        nv, m = len(self.end.G), len(self.own)
        reduced = row @ self.end.whole
        before, pulled = np.zeros(2 * nv), reduced @ self.A
        before[self.own], before[nv + self.own] = pulled[:m], pulled[m:]
        return before, reduced @ self.B


@dataclass(frozen=True)
class Turned:
    """A jump, and the outputs just before and just after it, where there are such."""

    jump: Jump
    before: int | None
    after: int | None
