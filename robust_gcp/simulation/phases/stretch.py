"""Steps of one phase up to its next event, which is located on a partial step of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from ...errors import ClosureError, SimulationError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .decision import Phase, State
from .machine import Machines
from .rows import Kind
from .watch import BELOW, Found, Holding, Signals, first_break

if TYPE_CHECKING:
    from ..trajectory import Trajectory

FINER = (4, 16, 64)
"""Parts of a step that fails: a stop may be what keeps the mechanism from the place where it does."""

SHALLOW = 1e-6
"""m or rad: a stop that is passed by less is looked at on a partial step, since the interpolant errs."""

CORRECTIONS = 5
"""Partial steps to an event: one or two do."""


@dataclass
class Walked:
    """A stretch of steps.

    Attributes
    ----------
    run : Trajectory
    count : int
        Outputs of it before the event, or all.
    held : ndarray (count, n)
        Forces of what is held.
    found : Found or None
        The event, in the step that begins at the last of them.
    part : Trajectory or None
        From there to the event; None where it is at the step's beginning.
    part_held : ndarray (2, n)
    """

    run: Trajectory
    count: int
    held: Array
    found: Found | None = None
    part: Trajectory | None = None
    part_held: Array | None = None


class Stretch:
    """Steps of a phase.

    Parameters
    ----------
    machines : Machines
    machine : Mechanism
        Of the phase.
    phase : Phase
    """

    def __init__(self, machines: Machines, machine: Mechanism, phase: Phase) -> None:
        self._machines, self._machine, self._phase = machines, machine, phase
        self._size = len(machines.rows.rows)
        self._signals, self._holding = Signals(machines.rows, phase), Holding(machines.rows, phase)

    def taken(self, start: State, times: Array) -> Walked:
        """Steps that end at these times, as far as the first event.

        Raises
        ------
        SimulationError, ClosureError
            Where a step fails and no event comes before it.
        """
        run, fault = self._marched(start, times)
        found, held = self._first(run, start.seen.toward)
        if fault is not None and len(run.t) < 2:
            for parts in FINER:
                run, _ = self._marched(start, np.linspace(times[0], times[1], parts + 1))
                found, held = self._first(run, start.seen.toward)
                if found is not None:
                    break
            else:
                raise fault
        if found is None:
            return Walked(run, len(run.t), held)
        k = found.step
        part = self._located(run, found, start)
        walked = Walked(run, k + 1, held[: k + 1], found, part)
        if part is not None:
            walked.part_held = np.array([held[k], self._forces(part, -1)])
        return walked

    def first_output(self, start: State, after: float) -> Walked:
        """The state at the beginning of a step, with its accelerations."""
        run = self._march(start, np.array([start.t, after]))
        return Walked(run, 1, self._forces(run, 0)[None])

    def _march(self, start: State, times: Array) -> Trajectory:
        return self._machines.march(self._machine, self._phase, times, start.q, start.v, start.seen.toward)

    def _marched(
        self, start: State, times: Array
    ) -> tuple[Trajectory, SimulationError | ClosureError | None]:
        """The steps, and what stopped them before their end."""
        try:
            return self._march(start, times), None
        except (SimulationError, ClosureError) as error:
            if error.trajectory is None or not len(error.trajectory.t):
                raise
            return error.trajectory, error

    # ----------------------------------------------------------------- which event comes first

    def _is_reached(self, run: Trajectory, found: Found, toward: Array) -> bool:
        """Whether a stop is met, where the interpolant would go beyond it by little more than it errs."""
        k = found.step
        lowest = float(run.t[k] + found.lowest * (run.t[k + 1] - run.t[k]))
        times = np.array([run.t[k], lowest])
        if self._machines.rows.rows[found.row].kind is not Kind.STOP or found.lowest == 1.0:
            return True
        part = self._machines.march(self._machine, self._phase, times, run.q[k], run.v[k], toward)
        assert part.a is not None
        return self._signals.at(found.row, part.q[-1], part.v[-1], part.a[-1])[0] < -BELOW

    def _first(self, run: Trajectory, toward: Array) -> tuple[Found | None, Array]:
        """The first event of a stretch, and the forces of what is held as far as that."""
        assert run.a is not None
        holding, n = self._holding, len(run.t)
        found, none = None, set[tuple[int, int]]()
        while True:
            found = self._signals.first(run.t, run.q, run.v, run.a, none)
            if found is None or found.depth > SHALLOW or self._is_reached(run, found, toward):
                break
            none.add((found.step, found.row))
        held, margins = np.zeros((n, self._size)), np.full(n, np.inf)
        for k in range(n if found is None else found.step + 2) if holding else ():
            held[k], margins[k] = holding.forces(run.q[k], run.v[k], run.a[k], torque_at(run, k))
            if k and holding.limited and margins[k] < 0.0:
                break
        step = first_break(margins[1:]) if holding.limited else None
        if step is None or (found is not None and found.step < step):
            return found, held
        share = self._broken(run, step)
        earlier = found is not None and found[:2] < (step, share)
        return (found if earlier else Found(step, share, -1)), held

    def _broken(self, run: Trajectory, step: int) -> float:
        """The share of the step at which the margin of what is held is 0, on the interpolated motion."""
        h = run.t[step + 1] - run.t[step]

        def margin(x: float) -> float:
            return self._margin(run, float(min(run.t[step] + x * h, run.t[step + 1])))

        if margin(0.0) <= 0.0:
            return 0.0
        return 1.0 if margin(1.0) >= 0.0 else float(brentq(margin, 0.0, 1.0, xtol=1e-13))

    def _margin(self, run: Trajectory, t: float) -> float:
        s = run.at(t)
        return self._holding.margin(s.q, s.v, s.a, self._machines.acting(self._phase)(t, s.q, s.v))

    def _forces(self, run: Trajectory, k: int) -> Array:
        if not self._holding:
            return np.zeros(self._size)
        assert run.a is not None
        return self._holding.forces(run.q[k], run.v[k], run.a[k], torque_at(run, k))[0]

    # ----------------------------------------------------------------- where it is

    def _located(self, run: Trajectory, found: Found, start: State) -> Trajectory | None:
        """A partial step to the event, corrected until the event's own function vanishes."""
        k, x = found.step, found.share
        h, begin = float(run.t[k + 1] - run.t[k]), float(run.t[k])
        here = State(begin, run.q[k], run.v[k], start.seen)
        part: Trajectory | None = None
        for _ in range(CORRECTIONS):
            if x * h < max(1e-15, 4.0 * np.spacing(abs(begin))):
                return None
            part = self._march(here, np.array([begin, begin + x * h]))
            value, slope = self._value(part, found, h)
            if abs(value) <= max(1e-14, -1e-15 * slope) or slope >= 0.0 or abs(value) > -1e-3 * slope:
                break
            x = min(x - value / slope, 1.0)
        return part

    def _value(self, part: Trajectory, found: Found, h: float) -> tuple[float, float]:
        """The event's function at the end of a partial step, and its slope by a share of the step h."""
        assert part.a is not None
        q, v, a = part.q[-1], part.v[-1], part.a[-1]
        if found.row >= 0:
            value, rate = self._signals.at(found.row, q, v, a)
            return value, rate * h
        value = self._holding.margin(q, v, a, torque_at(part, -1))
        dt = min(1e-3 * h, 0.5 * float(part.t[-1] - part.t[0]))
        return value, (value - self._margin(part, float(part.t[-1]) - dt)) / dt * h


def torque_at(run: Trajectory, k: int) -> Array:
    """All that acts besides gravity at an output."""
    return np.zeros(run.v.shape[1]) if run.tau is None else np.asarray(run.tau[k])
