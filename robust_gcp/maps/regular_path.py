"""The regular path: from a prediction to q = γ(y), G and g, where K_d can be solved.

This one object does all the work of a right-hand side as long as nothing rare happens. It knows
nothing of singularities beyond reporting how well K_d is conditioned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..mechanism.constraint import ImplicitConstraint
from ..mechanism.loops import STRUCTURAL
from ..mechanism.mechanism import Mechanism
from ..mechanism.partition import Block, triangular_blocks
from ..mechanism.tree import Array
from .blocks import BlockFactor

CONVERGED = 2e-15
"""max |φ| / length at which Newton stops: the rounding of a short chain of joints."""

STAGNANT = 1e-12
"""max |φ| / length accepted when Newton stops making progress: rounding of long chains."""

MAX_NEWTON = 12
"""Newton iterations before a start counts as lost; from a good prediction two or three suffice."""


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


_structures: WeakKeyDictionary[
    Mechanism, dict[tuple[int, ...], tuple[Sequence[Block], NDArray[np.bool_], Array]]
] = WeakKeyDictionary()


class RegularPath:
    """Newton's method on φ(γ(y)) = 0 from a prediction, then (4): G and g with K_d factorised once.

    Parameters
    ----------
    mechanism : Mechanism
    rows : ndarray of int
        The rows of φ that determine the dependent velocities (`Mechanism.select_rows`).
    counters : Counters
        Incremented as work is done.
    """

    def __init__(
        self, mechanism: Mechanism, rows: NDArray[np.int64], counters: Counters | None = None
    ) -> None:
        self.mechanism = mechanism
        self.tree = mechanism.tree
        self.counters = counters or Counters()
        self.rows = rows
        self.dependent = mechanism.iv_dependent
        self.independent = mechanism.iv_independent
        self.iq = mechanism.iq_independent
        self.m, self.nd = mechanism.m, len(self.dependent)
        self._column_scale = mechanism.column_scale[self.dependent]
        scale = np.ones(mechanism.nv)
        scale[self.dependent] = self._column_scale
        self.implicit = ImplicitConstraint(
            self.tree,
            mechanism.closures,
            mechanism.implicit.rows[rows],
            mechanism.row_scale[rows],
            scale,
        )
        self._length_scale = 1.0 / mechanism.column_scale
        self._turn_scale = 1.0 / mechanism.units
        self._eye = np.eye(self.m)
        self._tree_G = np.zeros((mechanism.nv, self.m))  # G of a tree: y may be in another order than v
        self._tree_G[self.independent] = self._eye
        self._none = np.ones(0)
        self.factor = self._factor()

    def _factor(self) -> BlockFactor:
        """The factorisation of K_d; its structure is found once for each mechanism and choice of rows."""
        if self.nd == 0:
            return BlockFactor([], np.zeros((0, 0), dtype=bool), self.dependent, self.tree.nv)
        known = _structures.setdefault(self.mechanism, {})
        key = tuple(self.rows.tolist())
        if key not in known:
            known[key] = self._structure()
        blocks, pattern, reference = known[key]
        factor = BlockFactor(blocks, pattern, self.dependent, self.tree.nv)
        factor.reference = reference
        return factor

    def _structure(self) -> tuple[Sequence[Block], NDArray[np.bool_], Array]:
        """Blocks and pattern of K_d, and the conditioning of large blocks at generic configurations."""
        pattern = np.zeros((self.nd, self.nd), dtype=bool)
        for q in self.mechanism.generic_configurations():
            self._evaluate(q)
            pattern |= np.abs(self._K[:, self.dependent]) > STRUCTURAL
        blocks = triangular_blocks(pattern)
        if blocks is None:
            blocks = [Block(np.arange(self.nd), np.arange(self.nd))]
        factor = BlockFactor(blocks, pattern, self.dependent, self.tree.nv)
        seen = []
        for q in self.mechanism.generic_configurations():
            self._evaluate(q)
            factor.factor(self._K)
            seen.append(factor.rcond)
        large = np.array([len(block.rows) > 2 for block in blocks])
        return blocks, pattern, np.where(large, np.maximum(np.max(seen, axis=0), 1e-6), 1.0)

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The diagonal blocks of K_d, in the order of substitution."""
        return self.factor.blocks

    def predict(self, anchor: Point, y: Array) -> tuple[Array, Array]:
        """q_a ⊕ dv and dv = G Δy + ½ γ''[Δy, Δy].

        For m > 1 the curvature is known along the anchor's ẏ, which is where a simulation goes.
        """
        delta = y - anchor.y
        dv = anchor.G @ delta
        if anchor.curvature is not None:
            move = float(delta[0])
            dv += (0.5 * move * move) * anchor.curvature
        elif self.m:
            speed = float(anchor.ydot @ anchor.ydot)
            if speed > 0.0:
                along = float(delta @ anchor.ydot) / speed
                dv += (0.5 * along * along) * anchor.g
        return self.tree.integrate(anchor.q, dv), dv

    def size(self, dv: Array) -> float:
        """Largest entry of a step dv, dimensionless."""
        return float(np.abs(dv * self._length_scale).max(initial=0.0))

    def turn(self, dv: Array) -> float:
        """Largest rotation in a step dv, rad, or slide in characteristic lengths."""
        return float(np.abs(dv * self._turn_scale).max(initial=0.0))

    def close(self, q: Array, contracting: bool = True) -> tuple[Array, float] | None:
        """Newton on the dependent joints from q (overwritten).

        Parameters
        ----------
        contracting : bool
            Give up as soon as a step is not half of the one before: from a good prediction it is.

        Returns
        -------
        (q, correction) or None
            None when the iteration does not contract to φ = 0.
        """
        correction = 0.0
        if self.nd == 0:
            return q, correction
        last_size = last_step = np.inf
        for iteration in range(MAX_NEWTON):
            phi = self._evaluate(q)
            size = float(np.abs(phi).max())
            if size <= CONVERGED or (size <= STAGNANT and size >= 0.25 * last_size):
                return q, correction
            if not np.isfinite(size):
                return None
            self.factor.factor(self._K)
            u = self.factor.solve(phi)
            step = float(np.abs(u).max())
            if iteration == 0:
                correction = step
            elif contracting and not step <= 0.5 * last_step and size > STAGNANT:
                return None
            last_size, last_step = size, step
            q = self._move(q, -u * self._column_scale)
            self.counters.newton_iterations += 1
        return None

    def derivatives(self, q: Array, y: Array, ydot: Array) -> Point:
        """G = [I; −K_d⁻¹ K_i] and g = [0; K_d⁻¹ k] at a closed q where `close` has just ended."""
        if self.nd == 0:
            return Point(y, ydot, q, self._tree_G, self.tree.zero, None, self._none, self._none)
        tree, factor, dependent = self.tree, self.factor, self.dependent
        K = self._K
        factor.factor(K)
        G = np.zeros((tree.nv, self.m))
        G[self.independent] = self._eye
        g = np.zeros(tree.nv)
        curvature = None
        if self.m == 1:
            G[dependent, 0] = self._column_scale * -factor.solve(K[:, self.independent[0]])
            curvature = np.zeros(tree.nv)
            curvature[dependent] = self._bias(q, G[:, 0])
            g = curvature * float(ydot[0]) ** 2
        elif self.m:
            G[dependent] = self._column_scale[:, None] * -factor.solve(K[:, self.independent])
            g[dependent] = self._bias(q, G @ ydot)
        return Point(y, ydot, q, G, g, curvature, factor.det, factor.rcond, factor.worst)

    def second_derivative(self, point: Point, direction: Array) -> Array:
        """γ''[d, d] at a point for a direction d (m,): g at ẏ = d."""
        self._evaluate(point.q)
        self.factor.factor(self._K)
        g = np.zeros(self.tree.nv)
        g[self.dependent] = self._bias(point.q, point.G @ direction)
        return g

    def conditioning(self, q: Array) -> tuple[Array, Array]:
        """Determinants and conditioning of K_d's blocks at any q."""
        self._evaluate(q)
        self.factor.factor(self._K)
        return self.factor.det, self.factor.rcond

    def worst_conditioning(self, q: Array) -> float:
        """Smallest conditioning of all blocks at any q."""
        return float(self.conditioning(q)[1].min(initial=1.0))

    def step(self, anchor: Point, y: Array, ydot: Array) -> Point | None:
        """The point at y reached from the anchor in one predicted step, or None when Newton is lost."""
        if self.nd == 0:  # a tree: q is y
            place: Array = np.empty(self.tree.nq)
            place[self.iq] = y
            return self.derivatives(place, y, ydot)
        q, dv = self.predict(anchor, y)
        point = self.settle(q, y, ydot)
        if point is not None and point.correction > 0.0:
            point.distance, point.turn = self.size(dv), self.turn(dv)
        return point

    def settle(self, q: Array, y: Array, ydot: Array, contracting: bool = True) -> Point | None:
        """The point at y that Newton finds from the guess q (overwritten), or None when it is lost."""
        q[self.iq] = y
        closed = self.close(q, contracting)
        if closed is None:
            return None
        point = self.derivatives(closed[0], y, ydot)
        point.correction = closed[1]
        return point

    def _evaluate(self, q: Array) -> Array:
        self.counters.constraint_evaluations += 1
        self.tree.jacobians(q)
        phi = self.implicit.residual()
        self._K = self.implicit.jacobian()
        return phi

    def _bias(self, q: Array, v: Array) -> Array:
        self.tree.rnea(q, v, self.tree.zero)
        return self._column_scale * self.factor.solve(self.implicit.bias())

    def _move(self, q: Array, dv_dependent: Array) -> Array:
        if self.tree.vector_space:
            q[self.dependent] += dv_dependent
            return q
        dv = np.zeros(self.tree.nv)
        dv[self.dependent] = dv_dependent
        return self.tree.integrate(q, dv)
