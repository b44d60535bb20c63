"""Loops that are closed more often than once, up to the rounding of a file's numbers.

A planar loop that is closed by a weld has three rows too many. They do no harm where the axes are parallel to
the last digit; where a file writes 1.5708 for a right angle they leave singular values of 1e-6 in K, and the
loop no freedom. Such rows are left out, and told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from .closures import Closure
from .couplings import AnyClosure, CouplingClosure
from .independent import motions
from .loop_graph import loop_groups
from .loops import ClosedLoops
from .partial_closure import PartialClosure
from .partition import numerical_rank
from .rows import rows_of
from .tolerances import STRUCTURAL
from .tree import Array

ROUNDED = 2e-5
"""Singular value of the dimensionless K, against the largest, that may be rounding of a file's numbers."""

GAP = 100.0
"""How much smaller it must be than the next."""

MOVED, LEFT_OPEN = 0.3, 1e-4
"""A motion, rad or lengths, and by how much rows that are left out may open in it, rad or lengths.

A structure that is shaky to first order opens by a tenth of the motion."""


def without_rounded_rows(loops: ClosedLoops, home: Array) -> tuple[tuple[AnyClosure, ...], list[str]]:
    """The closures, without rows that depend on the others up to rounding, and in words which have lost some.

    Parameters
    ----------
    loops : ClosedLoops
    home : ndarray (nq,)
        Closed, up to that rounding.
    """
    closures, told = list(loops.closures), []
    for group in loop_groups(loops.model, loops.closures):
        members = [closures[i] for i in group.closures]
        if any(isinstance(c, CouplingClosure | PartialClosure) for c in members):
            continue
        velocities = [i for j in group.joints for i in range(*loops.joints[j - 1].v.indices(loops.nv))]
        left = _selected(loops, members, velocities, home)
        if left is None:
            continue
        others = [c for i, c in enumerate(closures) if i not in group.closures]
        if not _persists(loops, [*left[0], *others], home, velocities):
            continue
        for i, closure in zip(group.closures, left[0], strict=True):
            closures[i] = closure
        told.append(f"{left[0][0].frame1} – {left[0][0].frame2} and what closes with it: {left[1]:.1e}")
    kept = tuple(c for c in closures if isinstance(c, CouplingClosure) or _has_rows(c))
    return kept, told


def _has_rows(closure: Closure) -> bool:
    return len(rows_of([closure])) > 0


def _selected(
    loops: ClosedLoops, members: Sequence[AnyClosure], velocities: Sequence[int], home: Array
) -> tuple[list[PartialClosure], float] | None:
    """The members with the best rows, as many as are independent, and the largest of what is rounding."""
    whole = [PartialClosure.of(c) for c in members if isinstance(c, Closure)]
    part = ClosedLoops(loops.model, whole)
    K = part.K(home) / part.row_scale[:, None] * loops.units
    K = K[:, velocities]
    s = np.linalg.svd(K, compute_uv=False)
    strict, loose = numerical_rank(s, STRUCTURAL), numerical_rank(s, ROUNDED)
    if loose == 0 or loose == strict or s[loose - 1] < GAP * s[loose]:
        return None
    pivots = scipy.linalg.qr(K.T, mode="economic", pivoting=True)[2][:loose]
    layout = rows_of(whole)
    kept = {int(part.implicit.rows[p]) for p in pivots}
    first = np.cumsum([0, *(len(rows_of([c])) for c in whole)])
    left = []
    for closure, start in zip(whole, first[:-1].tolist(), strict=True):
        positions = len(closure.along)
        along = tuple(a for k, a in enumerate(closure.along) if start + k in kept)
        turns = tuple(t for k, t in enumerate(closure.turns) if start + positions + k in kept)
        left.append(replace(closure, along=along, turns=turns))
    assert len(kept) == sum(len(c.along) + len(c.turns) for c in left) <= len(layout)
    return left, float(s[loose] / s[0])


def _persists(
    loops: ClosedLoops, closures: Sequence[AnyClosure], home: Array, velocities: Sequence[int]
) -> bool:
    """Whether all rows stay nearly closed where the loops move without those that are left out."""
    freed = ClosedLoops(loops.model, [c for c in closures if isinstance(c, CouplingClosure) or _has_rows(c)])
    T = motions(freed, home)
    ways = [way for way in T.T if np.abs(way[list(velocities)]).max(initial=0.0) > 1e-6]
    every = np.arange(loops.nv)
    for way in ways:
        for sign in (1.0, -1.0):
            step = sign * way * freed.column_scale
            step *= MOVED / max(float(np.abs(step / freed.units).max()), 1e-9)
            q = freed.polish(loops.tree.integrate(home, step), every)
            if freed.closure_residual(q) < STRUCTURAL and loops.closure_residual(q) > LEFT_OPEN:
                return False
    return bool(ways)
