"""Events: zeros of functions of the motion, as scipy's solve_ivp knows them.

A function g(t, q, v) is looked at wherever a step ends. Where its sign changes over a step, the zero is found
on the motion between: for fixed steps on the polynomial of `trajectories.interpolant`, for a solver of
scipy's on its own dense output. So the time of an event has an error of the stepper's order, the fourth with
RK4. Two zeros within one step show no change of sign, and are not seen; nor does solve_ivp see them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy

from ..checks import check_callable, check_number, listed, shown
from ..errors import OptionError
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.tree import Array
from ..user_functions import returned

EventFunction = Callable[[float, Array, Array], float]

EVENTS = "rg.Event or functions (t, q, v), or a single one"

AT_START = 1e-9
"""Share of a run's first step within which a zero is one of the start."""

RTOL = 4.0 * float(np.finfo(float).eps)
"""Of the times of events: as close as brentq takes them."""


@dataclass(frozen=True)
class Event:
    """A function of the motion whose zeros `simulate` finds.

    A plain function serves too, as in solve_ivp, with attributes `terminal` and `direction` if need be.

    Parameters
    ----------
    function : callable (t, q, v) -> float
        Continuous. It is called more than once a step, and may not remember.
    terminal : bool or int
        Whether the run ends there; a number: at how many of them.
    direction : float
        Positive for zeros on the way up only, negative for those on the way down, 0 for all.

    Raises
    ------
    OptionError
        For arguments that are none.
    """

    function: EventFunction
    terminal: bool | int = False
    direction: float = 0.0

    def __post_init__(self) -> None:
        """Check the arguments."""
        check_callable("Event", self.function, "(t, q, v)")
        if self.function is None:
            raise OptionError("Event: give a function (t, q, v)")
        whole = isinstance(self.terminal, bool | int | np.integer | np.bool_)
        if not whole or self.terminal < 0:
            raise OptionError(
                f"Event: terminal = {shown(self.terminal)} must be True, False or a number of events"
            )
        check_number("Event: direction", self.direction)

    def __call__(self, t: float, q: Array, v: Array) -> float:
        """Its value."""
        return self.function(t, q, v)


class Between(Protocol):
    """The motion within a step."""

    @property
    def t0(self) -> float:
        """Where it begins, s."""
        ...

    @property
    def t1(self) -> float:
        """Where it ends, s."""
        ...

    def state(self, t: float) -> tuple[Array, Array]:
        """q and v at a time of the step."""
        ...


@dataclass(frozen=True)
class Zero:
    """A zero of event number k at time t, s; `ends` where the run is over with it."""

    t: float
    k: int
    ends: bool


