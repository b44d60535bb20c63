"""Which joints can be independent: the best set at home, and a check that a set determines the others."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import ClosureError, PartitionError
from ..assembly.assembly import assembled, free_velocities
from ..assembly.ranges import assembled_within
from ..constraint.rank import motions, singular_values, singular_words
from ..loops import ClosedLoops
from ..tolerances import CLOSED, DETERMINES, RANK, STRUCTURAL
from ..tree.joints import in_v
from ..tree.tree import Array
from .coordinates import COMPONENT, Coordinates
from .partition import independent_rows, numerical_rank, spanning, spelled, triangular_blocks

log = logging.getLogger(__name__)

SERVES = 1e-3
"""σ_min of the chosen rows of the motions below which a joint does not serve beside the others."""

BESIDE, AWAY = 6, 0.5
"""Configurations tried beside a singular one, and how far away they are, rad or characteristic lengths."""

LEAST_AWAY = 1e-3
"""How far they must be once closed: 1e-6 beside an isolated point loops are closed to rounding."""


def best_at_home(loops: Coordinates, home: Array, name: str) -> tuple[Array, tuple[str, ...]]:
    """Home, assembled if need be, and the best conditioned independent joints there, which are logged.

    At a singular home they are those of a regular configuration beside it.

    Raises
    ------
    PartitionError
        Where no joints with one number each parametrise the motion, or home is an isolated point.
    """
    home = assembled_within(loops, home, np.arange(loops.nv), "independent = 'auto'")
    words = singular_words(loops, home)
    place = regular_near(loops, home) if words else home
    if words and place is home:
        raise PartitionError(
            f"independent = 'auto': home is singular ({words}), and no regular configuration was found "
            "beside it; give another home, or name the joints"
        )
    choices = loops.coordinate_choices(place)
    if not choices:
        single = [joint.name for joint in loops.joints if joint.single]
        freedom = loops.nv - numerical_rank(singular_values(loops, place), RANK)
        if freedom == 0:
            raise PartitionError(
                "independent = 'auto': the mechanism is rigid, its loops leave no joint any freedom; check "
                "the link lengths and the axes of the joints, or leave a closure out"
            )
        raise PartitionError(
            f"independent = 'auto': the mechanism has {freedom} degrees of freedom, and its joints with "
            f"one number each ({', '.join(single) or 'none'}) do not parametrise them; give the tree "
            "more such joints, for instance a chain of revolute and prismatic ones for a free body"
        )
    quality, names = choices[0]
    log.info("%s: independent joints %s (conditioning %.2g)", name, ", ".join(names), quality)
    return home, names


def completed(
    loops: ClosedLoops, place: Array, wanted: Sequence[str], name: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The wanted joints as far as they can serve at a place, and what completes them; both are logged.

    With T an orthonormal basis of the motions there, a joint serves while the rows of T that it adds keep
    σ_min above SERVES. What is lacking is chosen by pivoted QR of the rest of T, numbers of joints that have
    one each before components of others.

    Parameters
    ----------
    loops : ClosedLoops
    place : ndarray (nq,)
        A closed, regular configuration.
    wanted : sequence of str
        Joints, or components of joints, in the order of preference.

    Returns
    -------
    tuple of str, tuple of str
        All independent joints and components; those of the wanted ones that cannot serve.
    """
    T = motions(loops, place)
    kept, rows = _serving(loops, T, wanted)
    lost = tuple(one for one in wanted if one not in kept)
    numbers = in_v(loops.joints)
    weight = np.array([1.0 if loops.joint_at(i).single else COMPONENT for i in range(loops.nv)])
    weight[free_velocities(loops)] = 1.0  # no other joint could stand for these
    rest = np.setdiff1d(np.arange(loops.nv), rows)
    Q = np.linalg.qr(T[rows].T)[0]
    left = (T[rest] - T[rest] @ Q @ Q.T) * weight[rest, None]  # motions that the kept ones leave
    added = sorted(rest[spanning(left, T.shape[1] - len(rows))].tolist())
    names = [*kept, *(numbers[i].name for i in added)]
    quality = float(np.linalg.svd(T[[*rows, *added]], compute_uv=False).min(initial=1.0))
    log.info("%s: independent %s (conditioning %.2g)", name, ", ".join(names), quality)
    if lost:
        log.info("%s: cannot be independent beside them: %s", name, ", ".join(lost))
    return tuple(names), lost


def _serving(loops: ClosedLoops, T: Array, wanted: Sequence[str]) -> tuple[list[str], list[int]]:
    """Those of the wanted joints that serve beside each other where T spans the motions; their rows of T."""
    kept: list[str] = []
    rows: list[int] = []
    for one in wanted:
        more = [*rows, *loops.velocities_of(one)]
        enough = len(set(more)) == len(more) <= T.shape[1]  # none twice, no more than there is mobility
        if enough and np.linalg.svd(T[more], compute_uv=False)[-1] > SERVES:
            kept, rows = [*kept, one], more
    return kept, rows


