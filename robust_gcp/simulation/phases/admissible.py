"""Admissible velocities v = N z and accelerations a = N z + p at an instant: no choice of y enters.

On regular ground the columns of N are an orthonormal basis of ker K, and p = K⁺ k, cluster by cluster. That
spans what the map's G spans, and G's columns would be worse where y is close to turning back. At and near
a singular place ker K is larger than the mode, or close to that: there a cluster of mobility 1 takes the
tangent and the curvature of its motion; of larger ones there is no decision.

Where joints are driven, N leaves these at rest and p has their accelerations: what a drive takes does no
work in N, and is no unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from ...errors import SimulationError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .driven import Driven

NEAR = 1e-2
"""σ_min of K over σ_max below which the motion's own tangent is the better one: ker K errs by ε/δ."""

SINGULAR = 1e-6
"""The same, below which ker K is not taken at all."""

SLOW = 1e-6
"""Units per second below which a velocity has too few digits for a tangent; the acceleration has it then."""

UNMOVED = 1e-9
"""Share of the most that a row can be moved below which this mode does not move it: the rest is rounding."""


@dataclass(frozen=True)
class Seen:
    """How the mechanism moves, or moved here last.

    Attributes
    ----------
    v, a : ndarray (nv,)
        Now.
    toward : ndarray (nv,)
        Velocity when it last moved.
    """

    v: Array
    a: Array
    toward: Array

    @classmethod
    def of(cls, v: Array, a: Array, before: Seen | None = None) -> Seen:
        """Where nothing moves `toward` stays as it was."""
        if before is None or np.abs(v).max(initial=0.0) > SLOW:
            return cls(v, a, v)
        return cls(v, a, before.toward)

    def tangent(self, iv: NDArray[np.int64], units: Array) -> tuple[Array, Array] | None:
        """Unit tangent t of velocities `iv`, and their curvature: dt/ds; None where nothing tells them."""
        v, a = self.v[iv], self.a[iv]
        if np.abs(v / units).max() > SLOW:
            size = float(np.linalg.norm(v))
            t = v / size
            return t, (a - t * (t @ a)) / size**2
        for way in (a, self.toward[iv]):
            if np.abs(way / units).max() > SLOW:
                return way / np.linalg.norm(way), np.zeros(len(way))  # whose u² is nothing at rest
        return None


def admissible(
    mechanism: Mechanism, q: Array, v: Array, seen: Seen, driven: Driven | None = None
) -> tuple[Array, Array]:
    """N (nv, m) and p (nv,): what may move at q, and the acceleration that v and drives alone ask for.

    Raises
    ------
    SimulationError
        At singular places of a cluster whose motion does not tell its mode.
    """
    nv = mechanism.nv
    if driven is not None:
        return driven.restricted(*admissible(mechanism, q, v, seen))
    if not mechanism.nc:
        return np.eye(nv), np.zeros(nv)
    tree, implicit = mechanism.tree, mechanism.implicit
    tree.jacobians(q)
    K = mechanism.scaled(implicit.jacobian())
    tree.rnea(q, v, tree.zero)  # at a = 0, as `bias` reads the bodies' accelerations
    k = implicit.bias() / mechanism.row_scale
    columns, p = [mechanism.memo.once("columns of free joints", lambda: _free(mechanism))], np.zeros(nv)
    for cluster in mechanism.clusters:
        iv, rank = cluster.iv, len(cluster.iv) - cluster.m  # of K on the mode, where it meets no other
        scale = mechanism.column_scale[iv]
        U, s, Vt = np.linalg.svd(K[:, iv], full_matrices=True)
        share = float(s[rank - 1] / s[0]) if rank else 1.0
        # Nearly singular, ker K turns by ε/δ with rounding; the tangent of the motion itself does not.
        told = seen.tangent(iv, mechanism.units[iv]) if cluster.m == 1 and share < NEAR else None
        own = np.zeros((nv, cluster.m))
        if told is not None:
            tangent, curvature = told
            own[iv, 0] = tangent
            p[iv] = curvature * float(v[iv] @ v[iv])  # a = t u̇ + (dt/ds) u²
        elif share > SINGULAR:
            own[iv] = scale[:, None] * Vt[rank:].T  # K's columns are scaled: v = scale x
            p[iv] = scale * (Vt[:rank].T @ (U[:, :rank].T @ k / s[:rank]))
        elif cluster.m:
            raise SimulationError(
                f"stops, friction and locks: at a singular configuration of {', '.join(cluster.joints)}, "
                f"with {cluster.m} independent joints{'' if cluster.m > 1 else ' at rest'}, it is open "
                "what is held; start a little beside it",
                None, share=share,
            )  # fmt: skip
        columns.append(own)
    return np.hstack(columns), p


