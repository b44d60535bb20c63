"""Which joints can be independent: the best set at home, and a check that a set determines the others."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..analysis.local import analyse
from ..errors import PartitionError
from .loops import CLOSED, STRUCTURAL, ClosedLoops
from .partition import numerical_rank, spelled
from .tree import Array

log = logging.getLogger(__name__)


def best_at_home(loops: ClosedLoops, home: Array, name: str) -> tuple[Array, tuple[str, ...]]:
    """Home, assembled if need be, and the best conditioned independent joints there, which are logged.

    Raises
    ------
    PartitionError
        Where home is singular, or no joints with one number each parametrise the motion.
    """
    if loops.closure_residual(home) > CLOSED:
        home = loops.close_loops(home, np.arange(loops.nv))
    picture = analyse(loops, home)
    choices = loops.coordinate_choices(home)
    freedom = picture.differential_dof
    if picture.kind in ("regular", "redundant") and not choices:
        single = [joint.name for joint in loops.joints if joint.single]
        raise PartitionError(
            f"independent = 'auto': the mechanism has {freedom} degrees of freedom, and its joints with "
            f"one number each ({', '.join(single) or 'none'}) do not parametrise them; give the tree "
            "more such joints, for instance a chain of revolute and prismatic ones for a free body"
        )
    if picture.kind not in ("regular", "redundant"):
        raise PartitionError(
            f"independent = 'auto' needs a regular home configuration, and home is {picture.kind} "
            f"({picture.message}); give another home, or name the joints"
        )
    quality, names = choices[0]
    log.info("%s: independent joints %s (conditioning %.2g)", name, ", ".join(names), quality)
    return home, names


def require_determined(
    loops: ClosedLoops, independent: Sequence[str], dependent: Sequence[str], iv_dependent: NDArray[np.int64]
) -> None:
    """A PartitionError, with sets that would serve, where K_d is singular in every configuration."""
    nd = len(iv_dependent)
    jacobians = [loops.scaled(K)[:, iv_dependent] for K in loops.generic_jacobians()]
    ranks = [numerical_rank(np.linalg.svd(K, compute_uv=False), STRUCTURAL) for K in jacobians]
    rank = max(ranks, default=0)
    if rank == nd:
        return
    _, _, Vt = np.linalg.svd(jacobians[0])
    moving = np.zeros(loops.nv)
    moving[iv_dependent] = np.max(np.abs(Vt[rank:]), axis=0)
    culprits = [n for n in dependent if np.any(moving[loops.velocity_slice(n)] > 1e-6)]
    # joints whose complement the closures determine at a generic configuration
    suggestions = [names for _, names in loops.coordinate_choices(loops.generic_configurations()[0])]
    hint = "; sets that would serve: " + spelled(suggestions) if suggestions else ""
    raise PartitionError(
        f"independent = {', '.join(map(repr, independent)) or 'none'}: K_d is structurally "
        f"singular (rank {rank} for {nd} dependent velocities): the closures do not determine "
        f"{', '.join(map(repr, culprits))} in any configuration{hint}",
        suggestions,
    )
