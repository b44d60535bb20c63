"""The few choices of the method, and what is raised where no bridge can be built."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...checks import check_between, check_number, check_positive, listed
from ...errors import OptionError, SimulationError

LAST_RESORT = 2e-2
"""Share of the best chart's quality below which a motion that is followed with error control stops."""

PRESCRIBED = 3e-5
"""The same where all coordinates move as prescribed, so that nothing is integrated in them: that they
determine the others to ten digits is enough."""

REACH_OF_ZONE = 5.0
"""Distance to the singular set, rad, of a zone of unit conditioning: 0.25 for a zone of 0.05."""


ACROSS = 0.2
"""Share of this for clusters of several coordinates: across the bridge's line Γ is interpolated by its values
alone, with an error of zone⁶ instead of zone¹². At 0.05 it is some 1e-11, as the rounding of ε/zone³ is."""


@dataclass(frozen=True)
class BridgeOptions:
    """The few choices of the method, all dimensionless.

    Attributes
    ----------
    zone : float
        Conditioning of K_d (σ_min/σ_max of a 2 × 2 block) below which the bridge takes over. Also
        sets its half width. Rounding errors grow as ε/zone³, the interpolation error falls as zone¹².
    nodes : tuple of float
        Distances of a curve's nodes (m = 1) from the singular place in half widths, ascending from 1.
    closure_tolerance : float
        Largest max |φ| / length over the bridge for a certificate: some thousand roundings.
    geometric_tolerance : float
        Gap between modes, in lengths, below which a near miss counts as a crossing and is reported.
        A gap of e lets the modes veer within √e, and double precision loses ε/e^1.5 of g there.
    transversality : float
        Smallest second-order separation of modes that is certified.
    """

    zone: float = 0.05
    nodes: tuple[float, ...] = (1.0, 1.6, 2.2)
    closure_tolerance: float = 1e-12
    geometric_tolerance: float = 1e-9
    transversality: float = 1e-4

    def __post_init__(self) -> None:
        """Refuse values that make no bridge (`OptionError`)."""
        check_between("BridgeOptions: zone", self.zone, 0.0, 0.5)
        nodes = tuple(listed(self.nodes, "BridgeOptions: nodes", "distances", OptionError, (int, float)))
        for i, node in enumerate(nodes):
            check_positive(f"BridgeOptions: nodes[{i}]", node)
        if len(nodes) < 2 or nodes[0] < 1.0 or any(b <= a for a, b in pairwise(nodes)):
            raise OptionError(
                f"BridgeOptions: nodes = {nodes} must be at least two distances, ascending from 1 half width"
            )
        object.__setattr__(self, "nodes", nodes)
        check_positive("BridgeOptions: closure_tolerance", self.closure_tolerance)
        check_positive("BridgeOptions: transversality", self.transversality)
        check_number("BridgeOptions: geometric_tolerance", self.geometric_tolerance)
        if not 0.0 <= self.geometric_tolerance < np.inf:
            raise OptionError(
                f"BridgeOptions: geometric_tolerance = {self.geometric_tolerance} must be finite, 0 or more"
            )

    def reach(self, mobility: int) -> float:
        """Distance to the singular set at which a cluster's bridge takes over, dimensionless joint units."""
        return REACH_OF_ZONE * self.zone * (1.0 if mobility == 1 else ACROSS)

    @property
    def largest_gap(self) -> float:
        """max |φ| that a bridge may leave."""
        return max(self.closure_tolerance, self.geometric_tolerance)


USUAL = BridgeOptions()
"""The choices where none are made."""


class NoBridgeError(SimulationError):
    """No certified bridge exists here; `residual` is what is left of φ on the best attempt."""

    def __init__(
        self, reason: str, residual: float = np.inf, separation: float = np.nan, met: object = None
    ) -> None:
        super().__init__(reason)
        self.residual, self.separation = residual, separation
        self.met = met  # the Meeting, where it is a cusp
