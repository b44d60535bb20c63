"""The rank of K at a configuration and beside it on the constraint."""

from __future__ import annotations

import numpy as np

from ..coordinates.partition import numerical_rank
from ..loops import ClosedLoops
from ..tolerances import CLOSED, RANK, RANK_NEARBY, STRUCTURAL
from ..tree.tree import Array

NEARBY = 1e-2
"""How far, in dimensionless velocity units, the rank is looked up along a direction."""


def singular_values(loops: ClosedLoops, q: Array) -> Array:
    """Of the dimensionless K at q, descending."""
    s: Array = np.linalg.svd(loops.scaled(loops.K(q)), compute_uv=False)  # scaled: ranks have no unit
    return s


def motions(loops: ClosedLoops, q: Array) -> Array:
    """Orthonormal basis of the instantaneous motions at q, (nv, differential mobility), dimensionless."""
    _, s, Vt = np.linalg.svd(loops.scaled(loops.K(q)))
    basis: Array = Vt[numerical_rank(s, STRUCTURAL) :].T
    return basis


def opening(loops: ClosedLoops, q: Array, v: Array) -> Array:
    """The least part of v (nv,) without which K v = 0."""
    K, scale = loops.scaled(loops.K(q)), loops.column_scale
    # least in dimensionless velocities, not in a mixture of radians and metres
    return np.asarray(scale * np.linalg.lstsq(K, K @ (v / scale), rcond=STRUCTURAL)[0])


def beside(loops: ClosedLoops, q: Array, direction: Array) -> Array | None:
    """The closed configuration a little way along a direction (nv,); None where the loops do not close."""
    size = np.abs(direction / loops.column_scale).max()  # so that no joint moves by more than `NEARBY`
    near = loops.polish(loops.tree.integrate(q, direction * (NEARBY / size)), np.arange(loops.nv))
    return near if loops.closure_residual(near) <= CLOSED else None


def rank_along(loops: ClosedLoops, q: Array, kernel: Array) -> int:
    """Largest rank of K a little way along the columns of `kernel` (nv, δ), back on the constraint."""
    found = [beside(loops, q, direction) for direction in kernel.T]
    # Beside a place the rank can only rise, so the largest that is met is nearest to the generic one.
    return max(
        (numerical_rank(singular_values(loops, near), RANK_NEARBY) for near in found if near is not None),
        default=0,
    )


def singular_words(loops: ClosedLoops, q: Array) -> str:
    """Why a closed q is no regular configuration, in words; empty where it is one.

    Regular: K keeps its rank, and every direction of its kernel leads on along the constraint.
    """
    _, s, Vt = np.linalg.svd(loops.scaled(loops.K(q)))
    rank = numerical_rank(s, RANK)
    if rank == loops.nc:
        return ""
    for direction in Vt[rank:]:
        way = loops.column_scale * direction
        near = beside(loops, q, way)
        # Closing the loops takes most of a step back that is a motion of K alone.
        least = 0.5 * NEARBY * float(direction @ direction) / np.abs(direction).max()
        if near is None or (loops.tree.difference(q, near) / loops.column_scale) @ direction < least:
            return f"rank {rank}, and a direction in which K v = 0 leads nowhere"
        there = numerical_rank(singular_values(loops, near), RANK_NEARBY)
        if there != rank:
            return f"rank {rank} against {there} nearby"
    return ""
