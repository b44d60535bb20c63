"""What rounding of q and φ leaves uncertain of a cluster's `MapRates` at a configuration."""

from __future__ import annotations

import numpy as np

from ...errors import NotCertifiedError
from ...mechanism.constraint.extended_precision import EPS
from ...mechanism.tree.tree import Array
from .map_rates import ClusterRates

ROUNDINGS, DOUBLE = 8.0, float(np.finfo(float).eps)
"""How many roundings q and φ are taken to be off by, and their size in q; `extended_precision.EPS` in φ."""

SAMPLES = 4
"""Ways of rounding that are tried."""


def rounding(rates: ClusterRates, q: Array) -> tuple[Array, float]:
    """q closed anew, and how much G and its two derivatives change there, without units.

    Where q, and what φ was when q was closed, are rounded otherwise.
    """
    scale, tree = rates.scale, rates.cluster.loops.tree
    unit = scale[rates.independent]

    def parts(at: Array) -> Array:
        found = rates.rates_at(rates.rates.real(at), unit)
        return np.array((found.G, *found.bend, found.A_y)) / scale[:, None] * unit

    try:
        q = rates.closed(q)
        here, change = parts(q), 0.0
        for seed in range(1, SAMPLES + 1):
            sign = np.random.default_rng(seed).choice([-1.0, 1.0], len(scale) + rates.cluster.loops.nc)
            moved = rates.reopened(q, ROUNDINGS * EPS * sign[len(scale) :])
            moved = tree.integrate(moved, ROUNDINGS * DOUBLE * sign[: len(scale)] * scale)
            off = np.abs(here - parts(moved)) / (1.0 + np.abs(here))
            change = max(change, float(off.max()))
    except NotCertifiedError:
        return q, np.inf
    return q, change
