"""Coordinates that move as prescribed, in the kernel: what it is told at a single time; what they take."""

from __future__ import annotations

import numpy as np

from ..dynamics.prescribed.drive import Drive
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array
from .structures import Request, address, side_by_side


class Driving:
    """Buffers that a request points to; none where nothing is prescribed.

    Parameters
    ----------
    request : Request
    mechanism : Mechanism
    drive : Drive or None

    Attributes
    ----------
    which : tuple of int
        Which of y are prescribed.
    of_all : bool
        Whether all are.
    """

    def __init__(self, request: Request, mechanism: Mechanism, drive: Drive | None) -> None:
        self._request, self._drive, self._nv = request, drive, mechanism.nv
        self.which: tuple[int, ...] = () if drive is None else tuple(drive.driven.tolist())
        self.of_all = len(self.which) == mechanism.m > 0
        if drive is None:
            return
        self._columns = mechanism.iv_independent[drive.driven]
        n = len(self.which)
        (self._now, self._effort), places = side_by_side({"now": 3 * n, "effort": n})
        request.effort = places["effort"]

    def prescribe(self, t: float) -> None:
        """Tell what is prescribed at a time, s."""
        if self._drive is not None:
            self._now[:] = np.concatenate(self._drive.at(t))
            self._request.prescribed = address(self._now)

    def effort(self) -> Array | None:
        """What the kernel found last that this takes, (nv,), NaN at other joints."""
        if self._drive is None:
            return None
        found: Array = np.full(self._nv, np.nan)
        found[self._columns] = self._effort
        return found
