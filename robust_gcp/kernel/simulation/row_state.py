"""Where the rows of a batch are, as plain numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array
from .guard import Watch

Which = NDArray[np.int64]


@dataclass(frozen=True)
class RowState:
    """What is known of every row, whatever its coordinates.

    Attributes
    ----------
    step : float
        s.
    t0 : ndarray (N,)
        s.
    at, left, passed : ndarray of int (N,)
        Steps since t0; steps that were not taken at last; singular places passed.
    status : ndarray of int (N,)
        A `Reason`.
    held : ndarray (N, width)
        Torques, and controls after them.
    q, v : ndarray (N, nq), (N, nv)
    """

    step: float
    t0: Array
    at: Which
    left: Which
    passed: Which
    status: NDArray[np.int32]
    held: Array
    q: Array
    v: Array

    @classmethod
    def room(cls, count: int, step: float, nq: int, nv: int, width: int) -> RowState:
        """Room for so many rows."""
        at, left, passed = (np.zeros(count, np.int64) for _ in range(3))
        status, held = np.zeros(count, np.int32), np.zeros((count, width))
        q, v = np.zeros((count, nq)), np.zeros((count, nv))
        return cls(step, np.zeros(count), at, left, passed, status, held, q, v)

    def take(self, other: RowState) -> None:
        """Become what another one is."""
        for name in list(self.__dataclass_fields__)[1:]:  # in place, as the kernel has their addresses
            getattr(self, name)[...] = getattr(other, name)

    def copy(self) -> RowState:
        """The same in other memory."""
        arrays = (getattr(self, name).copy() for name in list(self.__dataclass_fields__)[1:])
        return RowState(self.step, *arrays)


@dataclass(frozen=True)
class Standing:
    """Where a row is, in its coordinates.

    Attributes
    ----------
    x, anchor, origin, ydd : ndarray
        See `Workspace`.
    trackers : ndarray or None
        In a zone.
    watch : Watch or None
        Up to where its coordinates serve; None: as they do at first.
    """

    x: Array
    anchor: Array
    origin: Array
    ydd: Array
    trackers: Array | None
    watch: Watch | None
