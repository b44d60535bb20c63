"""Which explicit map a motion follows, and how."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..errors import OptionError
from .classical import ClassicalMap, NewtonStart
from .cluster.cluster_map import ClusterMap
from .cluster.options import LAST_RESORT, PRESCRIBED, USUAL, BridgeOptions
from .explicit import ExplicitMap
from .four_bar import FourBarMap
from .grouped import GroupMap
from .grouped_start import GroupStart
from .projection import PROJECTION_THRESHOLD, ProjectionMap
from .start import Start

Method = Literal["bridge", "projection", "classical", "closed_form"]
KernelMap = ClusterMap | ClassicalMap | GroupMap
"""The maps that the kernel knows."""

METHODS: tuple[Method, ...] = ("bridge", "projection", "classical", "closed_form")


@dataclass(frozen=True)
class MapChoice:
    """The explicit map of a motion, before its start is known.

    Attributes
    ----------
    method : {"bridge", "projection", "classical", "closed_form"}
    options : BridgeOptions
        Of "bridge".
    newton_start : {"tangent", "previous"}
        Of "classical".
    threshold : float
        Of "projection".
    error_controlled : bool
        Whether the caller controls its error, so that a zone without a certified bridge may be entered.
    prescribed : bool
        Whether all coordinates move as prescribed.
    """

    method: Method = "bridge"
    options: BridgeOptions = USUAL
    newton_start: NewtonStart = "tangent"
    threshold: float = PROJECTION_THRESHOLD
    error_controlled: bool = False
    prescribed: bool = False

    def over(self, start: Start) -> ExplicitMap:
        """The map on the mode of a start."""
        if isinstance(start, GroupStart):
            return GroupMap(start.groups, self.over(start.rest), start.point)
        if self.method == "classical":
            return ClassicalMap(start.path, start.point, self.newton_start)
        if self.method == "projection" and start.mechanism.chart_joints:
            raise OptionError(
                'method="projection": Eq. (7) is written for coordinates that are numbers in q; joint '
                f"{start.mechanism.chart_joints[0].name!r} has independent velocities that are none; use "
                'method="bridge" or "classical"'
            )
        if self.method == "projection":
            return ProjectionMap(start.path, start.point, self.threshold)
        if self.method == "closed_form":
            return FourBarMap(start.path, start.point, self.error_controlled)
        least = PRESCRIBED if self.prescribed else LAST_RESORT
        return ClusterMap(start.path, start.point, self.options, self.error_controlled, start.trackers, least)
