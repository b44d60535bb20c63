"""Friction of joints that slip, where it is a share of reactions that it acts on itself.

With the friction x ≥ 0 of each against the sign of its rate, n_i = n⁰_i + Σ_j n¹_ij x_j, and

    x_i = F⁰_i + μ_i r_i |n⁰_i + Σ_j n¹_ij x_j|.

Right-hand sides differ by no more than C |Δx|, C_ij = μ_i r_i |n¹_ij|. Where the spectral radius of C is
below 1 that is a contraction, with one solution; elsewhere there may be none or several (Painlevé's paradox).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...dynamics.equations import Split
from ...errors import SimulationError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .bearings import MOST, REMEDY, FrictionBounds, undetermined
from .decision import Phase
from .driven import Driven


class Sliding:
    """F of each row in a phase in which some joints slip: a function (t, q, v) -> (n,).

    Parameters
    ----------
    bounds : FrictionBounds
    mechanism : Mechanism
        Of the phase, with what it holds.
    phase : Phase
    acting : callable (t, q, v, F) -> (nv,)
        All that acts besides gravity and what is held, under bounds F.

    Raises
    ------
    SimulationError
        Where friction is not determined.
    """

    def __init__(
        self, bounds: FrictionBounds, mechanism: Mechanism, phase: Phase, acting: Callable[..., Array]
    ) -> None:
        self._bounds, self._mechanism, self._acting = bounds, mechanism, acting
        self._rows, rows = bounds.sliding(phase), bounds.rows
        self._least = rows.bounds[self._rows]
        self._against = np.array([-phase.slip[i] * rows.E[i] for i in self._rows])

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """F (n,) at a state."""
        rows, bounds, k = self._rows, self._bounds, len(self._rows)
        other = bounds.constant.copy()
        other[rows] = 0.0
        # n is affine in the friction: without any and with 1 of each tells n⁰ and n¹
        tau = self._acting(t, q, v, other) + np.vstack([np.zeros(len(v)), self._against])
        a, multipliers = moved(self._mechanism, t, q, v, tau, bounds.rows.driven(t))
        same = np.full(k + 1, t), np.tile(q, (k + 1, 1)), np.tile(v, (k + 1, 1))
        n = bounds.reactions(self._mechanism, rows, (*same, a, multipliers))
        n0, by = n[:, 0], n[:, 1:] - n[:, :1]
        share = bounds.share[rows]
        C = share[:, None] * _sizes(by)
        growth = C.sum(axis=1).max()  # no less than the spectral radius
        growth = growth if growth < 1.0 else np.abs(np.linalg.eigvals(C)).max()
        found = None if growth >= 1.0 else friction(self._least, share, n0, by)
        if found is None:
            raise SimulationError(
                f"JointFriction {', '.join(bounds.rows.names(rows))}: at t = {t:.6g} s the friction grows by "
                f"{growth:.3g} of itself through the reaction that it causes: there may be no motion, "
                f"or several (Painlevé's paradox); {REMEDY}",
                None, growth=float(growth),
            )  # fmt: skip
        other[rows] = found
        return other


def friction(least: Array, share: Array, n0: Array, by: Array) -> Array | None:
    """x (k,) with x = least + share |n0 + Σ by x|; by Newton's method, by iteration where that leads away.

    Parameters
    ----------
    n0, by : ndarray (k, 3), (k, k, 3)
    """
    along, rounding = by.transpose(0, 2, 1), 8.0 * np.finfo(float).eps
    large, reach = share * _sizes(n0), share[:, None] * _sizes(by)
    x = least + large
    n = n0 + along @ x
    for _ in range(MOST):
        size = _sizes(n)
        target = least + share * size
        wrong = x - target
        if np.all(np.abs(wrong) <= rounding * (target + large + reach @ x)):
            return np.asarray(target)
        slope = (by @ n[:, :, None])[:, :, 0] * (share / np.where(size > 0.0, size, 1.0))[:, None]
        x = x - np.linalg.solve(np.eye(len(x)) - slope, wrong)
        n = n0 + along @ x
        if np.abs(x - least - share * _sizes(n)).max() >= 0.5 * np.abs(wrong).max():
            x, n = target, n0 + along @ target
    return None


def _sizes(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def moved(
    mechanism: Mechanism, t: float, q: Array, v: Array, tau: Array, driven: Driven | None
) -> tuple[Array, Array]:
    """a (k, nv) and λ (k, nc) under each of k torques besides gravity and drives, (k, nv).

    Raises
    ------
    SimulationError
        At singular configurations.
    """
    tree, k = mechanism.tree, len(tau)
    M = tree.crba(q)
    split = Split(mechanism, q) if mechanism.nc else None
    N: Array = np.eye(len(v)) if split is None else split.free
    a0 = tree.zero if split is None else split.acceleration(mechanism.k(q, v))
    if N.shape[1] > mechanism.m:
        raise undetermined(t)
    ways, a0 = (N, a0) if driven is None else driven.restricted(N, a0)
    free = tau - tree.rnea(q, v, a0)
    further = np.linalg.solve(ways.T @ M @ ways, ways.T @ free.T).T @ ways.T
    if split is None:
        return a0 + further, np.zeros((k, 0))
    left = further @ M - free  # M a + C − τ, which Kᵀ λ balances
    if driven is not None:
        for part in left:
            part[driven.iv] -= driven.effort(N, part)
    return a0 + further, np.array([split.multipliers(part) for part in left])
