"""Continuation: one operation mode followed through regular and singular configurations alike.

For one degree of freedom φ(q) = 0 is a set of curves. Between singular points each is followed by
arclength continuation in the kernel of K, whichever joint leads; a singular point ahead is located
to rounding, and the curve is continued beyond it along the tangent of its own mode. All vectors
written u here are dimensionless, v = column_scale · u.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import BranchError
from ..mechanism.constraint.rank import rank_along
from ..mechanism.loops import ClosedLoops
from ..mechanism.tolerances import BENDING, CLOSED
from ..mechanism.tree.tree import Array
from .configuration_space import Curve
from .local import LocalAnalysis, analyse
from .second_order import second_order_forms
from .singular_points import located
from .torus import Torus
from .touching_modes import touching_at

if TYPE_CHECKING:
    from ..maps.cluster.touching.contact import Touching

STEP = 0.04
"""Longest step, dimensionless: some 300 points for a joint's full turn."""

SMALLEST_STEP = 1e-7
TURNING = (0.03, 0.15)
"""Angle between the tangents of two neighbours, rad: below, steps grow; above, they are halved."""

LOOKOUT = 0.25
"""σ_r/σ_1 of K, r = nv − 1, below which a singular point is looked for."""

REACH = 4.0 * STEP
"""Distance at which a singular point that was found is approached."""

PASSING = 1.5 * STEP
"""Distance from which a singular point is passed in one step, where K still has most of its digits."""

MAX_LENGTH = 400.0
"""Dimensionless length after which a curve that does not close is left open."""