class Events:
    """The events of a run, and what was found of them.

    Parameters
    ----------
    asked : sequence of Event
    start, step : float
        Of the run, s.

    Attributes
    ----------
    asked : list of Event
    t, q, v : list of list
        What was found, for each event.
    ended_by : int or None
        Which terminal event ended the run.
    together : list of int
        All that were zero there with it, but for rounding.
    pending : bool
        Whether the last step that `met` was asked for has events that are still to be found.
    """

    def __init__(self, asked: Sequence[Event], start: float, step: float) -> None:
        self.asked, self._start, self._soon = list(asked), start, start + AT_START * step
        self.t: list[list[float]] = [[] for _ in asked]
        self.q: list[list[Array]] = [[] for _ in asked]
        self.v: list[list[Array]] = [[] for _ in asked]
        self.ended_by: int | None = None
        self.together: list[int] = []
        self._left, self.pending = start, False
        self._values: Array = np.zeros(0)

    def __bool__(self) -> bool:
        """Whether any are asked for."""
        return bool(self.asked)

    def begin(self, t: float, q: Array, v: Array) -> None:
        """Take note of the state from which the next step begins."""
        self._left, self._values = t, self._at(t, q, v)

    def met(self, t: float, q: Array, v: Array) -> bool:
        """Whether the step that ends there has one; else the next step begins there."""
        after = self._at(t, q, v)
        self.pending = bool(self._changed(self._left, self._values, after))
        if not self.pending:
            self._left, self._values = t, after
        return self.pending

    def zeros(self, q: Array, v: Array, step: Between) -> list[Zero]:
        """Those in the step to q and v, by time, up to one that ends the run; the next step begins there.

        A zero at the start of a run ends nothing: a run may begin where another ended.
        """
        left, before, after = self._left, self._values, self._at(step.t1, q, v)
        self._left, self._values, self.pending = step.t1, after, False
        times = [(self._zero(k, before, after, step), k) for k in self._changed(left, before, after)]
        found = []
        for t, k in sorted(times):
            limit, so_far = int(self.asked[k].terminal), sum(when > self._soon for when in self.t[k])
            ends = t > self._soon and 0 < limit <= so_far + 1
            found.append(Zero(t, k, ends))
            if ends:
                slack = 8.0 * float(np.spacing(max(abs(step.t0), abs(step.t1))))  # twice what a zero may err
                self.together = [other for when, other in times if abs(when - t) <= slack]
                break
        return found

    def add(self, zero: Zero, q: Array, v: Array) -> None:
        """Keep a zero and the state there."""
        self.t[zero.k].append(zero.t)
        self.q[zero.k].append(q)
        self.v[zero.k].append(v)
        if zero.ends:
            self.ended_by = zero.k

    def forget(self, t: float) -> None:
        """Forget what was found after time t."""
        for k, times in enumerate(self.t):
            kept = sum(when <= t for when in times)
            del self.t[k][kept:], self.q[k][kept:], self.v[k][kept:]

    def found(self, mechanism: Mechanism) -> tuple[list[Array], list[Array], list[Array]]:
        """Times (k,), q (k, nq) and v (k, nv) of each."""
        return (
            [np.array(times) for times in self.t],
            [np.array(q).reshape(-1, mechanism.nq) for q in self.q],
            [np.array(v).reshape(-1, mechanism.nv) for v in self.v],
        )

    @property
    def ended(self) -> bool:
        """Whether one of them ended the run."""
        return self.ended_by is not None

    def only(self, n: int) -> Events:
        """The first n of them, as they are now."""
        other = copy(self)
        other.asked, other.t, other.q, other.v = self.asked[:n], self.t[:n], self.q[:n], self.v[:n]
        return other

    def copied(self) -> Events:
        """A copy that goes its own way."""
        other = copy(self)
        other.t = [list(times) for times in self.t]
        other.q, other.v = [list(values) for values in self.q], [list(values) for values in self.v]
        return other

    def _at(self, t: float, q: Array, v: Array) -> Array:
        return np.array([_value(event, k, t, q, v) for k, event in enumerate(self.asked)])

    def _changed(self, left: float, before: Array, after: Array) -> list[int]:
        """Which functions became or passed zero, in a direction that counts, after the time `left`."""
        found = []
        for k, (a, b) in enumerate(zip(before.tolist(), after.tolist(), strict=True)):
            # a zero at the end of a step counts there, and not where the next step begins with it
            rises, falls = a < 0.0 <= b, a > 0.0 >= b
            if a == 0.0 and left == self._start:  # no step came before that could have told it
                rises, falls = b > 0.0, b < 0.0
            way = self.asked[k].direction
            if (rises and way >= 0.0) or (falls and way <= 0.0):
                found.append(k)
        return found

    def _zero(self, k: int, before: Array, after: Array, step: Between) -> float:
        ends = {step.t0: float(before[k]), step.t1: float(after[k])}

        def value(t: float) -> float:
            # at the ends what was seen: the polynomial rounds there, and may have lost the change of sign
            return ends[t] if t in ends else _value(self.asked[k], k, t, *step.state(t))

        xtol = 4.0 * float(np.spacing(max(abs(step.t0), abs(step.t1))))
        return float(scipy.optimize.brentq(value, step.t0, step.t1, xtol=xtol, rtol=RTOL))


NO_EVENTS = Events((), 0.0, 0.0)
"""Of runs that look for none."""


def _value(event: Event, k: int, t: float, q: Array, v: Array) -> float:
    """What an event says at one time, a finite number."""
    return float(returned(event(t, q.copy(), v.copy()), (), f"events[{k}](t, q, v)", t=t))


def checked_events(events: Any) -> list[Event]:
    """What `simulate` was given as events, or an OptionError."""
    if events is None:
        return []
    if callable(events):
        events = [events]
    found = []
    for k, event in enumerate(listed(events, "events", EVENTS, OptionError, ())):
        if not callable(event) or isinstance(event, type):
            raise OptionError(f"events[{k}] = {shown(event)} must be an rg.Event or a function (t, q, v)")
        ready = isinstance(event, Event)
        terminal, direction = getattr(event, "terminal", False), getattr(event, "direction", 0.0)
        found.append(event if ready else Event(event, False if terminal is None else terminal, direction))
    return found
