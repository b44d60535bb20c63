"""What an evaluation of an explicit map gives, and what was computed for it."""

from __future__ import annotations

from dataclasses import dataclass

from ..mechanism.tree import Array


@dataclass(slots=True)
class Point:
    """A configuration on the constraint, and the explicit map's derivatives there.

    Attributes
    ----------
    y, ydot : ndarray (m,)
    q : ndarray (nq,)
    G : ndarray (nv, m)
        ∂γ/∂y: v = G ẏ.
    g : ndarray (nv,)
        Ġ ẏ: a = G ÿ + g.
    curvature : ndarray (nv,) or None
        γ'' for m = 1 (g at ẏ = 1); None for other m.
    det, rcond : ndarray (nblocks,)
        Sign and conditioning of K_d's blocks; see `BlockFactor`.
    conditioning : float
        Smallest rcond of all blocks; 1 where nothing is dependent.
    correction : float
        Length of Newton's first step, dimensionless: how wrong the prediction was.
    distance : float
        Length of the predicted step, dimensionless.
    turn : float
        Largest rotation in the predicted step, rad, or slide in characteristic lengths.
    origin : ndarray or None
        Where y holds w of joints in a chart, q = origin ⊕ w: their numbers in q at w = 0. Their ẏ are
        velocities in their own axes, u, and ẇ is `ExplicitMap.rate`.
    """

    y: Array
    ydot: Array
    q: Array
    G: Array
    g: Array
    curvature: Array | None
    det: Array
    rcond: Array
    conditioning: float = 1.0
    correction: float = 0.0
    distance: float = 0.0
    turn: float = 0.0
    origin: Array | None = None


@dataclass(slots=True)
class Counters:
    """What was computed, for `Trajectory.stats`."""

    constraint_evaluations: int = 0
    newton_iterations: int = 0
    force_evaluations: int = 0
    second_order: int = 0
    marching_steps: int = 0
    zone_evaluations: int = 0
    bridges_built: int = 0
    svds: int = 0
    refined_steps: int = 0
    native_steps: int = 0


@dataclass(frozen=True, slots=True)
class Closed:
    """A configuration that closes the selected rows, as the tree's workspace holds it.

    Attributes
    ----------
    q : ndarray (nq,)
    K : ndarray (nd, nv)
        Dimensionless.
    correction : float
        Length of Newton's first step, dimensionless.
    placed : int
        `Tree.placed` when it was evaluated: another number there means that the workspace has moved on.
    """

    q: Array
    K: Array
    correction: float
    placed: int
