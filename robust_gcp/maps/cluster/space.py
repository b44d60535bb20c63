"""A cluster in dimensionless joint coordinates x: φ, K and φ'' there."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...mechanism.constraint.constraint import ImplicitConstraint
from ...mechanism.coordinates.clusters import LoopCluster
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array

if TYPE_CHECKING:
    from .curve import Curve
    from .known_curves import NearMiss
    from .options import BridgeOptions
    from .touching.meeting import Meeting

WIDEST = 10.0
"""Largest unit of a joint, in radians or characteristic lengths: K changes with the angle of any joint."""

RATE_STEP = 1e-2
"""Step of the eighth-order difference of the exponential map's rate: it errs by rounding."""

_WEIGHTS = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


class Svd(NamedTuple):
    """K · balance = U S Vᵀ in full."""

    U: Array
    s: Array
    Vt: Array


class ClusterSpace:
    """Dimensionless coordinates of a cluster: q = q_ref ⊕ D x, with φ, K and φ'' by x.

    Where all joints have one number each, q_ref = 0 and x = q / D. Else x are exponential coordinates at the
    reference, which serve up to half a turn of a spherical joint from there.

    Parameters
    ----------
    cluster : LoopCluster
    reference : ndarray (nq,)
        Of the cluster's own q; used where a joint has more than one number.

    Attributes
    ----------
    nv, nd, m, rows : int
        Velocities, dependent velocities, mobility, rows of φ.
    D : ndarray (nv,)
        Joints' units: `ClosedLoops.column_scale`, but no more than `WIDEST`. A link that is much shorter than
        others hardly moves them, and yet its own pose, on which K depends, changes with its angle.
    balance : ndarray (nv,)
        column_scale / D, 1 but for very short links: K · balance has columns of size one.
    met : tuple of (BridgeOptions, Meeting)
        The last meetings of modes that were found, and cusps, and what they were judged by.
    bridged : tuple of (BridgeOptions, Curve)
        The last curves that were built through places where modes touch.
    near_misses : list of NearMiss
        The last places that modes pass without a bridge, whatever joints are independent.
    """

    def __init__(self, cluster: LoopCluster, reference: Array) -> None:
        self.cluster, self.loops = cluster, cluster.loops
        self.tree = cluster.loops.tree
        self.flat = self.tree.vector_space
        self.reference = np.zeros(self.tree.nq) if self.flat else reference.copy()
        self.nv, self.m = self.tree.nv, cluster.m
        self.nd = self.nv - self.m  # not rank K, which is less at singular places
        self.rows = self.loops.nc
        self.D = np.minimum(self.loops.column_scale, WIDEST * self.loops.units)
        self.balance = self.loops.column_scale / self.D
        self.met: tuple[tuple[BridgeOptions, Meeting], ...] = ()
        self.bridged: tuple[tuple[BridgeOptions, Curve], ...] = ()
        # where q_ref = 0, x are the same in all choices of coordinates
        self.near_misses: list[NearMiss] = self.loops.memo.once("near misses", list) if self.flat else []
        self.implicit = self.loops.memo.once("dimensionless constraint", self._scaled)
        self.phi_size = self.loops.memo.once("size of the second derivative", self._curvature)

    def __deepcopy__(self, memo: object) -> ClusterSpace:
        """Itself: it holds nothing of a motion, and views that must not be copied."""
        return self

    def _scaled(self) -> ImplicitConstraint:
        loops = self.loops
        rows, scale = loops.implicit.rows, loops.row_scale
        return ImplicitConstraint(self.tree, loops.closures, rows, scale, self.D)

    def _curvature(self) -> float:
        """Largest entry of φ'', balanced, at generic configurations: what forms are compared with."""
        sizes = [0.0]
        for q in self.loops.generic_configurations()[:2]:  # elsewhere φ'' may be small by chance
            rates = [self._rate(q, self.D * e) * self.balance for e in np.eye(self.nv)]
            sizes += [float(np.abs(rate).max(initial=0.0)) for rate in rates]
        return max(sizes) or 1.0

    # ----------------------------------------------------------------- coordinates

    def q(self, x: Array) -> Array:
        """The cluster's configuration, (nq,)."""
        return self.D * x if self.flat else self.tree.integrate(self.reference, self.D * x)

    def x(self, q: Array) -> Array:
        """Coordinates of a configuration of the cluster, (nv,)."""
        return q / self.D if self.flat else self.tree.difference(self.reference, q) / self.D

    def chart(self, chosen: NDArray[np.int64]) -> Array:
        """C (nv, m) that picks these components."""
        C = np.zeros((self.nv, len(chosen)))
        C[chosen, np.arange(len(chosen))] = 1.0
        return C

    def turn(self, x: Array) -> Array:
        """T D with v = T D ẋ, (nv, nv)."""
        if self.flat:
            return np.diag(self.D)
        return self.tree.integrate_rate(self.reference, self.D * x) * self.D

    def turn_rate(self, x: Array, a: Array) -> Array:
        """d(T D)/ds along x + s a, (nv, nv), by an eighth-order difference of Pinocchio's dIntegrate."""
        if self.flat:
            return np.zeros((self.nv, self.nv))
        steps = RATE_STEP * np.arange(-4, 5)
        values = np.array([self.turn(x + s * a) for s in steps])
        return np.asarray(np.tensordot(_WEIGHTS, values, 1) / RATE_STEP)

    # ----------------------------------------------------------------- the constraint

    def phi(self, x: Array) -> Array:
        """φ, dimensionless, (rows,)."""
        self.tree.jacobians(self.q(x))
        return self.implicit.residual()

    def linear(self, x: Array) -> tuple[Array, Array]:
        """φ (rows,) and K = ∂φ/∂x (rows, nv)."""
        phi = self.phi(x)
        K = self.implicit.jacobian()
        return phi, K if self.flat else K @ (self.turn(x) / self.D[:, None])

    def K(self, x: Array) -> Array:
        """∂φ/∂x, (rows, nv)."""
        return self.linear(x)[1]

    def second(self, x: Array, a: Array) -> Array:
        """φ''[a, ·] = dK/ds along x + s a, (rows, nv)."""
        if self.flat:
            return self._rate(self.D * x, self.D * a)
        turn = self.turn(x)
        rate = self._rate(self.q(x), turn @ a) @ (turn / self.D[:, None])
        self.phi(x)  # places the tree at x again, which `_rate` did with a velocity
        return rate + self.implicit.jacobian() @ (self.turn_rate(x, a) / self.D[:, None])

    def residual(self, x: Array) -> float:
        """max |φ| over all rows, in lengths and radians."""
        return float(np.abs(self.phi(x)).max(initial=0.0))

    def noise(self, x: Array) -> float:
        """What rounding leaves of φ at best: some units in the last place of the joints' positions."""
        return 4e-16 * (self.nv + float(np.abs(self.D * x * self.loops.tree.rotates).max(initial=0.0)))

    def _rate(self, q: Array, v: Array) -> Array:
        self.tree.jacobian_rates(q, v)
        # both are asked for what they leave behind: frames and rows at q, which the rate takes up
        self.implicit.residual()
        self.implicit.jacobian()
        return self.implicit.jacobian_rate(v)

    def factors(self, x: Array) -> Svd:
        """U, s and Vᵀ of K · balance."""
        return Svd(*np.linalg.svd(self.K(x) * self.balance))


def space_of(mechanism: Mechanism, cluster: LoopCluster, q: Array) -> ClusterSpace:
    """The space of a cluster at its configuration q, made once where it does not depend on q."""
    if not cluster.loops.tree.vector_space:
        return ClusterSpace(cluster, q)
    space: ClusterSpace = mechanism.memo.once(("space", cluster.index), lambda: ClusterSpace(cluster, q))
    return space
