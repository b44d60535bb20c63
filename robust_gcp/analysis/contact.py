"""Beyond second order: what two modes of a cluster of mobility 1 do where they touch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..maps.cluster.curve import Curve
from ..maps.cluster.jet import LostError
from ..maps.cluster.meeting import Meeting, meeting
from ..maps.cluster.meeting_builder import mode_through
from ..maps.cluster.options import USUAL, BridgeOptions
from ..maps.cluster.space import ClusterSpace
from ..maps.cluster.within import window
from ..mechanism.clusters import loop_clusters
from ..mechanism.loops import ClosedLoops
from ..mechanism.mechanism import Mechanism
from ..mechanism.partition import numerical_rank
from ..mechanism.tolerances import FORM, RANK
from ..mechanism.tree import Array
from .second_order import bending, curvature, second_order_forms


@dataclass(frozen=True)
class Contact:
    """A singular cluster of mobility 1, and what its modes do.

    Attributes
    ----------
    space : ClusterSpace
    x : ndarray (nv,)
        The place, in its coordinates.
    P : ndarray (nd, rows)
        Rows of φ that determine the modes.
    found : Meeting
    """

    space: ClusterSpace
    x: Array
    P: Array
    found: Meeting

    def mode(self, number: int, options: BridgeOptions) -> Curve:
        """The mode of this number through the place, 0 or 1, as the bridge that passes it.

        Raises
        ------
        NoBridgeError
        """
        if self.found.kind == "inside":
            return window(self.space, self.x, self.P, options)
        return mode_through(self.found, (1.0, -1.0)[number], self.P, options)

    def tangents(self, kernel: Array) -> Array:
        """The modes' tangent space in ker K of the whole mechanism, (nv, δ − 1), without the way across."""
        iv, surface = self.space.cluster.iv, self.found.curve.surface
        own = np.column_stack([surface.t, surface.v])
        across = np.linalg.lstsq(self.space.turn(self.x) @ own, kernel[iv], rcond=None)[0][1]
        return np.asarray(kernel @ scipy.linalg.null_space(across[None, :]))


def contact_at(loops: ClosedLoops, q: Array) -> Contact | None:
    """What the modes of the one singular cluster do at q; None where that is not decided this way.

    The cluster's kernel must have two directions, and one combination of its rows bend there: corank one.
    """
    found: list[Contact] = []
    whole = (
        loops.clusters if isinstance(loops, Mechanism) else loop_clusters(loops, (), np.empty(0, np.int64))
    )
    for cluster in whole:
        own = q[cluster.iq]
        K = cluster.loops.scaled(cluster.loops.K(own))
        U, s, Vt = np.linalg.svd(K)
        rank = numerical_rank(s, RANK)
        kernel = cluster.loops.column_scale[:, None] * Vt[rank:].T
        if rank == len(K) or not kernel.shape[1]:
            continue
        forms = second_order_forms(cluster.loops, own, U[:, rank:], kernel)
        bent, _ = bending(forms, FORM * curvature(cluster.loops, own))
        if bent.shape[1] == 0:
            continue
        if kernel.shape[1] != 2 or bent.shape[1] != 1 or found:
            return None
        alone = cluster if cluster.m == 1 else replace(cluster, chosen=np.zeros(1, np.int64))
        space = ClusterSpace(alone, own)
        P = np.vstack([U[:, :rank].T, (U[:, rank:] @ bent[:, 0])[None, :]])
        x = space.x(own)
        try:
            found.append(Contact(space, x, P, meeting(space, x, P, np.zeros(space.nv), USUAL)))
        except (LostError, np.linalg.LinAlgError):
            return None
    return found[0] if found else None
