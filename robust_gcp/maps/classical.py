"""Classical generalized coordinate partitioning, as published: Eq. (4), and its Newton starts."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..errors import BranchError
from ..mechanism.tree.tree import Array
from ..warning import warn
from .explicit import Point, Unaware
from .regular_path import RegularPath

NewtonStart = Literal["previous", "tangent"]

DIGITS_LOST = 1e-3
"""Conditioning of K_d at which the classical map warns: nine digits of g are gone."""


class SingularityWarning(RuntimeWarning):
    """A method without a certificate passed a singular configuration, or a gap was bridged."""


class ClassicalMap(Unaware):
    """G = [I; −K_d⁻¹ K_i], g = [0; K_d⁻¹ k] everywhere, q_d by Newton (Eq. 4).

    Kept as published, to compare against: beside a singularity it loses digits, and started from
    the previous q_d it may continue on another mode. It warns when that may have happened.

    Parameters
    ----------
    path : RegularPath
    start : Point
    newton_start : {"previous", "tangent"}
        Newton starts from the last q_d, as in the paper, or from q_d + G_d Δy + ½ γ''[Δy, Δy].
    """

    def __init__(self, path: RegularPath, start: Point, newton_start: NewtonStart) -> None:
        self.path, self.anchor, self.newton_start = path, start, newton_start
        self._warned = False

    def resume(self, anchor: Point, *_: object) -> None:
        """Go on from a point that was reached elsewhere; there are no bridges here."""
        self.anchor = anchor

    def point_at(self, y: Array, ydot: Array) -> Point:
        """The point at y that Newton finds.

        Raises
        ------
        BranchError
            When Newton does not converge or K_d is exactly singular.
        """
        if self.newton_start == "previous":
            # beside a crossing the last q_d is a poor guess: Newton wanders before it contracts
            point = self.path.settle(
                self.anchor.q.copy(), y, ydot, contracting=False, origin=self.anchor.origin
            )
        else:
            point = self.path.step(self.anchor, y, ydot)
        if point is None or not np.all(np.isfinite(point.g)):
            raise BranchError(
                f"classical GCP has no solution at y = {y}: Newton on the dependent joints failed or K_d is "
                'singular; method="bridge" passes singular configurations',
                y,
            )
        if point.conditioning < DIGITS_LOST and not self._warned:
            self._warned = True
            warn(
                f"classical GCP came within a conditioning of {point.conditioning:.1g} of a singular "
                f"configuration at y = {y}: digits are lost and the mode may change; "
                'method="bridge" keeps both',
                SingularityWarning,
            )
        self.anchor = point
        return point
