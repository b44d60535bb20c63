"""Beyond second order: what two modes of a cluster of mobility 1 do where they touch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from ....analysis.second_order import bending, curvature, second_order_forms
from ....mechanism.coordinates.clusters import loop_clusters
from ....mechanism.coordinates.partition import numerical_rank
from ....mechanism.loops import ClosedLoops
from ....mechanism.mechanism import Mechanism
from ....mechanism.tolerances import FORM, RANK
from ....mechanism.tree.tree import Array
from ..curve import Curve
from ..jet import LostError
from ..known_curves import turned_to
from ..options import USUAL, BridgeOptions, NoBridgeError
from ..space import ClusterSpace
from .meeting import Meeting, meeting
from .meeting_builder import mode_through
from .singular_mode import window

APART = 1e-12
"""Dimensionless distance of two modes from which a point is on one of them."""

ASTRAY = 1e-4
"""Sine of the angle from a tangent beyond which a mode is another one."""

ContactKind = Literal["singular", "cusp", "isolated", "inside", "not certified"]


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

    def words(self, rank: int) -> tuple[ContactKind, str, int]:
        """Which kind of place it is, in words too, and how many modes pass it or end there."""
        found = self.found
        if found.kind == "meets" and len(found.orders) == 1:
            k = found.order
            words = f"rank {rank} against {rank + 1} nearby: 2 modes touch here, with contact of order {k}"
            return "singular", words, 2
        if found.kind == "cusp":
            return "cusp", "the mode ends in a cusp: both its branches leave to one side", 1
        if found.kind == "isolated":
            return "isolated", f"an isolated point, of order {found.order}", 0
        if found.kind == "inside":
            return "inside", f"rank {rank} all along the mode, which lies in the singular set", 1
        words = f"modes come within {found.gap:.1g} lengths of meeting here: digits do not suffice"
        return "not certified", words, 0

    def mode(self, number: int, options: BridgeOptions) -> Curve:
        """The mode of this number through the place, 0 or 1, as the bridge that passes it.

        Raises
        ------
        NoBridgeError
        """
        if self.found.kind == "inside":
            return window(self.space, self.x, self.P, options)
        return mode_through(self.found, (1.0, -1.0)[number], self.P, options)

    def number(self, way: Array, number: int, options: BridgeOptions) -> int:
        """The number of the mode that leaves x this way, (nv,); of modes that touch, the given one.

        Raises
        ------
        NoBridgeError
            Also where no mode leaves this way.
        """
        off = []
        for curve in (self.mode(0, options), self.mode(1, options)):
            slope = curve.point(curve.u(self.x))[1]
            t = slope / np.linalg.norm(slope)
            off.append(float(np.linalg.norm(way - t * (t @ way)) / np.linalg.norm(way)))
        if min(off) > ASTRAY:
            raise NoBridgeError(f"the nearest mode leaves at an angle of {min(off):.1e}")
        return int(np.argmin(off)) if max(off) > ASTRAY else number  # modes that touch leave the same way

    def beside(self, options: BridgeOptions) -> tuple[int, Array] | None:
        """The mode that passes x beside the place, and its velocity there (nv,); None where both do.

        Raises
        ------
        NoBridgeError
        """
        if self.found.kind != "meets":
            return None
        points = []
        for number in (0, 1):
            curve = self.mode(number, options)
            x, slope, _ = curve.point(curve.u(self.x))
            points.append((float(np.abs(x - self.x).max()), number, slope))
        (near, number, slope), (far, _, _) = sorted(points, key=lambda point: point[0])
        return (number, self.space.turn(self.x) @ slope) if far > max(APART, 10.0 * near) else None

    def tangents(self, kernel: Array) -> Array:
        """The modes' tangent space in ker K of the whole mechanism, (nv, δ − 1), without the way across."""
        iv, surface = self.space.cluster.iv, self.found.curve.surface
        own = np.column_stack([surface.t, surface.v])
        across = np.linalg.lstsq(self.space.turn(self.x) @ own, kernel[iv], rcond=None)[0][1]
        return np.asarray(kernel @ scipy.linalg.null_space(across[None, :]))


class Touching:
    """The two modes that touch at a place, as bridges through it.

    Parameters
    ----------
    contact : Contact

    Raises
    ------
    NoBridgeError
    """

    def __init__(self, contact: Contact) -> None:
        self._space = contact.space
        self._curves = [contact.mode(number, USUAL) for number in (0, 1)]
        self._star = [curve.u(contact.x) for curve in self._curves]

    def number(self, q: Array) -> int | None:
        """Which of them passes through a configuration beside the place."""
        x = self._space.x(q[self._space.cluster.iq])
        found = [i for i, curve in enumerate(self._curves) if turned_to(curve, x).passes(x) is not None]
        return found[0] if len(found) == 1 else None

    def beyond(self, number: int, star: Array, way: Array, distance: float) -> Array:
        """The configuration of a mode at a distance from its place, in the sense of a velocity (nv,)."""
        space, q = self._space, star.copy()
        iq, iv = space.cluster.iq, space.cluster.iv
        curve = turned_to(self._curves[number], space.x(star[iq]))
        sense = float(np.sign(curve.C[:, 0] @ (way[iv] / space.D)))
        q[iq] = space.q(curve.point(self._star[number] + sense * distance)[0])
        return q


def contact_at(loops: ClosedLoops, q: Array, tolerance: float = RANK) -> Contact | None:
    """What the modes of the one singular cluster do at q; None where that is not decided this way.

    Singular values of K below `tolerance`, relative, count as zero. The cluster's kernel must have two
    directions, and one combination of its rows bend there: corank one.
    """
    found: list[Contact] = []
    whole = (
        loops.clusters if isinstance(loops, Mechanism) else loop_clusters(loops, (), np.empty(0, np.int64))
    )
    for cluster in whole:
        own = q[cluster.iq]
        K = cluster.loops.scaled(cluster.loops.K(own))
        U, s, Vt = np.linalg.svd(K)
        rank = numerical_rank(s, tolerance)
        kernel = cluster.loops.column_scale[:, None] * Vt[rank:].T
        if rank == len(K) or not kernel.shape[1]:
            continue
        forms = second_order_forms(cluster.loops, own, U[:, rank:], kernel)
        bent, _ = bending(forms, FORM * curvature(cluster.loops, own))
        if bent.shape[1] == 0:
            continue
        if kernel.shape[1] != 2 or bent.shape[1] != 1 or found:
            return None
        # the modes here have mobility 1, whatever the mechanism was declared with; any one component will do
        alone = cluster if cluster.m == 1 else replace(cluster, chosen=np.zeros(1, np.int64))
        space = ClusterSpace(alone, own)
        # the row that bends has rank beside the place; those that stay flat are redundant there too
        P = np.vstack([U[:, :rank].T, (U[:, rank:] @ bent[:, 0])[None, :]])
        x = space.x(own)
        try:
            found.append(Contact(space, x, P, meeting(space, x, P, np.zeros(space.nv), USUAL)))
        except (LostError, np.linalg.LinAlgError):
            return None
    return found[0] if found else None