class Continuation:
    """Follows curves of one mechanism.

    Parameters
    ----------
    mechanism : ClosedLoops
        With one degree of freedom.
    points : sequence of LocalAnalysis
        The singular points found so far; grows as `known` is called.
    known : callable (q) -> (int, LocalAnalysis)
        The number and local analysis of a singular configuration.
    """

    def __init__(
        self,
        mechanism: ClosedLoops,
        points: Sequence[LocalAnalysis],
        known: Callable[[Array], tuple[int, LocalAnalysis]],
    ) -> None:
        self.mechanism, self.torus = mechanism, Torus(mechanism)
        self.points, self.known = points, known
        self.scale, self.rank = mechanism.column_scale, mechanism.nv - 1
        self.all = np.arange(mechanism.nv)
        self._touches: dict[int, Touching] = {}

    def conditioning(self, q: Array, corank: int = 0) -> float:
        """σ_r/σ_1 of the scaled K, r = nv − 1 − corank: 0 at a singular point of a curve."""
        s = np.linalg.svd(self.mechanism.scaled(self.mechanism.K(q)))[1]
        return float(s[self.rank - corank - 1] / s[0])

    def tangent(self, q: Array, like: Array, corank: int = 0) -> Array:
        """Unit vector of ker K that points as `like` does, dimensionless; for q at no singular point.

        Where K lacks ranks all along a curve, the one in which no second-order form bends.
        """
        U, _, Vt = np.linalg.svd(self.mechanism.scaled(self.mechanism.K(q)))
        r = self.rank - corank
        N = Vt[r:].T
        if corank:
            forms = second_order_forms(self.mechanism, q, U[:, r:], self.scale[:, None] * N)
            N = N @ np.linalg.svd(np.vstack(forms))[2].T
        t = N[:, -1]
        return t if t @ like >= 0.0 else -t

    def directions(self, picture: LocalAnalysis) -> list[Array]:
        """The modes of a local analysis as dimensionless unit tangents; zero for larger ones."""
        found = [mode / self.scale if mode.ndim == 1 else 0.0 * self.scale for mode in picture.modes]
        return [u / max(float(np.linalg.norm(u)), 1e-300) for u in found]

    def moved(self, q: Array, u: Array, corank: int = 0) -> Array:
        """Integrate from q along u and close the loops again, where K lacks as many ranks."""
        near = self.mechanism.tree.integrate(q, self.scale * u)
        if not corank:
            return self.mechanism.polish(near, self.all)
        found = located(self.mechanism, near, self.rank, corank)
        return near if found is None else found

    def step(self, q: Array, t: Array, h: float, corank: int) -> tuple[Array, Array, float]:
        """Advance by h or less along the curve: q, tangent and the step that held the curve.

        Raises
        ------
        BranchError
            When even the smallest step leaves it.
        """
        K = self.mechanism.scaled(self.mechanism.K(q))
        frame = np.linalg.svd(K)
        rows = frame[0][:, : self.rank].T
        # with frozen rows det [P K; tᵀ] keeps its sign along a mode, but for places where K loses a rank
        side = np.linalg.det(np.vstack([rows @ K, t]))
        bend = self._bend(q, t, frame)
        while h > SMALLEST_STEP:
            u = h * t + 0.5 * h * h * bend
            predicted, ahead = self.mechanism.tree.integrate(q, self.scale * u), self.moved(q, u, corank)
            K = self.mechanism.scaled(self.mechanism.K(ahead))
            t_ahead = self.tangent(ahead, t, corank)
            side_ahead = np.linalg.det(np.vstack([rows @ K, t_ahead]))
            correction = self.torus.distance(predicted, ahead)
            if (
                self.mechanism.closure_residual(ahead) <= CLOSED
                and correction < 0.1 * h  # with the curvature, third order: more is another mode
                and t @ t_ahead > np.cos(TURNING[1])
                and (corank or side * side_ahead > 0.0)  # else a singular point was jumped over
            ):
                return ahead, t_ahead, h
            h *= 0.5
        raise BranchError("the mode cannot be followed on: no closed configuration ahead continues it")

    def _bend(self, q: Array, t: Array, frame: tuple[Array, Array, Array]) -> Array:
        """Curvature of the curve, u'' = K⁺ k at unit speed, dimensionless."""
        U, s, Vt = frame
        k = self.mechanism.k(q, self.scale * t) / self.mechanism.row_scale
        kept = s[: self.rank] > BENDING * s[0]
        parts = (U[:, : self.rank].T @ k)[kept] / s[: self.rank][kept]
        return Vt[: self.rank][kept].T @ parts

    def singular_near(self, q: Array, corank: int) -> Array | None:
        """The singular configuration next to q, to rounding; None where there is none within reach."""
        star = self._located(q, corank + 1)
        if star is None:
            return None
        picture = analyse(self.mechanism, star)
        larger = picture.kind == "redundant"  # a point of a larger mode, on all of which K lacks a rank
        # where K lacks more ranks one left vector is not determined: located again with as many as vanish
        lacking = corank + 2 if larger else self.rank - picture.rank
        again = self._located(q, lacking) if lacking > corank + 1 else None
        return star if again is None and not larger else again

    def _located(self, q: Array, corank: int) -> Array | None:
        star = located(self.mechanism, q, self.rank, corank)
        return None if star is None or self.torus.distance(q, star) > 1.5 * REACH else star

    def trace(self, curve: Curve) -> Curve:
        """Follow the curve from its last row until it closes, leaves or cannot be followed.

        A curve starts with one row: a regular configuration, or a singular one with its pass noted.
        """
        h, length, begun = STEP, 0.0, len(curve.q)
        while length < MAX_LENGTH:
            q, t = curve.q[-1], curve.tangents[-1]
            singular = bool(curve.passes) and curve.passes[-1][0] == len(curve.q) - 1
            try:
                if singular:
                    ahead, t_ahead = self._leave(q, t, curve)
                    taken = PASSING
                else:
                    limit = self._approach(q, t, curve.corank)
                    if limit is not None and limit[0] <= 0.0:
                        if self._pass(curve, limit[1]):
                            return curve
                        continue
                    ahead, t_ahead, taken = self.step(
                        q, t, h if limit is None else min(h, limit[0]), curve.corank
                    )
            except BranchError as error:
                curve.stop = str(error)
                return curve
            if len(curve.q) > begun + 2 and self._meets(q, t, taken, curve):
                return curve
            curve.q.append(ahead)
            curve.tangents.append(t_ahead)
            length += taken
            turned = float(np.arccos(np.clip(t @ t_ahead, -1.0, 1.0)))
            h = min(STEP, 2.0 * taken) if turned < TURNING[0] else taken
        curve.stop = f"left open after a length of {MAX_LENGTH:g}"
        return curve

    def _approach(self, q: Array, t: Array, corank: int) -> tuple[float, Array] | None:
        """How far to go before a singular point ahead is passed, and that point."""
        if self.conditioning(q, corank) > LOOKOUT:
            return None
        star = self._known_near(q)
        if star is None:
            star = self.singular_near(q, corank)
        if star is None:
            return None
        way = self.mechanism.tree.difference(q, star) / self.scale
        distance = float(np.linalg.norm(way))
        if distance > REACH or t @ way <= 0.5 * distance:
            return None  # behind, or on another curve
        if distance > 1.2 * PASSING:  # nearer, K has too few digits for more steps
            return distance - PASSING, star
        directions = self.directions(self.known(star)[1])
        # the place may be one of another strand that passes here, whose tangents do not lead to q
        aligned = max((abs(float(way @ u)) for u in directions), default=distance)
        return (0.0, star) if aligned > 0.9 * distance else None

    def _known_near(self, q: Array) -> Array | None:
        """A singular point found before, when q is near it."""
        for point in self.points:
            way = self.torus.difference(q, point.q)
            if np.linalg.norm(way / self.scale) < REACH:
                return self.mechanism.tree.integrate(q, way)
        return None

    def _pass(self, curve: Curve, star: Array) -> bool:
        """Put the singular point on the curve; True where the curve ends or closes there."""
        tree, q = self.mechanism.tree, curve.q[-1]
        number, picture = self.known(star)
        way = tree.difference(q, star) / self.scale
        directions = self.directions(picture)
        touching = self._touching(number, picture)
        chosen = None if touching is None else touching.number(q)
        if not directions or picture.kind == "cusp" or (touching is not None and chosen is None):
            curve.stop = f"{picture.kind}: {picture.message}"
            return True
        aligned = [float(way @ u) for u in directions]
        chosen = int(np.argmax(np.abs(aligned))) if chosen is None else chosen
        t = directions[chosen] * np.sign(aligned[chosen])
        curve.q.append(star)
        curve.tangents.append(t)
        curve.passes.append((len(curve.q) - 1, number, chosen))
        row, first, tangent = curve.passes[0]
        # along the tangent it began with, and in its sense; the other way round it has come to its own end
        if row == 0 and len(curve.passes) > 1 and (first, tangent) == (number, chosen):
            curve.closed = bool(t @ curve.tangents[0] > 0.0)
        return curve.closed

    def _touching(self, number: int, picture: LocalAnalysis) -> Touching | None:
        """The modes that touch at a singular point; None where they cross."""
        if all(order == 1 for *_, order in picture.contacts):
            return None
        if number not in self._touches:
            self._touches[number] = touching_at(self.mechanism, picture.q)
        return self._touches[number]

    def _leave(self, star: Array, t: Array, curve: Curve) -> tuple[Array, Array]:
        """The next row of a curve beyond a singular point along t."""
        _, number, chosen = curve.passes[-1]
        touching = self._touching(number, self.points[number])
        if touching is not None:
            ahead = touching.beyond(chosen, star, self.scale * t, PASSING)
            return ahead, self.tangent(ahead, t)
        if len(curve.q) == 1:
            beside = rank_along(self.mechanism, star, (self.scale * t)[:, None])
            curve.corank = self.rank - beside if beside else 0
        for distance in (PASSING, 0.5 * PASSING, 0.25 * PASSING):  # straight on: the mode bends by the square
            ahead = self.moved(star, distance * t, curve.corank)
            if self.mechanism.closure_residual(ahead) > CLOSED:
                continue
            t_ahead = self.tangent(ahead, t, curve.corank)
            way = self.mechanism.tree.difference(star, ahead) / self.scale
            if t_ahead @ t > 0.95 and np.linalg.norm(way - distance * t) < 0.2 * distance:
                return ahead, t_ahead
        raise BranchError("beyond the singular point the mode is not found again")

    def _meets(self, q: Array, t: Array, h: float, curve: Curve) -> bool:
        """Close the curve when its first row lies within the next step."""
        start = curve.q[0]
        way = self.torus.difference(q, start) / self.scale
        along = float(t @ way)
        # farther off the tangent it is another strand
        if not 0.0 < along <= h * 1.01 or np.linalg.norm(way) > 1.1 * along + 1e-9:
            return False
        if t @ curve.tangents[0] < 0.9:  # the same place on another mode, which crosses
            return False
        curve.q.append(self.mechanism.tree.integrate(q, self.scale * way))
        curve.tangents.append(curve.tangents[0])
        curve.closed = True
        return True
