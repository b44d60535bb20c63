"""Beside the apex of an isolated cone: φ relative to the apex, so that rounding costs ε/δ of G, not ε/δ²."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...mechanism.tree.tree import Array
from .jet import Jet
from .obstacles import APEX
from .singular_place import place
from .space import ClusterSpace

BESIDE, LEFT = 1e-2, 2e-2
"""Distances to the singular set below which φ is taken relative to an apex, and above which no longer."""

AT_MOST = 8.0
"""What rounding may cost over its usual share: the worst of 500 motions, by their steps, has 6 times it."""

ASKED = 0.01
"""Share of it below which no tolerance is asked for: with all, one motion in a hundred errs ten times it."""

_POINTS, _WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(5))
"""Of Gauss' rule on (−½, ½): exact to the tenth order of the distance."""


class BesideApex(ClusterSpace):
    """The space of a cluster beside an apex x*, where K loses rank and the loops close.

    φ(x) = ∫₀¹ K(x* + s ξ) ξ ds with ξ = x − x*, exact to rounding ε |ξ|, where φ itself is known to ε. What
    is left of φ at x* is below its rounding, and counts as none.

    Parameters
    ----------
    plain : ClusterSpace
    apex : ndarray (nv,)
    """

    def __init__(self, plain: ClusterSpace, apex: Array) -> None:
        vars(self).update(vars(plain))
        self.plain, self.apex = plain, apex

    def linear(self, x: Array) -> tuple[Array, Array]:
        """φ (rows,) relative to the apex, and K (rows, nv)."""
        away = x - self.apex
        phi = np.zeros(self.rows)
        for point, weight in zip(0.5 + _POINTS, _WEIGHTS, strict=True):
            phi += weight * (self.plain.K(self.apex + point * away) @ away)
        return phi, self.plain.K(x)


def apex_near(here: Jet, largest_gap: float) -> Array | None:
    """The apex of an isolated cone next to a point; None where there is none."""
    found = place(here)
    return found.x if found.is_cone and found.gap <= largest_gap else None


def rounding(points: Iterable[Jet]) -> tuple[float, float, float]:
    """What rounding costs of G at most beside singular places without a bridge.

    x is known to ε/δ, and G changes within δ. Relative to an apex φ is known to ε δ.

    Returns
    -------
    lost, asked, nearest : float
        The bound, the least tolerance to ask for there, and the least distance.
    """
    lost, asked, nearest = 0.0, 0.0, np.inf
    for here in points:
        distance = max(here.delta(), APEX)  # nearer the motion is refused
        if isinstance(here.space, BesideApex):
            bound = least = 2e-15 / distance
        else:
            usual = 1e-16 / distance**2
            bound, least = AT_MOST * usual, ASKED * usual
        lost, asked, nearest = max(lost, bound), max(asked, least), min(nearest, distance)
    return lost, asked, nearest
