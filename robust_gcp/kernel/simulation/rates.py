"""ẋ by the kernel for a solver that chooses its own steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from ...dynamics.equations import Evaluation
from ...maps.explicit import Crossing
from ...mechanism.tree.tree import Array
from ..handles import Trackers
from ..structures import Reason, address
from .batch import counted

if TYPE_CHECKING:
    from .workspace import Workspace

DONE, TORQUE, REFUSED = int(Reason.DONE), int(Reason.TORQUE), int(Reason.REFUSED)

ON_BRIDGE = 2
"""Where a request tells that its last state is: in a zone, on a bridge."""

DEGREE = 12
"""Of the polynomials that SciPy's solvers give within a step, at most (LSODA's)."""


@cache
def _chebyshev() -> tuple[Array, Array]:
    """Where such a polynomial on [−1, 1] is asked for, and what makes its Chebyshev coefficients of that."""
    nodes = chebyshev.chebpts1(DEGREE + 1)
    return nodes, np.linalg.inv(chebyshev.chebvander(nodes, DEGREE))  # of condition √2 at these nodes


class Rates:
    """ẋ = f(t, x) in a workspace, from the point evaluated last or from the one that was kept.

    Any other use of the workspace ends this.

    Parameters
    ----------
    workspace : Workspace
        Whose request has all choices and the point to begin from.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self._library, self._handle = workspace, workspace.library, workspace.handle
        self._request, self._reference = workspace.request, workspace.reference
        self._follow, shared = self._library.follow, workspace.shared
        self._time, self._x, self._rate = shared.time, shared.x, shared.rate
        self._prescribe, self._raised = workspace.acting.prescribe, workspace.acting.raised

    def __call__(self, t: float, x: Array) -> Array | None:
        """ẋ, (n,); None where the kernel cannot tell, which ends this unless the state was `refused`.

        Raises
        ------
        BaseException
            What the torque function raised.
        """
        self._time[0], self._x[:] = t, x
        self._prescribe(t)
        self._follow(self._handle, self._reference)
        reason = self._request.reason
        if reason == TORQUE:  # or it was interrupted between two lines of the generator
            raise self._raised[0] if self._raised else KeyboardInterrupt
        return self._rate.copy() if reason == DONE else None

    def slopes(self) -> Array | None:
        """∂ẋ/∂x but for the work done, (2m, 2m), where it begins; None where the kernel cannot tell.

        By forward differences, see `dynamics.linearise`.
        """
        self._prescribe(float(self._time[0]))
        unit = self._workspace.unit
        A: Array = np.empty((2 * len(unit), 2 * len(unit)))
        self._library.bend(self._handle, self._reference, address(unit), address(A))
        self._workspace.acting.require_answered()
        return A if self._request.reason == DONE else None

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
        # ÿ by the chain rule from [−1, 1]; a derivative has one coefficient less
        bend = np.vstack([chebyshev.chebder(states[:, n // 2 :]) / half, np.zeros((1, n // 2))])
        told, rows = np.ascontiguousarray(ends), np.hstack([states, bend])
        self._library.passed(self._handle, self._reference, t0, t1, address(told), address(rows), len(rows))
        return self._workspace.passed if self._request.reason == DONE else None

    def told(self) -> tuple[Evaluation, Trackers | None, bool, bool]:
        """The evaluation made last, the trackers where they know something, whether in a zone, and met."""
        self._library.tell(self._handle, self._reference)
        knows = self._request.in_zone or self._request.met
        trackers = self._workspace.handed.new() if knows else None
        return self._workspace.told(), trackers, bool(self._request.in_zone), bool(self._request.met)

    def keep(self) -> Evaluation:
        """The evaluation made last, which is gone back to where that is nearer than what comes after."""
        self._library.tell(self._handle, self._reference)
        self._library.keep(self._handle)
        return self._workspace.told()

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
        """What was computed, by the names of `Counters`."""
        return counted(self._request)
