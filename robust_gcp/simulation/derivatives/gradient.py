"""Gradient of a cost along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import overload

from numpy.typing import ArrayLike

from ...checks import check_callable, shown
from ...dynamics.equations import Torque
from ...dynamics.torque_feedback import TorqueSlopes, slopes_of_all
from ...errors import OptionError
from ...mechanism.building.lengths import Along, in_parts
from ...mechanism.building.variable_geometry import is_geometry
from ..batches.runs import Runs
from ..trajectories.trajectory import Trajectory
from .cost import Cost, Gradient
from .reverse_sweep import ReverseSweep
from .run_again import require_steps


@overload
def gradient(
    trajectory: Trajectory,
    cost: Cost,
    torque: Torque | ArrayLike | None = None,
    parameters: Sequence[str | Along] = (),
    torque_slopes: TorqueSlopes | None = None,
    mode: ArrayLike | None = None,
) -> Gradient: ...


@overload
def gradient(
    trajectory: Runs,
    cost: Cost,
    torque: Torque | ArrayLike | None = None,
    parameters: Sequence[str | Along] = (),
    torque_slopes: TorqueSlopes | None = None,
    mode: ArrayLike | None = None,
) -> list[Gradient | None]: ...


def gradient(
    trajectory: Trajectory | Runs,
    cost: Cost,
    torque: Torque | ArrayLike | None = None,
    parameters: Sequence[str | Along] = (),
    torque_slopes: TorqueSlopes | None = None,
    mode: ArrayLike | None = None,
) -> Gradient | list[Gradient | None]:
    """Derivatives of a cost by the start, the torques and parameters, exact for the steps that were taken.

    Through singular configurations, impacts, holds and releases too. The run has an output at every step; the
    start is its first output, and the time of its end is held, also where a terminal event ended it.

    Parameters
    ----------
    trajectory : Trajectory or Runs
        Of many runs a list comes back: one of each, None where a start took no step.
    cost : Cost
    torque : callable (t, q, v) -> (nv,), array_like (nv,) or (N, nv), or mapping, optional
        What the run was made with; a table holds a row for each step. When left out, what the trajectory
        remembers: see `Acted`. Wrenches that it remembers are added to a function or constant; of torques
        that were held a function is asked at the beginning of each step.
    parameters : sequence of str
        See `Parameters`: "q1.m", "q2.Ixx", "q1.stiffness", …; placements of joints and of frames of closures
        and springs, m and rad: "q3.placement.x", "coupler_tip.placement.rz"; `rg.along(joint, frame)`.
    torque_slopes : callable, optional
        ∂τ/∂q and ∂τ/∂v of a torque that is a function, see `derivatives`.
    mode : array_like, optional
        As in `simulate`, where the run began at a singular configuration.

    Raises
    ------
    OptionError
        Where steps taken again do not end at the recorded states: another torque or mode; for runs of other
        steppers or with other outputs than their steps, and where a torque function or a prescribed motion is
        needed that a file does not hold; for `torque=` and `parameters=` of runs with `joints=`.
    SimulationError
        Where a state on the way has no certified derivatives; where the independent joints turn back at the
        start, so that the run took others. NotDifferentiableError as `sensitivity`.
    """
    if isinstance(trajectory, Runs):
        others = cost, torque, parameters, torque_slopes, mode
        return [None if run is None or len(run.t) < 2 else gradient(run, *others) for run in trajectory]
    if not isinstance(trajectory, Trajectory):
        raise OptionError(f"gradient: {shown(trajectory)} is no Trajectory; give what simulate returns")
    if not isinstance(cost, Cost):
        raise OptionError(f"gradient: cost = {shown(cost)} is no Cost; give rg.Cost(terminal, running)")
    check_callable("torque_slopes", torque_slopes, "(t, q, v)")
    mode = require_steps(trajectory, mode, "gradient")
    parts = in_parts(trajectory.mechanism, parameters)
    names = list(dict.fromkeys(name for part in parts for name in part))
    moved = any(is_geometry(name) for name in names)
    if trajectory.acted is not None and not moved:  # else they change with the placements
        torque_slopes = slopes_of_all(trajectory.mechanism, torque_slopes, trajectory.acted.wrenches)
    if trajectory.dissipated is not None:
        from ..phases.gradient import pulled  # loaded where it is used

        return pulled(trajectory, cost, torque, names, torque_slopes, mode)
    if moved:
        from .geometry_gradient import by_geometry  # loaded where it is used

        found = by_geometry(trajectory, cost, torque, names, torque_slopes, mode)
    else:
        found = ReverseSweep(trajectory, cost, torque, names, torque_slopes, mode).gradient()
    sums = [sum(weight * found.parameters[name] for name, weight in part.items()) for part in parts]
    return replace(found, parameters=dict(zip(map(str, parameters), sums, strict=True)))
