"""ẋ by the kernel for a solver that chooses its own steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from ...dynamics.equations import Evaluation
from ...maps.explicit import Crossing
from ...mechanism.tree.tree import Array
from ..handles import Shared, Trackers
from ..library import Library
from ..structures import Reason, Request, address
from .batch import counted

DONE, TORQUE, REFUSED = int(Reason.DONE), int(Reason.TORQUE), int(Reason.REFUSED)

ON_BRIDGE = 2
"""Where a request tells that its last state is: in a zone, on a bridge."""

DEGREE = 12
"""Of the polynomials that SciPy's solvers give within a step, at most (LSODA's)."""


@cache
def _chebyshev() -> tuple[Array, Array]:
    """Where such a polynomial on [−1, 1] is asked for, and what makes its Chebyshev coefficients of that."""
    nodes = chebyshev.chebpts1(DEGREE + 1)
    return nodes, np.linalg.inv(chebyshev.chebvander(nodes, DEGREE))


class Rates:
    """ẋ = f(t, x) in a workspace, from the point evaluated last or from the one that was kept.

    Any other use of the workspace ends this.

    Parameters
    ----------
    library : Library
    handle : int
    request : Request
        With all choices and the point to begin from.
    reference : pointer
        To the request.
    shared : Shared
        Where the kernel reads and writes.
    raised : list
        Of what the torque function raised.
    evaluation, trackers : callable
        Read what the kernel has told, and the state of its trackers.
    prescribe : callable (t)
        Writes what moves as prescribed.
    crossings : callable
        Reads what was passed last.
    """

    def __init__(
        self,
        library: Library,
        handle: Any,
        request: Request,
        reference: Any,
        shared: Shared,
        raised: list[BaseException],
        evaluation: Callable[[], Evaluation],
        trackers: Callable[[], Trackers],
        prescribe: Callable[[float], None],
        crossings: Callable[[], list[Crossing]],
    ) -> None:
        self._prescribe, self._crossings = prescribe, crossings
        self._library, self._follow = library, library.follow
        self._handle, self._request, self._reference = handle, request, reference
        self._time, self._x, self._rate = shared.time, shared.x, shared.rate
        self._raised, self._evaluation, self._trackers = raised, evaluation, trackers

    def __call__(self, t: float, x: Array) -> Array | None:
        """ẋ, (n,); None where the kernel cannot tell, which ends this unless the state was `refused`.

        Raises
        ------
        BaseException
            What the torque function raised.
        """
        self._at(t, x)
        self._follow(self._handle, self._reference)
        return self._rate.copy() if self._done() else None

    def _at(self, t: float, x: Array) -> None:
        self._time[0], self._x[:] = t, x
        self._prescribe(t)

    def _done(self) -> bool:
        reason = self._request.reason
        if reason == TORQUE:  # or it was interrupted between two lines of the generator
            raise self._raised[0] if self._raised else KeyboardInterrupt
        return bool(reason == DONE)

    def slopes(self, t: float, x: Array, unit: Array) -> Array | None:
        """∂ẋ/∂x but for the work done, (2m, 2m), by forward differences; None where the kernel cannot tell.

        Parameters
        ----------
        unit : ndarray (m,)
            Of the independent velocities, contiguous.

        Raises
        ------
        BaseException
            As a call does.
        """
        self._at(t, x)
        A: Array = np.empty((2 * len(unit), 2 * len(unit)))
        self._library.bend(self._handle, self._reference, address(unit), address(A))
        return A if self._done() else None

    def passed(
        self, times: tuple[float, float], ends: Array, within: Callable[[float], Array]
    ) -> list[Crossing] | None:
        """Singular places that a step of the solver's passed; None where the kernel cannot tell.

        Parameters
        ----------
        times : (float, float)
            s.
        ends : ndarray (2, 2m)
            (y, ẏ) there.
        within : callable (t) -> ndarray
            The state at a time between, y and ẏ first.
        """
        if not self._request.met:
            return []
        n, (t0, t1) = ends.shape[1], times
        half, (nodes, to_series) = 0.5 * (t1 - t0), _chebyshev()
        states = to_series @ np.array([within(t0 + half * (1.0 + s))[:n] for s in nodes.tolist()])
        if not np.isfinite(states).all():  # the solver's interpolant asked where the motion does not go
            return None
        bend = np.vstack([chebyshev.chebder(states[:, n // 2 :]) / half, np.zeros((1, n // 2))])
        told, rows = np.ascontiguousarray(ends), np.hstack([states, bend])
        self._library.passed(self._handle, self._reference, t0, t1, address(told), address(rows), len(rows))
        return self._crossings() if self._done() else None

    def told(self) -> tuple[Evaluation, Trackers | None, bool, bool]:
        """The evaluation made last, the trackers where they know something, whether in a zone, and met."""
        self._library.tell(self._handle, self._reference)
        knows = self._request.in_zone or self._request.met
        trackers = self._trackers() if knows else None
        return self._evaluation(), trackers, bool(self._request.in_zone), bool(self._request.met)

    def keep(self) -> Evaluation:
        """The evaluation made last, which is gone back to where that is nearer than what comes after."""
        self._library.tell(self._handle, self._reference)
        self._library.keep(self._handle)
        return self._evaluation()

    def rounding(self) -> tuple[float, float, float]:
        """As `apex.rounding`, where the kernel told it last."""
        request = self._request
        return float(request.uncertain), float(request.asked), float(request.nearest)

    def looked(self, limit: float | None) -> None:
        """What was met so far was told of; the largest entry of J that is not told of."""
        self._library.forget(self._handle)
        if limit is not None:
            self._request.limit = limit

    @property
    def on_bridge(self) -> bool:
        """Whether the last state is on a bridge."""
        return bool(self._request.in_zone == ON_BRIDGE)

    @property
    def refused(self) -> bool:
        """Whether the mode cannot be followed to the last state; this goes on from what was kept."""
        return bool(self._request.reason == REFUSED)

    @property
    def plain(self) -> bool:
        """Whether no singular place was passed since they were forgotten, and no coordinate is outgrown."""
        return bool(self._request.plain)

    @property
    def taken(self) -> dict[str, int]:
        """What was computed, right-hand sides apart."""
        return counted(self._request)

    @property
    def calls(self) -> int:
        """Right-hand sides that were told."""
        return int(self._request.rhs)
