"""The first event on steps of a phase, which is located on a partial step of its own."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from .admissible import Seen
from .decision import Phase, State
from .machine import Machines
from .partial_steps import Partial
from .phase_run import Steps
from .record import Block
from .rows import Kind
from .watch import BELOW, Found, Holding, Signals

SHALLOW = 1e-6
"""m or rad: a stop that is passed by less is looked at on a partial step, since the interpolant errs."""

MANY = 4
"""Ends of steps from which on forces are found all at once."""

ROUGHLY = 1e-4
"""Share of a step to which a break is found on the interpolated motion, which errs by more."""

CORRECTIONS = 5
"""Partial steps to an event: one or two do."""


class Stretch:
    """Steps of a phase, as they are looked at.

    Parameters
    ----------
    machines : Machines
    machine : Mechanism
        Of the phase.
    phase : Phase
    """

    def __init__(self, machines: Machines, machine: Mechanism, phase: Phase) -> None:
        self._machines, self._machine, self._phase = machines, machine, phase
        self._size, self._within = len(machines.rows.rows), not machines.course.schedule.plain
        self._signals = Signals(machines.rows, phase)
        self._holding = Holding(machines.bounds, phase)
        self._bounds, self._acting = machines.sliding(phase, machine), machines.acting(phase)
        self.guard = self._signals.guard()
        self._partial = Partial(machines, machine, machines.torque_of(phase, machine))

    # ----------------------------------------------------------------- which event comes first

    @property
    def looks(self) -> bool:
        """Whether steps count in which the guard is not met: something is held, or outputs lie within."""
        return bool(self._holding) or self._within

    @property
    def limited(self) -> bool:
        """Whether forces of what is held are to be looked at after each step."""
        return self._holding.limited

    def first(self, steps: Steps, seen: Seen, since: int = 0) -> tuple[Found | None, Array]:
        """The first event, and the forces (N, n) of what is held as far as that.

        Gaps and rates are looked at from the end of step number `since` on.
        """
        holding, n = self._holding, len(steps.t)
        none = set[tuple[int, int]]()
        while True:  # until one that is there: the interpolant may pass a stop that the motion does not meet
            t, q, v, a = (part[since:] for part in (steps.t, steps.q, steps.v, steps.a))
            found = self._signals.first(t, q, v, a, none, since)
            if found is None or found.depth > SHALLOW or self._is_reached(steps, found, seen):
                break
            none.add((found.step, found.row))
        # forces as far as the end of the event's step: what was taken beyond it does not count
        held, margins = self._held(steps.first(n if found is None else found.step + 2), n)
        broken = np.flatnonzero(margins[1:] < 0.0)
        if not (holding.limited and len(broken)) or (found is not None and found.step < broken[0]):
            return found, held
        step = int(broken[0])
        share = self._broken(steps, step)
        # both in one step: where they are in it decides
        earlier = found is not None and found[:2] < (step, share)
        return (found if earlier else Found(step, share, -1)), held

    def _held(self, steps: Steps, n: int) -> tuple[Array, Array]:
        """Forces (n, …) of what is held and margins (n,) at these ends of steps, up to one that breaks."""
        holding, held, margins = self._holding, np.zeros((n, self._size)), np.full(n, np.inf)
        if not holding:
            return held, margins
        many = steps.regular and len(steps.t) > MANY  # near a singular place λ by K loses its digits
        if many and (quick := holding.along(self._machine, steps)) is not None:
            held[: len(steps.t)], margins[: len(steps.t)] = quick
            return held, margins
        for k in range(len(steps.t)):
            held[k], margins[k] = holding.forces(steps.t[k], steps.q[k], steps.v[k], steps.a[k], steps.tau[k])
            if k and holding.limited and margins[k] < 0.0:  # at the start it was decided that they hold
                break
        return held, margins

    def forces(self, steps: Steps, k: int) -> Array:
        """Of what is held, at the end of a step, (n,)."""
        if not self._holding:
            return np.zeros(self._size)
        return self._holding.forces(steps.t[k], steps.q[k], steps.v[k], steps.a[k], steps.tau[k])[0]

    def block(self, steps: Steps, held: Array) -> Block:
        """Ends of steps for the record, with the forces (N, n) of what is held."""
        bounds, rows, n = self._machines.bounds, self._machines.rows, len(steps.t)
        sliding = bounds.sliding(self._phase)
        if not sliding:
            return Block.of(steps, held, bounds.constant[None].repeat(n, axis=0), np.zeros(n))
        E = np.array([self._phase.slip[i] * rows.E[i] for i in sliding])
        F = bounds(steps.t, steps.q, steps.v, steps.a, steps.tau + held @ rows.E)
        power = np.einsum("nk,nk->n", F[:, sliding], steps.v @ E.T)
        h, heat, within = np.diff(steps.t), np.zeros(n), steps.t[:-1] + 0.5 * np.diff(steps.t)
        for k, t in enumerate(within.tolist()):  # Simpson's rule
            q, v, _ = steps.motion_at(t)
            middle = float(self._bounds(t, q, v)[sliding] @ (E @ v))
            heat[k + 1] = heat[k] + h[k] / 6.0 * (power[k] + 4.0 * middle + power[k + 1])
        return Block.of(steps, held, F, heat)

    def _is_reached(self, steps: Steps, found: Found, seen: Seen) -> bool:
        """Whether a stop is met, where the interpolant would go beyond it by little more than it errs."""
        k = found.step
        lowest = float(steps.t[k] + found.lowest * (steps.t[k + 1] - steps.t[k]))
        if self._machines.rows.rows[found.row].kind is not Kind.STOP or found.lowest == 1.0:
            return True  # beyond it at the step's end, which is no interpolation
        part = self.part(State.of(steps, k, seen), lowest)
        return self._signals.signal_at(found.row, part.q[-1], part.v[-1], part.a[-1])[0] < -BELOW

    def _broken(self, steps: Steps, step: int) -> float:
        """The share of the step at which the margin of what is held is 0, on the interpolated motion."""
        h = steps.t[step + 1] - steps.t[step]

        def margin(x: float) -> float:
            return self._margin(steps, float(min(steps.t[step] + x * h, steps.t[step + 1])))

        if margin(0.0) <= 0.0:
            return 0.0
        return 1.0 if margin(1.0) >= 0.0 else float(brentq(margin, 0.0, 1.0, xtol=ROUGHLY))

    def _margin(self, steps: Steps, t: float) -> float:
        q, v, a = steps.motion_at(t)
        return self._holding.margin(t, q, v, a, self._acting(t, q, v, self._bounds(t, q, v)))

    # ----------------------------------------------------------------- where it is

    def part(self, start: State, end: float) -> Steps:
        """One step from a state on."""
        machines, torque = self._machines, None
        if machines.held is not None:
            torque = machines.held.spanning((start.t, end), machines.constant(self._phase)).value
        part = self._partial.step(start, end, torque)
        return self._machines.part(self._machine, self._phase, start, end) if part is None else part

    def located(self, start: State, h: float, found: Found) -> Steps | None:
        """A partial step to an event of a step h, until its function vanishes; None where that is at once."""
        x, begin = found.share, start.t
        part: Steps | None = None
        before: tuple[float, float] | None = None
        for _ in range(CORRECTIONS):
            if x * h < max(1e-15, 4.0 * np.spacing(abs(begin))):  # no step can be taken to it
                return None
            part = self.part(start, begin + x * h)
            value, slope = self._value(part, found, h, before is None)
            # of a margin no slope is known after the first: the secant through both partial steps
            slope = slope if before is None or found.row >= 0 else (value - before[1]) / (x - before[0])
            # a last bit of t changes the function by as much
            exact = max(1e-14, -slope * float(np.spacing(abs(begin) + h)) / h)
            if abs(value) <= exact or slope >= 0.0 or abs(value) > -1e-3 * slope:
                break
            if before is not None and abs(value) > 0.5 * abs(before[1]):  # rounding
                break
            if before is not None and (secant := (value - before[1]) / (x - before[0])) < 0.5 * slope:
                slope = secant  # a partial step errs by its length too
            before, x = (x, value), min(x - value / slope, 1.0)
        return part

    def _value(self, part: Steps, found: Found, h: float, sloping: bool) -> tuple[float, float]:
        """The event's function at the end of a partial step, and its slope by a share of the step h.

        That of a margin is a difference, and 0 where it is not asked for.
        """
        q, v, a = part.q[-1], part.v[-1], part.a[-1]
        if found.row >= 0:
            value, rate = self._signals.signal_at(found.row, q, v, a)
            return value - found.begun, rate * h
        value = self._holding.margin(float(part.t[-1]), q, v, a, part.tau[-1])
        if not sloping:
            return value, 0.0
        dt = min(1e-3 * h, 0.5 * float(part.t[-1] - part.t[0]))
        return value, (value - self._margin(part, float(part.t[-1]) - dt)) / dt * h
