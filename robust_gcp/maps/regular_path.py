"""The regular path: from a prediction to q = γ(y), G and g, where K_d can be solved.

This one object does all the work of a right-hand side as long as nothing rare happens. It knows
nothing of singularities beyond reporting how well K_d is conditioned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..mechanism.constraint.constraint import ImplicitConstraint
from ..mechanism.coordinates.partition import Block
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array, Tree
from .blocks import BlockFactor
from .explicit import Counters, Point
from .structure import reference_of_whole, structured
from .weld_points import tree_at_points

CONVERGED = 2e-15
"""max |φ| / length at which Newton stops: the rounding of a short chain of joints."""

STAGNANT = 1e-12
"""max |φ| / length accepted when Newton stops making progress: rounding of long chains."""

NONE = np.ones(0)
"""Of the blocks of a tree."""

MAX_NEWTON = 12
"""Newton iterations before a start counts as lost; from a good prediction two or three suffice."""


class Closed(NamedTuple):
    """A configuration that closes the selected rows, at which the tree's workspace is.

    Attributes
    ----------
    q : ndarray (nq,)
    K : ndarray (nd, nv)
        Dimensionless.
    correction : float
        Length of Newton's first step, dimensionless.
    """

    q: Array
    K: Array
    correction: float = 0.0


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
        self.counters = counters or Counters()
        self.rows = rows
        self.dependent, self.independent = mechanism.iv_dependent, mechanism.iv_independent
        self.iq, self.numbers = mechanism.iq_numbers, mechanism.numbers
        self.m, self.nd = mechanism.m, len(self.dependent)
        self._scale, self._tree_G = np.ones(mechanism.nv), np.zeros((mechanism.nv, self.m))
        self._column_scale = self._scale[self.dependent] = mechanism.column_scale[self.dependent]
        self._tree_G[self.independent] = np.eye(self.m)  # y may be in another order than v
        once, dependent, key = mechanism.memo.once, self.dependent, tuple(rows.tolist())
        self.points, self.tree = once(("points", key), lambda: tree_at_points(mechanism, rows, dependent))
        self.implicit = once(("selected rows of φ", key), lambda: self._selected(self.tree))
        self.factor: BlockFactor = once(("structure of K_d", key), self._structured).fresh()

    def __deepcopy__(self, memo: object) -> RegularPath:
        """Itself: it holds nothing of a motion, and views that must not be copied."""
        return self

    def _selected(self, tree: Tree) -> ImplicitConstraint:
        """The selected rows of the constraint, which keeps no state, dimensionless."""
        mechanism, rows = self.mechanism, self.rows
        chosen = mechanism.implicit.rows[rows]
        return ImplicitConstraint(tree, mechanism.closures, chosen, mechanism.row_scale[rows], self._scale)

    def _structured(self) -> BlockFactor:
        """The factorisation of K_d with its structure, found once for each mechanism and choice of rows."""
        mechanism = self.mechanism
        if self.nd == 0:
            return BlockFactor([], np.zeros((0, 0), dtype=bool), self.dependent)
        configurations = mechanism.generic_configurations()

        def found(tree: Tree, implicit: ImplicitConstraint) -> BlockFactor:
            def jacobian(q: Array) -> Array:
                tree.jacobians(q)
                return implicit.jacobian()

            return structured(jacobian, configurations, self.dependent)

        factor = found(self.tree, self.implicit)
        if self.points.any():
            whole = found(mechanism.tree, self._selected(mechanism.tree))
            factor.reference = reference_of_whole(factor, whole)
        return factor

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
        if anchor.curvature is not None:  # m = 1: γ'' serves any speed, also at rest
            move = float(delta[0])
            dv += (0.5 * move * move) * anchor.curvature
        elif self.m:
            speed = float(anchor.ydot @ anchor.ydot)  # at rest g is zero and tells nothing
            if speed > 0.0:
                along = float(delta @ anchor.ydot) / speed
                dv += (0.5 * along * along) * anchor.g
        return self.tree.integrate(anchor.q, dv), dv

    def size(self, dv: Array) -> float:
        """Largest entry of a step dv, dimensionless."""
        return float(np.abs(dv * (1.0 / self.mechanism.column_scale)).max(initial=0.0))

    def turn(self, dv: Array) -> float:
        """Largest rotation in a step dv, rad, or slide in characteristic lengths."""
        return float(np.abs(dv * (1.0 / self.mechanism.units)).max(initial=0.0))

    def closed_at(self, q: Array) -> Closed:
        """A configuration that is closed already, placed and with K there, for `derivatives`."""
        return Closed(q, self._constraint(q)[1] if self.nd else np.zeros((0, self.tree.nv)))

    def close(self, q: Array, contracting: bool = True, origin: Array | None = None) -> Closed | None:
        """Newton on the dependent joints from q (overwritten).

        Parameters
        ----------
        contracting : bool
            Give up as soon as a step is not half of the one before: from a good prediction it is.
        origin : ndarray, optional
            Of the chart that y is kept in; see `Point`.

        Returns
        -------
        Closed or None
            None when the iteration does not contract to φ = 0.
        """
        if self.nd == 0:
            return self.closed_at(q)
        correction = 0.0
        last_size = last_step = np.inf
        for iteration in range(MAX_NEWTON):
            phi, K = self._constraint(q)
            size = float(np.abs(phi).max())
            # of long chains φ rounds more: it is closed where Newton gains nothing any more
            if size <= CONVERGED or (size <= STAGNANT and size >= 0.25 * last_size):
                return Closed(q, K, correction)
            if not np.isfinite(size):
                return None
            self.factor.factor(self._turned(q, K, origin))
            u = self.factor.solve(phi)
            step = float(np.abs(u).max())
            if iteration == 0:
                correction = step
            elif contracting and not step <= 0.5 * last_step and size > STAGNANT:
                return None
            last_size, last_step = size, step
            q = self._move(q, -u * self._column_scale, origin)
            self.counters.newton_iterations += 1
        return None

    def derivatives(self, closed: Closed, y: Array, ydot: Array) -> Point:
        """G = [I; −K_d⁻¹ K_i] and g = [0; K_d⁻¹ k] at a configuration that was closed just now.

        K_d is factorised once.
        """
        q, K, correction = closed
        if self.nd == 0:
            return Point(y, ydot, q, self._tree_G, self.tree.zero, None, NONE, NONE)
        tree, factor, dependent = self.tree, self.factor, self.dependent
        factor.factor(K)
        G = self._tree_G.copy()
        g = np.zeros(tree.nv)
        curvature = None
        if self.m == 1:
            G[dependent, 0] = self._column_scale * -factor.solve(K[:, self.independent[0]])
            curvature = np.zeros(tree.nv)
            curvature[dependent] = self._bias(q, G[:, 0])  # at ẏ = 1: serves every speed, and the prediction
            g = curvature * float(ydot[0]) ** 2
        elif self.m:
            G[dependent] = self._column_scale[:, None] * -factor.solve(K[:, self.independent])
            g[dependent] = self._bias(q, G @ ydot)
        return Point(y, ydot, q, G, g, curvature, factor.det, factor.rcond, factor.worst, correction)

    def conditioning(self, q: Array) -> tuple[Array, Array]:
        """Determinants and conditioning of K_d's blocks at any q."""
        self.factor.factor(self._constraint(q)[1])
        return self.factor.det, self.factor.rcond

    def worst_conditioning(self, q: Array) -> float:
        """Smallest conditioning of all blocks at any q."""
        return float(self.conditioning(q)[1].min(initial=1.0))

    def step(self, anchor: Point, y: Array, ydot: Array) -> Point | None:
        """The point at y reached from the anchor in one predicted step, or None when Newton is lost."""
        if self.nd == 0:  # a tree: q is y
            place: Array = np.empty(self.tree.nq)
            place[self.iq] = y
            return self.derivatives(self.closed_at(place), y, ydot)
        # with the curvature the prediction errs by the third order, and modes beside it part at the first
        q, dv = self.predict(anchor, y)
        point = self.settle(q, y, ydot, origin=anchor.origin)
        if point is not None and point.correction > 0.0:  # else q was closed already: nothing was predicted
            point.distance, point.turn = self.size(dv), self.turn(dv)
        return point

    def settle(
        self, q: Array, y: Array, ydot: Array, contracting: bool = True, origin: Array | None = None
    ) -> Point | None:
        """The point at y that Newton finds from the guess q (overwritten), or None when it is lost.

        `origin` is that of the chart that y is in; see `Point`.
        """
        q[self.iq] = y
        closed = self.close(q, contracting)
        return None if closed is None else self.derivatives(closed, y, ydot)

    def rate(self, point: Point) -> Array:
        """ẏ at a point, which differs from its independent velocities in charts alone."""
        return point.ydot

    def renewed(self, point: Point) -> Point:
        """The same point as the origin of a new chart; itself where y are numbers in q."""
        return point

    def away(self, point: Point) -> float:
        """Largest entry of w at a point, rad or m: how far it is from the origin of its chart."""
        return 0.0

    def y_of(self, point: Point, q: Array) -> Array:
        """y of another configuration in the chart of a point."""
        return q[self.iq]

    def _turned(self, q: Array, K: Array, origin: Array | None) -> Array:
        """K by what Newton moves: the joints' velocities."""
        return K

    def _constraint(self, q: Array) -> tuple[Array, Array]:
        """φ and K of the selected rows, dimensionless; K is a new array."""
        self.counters.constraint_evaluations += 1
        self.tree.jacobians(q)
        return self.implicit.residual(), self.implicit.jacobian()

    def _bias(self, q: Array, v: Array) -> Array:
        self.tree.rnea(q, v, self.tree.zero)  # bodies' accelerations at v̇ = 0: what k is
        return self._column_scale * self.factor.solve(self.implicit.bias())

    def _move(self, q: Array, dv_dependent: Array, origin: Array | None) -> Array:
        if self.tree.vector_space:
            q[self.dependent] += dv_dependent
            return q
        dv = np.zeros(self.tree.nv)
        dv[self.dependent] = dv_dependent
        return self.tree.integrate(q, dv)
