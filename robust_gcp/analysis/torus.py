"""Distances and turns between configurations that full turns of revolute joints leave the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.tree import Array


class Torus:
    """Configurations compared modulo full turns of the revolute joints.

    Parameters
    ----------
    mechanism : ClosedLoops
    """

    def __init__(self, mechanism: ClosedLoops) -> None:
        self.tree, self.scale = mechanism.tree, mechanism.column_scale
        self.hinges = np.flatnonzero(mechanism.tree.periodic)

    def difference(self, q0: Array, q1: Array) -> Array:
        """The short way from q0 to q1, (nv,): revolute joints in (−π, π]."""
        return self._short(np.array(self.tree.difference(q0, q1), dtype=float))

    def distance(self, q0: Array, q1: Array) -> float:
        """Dimensionless length of the short way."""
        return float(np.linalg.norm(self.difference(q0, q1) / self.scale))

    def distances(self, rows: Sequence[Array], q: Array) -> Array:
        """Dimensionless lengths of the short ways from many configurations to q."""
        if self.tree.vector_space:
            ways = q - np.array(rows)
        else:
            ways = np.array([self.tree.difference(row, q) for row in rows])
        return np.asarray(np.linalg.norm(self._short(ways) / self.scale, axis=1))

    def _short(self, way: Array) -> Array:
        way[..., self.hinges] -= 2.0 * np.pi * np.ceil(way[..., self.hinges] / (2.0 * np.pi) - 0.5)
        return way

    def turns(self, q0: Array, q1: Array) -> tuple[int, ...]:
        """Full turns of each velocity's joint on the way from q0 to q1; 0 for those that do not turn."""
        turns = np.zeros(len(self.scale), dtype=np.int64)
        way = self.tree.difference(q0, q1)[self.hinges] / (2.0 * np.pi)
        turns[self.hinges] = np.round(way)
        return tuple(turns.tolist())
