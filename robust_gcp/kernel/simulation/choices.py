"""The choices of a batch: where zones begin, how bridges are built, up to where coordinates serve."""

from __future__ import annotations

import ctypes

import numpy as np

from ...dynamics.tableau import Tableau
from ...maps.cluster.options import BridgeOptions
from ..structures import Arrays, Request, address
from .batch import bridging
from .guard import Guard, Watch


class Choices:
    """Makes a request's choices, and keeps what it then points to.

    Parameters
    ----------
    request : Request
    last_resort : float
        See `ClusterMap`.
    tableau, guard : Tableau, Guard, optional
        See `Workspace`.

    Attributes
    ----------
    shares : tuple of float
        See `Workspace`.
    """

    def __init__(
        self, request: Request, last_resort: float, tableau: Tableau | None, guard: Guard | None
    ) -> None:
        self._request, self._last_resort = request, last_resort
        self.shares: tuple[float, ...] = (0.0, 0.5)
        if tableau is not None:
            self.shares = tableau.c
            self._weights = np.array([*(x for row in tableau.a for x in row), *tableau.b, *tableau.c])
            request.stages, request.tableau = len(tableau.b), address(self._weights)
        if guard is not None:
            self._guarded = guard.structure
            request.guard = ctypes.addressof(self._guarded.structure)
        self._bridging: tuple[BridgeOptions, Arrays] | None = None
        self._watch: Watch | None = None

    def make(
        self, zone: float, options: BridgeOptions | None, watch: Watch | None, error_controlled: bool = False
    ) -> None:
        """Parameters are those of `Workspace.run`; `error_controlled`: the caller controls its error."""
        r = self._request
        r.zone = zone
        r.bridging = None if options is None else ctypes.pointer(self._structure(options, error_controlled))
        self._watch = watch
        r.sizes = r.uneven = None
        if watch is not None:
            r.sizes, r.limit, r.uneven = address(watch.sizes), watch.limit, address(watch.uneven)

    def _structure(self, options: BridgeOptions, error_controlled: bool) -> ctypes.Structure:
        if self._bridging is None or self._bridging[0] is not options:
            self._bridging = options, bridging(options, self._last_resort)
        structure = self._bridging[1].structure
        structure.error_controlled = error_controlled
        return structure
