"""One simulation in progress: what steps of all kinds have in common."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np

from ...dynamics.equations import Evaluation
from ...dynamics.prescribed.control import Actuated
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...dynamics.problem import Problem, initial_value_problem
from ...errors import CuspError, SimulationError
from ...maps.classical import SingularityWarning
from ...maps.cluster.cluster_map import ClusterMap
from ...maps.explicit import Point
from ...maps.start import Start
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...warning import warn
from ..events import NO_EVENTS, Event, Events, Zero
from ..trajectories.acted import Acted, controls_along
from ..trajectories.trajectory import Trajectory
from .coordinates import Coordinates, in_coordinates
from .crossings import q_of_rest
from .record import Record
from .recovery import Checkpoint
from .schedule import ALL, Keep, Schedule
from .solver_rates import Following
from .stats import Stats, Stretches
from .within_steps import DenseStep, FixedStep

TOLD = 3e-9
"""Relative error of G by rounding that a warning tells."""


class Run:
    """One simulation in progress.

    Parameters
    ----------
    motion : Problem
        What the run begins with; a change of coordinates replaces it.
    schedule : Schedule
        Steps and outputs.
    record : sequence of {"a", "energy", "multipliers", "tau"}
    on_toggle : {"error", "repartition"}
    progress : callable (fraction) or None
    events : sequence of Event, or Events
        Those of a longer run, of which this one is a part.
    named : Mechanism, optional
        In the coordinates that the user named, where the motion begins in others.
    keep : Keep
        Which outputs stay where there is no more room for them.

    Attributes
    ----------
    stepper : str
        As in `Stats`.
    fixed : bool
        Whether its steps have one length.
    acted : Acted or None
        What its trajectory is to remember.
    """

    stepper = "rk4"
    fixed = True

    def __init__(
        self,
        motion: Problem,
        schedule: Schedule,
        record: Sequence[str],
        on_toggle: str,
        progress: Callable[[float], None] | None = None,
        events: Sequence[Event] | Events = (),
        named: Mechanism | None = None,
        keep: Keep = ALL,
    ) -> None:
        self._motion, self._x, self._counters = motion, motion.x, motion.counters
        self._schedule = schedule
        self._on_toggle, self._progress = on_toggle, progress
        self._named = motion.mechanism if named is None else named
        times = schedule.times
        begin, first = float(times[0]), float(times[1] - times[0])
        self._events = NO_EVENTS
        if events:
            self._events = events if isinstance(events, Events) else Events(events, begin, first)
        self._record = Record(self._named, schedule, record, motion, keep, bool(self._events))
        self._ended = False
        self._repartitions: list[tuple[float, tuple[str, ...]]] = []
        if motion.mechanism is not self._named:
            self._repartitions.append((float(times[0]), motion.mechanism.independent))
        self._stretches: Stretches = []  # taken with error control
        self.acted: Acted | None = None
        self._lost, self._told = (0.0, np.inf), False
        self._coordinates = self._looked_after()
        self._last: Evaluation | None = None

    def go(self) -> None:
        """Take all steps."""
        raise NotImplementedError

    @property
    def times(self) -> Array:
        """The start and the ends of the steps, s."""
        return self._schedule.times

    @property
    def independent(self) -> tuple[str, ...]:
        """The joints that are independent now."""
        return self._motion.mechanism.independent

    def arrive(self, error: CuspError) -> None:
        """Tell a cusp when and how the motion arrives there from the last output.

        Not when and how under torques that are held, which are others by then.
        """
        from .cusp import arrive  # a run without one need not load it

        motion, record = self._motion, self._record
        point = motion.start.point
        start = float(self.times[0]), point.q, point.G @ motion.start.ydot
        state = (record.time, *record.state()) if record.count else start
        end, options = float(self.times[-1]), motion.choice.options
        with suppress(SimulationError, np.linalg.LinAlgError):  # the cusp is told of without it
            arrive(error, motion.mechanism, motion.equations.acting, state, end, options)
        if isinstance(motion.torque, HeldTorque):
            error.time = error.v = error.arrival = None

    def _keep_within(
        self, rows: Sequence[int], step: FixedStep | DenseStep, zeros: Sequence[Zero], now: Evaluation
    ) -> None:
        """Keep what lies within a step: outputs in `rows`, and events up to one that ends the run.

        The map is put back to the step's end, where the evaluation is, if it was asked and the run goes on.
        """
        waiting = list(zeros)
        for row in rows:
            t = float(self._schedule.outputs[row])
            while waiting and waiting[0].t < t:  # by time: no output after what ends the run
                self._keep_zero(waiting.pop(0), step)
            if self._ended:
                return
            x = step.x(t)
            self._record.keep(row, self._motion.equations.evaluate(t, x), x)
        for zero in waiting:
            self._keep_zero(zero, step)
        if (rows or zeros) and not self._ended:
            self._motion.explicit.point_at(now.point.y, now.point.ydot)

    def _keep_zero(self, zero: Zero, step: FixedStep | DenseStep) -> None:
        """Keep an event; where it ends the run, the state there too."""
        x, m = step.x(zero.t), self._motion.mechanism.m
        if zero.ends:
            now = self._motion.equations.evaluate(zero.t, x)
            self._events.add(zero, now.point.q, now.v)
            self._record.end(zero.t, now, x)
            self._last, self._ended = now, True
        else:
            point = self._motion.explicit.point_at(x[:m], x[m : 2 * m])
            self._events.add(zero, point.q, point.G.dot(point.ydot))

    def _cluster_map(self) -> ClusterMap:
        explicit = self._motion.explicit.rest
        assert isinstance(explicit, ClusterMap)  # no other map knows uncertified zones
        return explicit

    def _rounding(self, following: Following, wanted: float = 0.0) -> float:
        """The least tolerance to ask for; what rounding costs of G is told once, afterwards, if it shows."""
        lost, asked, distance = following.rounding()
        self._lose(lost, distance, wanted)
        return asked

    def _lose(self, lost: float, distance: float, wanted: float = 0.0) -> None:
        """Take note of what rounding costs of G beside a singular place without a bridge."""
        # the worst of a passage, of which one knows when half of it is left: one warning, not one a step
        if lost > max(TOLD, wanted, self._lost[0]):
            self._lost = lost, distance
        elif lost < 0.5 * self._lost[0]:
            self._tell_what_is_lost()

    def _tell_what_is_lost(self) -> None:
        """Warn of the nearest that the motion came to a singular place without a bridge."""
        (lost, distance), told = self._lost, self._told
        self._lost, self._told = (0.0, np.inf), True
        if not told:
            warn(
                f"the motion passed a singular place without a bridge at a distance of {distance:.1g}: "
                f"rounding leaves it right to {lost:.1e} there, whatever the step",
                SingularityWarning,
            )

    def _looked_after(self) -> Coordinates | None:
        """What looks after the present coordinates, where they may be changed."""
        if self._on_toggle == "error":
            return None
        return Coordinates(self._motion.mechanism, self._named.independent, self._counters, self.fixed)

    def _suspicious(self, point: Point) -> bool:
        """Whether the independent joints are to be looked at."""
        return self._coordinates is not None and self._coordinates.suspicious(point)

    def _turns_back(self, point: Point) -> bool:
        """Whether the independent joints are about to turn back, however evenly the others move."""
        return self._coordinates is not None and self._coordinates.turns_back(point)

    def _better(self, point: Point) -> tuple[str, ...] | None:
        """Joints that serve better than the independent ones beside bridges; None where these do well."""
        if self._coordinates is None:
            return None
        # a bridge has a parameter of its own: that y turns back on it does no harm
        on_bridge = self._motion.trackers is not None and self._cluster_map().on_bridge
        return None if on_bridge else self._coordinates.better(point)

    def _others(self, point: Point) -> tuple[str, ...] | None:
        """Joints that see more of the motion at a regular point than the independent ones do."""
        assert self._coordinates is not None  # asked for where coordinates may change
        return self._coordinates.best(point)

    def _repartition(self, i: int, t: float, names: tuple[str, ...] | None) -> Checkpoint:
        """Go on in other coordinates from the present state, at time i or later, which is returned."""
        if names is None:
            raise self._cluster_map().refusal()
        old, x = self._motion, self._x
        here, m = old.explicit.anchor, old.mechanism.m
        mechanism = in_coordinates(self._named, names)
        self._motion = self._problem_in(mechanism, here, here.G @ x[m : 2 * m])
        self._coordinates = self._looked_after()
        self._x = np.concatenate([self._motion.x[: 2 * m], x[2 * m :]])  # the work done goes on
        self._last = None
        # later ones are of steps that were gone back over
        self._repartitions = [(when, what) for when, what in self._repartitions if when < t]
        self._repartitions.append((t, names))
        return Checkpoint(i, self._x, self._motion.start.point)

    def _problem_in(self, mechanism: Mechanism, here: Point, v: Array) -> Problem:
        """The motion from here on in the coordinates of `mechanism`."""
        motion, explicit = self._motion, self._motion.explicit
        # there q tells φ to ε alone, and with it G to ε/δ²: the map's own tangents, not a start anew
        apart = explicit.beside_apex(mechanism) if isinstance(explicit, ClusterMap) else None
        if apart is not None:
            path, point, trackers = apart
            start = Start(path, point, v[mechanism.iv_independent], trackers)
            return Problem(start, motion.torque, motion.choice)
        more = None, motion.torque, motion.choice, motion.counters
        return initial_value_problem(mechanism, here.q, v, *more)

    def _accept(self, i: int, now: Evaluation) -> None:
        """Record the evaluation at time i."""
        if self._redundant:
            self._watch(now.point.q, i)  # before it is recorded as an output
        self._record.add(i, now, self._x)
        self._last = now
        if self._progress is not None:
            self._progress(i / (len(self.times) - 1))

    @property
    def _redundant(self) -> bool:
        """Whether rows of φ may be left open that do not determine the dependent joints."""
        path = self._motion.path
        return path.mechanism.nc > path.nd

    def _watch(self, q: Array, i: int) -> None:
        """Refuse to go on where rows of φ are left open."""
        explicit, rest = self._motion.explicit, self._motion.explicit.rest
        if isinstance(rest, ClusterMap):
            rest.require_closed(q_of_rest(explicit, q), f"at t = {self.times[i]:.6g} s")

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        if self._lost[0] > 0.0:
            self._tell_what_is_lost()
        stats = Stats(
            **vars(self._counters),
            repartitions=self._repartitions,
            refined=self._stretches,
            wall_seconds=time.perf_counter() - begun,
            stepper=self.stepper,
            step=float(self.times[1] - self.times[0]) if self.fixed else None,
        )
        found = self._record.trajectory(stats, self._events)
        found.acted = self.acted
        if self.acted is not None and isinstance(self.acted.torque, Actuated):
            found.u = controls_along(self.acted.torque, found.t, found.q, found.v)
        return found
