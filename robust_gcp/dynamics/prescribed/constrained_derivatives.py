"""Derivatives of u̇ where some independent joints move as prescribed, or rows of v are held at rest.

Prescribed: with y = (d, f) and W = ∂u̇/∂τ of the independent ones while d is free, forces on d keep d̈ as it is
whatever else changes, and a change of d̈ takes forces W_dd⁻¹ δd̈:

    δf̈ = δf̈|τ − W_fd W_dd⁻¹ δd̈|τ,   ∂f̈/∂d̈ = W_fd W_dd⁻¹.

Held: E v = 0, by forces f on these rows, in the coordinates of the mechanism without them, which may be moved
along what is held: its place is a parameter of the motion. With Y = ∂u̇/∂τ Eᵀ and S = E G Y,

    f = −S⁻¹ E a,   δu̇ = δu̇|f − Y S⁻¹ E δa|f,   a = G u̇ + g.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
        shares = np.linalg.solve(by_force[driven].T, by_force[free].T).T  # W_fd W_dd⁻¹
        rows[free] -= shares @ rows[driven]
        rows[driven] = 0.0
        by_y, by_u, by_tau = np.split(rows, [self.mechanism.m, 2 * self.mechanism.m], axis=1)
        by_tau[:, own] = 0.0  # what drives a joint gives way to what else acts on it
        by_drive = np.zeros_like(by_force)
        by_drive[free] = shares
        return ByDrive(found.udot, by_y, by_u, by_tau, found.G, found.dv_dy, by_drive)


class HeldDerivatives(PointDerivatives):
    """`PointDerivatives` with rows held.

    Parameters
    ----------
    rows : ndarray (k, nv)
        E, independent on the motions of the mechanism.
    others
        As of `PointDerivatives`.
    """

    def __init__(self, rows: Array, *others: Any) -> None:
        super().__init__(*others)
        self._E = rows

    def derivatives_at(self, t: float, now: Evaluation) -> Derivatives:
        """At an evaluated point, whose u̇ is that without f."""
        return self.stage(t, now)[1]

    def stage(self, t: float, now: Evaluation) -> tuple[Evaluation, Derivatives]:
        """With f in τ and in u̇."""
        held, found, _, by_f = self._held(t, now)
        Y = found.da_dtau @ self._E.T
        m = self.mechanism.m
        by_y, by_u, by_tau = by_f[:, :m], by_f[:, m : 2 * m], by_f[:, 2 * m :]
        return held, replace(
            found,
            da_dy=found.da_dy + Y @ by_y,
            da_dv=found.da_dv + Y @ by_u,
            da_dtau=found.da_dtau + Y @ by_tau,
        )

    def forces(self, t: float, now: Evaluation) -> tuple[Array, Array]:
        """f (k,), and how it changes with (η, u, τ), (k, 2m + nv)."""
        _, _, f, by_f = self._held(t, now)
        return f, by_f

    def _held(self, t: float, now: Evaluation) -> tuple[Evaluation, Derivatives, Array, Array]:
        """The evaluation with f, derivatives with f as it is, f and how it changes."""
        E, free = self._E, super().derivatives_at(t, now)
        Y = free.da_dtau @ E.T
        S = E @ free.G @ Y
        f = np.linalg.solve(S, -E @ now.a)
        tau = E.T @ f if now.tau is None else now.tau + E.T @ f
        held = replace(now, ydd=now.ydd + Y @ f, tau=tau)
        found, whole = super().whole(t, held)  # with f in τ and u̇, which their derivatives depend on
        by = np.hstack([found.da_dy, found.da_dv, found.da_dtau])
        still = np.zeros((E.shape[1], E.shape[1]))  # at u̇ held a does not change with τ
        rates = np.hstack([whole.by_y, whole.by_u, still])
        return held, found, f, -np.linalg.solve(S, E @ (found.G @ by + rates))
