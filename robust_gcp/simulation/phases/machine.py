"""The mechanism of a phase, and its steps.

What is held, by stops, friction or locks, is one more closure, r = r*: its mobility falls exactly, without
drift, and cluster maps, bridges, changes of coordinates and the kernel serve a phase as they serve any
mechanism. A prescribed motion (`drive=`) would hold a joint too, but no sum of joints such as a clutch, and
only in coordinates that include it, which may turn back while the phase lasts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque, torque_function
from ...dynamics.prescribed.control import Actuated
from ...dynamics.prescribed.drive import Drive
from ...dynamics.prescribed.driven import driving
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...errors import SingularStartError
from ...kernel.library import Library
from ...kernel.simulation.guard import Guard
from ...mechanism.constraint.couplings import MovingCoupling
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..events import Events
from ..trajectories.acted import controls_along
from .bearings import FrictionBounds
from .decision import Acting, Phase, State
from .phase_run import Leg, Steps
from .rows import Rows
from .sliding import Sliding

if TYPE_CHECKING:
    from ..runs.course import Course
    from ..runs.error_control import Before


Held = tuple[tuple[MovingCoupling, ...], Mechanism]
"""A mechanism in which rows are held, and its closures for these."""


@dataclass
class Machines:
    """Mechanisms of phases, and what takes their steps.

    Attributes
    ----------
    rows : Rows
    course : Course
        Of the whole run.
    torque : HeldTorque, callable, array_like or None
        The user's.
    kernel : Library or None
    required : bool
        Whether the kernel has to take the steps.
    mode : array_like or None
        Tangent of the mode at the start.
    """

    rows: Rows
    course: Course
    torque: Torque | ArrayLike | None
    kernel: Library | None
    required: bool
    mode: ArrayLike | None

    def __post_init__(self) -> None:
        self.held = self.torque if isinstance(self.torque, HeldTorque) else None
        self._function = torque_function(self.rows.mechanism, self.torque)
        self._held: dict[tuple[int, ...], Held] = {}
        self.forget()
        self.checked = True
        self.before: tuple[Mechanism, Before] | None = None  # of the leg that was taken last
        self.bounds = FrictionBounds(self.rows, self.course.acted.wrenches, self.controls)

    def toward(self, v: Array) -> Array:
        """Where a start with the velocity v goes: along v, or along the one tangent that was named."""
        if np.any(v) or self.mode is None or np.size(self.mode) != len(v):
            return v
        return self.rows.mechanism.velocity(np.ravel(self.mode), "mode")

    @property
    def varies(self) -> bool:
        """Whether torques at rest may change with time within a step."""
        return callable(self.torque) and (self.held is None or bool(self.held.stride))

    def controls(self, t: Array, q: Array, v: Array) -> Array:
        """u of the actuators at outputs, (N, n), NaN without power."""
        n, found = len(self.rows.mechanism.actuators), None
        if not n:
            return np.zeros((len(t), 0))
        if self.held is not None:
            # a torque counts from its own time on
            values, at = [*self._before, self.held.value], np.searchsorted(self._until, t, side="right")
            found = self.held.driven(np.array([values[k] for k in at]), t)
        elif isinstance(self.torque, Actuated):
            found = controls_along(self.torque, t, q, v)
        return np.full((len(t), n), np.nan) if found is None else found

    def hold(self, t: float, value: Array) -> None:
        """Hold another torque from a time on; outputs that are told later were driven by the one before."""
        assert self.held is not None
        if self.rows.mechanism.actuators:
            self._until.append(t)
            self._before.append(self.held.value)
        self.held.value = value

    def forget(self) -> None:
        """All outputs up to now are told."""
        self._until, self._before = list[float](), list[Array]()

    def of(self, phase: Phase, here: Array) -> Mechanism | None:
        """The mechanism of a phase that begins at the configuration `here`; None where nothing can move."""
        mechanism = self.rows.mechanism
        if len(phase.basis) >= mechanism.m:
            return None
        if not phase.basis:
            return mechanism
        basis = tuple(phase.basis)
        if basis not in self._held:
            try:
                self._held[basis] = self._pool(basis).pop()
            except IndexError:  # not asked before: another thread may take the last one
                self._held[basis] = self._made(basis, here)
        closures, found = self._held[basis]
        for i, closure in zip(basis, closures, strict=True):
            closure.move(phase.offsets[i])
        found.home = here  # its own, from before the closures moved, opens its loops
        return found

    def _pool(self, basis: tuple[int, ...]) -> list[Held]:
        """Mechanisms that hold these rows, in coordinates with what is driven, and that no run uses."""
        # without r*: closures move to where rows are held, as to build anew takes 4 to 7 ms
        rows = tuple([(self.rows.rows[i].part.joints, self.rows.rows[i].part.weights) for i in basis])
        names = () if self.rows.drive is None else self.rows.drive.names
        pool: list[Held] = self.rows.mechanism.memo.once(("held", rows, names), list)
        return pool

    def _made(self, basis: tuple[int, ...], here: Array) -> Held:
        mechanism = self.rows.mechanism
        closures = tuple([self.rows.rows[i].closure() for i in basis])
        values = self.rows.values(here)  # coordinates are chosen at `here`, where the loops must be closed
        for i, closure in zip(basis, closures, strict=True):
            closure.move(float(values[i]))
        ties = (*mechanism.closures, *closures)
        place, driven = (here, mechanism.name, mechanism.forces), mechanism.actuators
        made = Mechanism(mechanism.own_model, ties, "auto", *place, actuators=driven)
        return closures, made if self.rows.drive is None else driving(made, self.rows.drive.names, here)

    def release(self) -> None:
        """Leave what was built to other runs; no more steps are taken."""
        for basis, held in self._held.items():
            self._pool(basis).append(held)
        self._held = {}

    def acting(self, phase: Phase) -> Acting:
        """All that acts besides gravity and what is held, (t, q, v) -> (nv,)."""
        applied, rows = self.rows.mechanism.applied, self.rows

        def tau(t: float, q: Array, v: Array, bounds: Array) -> Array:
            total: Array = rows.E.T @ phase.push(rows, q, v, bounds)
            if applied is not None:
                total = total + applied.tau(q, v)
            return total if self._function is None else total + self._function(t, q, v)

        return tau

    def sliding(self, phase: Phase, machine: Mechanism) -> Callable[[float, Array, Array], Array]:
        """F of each row at a state (t, q, v) of a phase."""
        if self.bounds.sliding(phase):
            return Sliding(self.bounds, machine, phase, self.acting(phase))
        constant = self.bounds.constant
        return lambda t, q, v: constant

    def torque_of(
        self, phase: Phase, machine: Mechanism, span: tuple[float, float] | None = None
    ) -> Torque | ArrayLike | None:
        """The user's torque with what slipping joints and springs add, as cheap as it can be.

        Parameters
        ----------
        machine : Mechanism
            Of the phase.
        span : (float, float), optional
            The step that it is held over, s, where activations change within it.
        """
        rows, function, held = self.rows, self._function, self.held
        if phase.touching or self.bounds.sliding(phase):
            bounds = self.sliding(phase, machine)

            def pushing(t: float, q: Array, v: Array) -> Array:
                pushed: Array = rows.E.T @ phase.push(rows, q, v, bounds(t, q, v))
                return pushed if function is None else pushed + function(t, q, v)

            return pushing
        if held is not None:
            return held.spanning(span, self.constant(phase))
        if not phase.slip:
            return self.torque  # as it is: the kernel takes constants and controls, but calls functions
        constant = self.constant(phase)
        if isinstance(self.torque, Actuated):
            return self.torque.beside(constant)
        if function is None or not callable(self.torque):
            zero = np.zeros(rows.mechanism.nq), np.zeros(rows.mechanism.nv)
            return constant if function is None else constant + function(0.0, *zero)
        return lambda t, q, v: constant + function(t, q, v)

    def constant(self, phase: Phase) -> Array:
        """What slipping joints add, (nv,)."""
        rows = self.rows
        zero = np.zeros(rows.mechanism.nq), np.zeros(rows.mechanism.nv)
        pushed: Array = rows.E.T @ phase.push(rows, *zero, rows.bounds)
        return pushed

    def leg(
        self, machine: Mechanism, phase: Phase, times: Array, q: Array, v: Array, toward: Array,
        events: Events | None = None, guard: Guard | None = None,
    ) -> Leg:  # fmt: skip
        """Steps of a phase from times[0] on.

        Let go at rest where modes meet, it goes on along the mode that it came by.

        Parameters
        ----------
        events : Events, optional
            The user's, that are looked for on the way.
        guard : Guard, optional
            What is to stay within bounds.
        """
        asked: Any = () if events is None else events
        drives = self.drive_of(machine, float(times[0]))
        plan = replace(
            self.course, mechanism=machine, checked=self.checked, events=asked, guard=guard, drives=drives
        )
        torque = self.torque_of(phase, machine, (float(times[0]), float(times[1])))
        try:
            leg = Leg(self, plan, torque, times, (q, v, None))
        except SingularStartError:  # v names no mode, as at rest
            mode = toward if np.any(toward) else self.mode
            if mode is None:
                raise
            leg = Leg(self, plan, torque, times, (q, v, mode))
        self.checked = False  # of steps that are too long it is warned once
        return leg

    def drive_of(self, machine: Mechanism, start: float = 0.0) -> Drive | None:
        """What is driven, in the coordinates of a phase that begins at `start`."""
        return None if self.rows.drive is None else Drive(machine, self.rows.drive.motions, start)

    def part(self, machine: Mechanism, phase: Phase, start: State, end: float, events: Any = None) -> Steps:
        """One step from a state on, with all that may happen."""
        times = np.array([start.t, end])
        leg = self.leg(machine, phase, times, start.q, start.v, start.seen.toward, events)
        fault, steps = leg.advance(1), leg.since(0)
        leg.release()
        if fault is not None:
            raise fault
        return steps
