"""Derivatives of G ẏ and G ÿ + g along a mode: how the explicit map bends.

Along y_j, with u = ẏ and u̇ held, v = G u and a = G u̇ + g change by

    V_y = −K_d⁻¹ (∂φ̇/∂q G),  A_y = −K_d⁻¹ (∂φ̈/∂q G + ∂φ̈/∂v V_y),  A_u = −K_d⁻¹ (∂φ̈/∂v G)

in the dependent components, and not in the others. ∂G_i/∂y is V_y at v = G_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import NotCertifiedError
from ..mechanism.closure_rates import ClosureRates, Placement
from ..mechanism.clusters import LoopCluster
from ..mechanism.tree import Array

LOST = 1e-4
"""Conditioning of K_d below which rounding leaves the derivatives no nine digits."""


@dataclass
class MapRates:
    """How the explicit map of a cluster, or of a mechanism, bends.

    Attributes
    ----------
    G : ndarray (nv, m)
    g : ndarray (nv,)
        At u.
    bend : ndarray (m, nv, m)
        bend[i][:, j] = ∂G_i/∂y_j.
    V_y, A_y, A_u : ndarray (nv, m)
        ∂v/∂y, ∂a/∂y and ∂a/∂u; ∂v/∂u is G.
    """

    G: Array
    g: Array
    bend: Array
    V_y: Array
    A_y: Array
    A_u: Array


class ClusterRates:
    """`MapRates` of one cluster where its K is regular, for real or complex placements.

    Parameters
    ----------
    cluster : LoopCluster
    """

    def __init__(self, cluster: LoopCluster) -> None:
        self.cluster, self.rates = cluster, ClosureRates(cluster.loops)
        self.independent = cluster.chosen
        self.dependent = np.setdiff1d(np.arange(cluster.loops.nv), cluster.chosen)
        self.scale = cluster.loops.column_scale

    def at(self, place: Placement, u: Array, udot: Array) -> MapRates:
        """The map's rates at a closed placement, (m,) velocities and accelerations.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where K_d is singular.
        """
        rates, nv, m = self.rates, len(self.scale), len(self.independent)
        dependent, scale = self.dependent, self.scale[self.dependent]
        none = np.zeros(nv)
        K = rates.at(place, none, none).x_q
        Q, R = np.linalg.qr(K[:, dependent] * scale)
        size = np.abs(np.diag(R))
        if size.min(initial=1.0) < LOST * size.max(initial=1.0):
            raise NotCertifiedError(
                "derivatives: K_d is singular here, so the independent joints do not determine the motion"
            )

        def solved(rows: Array) -> Array:
            """[0; −K_d⁻¹ rows], in the least-squares sense over redundant rows."""
            found = np.zeros((nv, *rows.shape[1:]), rows.dtype)
            found[dependent] = -(scale * np.linalg.solve(R, Q.conj().T @ rows).T).T
            return found

        G = solved(K[:, self.independent])
        G[self.independent] = np.eye(m)
        v = G @ u
        g = solved(rates.at(place, v, none).dd)
        here = rates.at(place, v, G @ udot + g)
        bend = np.array([solved(rates.at(place, column, none).d_q @ G) for column in G.T])
        V_y = np.einsum("i,inj->nj", u, bend)
        A_y = solved(here.dd_q @ G + here.dd_v @ V_y)
        return MapRates(G, g, bend, V_y, A_y, solved(here.dd_v @ G))
