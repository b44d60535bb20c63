"""Derivatives of u̇ where some independent joints move as prescribed.

With y = (d, f) and W = ∂u̇/∂τ of the independent ones while d is free, forces on d keep d̈ as it is whatever
else changes, and a change of d̈ takes forces W_dd⁻¹ δd̈:

    δf̈ = δf̈|τ − W_fd W_dd⁻¹ δd̈|τ,   ∂f̈/∂d̈ = W_fd W_dd⁻¹.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...mechanism.tree.tree import Array
from ..derivatives import Derivatives, PointDerivatives
from ..equations import Evaluation
from .drive import Drive


@dataclass(frozen=True)
class ByDrive(Derivatives):
    """`Derivatives` of the free coordinates, the rows of driven ones zero.

    Attributes
    ----------
    da_ddrive : ndarray (m, driven)
        By prescribed accelerations.
    """

    da_ddrive: Array


class DrivenDerivatives(PointDerivatives):
    """`PointDerivatives` where joints are driven.

    Parameters
    ----------
    drive : Drive
    others
        As of `PointDerivatives`.
    """

    def __init__(self, drive: Drive, *others: Any) -> None:
        super().__init__(*others)
        self._drive = drive

    def derivatives_at(self, t: float, now: Evaluation) -> ByDrive:
        """At an evaluated point, what moves the driven joints in its τ."""
        found, driven, free = super().derivatives_at(t, now), self._drive.driven, self._drive.free
        own = self.mechanism.iv_independent[driven]
        rows = np.hstack([found.da_dy, found.da_dv, found.da_dtau])
        by_force = found.da_dtau[:, own]
        shares = np.linalg.solve(by_force[driven].T, by_force[free].T).T
        rows[free] -= shares @ rows[driven]
        rows[driven] = 0.0
        by_y, by_u, by_tau = np.split(rows, [self.mechanism.m, 2 * self.mechanism.m], axis=1)
        by_tau[:, own] = 0.0  # what drives a joint gives way to what else acts on it
        by_drive = np.zeros_like(by_force)
        by_drive[free] = shares
        return ByDrive(found.udot, by_y, by_u, by_tau, found.G, found.dv_dy, by_drive)
