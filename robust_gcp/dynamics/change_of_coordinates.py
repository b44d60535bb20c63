"""Derivatives taken in some independent velocities u, transformed to others u' of the same motion.

Where u' = v[C] of v = G u, C the rows of the others, W = (G[C])⁻¹, and η moves along G e_j:

    δη = W δη',   δu = W (δu' − V_y[C] δη),   δa = (A_y + G ∂u̇/∂y) δη + (A_u + G ∂u̇/∂u) δu + G ∂u̇/∂τ δτ,

with V_y = ∂v/∂y, and A_y and A_u those of a at u̇ held. The rows C of δa are the derivatives of u̇'. So
derivatives exist wherever u' parametrises the motion, however near K_d of u' is to singular.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.tree.joints import Array, Index
from .derivatives import Accelerations, Derivatives


@dataclass(frozen=True)
class Slope:
    """How v = G u depends on position and velocity at a state.

    Attributes
    ----------
    G : ndarray (nv, m)
    dv_dy : ndarray (nv, m)
        Along the velocities G e_j, u held.
    """

    G: Array
    dv_dy: Array

    @classmethod
    def of(cls, found: Derivatives) -> Slope:
        """That of derivatives."""
        return cls(found.G, found.dv_dy)

    @property
    def whole(self) -> Array:
        """δ(q, v) along all velocities by δ(η, u), (2nv, 2m): [[G, 0], [V_y, G]]."""
        return np.block([[self.G, np.zeros_like(self.G)], [self.dv_dy, self.G]])

    def change(self, chosen: Index) -> Array:
        """δ(η', u') by δ(η, u), (2m, 2m): the rows C of `whole`."""
        return self.of_rows(chosen).whole

    def of_rows(self, chosen: Index) -> Slope:
        """That of some velocities of v."""
        return Slope(self.G[chosen], self.dv_dy[chosen])

    def pulled(self, by_q: Array, by_v: Array) -> Array:
        """What multiplies δ(η, u), (2m,), from what multiplies δq and δv, (nv,) each."""
        return np.concatenate([by_q @ self.G + by_v @ self.dv_dy, by_v @ self.G])

    def seen_in(self, chosen: Index) -> Slope:
        """The same by the velocities `chosen` (m,) of v."""
        W = np.linalg.inv(self.G[chosen])
        G = self.G @ W
        return Slope(G, self.dv_dy @ W - G @ (self.dv_dy[chosen] @ W))


def transformed(found: Derivatives, whole: Accelerations, chosen: Index) -> Derivatives:
    """Derivatives by the velocities `chosen` (m,) of v and their positions.

    Parameters
    ----------
    found : Derivatives
    whole : Accelerations
        At the same state, in the same velocities.
    chosen : ndarray of int (m,)
        Which of v are independent in the result, in its order.
    """
    own = found.G[chosen]
    W = np.linalg.inv(own)
    by_u = (whole.by_u[chosen] + own @ found.da_dv) @ W
    by_y = (whole.by_y[chosen] + own @ found.da_dy) @ W - by_u @ (found.dv_dy[chosen] @ W)  # u' held, not u
    slope = Slope.of(found).seen_in(chosen)
    return Derivatives(whole.a[chosen], by_y, by_u, own @ found.da_dtau, slope.G, slope.dv_dy)