def regular_near(loops: ClosedLoops, home: Array, nearly: float = 0.0, wanted: Sequence[Any] = ()) -> Array:
    """Home, or where K loses rank there a closed configuration beside it where it does not.

    Such a pose is singular, or an isolated point, beside which nothing is found.

    Parameters
    ----------
    nearly : float
        Conditioning of K, the least of its singular values that count over the largest, below which home
        is left too, for the best conditioned of the configurations beside it.
    wanted : sequence of str
        Joints that are to be independent: of motions that meet, one in which most of them serve is taken.
        What is no joint is for others to refuse.
    """
    if loops.nc == 0:
        return home
    names = set(loops.joint_names)
    given = [one for one in wanted if isinstance(one, str)]
    wanted = [one for one in given if one in names or one.rpartition(".")[0] in names]
    # along K's kernel only does one leave a singular place without opening the loops at first order
    rng, here = np.random.default_rng(1), motions(loops, home)
    at_home = _quality(loops, home, wanted)
    # ∞ beside the rank: a well conditioned home is left for a larger rank alone
    found, best = home, at_home if at_home[-1] < nearly else (at_home[0], np.inf)
    for _ in range(BESIDE):
        way = here @ (here.T @ rng.normal(0.0, 1.0, loops.nv))  # the same in any basis
        way[free_velocities(loops)] = 0.0  # joints in no loop change no rank
        step = loops.units * way * (AWAY / max(float(np.abs(way).max(initial=0.0)), 1e-300))
        try:
            q = assembled(loops, loops.tree.integrate(home, step), np.arange(loops.nv), "home", (0.0,))
        except ClosureError:
            continue
        quality = _quality(loops, q, wanted)
        if quality[0] and np.abs(loops.tree.difference(home, q) / loops.units).max() < LEAST_AWAY:
            continue  # back where it was, but for what rounding leaves open
        if quality > best:
            found, best = q, quality
    return found


def _quality(loops: ClosedLoops, q: Array, wanted: Sequence[str]) -> tuple[float, ...]:
    """rank K − nv at q; how many of the wanted joints serve, and which; K's conditioning, last.

    The last is the least of the singular values that count over the largest.
    """
    s = singular_values(loops, q)
    rank = numerical_rank(s, STRUCTURAL)
    kept = _serving(loops, motions(loops, q), wanted)[0] if wanted else []
    serve = [float(one in kept) for one in wanted]
    return rank - loops.nv, len(kept), *serve, float(s[rank - 1] / s[0]) if rank else 1.0


def require_determined(loops: Coordinates) -> None:
    """A PartitionError, with sets that would serve, where K_d is singular in every configuration.

    Raises
    ------
    PartitionError
    """
    iv_dependent, nd = loops.iv_dependent, len(loops.iv_dependent)
    # Open loops do: K_d is analytic in q, so that what is regular somewhere is so almost everywhere.
    seen = loops.generic_configurations()
    if loops.closure_residual(loops.home) <= CLOSED:
        seen.append(loops.home)
    jacobians = [loops.scaled(loops.K(q))[:, iv_dependent] for q in seen]
    if is_determined(jacobians):
        return
    ranks = [numerical_rank(np.linalg.svd(K, compute_uv=False), STRUCTURAL) for K in jacobians]
    rank = min(max(ranks, default=0), max(nd - 1, 0))  # at least one direction is to be named
    _, _, Vt = np.linalg.svd(jacobians[0])  # its last rows: what K_d leaves undetermined
    moving = np.zeros(loops.nv)
    moving[iv_dependent] = np.max(np.abs(Vt[rank:]), axis=0)
    culprits = [n for n in loops.dependent if np.any(moving[loops.velocity_slice(n)] > DETERMINES)]
    # joints whose complement the closures determine at a generic configuration
    suggestions = [names for _, names in loops.coordinate_choices(seen[0])]
    hint = "; sets that would serve: " + spelled(suggestions) if suggestions else ""
    raise PartitionError(
        f"independent = {', '.join(map(repr, loops.independent)) or 'none'}: K_d is structurally "
        f"singular (rank {rank} for {nd} dependent velocities): the closures do not determine "
        f"{', '.join(map(repr, culprits))} in any configuration{hint}",
        suggestions,
    )


def is_determined(jacobians: Sequence[Array]) -> bool:
    """Whether K_d has full column rank somewhere, told block by block.

    The rank of a chain of loops taken at once depends on luck: where each loop is fed by the one before,
    σ_min/σ_max falls geometrically with their number though each is well conditioned. So the zero pattern
    decides first (a maximum matching, triangular blocks), and each diagonal block by itself. Blocks are
    analytic in q: where each is regular somewhere, almost everywhere all are.

    Parameters
    ----------
    jacobians : sequence of ndarray (nc, nd)
        K_d, dimensionless, in several configurations.
    """
    count = jacobians[0].shape[1]
    if count == 0:
        return True
    if jacobians[0].shape[0] < count:
        return False
    rows = independent_rows(jacobians[0], count)
    square = [K[rows] for K in jacobians]
    # an entry that vanishes at one place by accident does not at all of them
    blocks = triangular_blocks(np.any([np.abs(K) > STRUCTURAL for K in square], axis=0))
    if blocks is None:  # these rows determine nothing; with redundant ones others might
        return len(rows) < jacobians[0].shape[0] and any(map(_has_full_rank, jacobians))
    return all(any(_has_full_rank(K[np.ix_(b.rows, b.columns)]) for K in square) for b in blocks)


def _has_full_rank(K: Array) -> bool:
    return numerical_rank(np.linalg.svd(K, compute_uv=False), STRUCTURAL) == K.shape[1]
