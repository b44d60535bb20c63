"""Derivatives of u̇ where some independent joints move as prescribed.

With y = (d, f) and W = ∂u̇/∂τ of the independent ones while d is free, forces on d keep d̈ as it is whatever
else changes, and a change of d̈ takes forces W_dd⁻¹ δd̈:

    δf̈ = δf̈|τ − W_fd W_dd⁻¹ δd̈|τ,   ∂f̈/∂d̈ = W_fd W_dd⁻¹.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .derivatives import Derivatives, PointDerivatives
from .drive import Drive
from .equations import Evaluation


class DrivenDerivatives(PointDerivatives):
    """`PointDerivatives` of the free coordinates; the rows of driven ones are zero.

    The torque on a driven joint changes nothing: its column of ∂u̇/∂τ holds ∂u̇/∂d̈.

    Parameters
    ----------
    drive : Drive
    others
        As of `PointDerivatives`.
    """

    def __init__(self, drive: Drive, *others: Any) -> None:
        super().__init__(*others)
        self._drive = drive

    def at(self, t: float, now: Evaluation) -> Derivatives:
        """At an evaluated point, what moves the driven joints in its τ."""
        found, driven, free = super().at(t, now), self._drive.driven, self._drive.free
        own = self.mechanism.iv_independent[driven]
        rows = np.hstack([found.da_dy, found.da_dv, found.da_dtau])
        by_force = found.da_dtau[:, own]
        shares = np.linalg.solve(by_force[driven].T, by_force[free].T).T
        rows[free] -= shares @ rows[driven]
        rows[driven] = 0.0
        m = self.mechanism.m
        by_tau = rows[:, 2 * m :]
        by_tau[np.ix_(free, own)] = shares
        return replace(found, da_dy=rows[:, :m], da_dv=rows[:, m : 2 * m], da_dtau=by_tau)
