"""What to say where a motion cannot go on."""

from __future__ import annotations

import numpy as np

from ...errors import BranchError, NotCertifiedError, SimulationError, ToggleError
from ...mechanism.clusters import LoopCluster
from ...mechanism.mechanism import Mechanism
from ...mechanism.partition import spelled
from ..point import Point
from .obstacles import Obstacle


def refusal(mechanism: Mechanism, cluster: LoopCluster, obstacle: Obstacle, here: Point) -> SimulationError:
    """The error that an obstacle ends a run with."""
    where = f"y = {np.array2string(here.y, precision=6)} ({', '.join(mechanism.independent)})"
    if len(mechanism.clusters) > 1:
        where += f", in the loops of {', '.join(cluster.joints)}"
    figures = {"gap": obstacle.gap, "cluster": cluster.index}
    if obstacle.kind == "toggle":
        choices = [
            names
            for _, names in mechanism.coordinate_choices(here.q)
            if set(names) != set(mechanism.independent)
        ]
        return ToggleError(
            f"toggle at {where}: K_d is singular while K is not, the independent coordinates turn "
            f"back here and cannot parametrise the motion; joints that can: {spelled(choices)} (or pass "
            'on_toggle="repartition")',
            here.y,
            choices,
            **figures,
        )
    if obstacle.kind == "near miss":
        gap = f"{obstacle.gap:.2g} lengths" if np.isfinite(obstacle.gap) else "unknown size"
        return BranchError(
            f"near miss at {where}: two modes pass each other with a gap of {gap} "
            "and the true curve could not be followed; use a smaller step or, if the gap is an error "
            "of the model, raise geometric_tolerance above it",
            here.y,
            **figures,
        )
    return NotCertifiedError(
        f"singularity at {where} not certified: {obstacle.reason}; second order does not say how the "
        "motion goes on (see analyse(mech, q) at traj.q[-1])",
        here.y,
        **figures,
    )
