"""A mode that lies wholly in the singular set: it is the mid curve {U₁ᵀ φ = 0, f_w = 0} itself, in windows.

K lacks one rank at every place of it, so that no bridge leads to regular ground: the motion goes from
window to window.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from ....mechanism.tree.tree import Array
from ..curve import Curve
from ..interpolation import HermiteCurve, chopped, series
from ..jet import Jet, LostError
from ..options import BridgeOptions, NoBridgeError
from ..space import ClusterSpace
from .meeting import INSIDE
from .mid_curve import MidCurve, Surface, mid_curve

USED, NODES, POINTS = 0.6, (0.6, 0.7, 0.8), 28
"""Share of a window that is used, where its own points lie, and how many points its series has."""

OVERLAP = 0.9
"""Share of what is used from within which a window that was built before serves again."""


def window(space: ClusterSpace, x: Array, P: Array, options: BridgeOptions) -> Curve:
    """A piece of such a mode about x.

    Parameters
    ----------
    space : ClusterSpace
        Of mobility 1.
    x : ndarray (nv,)
        A point of the mode.
    P : ndarray (nd, rows)
        Rows of φ that would determine it, were K regular.
    options : BridgeOptions

    Raises
    ------
    NoBridgeError
        Where the mode leaves the singular set.
    """
    try:
        surface = Surface(space, x, P)
        curve = mid_curve(surface, x, 0.0)
    except (LostError, np.linalg.LinAlgError) as lost:
        raise NoBridgeError(str(lost)) from lost
    if curve.size > 10.0 * INSIDE + options.closure_tolerance:  # g: by how much f opens along it
        raise NoBridgeError("the mode leaves the singular set", curve.size)
    R = curve.R
    sampled = _derivatives(curve)
    us = [side * share * R for side in (-1.0, 1.0) for share in NODES]
    C = surface.t[:, None]
    nodes = [
        Jet(space, x[0], C, slope[0][:, None], bend[0][None, None], P)
        for x, slope, bend in (sampled(np.array([u])) for u in us)
    ]
    # of all rows: U₁ᵀ φ is zero by construction
    left = max(space.residual(x) for x in sampled(np.linspace(-0.8 * R, 0.8 * R, 15))[0])
    if left > options.closure_tolerance + space.noise(x):
        raise NoBridgeError("the mode leaves the singular set", left)
    return Curve(
        space, C, surface.reference, HermiteCurve(us, nodes), -USED * R, USED * R, [], [], "within", left,
        0.0, left, np.zeros(space.nv), (), series(sampled, -USED * R, USED * R, POINTS),
    )  # fmt: skip


def _derivatives(curve: MidCurve) -> Callable[[Array], tuple[Array, Array, Array]]:
    """x with its two derivatives at many u."""
    columns = [chopped(column) for column in curve.x.T]  # one by one: joints that rest have no coefficients
    n = max(map(len, columns))
    table = np.array([np.pad(column, (0, n - len(column))) for column in columns]).T

    def sampled(us: Array) -> tuple[Array, Array, Array]:
        s = (us - curve.u0) / curve.R
        values = [
            chebyshev.chebval(s, chebyshev.chebder(table, k) if k else table).T / curve.R**k for k in range(3)
        ]
        return values[0], values[1], values[2]

    return sampled
