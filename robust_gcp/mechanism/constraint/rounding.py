"""Loops that are closed more often than once, up to the rounding of a file's numbers.

A planar loop that is closed by a weld has three rows too many. They do no harm where the axes are parallel to
the last digit; where a file writes 1.5708 for a right angle they leave singular values of 1e-6 in K, and the
loop no freedom. Such rows are left out, and told: those that no configuration moves (`without_unmoved_rows`),
and those that others imply where the loops are closed (`without_rounded_rows`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from ..coordinates.loop_graph import loop_groups
from ..coordinates.partition import numerical_rank
from ..loops import ClosedLoops
from ..tolerances import CLOSED, STRUCTURAL
from ..tree.tree import Array
from .closures import Closure
from .couplings import AnyClosure, CouplingClosure
from .partial_closure import PartialClosure
from .rank import motions, singular_values
from .rows import rows_of

IMPLIED = "rows of loops that others imply up to rounding"
"""What is told of them."""

ROUNDED = 2e-5
"""Singular value of the dimensionless K, against the largest, that may be rounding of a file's numbers."""

GAP = 100.0
"""How much smaller it must be than the next."""

LARGEST_GAP = 1e-4
"""What such rows may leave open, rad or lengths: rounding adds up along a chain."""

MOVED, LEFT_OPEN = 0.3, 1e-4
"""A motion, rad or lengths, and by how much rows that are left out may open in it, rad or lengths.

A structure that is shaky to first order opens by a tenth of the motion."""


def without_unmoved_rows(loops: ClosedLoops) -> tuple[ClosedLoops, list[str]]:
    """The loops without rows that hardly move in any configuration, and in words which have lost some.

    Such are those of a planar loop out of its plane. They are judged with the loops open, so that a singular
    pose is no matter. A combination u of rows that keeps u · φ above `ROUNDED` cannot be closed, and stays.
    """
    return _without(loops, loops.generic_configurations(), CLOSED)


def without_rounded_rows(loops: ClosedLoops, home: Array) -> tuple[ClosedLoops, list[str]]:
    """The loops without rows that depend on the others up to rounding, and in words which have lost some.

    Couplings among the closures of a loop leave it as it is.

    Parameters
    ----------
    loops : ClosedLoops
    home : ndarray (nq,)
        Closed, up to that rounding.
    """
    return _without(loops, [home], STRUCTURAL, home)


def _without(
    loops: ClosedLoops, places: Sequence[Array], exact: float, home: Array | None = None
) -> tuple[ClosedLoops, list[str]]:
    """Leave out rows that are rounding at these places, group by group; at `home` only what persists."""
    closures, told = list(loops.closures), list[str]()
    values = [singular_values(loops, q) for q in places]
    grey = bool(loops.implicit.vanishing) or any(map(_is_grey, values))
    # in a plane that is oblique to the world no row vanishes by itself, but one depends on others
    grey = grey or (home is None and all(loops.nc > numerical_rank(s, CLOSED) for s in values))
    for group in loop_groups(loops.own_model, loops.closures) if grey else ():
        # a coupling's one row is meant
        inside = [i for i in group.closures if isinstance(closures[i], Closure)]
        members = [closures[i] for i in inside]
        # whoever names rows of a closure means these: nothing more is left out of it
        if not members or any(isinstance(c, PartialClosure) for c in members):
            continue
        if home is not None and len(inside) < len(group.closures):
            continue
        velocities = [i for j in group.joints for i in loops.joints[j - 1].iv]
        left = _selected(loops, members, velocities, places, exact)
        if left is None:
            continue
        parts = dict(zip(inside, left[0], strict=True))
        kept = [parts.get(i, closure) for i, closure in enumerate(closures)]
        if home is None or _persists(loops, kept, home, velocities):
            closures = kept
            told.append(_told(left))
    return _closed_by(loops, closures), told


def _is_grey(s: Array) -> bool:
    """Whether one of these singular values may be rounding of a file's numbers."""
    return bool(np.any((s > CLOSED * s[0]) & (s < ROUNDED * s[0]))) if len(s) else False


def _told(left: tuple[list[PartialClosure], float]) -> str:
    """Which closures have lost rows, and how many; the largest of what is rounding."""
    lost = []
    for closure in left[0]:
        whole = rows_of([PartialClosure.of(closure.all_rows())])
        kept = {row.name for row in rows_of([closure])}
        if len(kept) < len(whole):
            lost.append(
                f"{closure.frame1} – {closure.frame2} ({len(whole) - len(kept)} of {len(whole)} rows)"
            )
    return f"{', '.join(lost)}: {left[1]:.1e}"


