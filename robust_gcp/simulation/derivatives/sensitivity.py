"""Derivatives of where a run ends by where it starts, also through impacts, holds and releases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_callable, shown
from ...dynamics.torque_feedback import TorqueSlopes, slopes_of_all
from ...errors import OptionError
from ...mechanism.tree.tree import Array
from ..phases.chain import Chain
from ..phases.links import Link
from ..trajectories.trajectory import Trajectory
from .run_again import require_steps


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the last state of a run by its start: along the velocities G e_j, and by velocities.

    NaN by changes of the start that what is held there does not allow: of a joint that sticks, or off a stop.

    Attributes
    ----------
    dq_dy, dq_dv : ndarray (nv, m)
        Of q, along the velocities' components.
    dv_dy, dv_dv : ndarray (nv, m)
        Of v.
    """

    dq_dy: Array
    dq_dv: Array
    dv_dy: Array
    dv_dv: Array


def sensitivity(
    trajectory: Trajectory, torque_slopes: TorqueSlopes | None = None, mode: ArrayLike | None = None
) -> Sensitivity:
    """How the end of a run with stops, friction and locks changes with its start.

    Steps are taken again with their derivatives, and where one phase ends and another begins the change jumps
    by the saltation matrix Ξ = R_x + (ẋ⁺ − R_x ẋ⁻) ∇c / ċ⁻: at an impact, at the end of slipping, where a
    springy stop is touched or left. At a release, and where dry friction gives way, it does not jump; at the
    time of a lock it is projected. Jumps and what is held are those of the smooth motion, which steps meet to
    their order: the result errs by O(step⁴).

    Parameters
    ----------
    trajectory : Trajectory
        Of `simulate` with `joints=`, an output at every step.
    torque_slopes : callable, optional
        As in `gradient`, of a torque that is a function.
    mode : array_like, optional
        As in `simulate`, where the run began at a singular configuration.

    Raises
    ------
    NotDifferentiableError
        Where a stop is grazed, several are met at once, or the run begins with an impact.
    OptionError
        For another run, and where steps taken again do not end at the recorded states.
    SimulationError
        Where a state on the way has no certified derivatives.
    """
    if not isinstance(trajectory, Trajectory):
        raise OptionError(f"sensitivity: {shown(trajectory)} is no Trajectory; give what simulate returns")
    check_callable("torque_slopes", torque_slopes, "(t, q, v)")
    if trajectory.dissipated is None:
        raise OptionError(
            "sensitivity: the run has no stops, friction or locks (joints=); rg.gradient differentiates it"
        )
    mode = require_steps(trajectory, mode, "sensitivity")
    if trajectory.acted is not None:
        torque_slopes = slopes_of_all(trajectory.mechanism, torque_slopes, trajectory.acted.wrenches)
    chain = Chain(trajectory, torque_slopes, mode)
    changes = chain.start.whole
    for link in chain.links():
        changes = link.onward(changes) if isinstance(link, Link) else link.jump.matrix @ changes
    changes = np.where(chain.undefined, np.nan, changes)
    nv, m = trajectory.mechanism.nv, trajectory.mechanism.m
    return Sensitivity(changes[:nv, :m], changes[:nv, m:], changes[nv:, :m], changes[nv:, m:])
