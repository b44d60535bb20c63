"""An initial value problem set out: coordinates, explicit map, equations of motion and first state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..maps.choice import MapChoice
from ..maps.explicit import Counters, ExplicitMap
from ..maps.grouped_start import initial_point_of_motion
from ..maps.start import Start
from ..maps.start_check import require_freedom
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .equations import EquationsOfMotion, Evaluation, Torque
from .prescribed.drive import Drive
from .prescribed.driven import DrivenEquations, driven_start


@dataclass(frozen=True)
class Problem:
    """What a stepper needs.

    Attributes
    ----------
    mechanism : Mechanism
    start : Start
    explicit : ExplicitMap
    equations : EquationsOfMotion
        ẋ = f(t, x).
    x : ndarray
        The first state: (y, u), with the work done so far, 0 J, where something does work. u = ẏ but on
        groups, see `maps.grouped`.
    first : Evaluation or None
        At x, where it is known already.
    """

    mechanism: Mechanism
    start: Start
    explicit: ExplicitMap
    equations: EquationsOfMotion
    x: Array
    first: Evaluation | None = None


def initial_value_problem(
    mechanism: Mechanism,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    mode: ArrayLike | None = None,
    torque: Torque | ArrayLike | None = None,
    choice: MapChoice | None = None,
    counters: Counters | None = None,
    drive: Drive | None = None,
) -> Problem:
    """Check a start and make all that follows from it; the one way to a motion.

    Parameters
    ----------
    q0, v0 : array_like (nq,), (nv,), optional
        The mechanism's home, at rest, when left out.
    mode, torque
        As in `simulate`.
    choice : MapChoice, optional
        Bridges with their usual options when left out.
    counters : Counters, optional
        Incremented as work is done.
    drive : Drive, optional
        Prescribed motions, from their start on.

    Raises
    ------
    StateError, ClosureError, OptionError, SimulationError
        As `maps.start.begin` does.
    """
    require_freedom(mechanism)
    choice = MapChoice() if choice is None else choice
    counters = Counters() if counters is None else counters
    q = mechanism.home if q0 is None else q0
    if drive is not None:
        q = driven_start(mechanism, drive, q0, v0, mode, choice, counters)
    start = initial_point_of_motion(mechanism, q, v0, mode, choice.options, counters)
    if drive is not None:
        start.ydot = start.ydot.copy()
        start.ydot[drive.driven] = drive.motion_at(drive.start)[1]
    return over(start, torque, choice, drive)


def over(
    start: Start, torque: Torque | ArrayLike | None, choice: MapChoice, drive: Drive | None = None
) -> Problem:
    """The motion from a checked start, with a map and equations of its own."""
    mechanism, explicit = start.mechanism, choice.over(start)
    if drive is None:
        equations = EquationsOfMotion(mechanism, explicit, torque)
    else:
        equations = DrivenEquations(mechanism, explicit, torque, drive)
    x = np.concatenate([start.point.y, start.ydot, np.zeros(int(equations.works))])
    return Problem(mechanism, start, explicit, equations, x)