def _free(mechanism: Mechanism) -> Array:
    """Unit velocities of joints in no loop, (nv, n)."""
    inside = np.concatenate([cluster.iv for cluster in mechanism.clusters])
    return np.asarray(np.delete(np.eye(mechanism.nv), inside, axis=1))


def _triangular(L: Array, rhs: Array, transposed: int = 0) -> Array:
    """L⁻¹ rhs, or L⁻ᵀ rhs; scipy's own call takes ten times as long to check a few numbers."""
    if not rhs.size:
        return np.zeros_like(rhs)
    found, _ = dtrtrs(L, rhs, lower=1, trans=transposed)
    return np.asarray(found)


class Frame:
    """The reduced dynamics at a state in such coordinates.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : ndarray (nq,), (nv,)
    seen : Seen
    tau : ndarray (nv,), optional
        All that acts besides gravity and drives; left out where only impulses are asked for.
    driven : Driven, optional

    Attributes
    ----------
    M : ndarray (nv, nv)
    N, p
        See `admissible`.
    free : ndarray (m,)
        Lᵀ z of the unconstrained motion, with L Lᵀ = Nᵀ M N.
    """

    def __init__(
        self, mechanism: Mechanism, q: Array, v: Array, seen: Seen, tau: Array | None = None,
        driven: Driven | None = None,
    ) -> None:  # fmt: skip
        self.N, self.p = admissible(mechanism, q, v, seen, driven)
        self.M = mechanism.tree.crba(q)
        try:
            self._L = np.linalg.cholesky(self.N.T @ self.M @ self.N)
        except np.linalg.LinAlgError as error:
            raise SimulationError(
                "stops, friction and locks: a motion of the mechanism has no inertia; give its bodies some"
            ) from error
        self._scale = mechanism.column_scale if mechanism.nc else mechanism.units
        self._reach = float(np.linalg.norm(self._solve((self.N / self._scale[:, None]).T)))
        self.free: Array = np.zeros(self.N.shape[1])
        if tau is not None:
            force = tau - mechanism.tree.rnea(q, v, self.p)  # a = N z + p: p is known beforehand
            self.free = self._solve(self.N.T @ force)

    def _solve(self, rhs: Array) -> Array:
        return _triangular(self._L, rhs)

    def rows(self, E: Array) -> Array:
        """B (m, n) with W = BᵀB = E G M_r⁻¹ Gᵀ Eᵀ; a column is 0 for a row that this mode does not move."""
        B = self._solve((E @ self.N).T)
        # rounding would hold joints: on the rhombus's folded mode q1 = 0 whatever moves, and its lock is none
        B[:, self.shares(E, B) <= UNMOVED] = 0.0
        return B

    def shares(self, E: Array, B: Array) -> Array:
        """How much of the most that rows like these can be moved this mode moves them, (n,)."""
        most = self._reach * np.linalg.norm(E * self._scale, axis=1)
        return np.linalg.norm(B, axis=0) / np.where(most > 0.0, most, 1.0)

    def kick(self, impulse: Array) -> Array:
        """Change of v where Lᵀ z grows by `impulse`."""
        return np.asarray(self.N @ _triangular(self._L, impulse, 1))

    @property
    def acceleration(self) -> Array:
        """a of the unconstrained motion, (nv,)."""
        return self.p + self.kick(self.free)
