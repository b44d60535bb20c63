"""Steps that nobody named: whether they serve, and what the run is taken again with where not.

The equations are linearised at the start: a step outside of RK4's stability region is cut into parts, and
where they would be too many, Radau takes over. A motion that becomes too fast on the way shows in its energy,
in joints that move by more than a radian in a step, or in steps that lose their branch or the finite numbers;
it is taken again with error control. Both are told by a warning, and the times recorded stay those of the
usual step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.prescribed.control import Controls
from ...dynamics.tableau import Tableau
from ...errors import BranchError, ClosureError, NonFiniteError, SimulationError
from ...warning import warn
from ..trajectories.trajectory import Trajectory
from .schedule import Schedule
from .too_long_steps import CoarseStepWarning

CONTROLLED, STIFF = "DOP853", "Radau"
"""What takes over: where a motion becomes too fast on the way, and where it is stiff from the start."""

FINER = 16
"""Parts of the step where that stops too, as where coordinates have to be changed on the way."""

TOO_LONG = (BranchError, NonFiniteError)
"""Errors that shorter steps may mend."""


def is_guarded(
    stepper: str | Tableau, method: str, drive: object, torque: Torque | ArrayLike | None,
    ctrl: Controls | None, backend: str,
) -> bool:  # fmt: skip
    """Whether a run without a named step may be cut into parts, and taken again where that fails.

    Not where a function of torques or controls would be called for runs that come to nothing, where joints
    are driven, or where the caller insists on a stepper, a method or the kernel.
    """
    usual = stepper == "rk4" and method == "bridge" and backend != "native"
    controls = ctrl.values() if isinstance(ctrl, Mapping) else ()
    return usual and drive is None and not any(map(callable, (torque, *controls)))


def words_of(stop: SimulationError | ClosureError) -> str | None:
    """An error that shorter steps may mend, in words; None for others."""
    return f"{type(stop).__name__}: {stop}" if isinstance(stop, TOO_LONG) else None


def taken_again(run: Callable[..., Trajectory], schedule: Schedule, step: float, fault: str) -> Trajectory:
    """The run by a stepper that chooses its steps, or, where that stops, in finer ones of RK4; it is told."""
    told = f"no step was named, and steps of {step:g} s do not serve ({fault}); the motion is taken again"
    try:
        found = run(stepper=CONTROLLED)
    except SimulationError as stop:  # a solver's long trials leave a zone where coordinates have to change
        finer = step / FINER
        warn(f"{told} in steps of {finer:.4g} s, as {CONTROLLED} stops ({stop})", CoarseStepWarning)
        return run(step=finer, outputs=schedule.outputs)
    warn(f"{told} with error control, stepper={CONTROLLED!r}, and recorded as before", CoarseStepWarning)
    return found