def _closed_by(loops: ClosedLoops, closures: Sequence[AnyClosure]) -> ClosedLoops:
    """The tree closed by what has rows of these closures; the same loops where that is all of theirs."""
    kept = [c for c in closures if isinstance(c, CouplingClosure) or _has_rows(c)]
    if [*map(id, kept)] == [*map(id, loops.closures)]:
        return loops
    return ClosedLoops(loops.own_model, kept)


def _has_rows(closure: Closure) -> bool:
    return len(rows_of([closure])) > 0


def _selected(
    loops: ClosedLoops,
    members: Sequence[AnyClosure],
    velocities: Sequence[int],
    places: Sequence[Array],
    exact: float,
) -> tuple[list[PartialClosure], float] | None:
    """The members with the best rows, as many as are independent, and the largest of what is rounding.

    None where none is rounding: singular values between `exact` and `ROUNDED` of all places together, and
    rows of that size.
    """
    whole = [PartialClosure.of(c) for c in members if isinstance(c, Closure)]
    part = ClosedLoops(loops.own_model, whole, np.inf)
    size = _levers(part, whole, places)
    K = np.hstack([(part.K(q) / size[:, None] * loops.units)[:, velocities] for q in places])
    # All places side by side: a row is superfluous where the same combination vanishes at each of them.
    U, s, _ = np.linalg.svd(K, full_matrices=False)
    strict, loose = numerical_rank(s, exact), numerical_rank(s, ROUNDED)
    rounding = max(part.implicit.vanishing.values(), default=0.0)  # of rows that were left out as zero before
    if loose < strict:
        rounding = max(rounding, float(s[loose] / s[0]))
    # without a clear gap below the rows that move it may be a linkage of very unequal links
    if loose == 0 or not 0.0 < rounding <= ROUNDED or (loose < strict and s[loose - 1] < GAP * s[loose]):
        return None
    # rows that no motion closes are frames that do not fit, which is for the user to know
    if max(np.abs(U[:, loose:].T @ (part.phi(q) / size)).max(initial=0.0) for q in places) > LARGEST_GAP:
        return None
    pivots = scipy.linalg.qr(K.T, mode="economic", pivoting=True)[2][:loose]  # the best conditioned ones
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
    return left, rounding


def _levers(part: ClosedLoops, whole: Sequence[Closure], places: Sequence[Array]) -> Array:
    """What makes each row dimensionless, (nc,): of position rows the longest lever of their closure.

    So a small loop beside a large one is not taken for rounding.
    """
    layout = rows_of(whole)
    moved = np.max([np.abs(part.K(q)).max(axis=1, initial=0.0) for q in places], axis=0)
    owner = np.array([layout[int(row)].closure for row in part.implicit.rows], dtype=np.int64)
    size = np.ones(len(owner))
    for closure in set(owner.tolist()):
        rows = (owner == closure) & part.implicit.is_length
        # a closure that nothing moves has no lever; one longer than the links is none of the mechanism's
        size[rows] = min(max(moved[rows].max(initial=0.0), STRUCTURAL * part.length), part.length)
    return size


def _persists(
    loops: ClosedLoops, closures: Sequence[AnyClosure], home: Array, velocities: Sequence[int]
) -> bool:
    """Whether all rows stay nearly closed where the loops move without those that are left out."""
    freed = _closed_by(loops, closures)
    T = motions(freed, home)
    # a motion of other loops says nothing of these rows
    ways = [way for way in T.T if np.abs(way[list(velocities)]).max(initial=0.0) > 1e-6]
    every = np.arange(loops.nv)
    # A row that others imply at home alone, as at a singular place, opens where the loops move on.
    for way in ways:
        for sign in (1.0, -1.0):
            step = sign * way * freed.column_scale
            step *= MOVED / max(float(np.abs(step / freed.units).max()), 1e-9)
            q = freed.polish(loops.tree.integrate(home, step), every)
            # where the rows that are kept do not close either, it tells nothing
            if freed.closure_residual(q) < STRUCTURAL and loops.closure_residual(q) > LEFT_OPEN:
                return False
    return bool(ways)  # what does not move proves nothing
