"""Derivatives taken in some independent velocities u, transformed to others u' of the same motion.

Where u' = v[C] of v = G u, C the rows of the others, W = (G[C])⁻¹, and η moves along G e_j:

    δη = W δη',   δu = W (δu' − V_y[C] δη),   δa = (A_y + G ∂u̇/∂y) δη + (A_u + G ∂u̇/∂u) δu + G ∂u̇/∂τ δτ,

with V_y = ∂v/∂y, and A_y and A_u those of a at u̇ held. The rows C of δa are the derivatives of u̇'. So
derivatives exist wherever u' parametrises the motion, however near K_d of u' is to singular.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mechanism.tree import Array
from .derivatives import Accelerations, Derivatives


def transformed(found: Derivatives, whole: Accelerations, chosen: NDArray[np.int64]) -> Derivatives:
    """Derivatives by the velocities `chosen` (m,) of v and their positions.

    Parameters
    ----------
    found : Derivatives
    whole : Accelerations
        At the same state, in the same velocities.
    chosen : ndarray of int (m,)
        Which of v are independent in the result, in its order.
    """
    G, own = found.G, found.G[chosen]
    W = np.linalg.inv(own)
    by_u = (whole.by_u[chosen] + own @ found.da_dv) @ W
    held = found.dv_dy[chosen] @ W
    by_y = (whole.by_y[chosen] + own @ found.da_dy) @ W - by_u @ held
    to_u = G @ W
    return Derivatives(whole.a[chosen], by_y, by_u, own @ found.da_dtau, to_u, found.dv_dy @ W - to_u @ held)


def change(found: Derivatives, chosen: NDArray[np.int64]) -> Array:
    """δ(η', u') by δ(η, u), (2m, 2m), at a state: [[G[C], 0], [V_y[C], G[C]]]."""
    own = found.G[chosen]
    return np.block([[own, np.zeros_like(own)], [found.dv_dy[chosen], own]])
