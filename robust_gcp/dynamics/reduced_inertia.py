"""The reduced inertia Gᵀ M G: solved, or refused where rounding has eaten it."""

from __future__ import annotations

import numpy as np
import scipy

from ..errors import SimulationError
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array

LOST = 1e-13
"""Gᵀ M G of one coordinate, relative to the inertia that the joints' motions have one by one, at which
rounding has eaten it: where heavy links rest, G says so to 1e-16 only, and their weight times that is
then a thousandth of what moves the light ones."""

CANCELLED = 1e-6
"""Gᵀ M G of one coordinate, relative to the size of the products in it, below which they have lost as many
digits; the bodies' sum has not. Where no loop ties the joints, G puts them in order and nothing cancels."""

TAKES_PART = 1e-3
"""Share of a lost motion from which a joint is named."""

DEFINITE = 1e-11
"""Smallest squared pivot of Gᵀ M G with a unit diagonal: below, ÿ has fewer than five digits left."""


class ReducedInertia:
    """ÿ = (Gᵀ M G)⁻¹ f with Gᵀ M G taken from the velocities of the bodies where products cancel.

    Parameters
    ----------
    mechanism : Mechanism
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism, self._tree = mechanism, mechanism.tree
        self._scale, self._own, self._suspect = mechanism.memo.once("sizes of inertia", self._sizes)

    def _sizes(self) -> tuple[Array, float, float]:
        scale, own = 1.0 / self._mechanism.column_scale, self._mechanism.joint_inertia
        return scale, own, LOST * own * float(np.max(scale, initial=0.0)) ** 2

    def solve(self, q: Array, G: Array, force: Array) -> Array:
        """ÿ for Gᵀ (τ − C − M g) = force, (m,) or several side by side, (m, k).

        Raises
        ------
        SimulationError
            Where a motion of the independent joints moves no mass, or so little of it that Gᵀ M G is
            rounding.
        """
        if G.shape[1] == 1:
            direction = G[:, 0]
            # body by body, all terms positive: Gᵀ (M G) cancels where heavy links rest on joints that move
            single = 2.0 * self._tree.kinetic(q, direction)
            # a bound that costs one product decides nearly always; NaN goes on to the stepper's own check
            if single <= self._suspect * direction.dot(direction) and single <= LOST * self._alone(direction):
                raise self._singular(np.ones(1))
            return force / single
        inertia = self._matrix(q, G)
        diagonal = inertia.diagonal()
        lost = [a <= LOST * self._alone(column) for a, column in zip(diagonal, G.T, strict=True)]
        if any(lost):
            raise self._singular(np.array(lost, dtype=float))
        size = 1.0 / np.sqrt(diagonal)  # pivots are judged whatever the masses are
        factor, info = scipy.linalg.lapack.dpotrf(inertia * size[:, None] * size, lower=1)
        if info > 0 or factor.diagonal().min(initial=1.0) ** 2 <= DEFINITE:
            raise self._singular(np.linalg.eigh(inertia * size[:, None] * size)[1][:, 0])
        found: Array = scipy.linalg.lapack.dpotrs(factor, (size * force.T).T, lower=1)[0]
        ydd: Array = (size * found.T).T
        return ydd

    def _matrix(self, q: Array, G: Array) -> Array:
        """Gᵀ M G, (m, m); by polarisation of the kinetic energy where the products cancel."""
        M = self._tree.crba(q)
        inertia: Array = G.T @ (M @ G)
        # |Σ g_i M_ik g_k| ≤ (Σ √M_ii |g_i|)², as M is positive
        products = (np.sqrt(np.maximum(M.diagonal(), 0.0)) @ np.abs(G)) ** 2
        if np.all(inertia.diagonal() > CANCELLED * products):
            return inertia
        twice = [2.0 * self._tree.kinetic(q, column) for column in G.T]
        for i, a in enumerate(twice):
            inertia[i, i] = a
            for j in range(i):
                # scaled to the same size, so that neither drowns in the other
                pace = np.sqrt(a / twice[j]) if a > 0.0 and twice[j] > 0.0 else 1.0
                both = 2.0 * self._tree.kinetic(q, G[:, i] + pace * G[:, j])
                inertia[i, j] = inertia[j, i] = 0.5 * (both - a - pace * pace * twice[j]) / pace
        return inertia

    def _alone(self, direction: Array) -> float:
        """What the joints' motions would have as inertia one by one, kg m² or kg."""
        pace = float(np.abs(direction * self._scale).max())
        return self._own * pace * pace

    def _singular(self, motion: Array) -> SimulationError:
        """The error for a lost motion (m,) of the independent joints, which names those that take part."""
        names = self._mechanism.independent
        if len(names) == len(motion):
            part = np.abs(motion) >= TAKES_PART * np.abs(motion).max()
            names = tuple(name for name, moves in zip(names, part, strict=True) if moves)
        whose = f" of {self._mechanism.name!r}" if self._mechanism.name else ""
        return SimulationError(
            f"the reduced inertia Gᵀ M G{whose} is singular: a motion of "
            f"{', '.join(names)} moves no mass, or too little to be told from rounding; give its links "
            "inertia"
        )
