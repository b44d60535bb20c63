"""How evenly the joints of a loop cluster move while some keep their rates, and which of them serve best so.

While independent components E keep their rates, ÿ_E = 0, the cluster's velocities change by

    a_E = g − T T[E]⁻¹ g[E]

where the columns of T span its motions and g is any acceleration that its loops have at velocity v. The
unevenness of E is η_E = max |a_E| / (max |v|)², in radians and lengths: no unit, the same at any rate, and
beyond all bounds where E turns back. A fixed step h errs by some (h |v| η)⁵, long before K_d is poorly
conditioned: the rates of a joint that turns back change most while it still moves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array

UNEVEN = 2.0
"""Unevenness from which other components are looked for."""

GAIN = 2.0
"""By what factor others have to be more even."""

WORTH = 0.05
"""Share by which an exchange has to help, so that rounding does not decide."""

LOOKED_AT = 8
"""Exchanges whose conditioning is looked at."""

Index = NDArray[np.int64]


def kept_rates(tangent: Array, chosen: Index, g: Array) -> tuple[Array, Array]:
    """W = T T[E]⁻¹, (n, m), and a_E, (n,)."""
    W = np.linalg.solve(tangent[chosen].T, tangent.T).T
    return W, g - W @ g[chosen]


def unevenness(tangent: Array, chosen: Index, g: Array, v: Array) -> float:
    """η_E; 0 at rest."""
    return bent(kept_rates(tangent, chosen, g)[1], v)


def bent(a: Array, v: Array) -> float:
    """max |a| / (max |v|)²; 0 at rest. With g for a that is η of the components that are independent now."""
    largest = float(np.abs(v).max(initial=0.0)) ** 2
    return float(np.abs(a).max(initial=0.0)) / largest if largest > 0.0 else 0.0


def evenest(
    tangent: Array, chosen: Index, g: Array, candidates: Index, serves: Callable[[Index], bool]
) -> Index:
    """Components that are more even than `chosen`, one exchanged for another as long as that helps.

    Parameters
    ----------
    tangent : ndarray (n, m)
        Its columns span the motions, in radians and lengths.
    chosen, candidates : ndarray of int
    g : ndarray (n,)
        An acceleration that the loops have.
    serves : callable
        Whether components are conditioned well enough.
    """
    for _ in range(len(chosen)):  # as many exchanges as replace all of them
        W, a = kept_rates(tangent, chosen, g)
        others = np.setdiff1d(candidates, chosen)
        # in the chart E, i in place of the component at j changes a_E by −W[:, j] a_E[i] / W[i, j]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = a[others][:, None] / W[others]
            sizes = np.abs(a[:, None, None] - W[:, None, :] * ratio).max(axis=0)
        sizes[~np.isfinite(sizes)] = np.inf  # W[i, j] = 0: i rests while j moves, and is none in its place
        enough = (1.0 - WORTH) * float(np.abs(a).max(initial=0.0))
        # each look at conditioning costs an SVD; stable: of equal ones the first, on all machines
        order = np.argsort(sizes.ravel(), kind="stable")[:LOOKED_AT]
        ways = ((*divmod(int(k), len(chosen)), float(sizes.flat[k])) for k in order)
        tried = (np.sort(np.append(np.delete(chosen, j), others[i])) for i, j, size in ways if size < enough)
        better = next(filter(serves, tried), None)
        if better is None:
            break
        chosen = better
    return chosen
