"""Inverse dynamics in minimal coordinates."""

from __future__ import annotations

from functools import partial

from numpy.typing import ArrayLike

from ..checks import check_mechanism, checked_vector, is_table, of_each, require_finite, rows_like
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .problem import initial_value_problem


def inverse_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    ydd: ArrayLike,
    mode: ArrayLike | None = None,
) -> Array:
    """Generalized forces on the independent joints that make the motion (q, v) accelerate by ÿ.

    τ_y = Gᵀ (M (G ÿ + g) + C − τ_applied), the rows of (3) solved for the drives; τ_applied are the
    mechanism's springs, dampers and constant torques. At a singular configuration the bridge supplies
    G and g, so the result is continuous along a mode.

    Parameters
    ----------
    q, v : array_like (nq,), (nv,), or (N, nq), (N, nv)
        Closed, and K v = 0 (see `Mechanism.lift`).
    ydd : array_like (m,) or (N, m)
        rad/s² or m/s².
    mode : array_like, optional
        As in `simulate`, where q is singular.

    Returns
    -------
    ndarray (m,) or (N, m)
        N m or N, in the order of `mechanism.independent`.

    Raises
    ------
    StateError, SimulationError
        As `simulate` does for a start.
    """
    check_mechanism(mechanism, Mechanism, "inverse_dynamics")
    if is_table(q):
        given = (q, mechanism.nq, "q", "nq"), (v, mechanism.nv, "v", "nv"), (ydd, mechanism.m, "ydd", "m")
        return of_each(partial(inverse_dynamics, mechanism, mode=mode), rows_like(*given), mechanism.m)
    wanted = checked_vector(ydd, mechanism.m, "ydd", "m")
    motion = initial_value_problem(mechanism, q, v, mode)
    point = motion.start.point
    speed = point.G @ motion.start.ydot
    force = mechanism.tree.rnea(point.q, speed, point.G @ wanted + point.g).copy()
    if mechanism.applied is not None:
        force -= mechanism.applied.tau(point.q, speed)
    return require_finite(point.G.T @ force, "the force")
