"""An initial value problem set out: coordinates, explicit map, equations of motion and first state."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..maps.choice import KernelMap, MapChoice
from ..maps.cluster.cluster_map import ClusterMap
from ..maps.explicit import Counters, ExplicitMap, Point
from ..maps.grouped_start import initial_point_of_motion
from ..maps.regular_path import RegularPath
from ..maps.start import Start
from ..maps.start_check import require_freedom
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from .equations import EquationsOfMotion, Evaluation, Torque, does_work
from .prescribed.drive import Drive
from .prescribed.driven import DrivenEquations, driven_start


class Problem:
    """What a stepper needs of a motion; its map and equations are made where they are first asked for.

    As long as the compiled kernel goes on by itself neither is, and the motion is where `resume` says.

    Parameters
    ----------
    start : Start
        Checked.
    torque : callable, array_like or None
    choice : MapChoice
    drive : Drive, optional
        Prescribed motions.

    Attributes
    ----------
    mechanism : Mechanism
    counters : Counters
        What was computed so far.
    works : bool
        Whether something acts whose work no potential energy accounts for.
    x : ndarray
        The first state: (y, u), with the work done so far, 0 J, where `works`. u = ẏ but on
        groups, see `maps.grouped`.
    first : Evaluation or None
        At x, where it is known already.
    """

    def __init__(
        self, start: Start, torque: Torque | ArrayLike | None, choice: MapChoice, drive: Drive | None = None
    ) -> None:
        self.mechanism, self.counters = start.mechanism, start.path.counters
        self.start, self.choice, self.drive, self.torque = start, choice, drive, torque
        self.works = drive is not None or does_work(self.mechanism, torque)
        self.x: Array = np.concatenate([start.point.y, start.ydot, np.zeros(int(self.works))])
        self.first: Evaluation | None = None
        self._explicit: ExplicitMap | None = None
        self._reached: tuple[Point, Callable[[], Array] | None] | None = None

    @property
    def explicit(self) -> ExplicitMap:
        """The explicit map, where the motion is."""
        if self._explicit is None:
            self._explicit = self.choice.over(self.start)
            if self._reached is not None:
                self.resume(*self._reached)
        return self._explicit

    @cached_property
    def equations(self) -> EquationsOfMotion:
        """ẋ = f(t, x)."""
        if self.drive is None:
            return EquationsOfMotion(self.mechanism, self.explicit, self.torque)
        return DrivenEquations(self.mechanism, self.explicit, self.torque, self.drive)

    @property
    def path(self) -> RegularPath:
        """What solves on regular ground."""
        return self.start.path if self._explicit is None else self._explicit.path

    @property
    def trackers(self) -> Callable[[], Array] | None:
        """What tells the clusters' trackers as plain numbers, where the motion is in a zone."""
        if self._explicit is None and not self.start.trackers:
            return None if self._reached is None else self._reached[1]
        rest = self.explicit.rest
        return rest.written if isinstance(rest, ClusterMap) and rest.in_zone else None

    def resume(self, anchor: Point, trackers: Callable[[], Array] | None) -> None:
        """Go on from a point that the kernel reached; see `ClusterMap.resume`."""
        if self._explicit is None:
            self._reached = anchor, trackers
        else:
            assert isinstance(self._explicit, KernelMap)  # the kernel knows no other map
            self._explicit.resume(anchor, trackers)


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
        As `maps.start.initial_point` does.
    """
    require_freedom(mechanism)
    choice = MapChoice() if choice is None else choice
    counters = Counters() if counters is None else counters
    q = mechanism.home if q0 is None else q0
    if drive is not None:
        q = driven_start(mechanism, drive, q0, v0, mode, choice, counters)
    start = initial_point_of_motion(mechanism, q, v0, mode, choice.options, counters)
    if drive is not None:
        # v0 that is left out is at rest, and the drive may begin with a velocity
        start.ydot = start.ydot.copy()
        start.ydot[drive.driven] = drive.motion_at(drive.start)[1]
    return Problem(start, torque, choice, drive)
