"""Singular configurations, located to rounding."""

from __future__ import annotations

import numpy as np

from ..mechanism.loops import ClosedLoops
from ..mechanism.tolerances import LOCATING
from ..mechanism.tree.tree import Array
from .second_order import second_order_forms

LOCATED = 1e-11
"""Residual of φ = 0, Kᵀ U = 0 at which a singular configuration is located."""

IDLE = 4
"""Iterations without one that nearly halves the residual, after which they lead nowhere; beside a degenerate
singularity they halve it."""

FAR = 10.0
"""Dimensionless step at which there is none near by."""


def located(loops: ClosedLoops, q: Array, rank: int, corank: int) -> Array | None:
    """The configuration next to q at which K, of this rank beside, lacks `corank`; None if there is none.

    Gauss–Newton on φ = 0, Kᵀ U = 0, Uᵀ U = 1 for q and the left null vectors U. At corank 1 its Jacobian has
    full column rank where the second-order form Q_u is regular on ker K.
    """
    left = np.linalg.svd(loops.scaled(loops.K(q)))[0]
    rows = left[:, :rank].T  # what the closures hold here; redundant rows stay out
    us = np.eye(rank)[:, rank - corank :]  # in the basis of left vectors the last ones, to begin with
    here, scale = q, loops.column_scale
    pairs = np.triu_indices(corank)
    least, idle = np.inf, 0
    while idle < IDLE:
        K = rows @ loops.scaled(loops.K(here))
        products = (us.T @ us - np.eye(corank))[pairs]  # else U = 0 would solve Kᵀ U = 0 anywhere
        F = np.concatenate([rows @ (loops.phi(here) / loops.row_scale), (K.T @ us).T.ravel(), 0.5 * products])
        size = np.abs(F).max()
        if size < LOCATED:
            return here
        least, idle = (size, 0) if size < 0.6 * least else (least, idle + 1)
        forms = second_order_forms(loops, here, (us.T @ rows).T, np.diag(scale))
        normal = np.zeros((len(products), us.size))
        for row, (i, j) in enumerate(zip(*pairs, strict=True)):
            normal[row, i * rank : (i + 1) * rank] += 0.5 * us[:, j]
            normal[row, j * rank : (j + 1) * rank] += 0.5 * us[:, i]
        J = np.block(
            [
                [K, np.zeros((rank, us.size))],
                [np.vstack(forms), np.kron(np.eye(corank), K.T)],
                [np.zeros((len(products), loops.nv)), normal],
            ]
        )
        # U may turn in itself: at corank above one J lacks rank
        move = np.linalg.lstsq(J, -F, rcond=LOCATING)[0]
        here = loops.tree.integrate(here, scale * move[: loops.nv])
        us = us + move[loops.nv :].reshape(corank, rank).T
        if not np.abs(move).max() < FAR:
            return None
    return None
