"""The mechanism of a phase, and its steps.

What is held, by stops, friction or locks, is one more closure, r = r*: its mobility falls exactly, without
drift, and cluster maps, bridges, changes of coordinates and the kernel serve a phase as they serve any
mechanism. A prescribed motion (`drive=`) would hold a joint too, but no sum of joints such as a clutch, and
only in coordinates that include it, which may turn back while the phase lasts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque, torque_function
from ...errors import SingularStartError
from ...kernel.library import Library
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from ..schedule import Schedule
from .decision import Acting, Phase
from .rows import Kind, Rows

if TYPE_CHECKING:
    from ..course import Course
    from ..trajectory import Trajectory


@dataclass
class Machines:
    """Mechanisms of phases, and what takes their steps.

    Attributes
    ----------
    rows : Rows
    course : Course
        Of the whole run.
    torque : callable, array_like or None
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
        self._function = torque_function(self.rows.mechanism, self.torque)
        self._once: dict[tuple[object, ...], Mechanism] = {}
        self.checked = True

    def toward(self, v: Array) -> Array:
        """Where a start with the velocity v goes: along v, or along the one tangent that was named."""
        if np.any(v) or self.mode is None or np.size(self.mode) != len(v):
            return v
        return self.rows.mechanism.velocity(np.ravel(self.mode), "mode")

    @property
    def varies(self) -> bool:
        """Whether torques at rest may change with time."""
        return callable(self.torque)

    def of(self, phase: Phase, here: Array) -> Mechanism | None:
        """The mechanism of a phase that begins at the configuration `here`; None where nothing can move."""
        mechanism = self.rows.mechanism
        if len(phase.basis) >= mechanism.m:
            return None
        if not phase.basis:
            return mechanism
        extra = tuple(self.rows.rows[i].closure(phase.offsets[i]) for i in phase.basis)

        def made() -> Mechanism:
            return Mechanism(
                mechanism.own_model,
                (*mechanism.closures, *extra),
                "auto",
                here,
                mechanism.name,
                mechanism.forces,
            )

        lasting = all(
            self.rows.rows[i].kind is Kind.STOP and phase.offsets[i] == self.rows.at[i] for i in phase.basis
        )
        if lasting:  # few of them; joints may stick anywhere
            found: Mechanism = mechanism.memo.once(("phase", extra), made)
            return found
        if extra not in self._once:
            self._once = {extra: made()}
        return self._once[extra]

    def acting(self, phase: Phase) -> Acting:
        """All that acts besides gravity and what is held, (t, q, v) -> (nv,)."""
        applied, rows = self.rows.mechanism.applied, self.rows

        def tau(t: float, q: Array, v: Array) -> Array:
            total: Array = rows.E.T @ phase.push(rows, q, v)
            if applied is not None:
                total = total + applied.tau(q, v)
            return total if self._function is None else total + self._function(t, q, v)

        return tau

    def torque_of(self, phase: Phase) -> Torque | ArrayLike | None:
        """The user's torque with what slipping joints and springs add, as cheap as it can be."""
        rows, function = self.rows, self._function
        if not (phase.slip or phase.touching):
            return self.torque
        if not phase.touching:
            zero = np.zeros(rows.mechanism.nq), np.zeros(rows.mechanism.nv)
            constant: Array = rows.E.T @ phase.push(rows, *zero)
            if function is None or not callable(self.torque):
                return constant if function is None else constant + function(0.0, *zero)
            return lambda t, q, v: constant + function(t, q, v)

        def sprung(t: float, q: Array, v: Array) -> Array:
            pushed: Array = rows.E.T @ phase.push(rows, q, v)
            return pushed if function is None else pushed + function(t, q, v)

        return sprung

    def march(
        self, machine: Mechanism, phase: Phase, times: Array, q: Array, v: Array, toward: Array
    ) -> Trajectory:
        """The steps of a phase from times[0] on, with accelerations and all that acts.

        Let go at rest where modes meet, it goes on along the mode that it came by.
        """
        plan = replace(
            self.course,
            mechanism=machine,
            schedule=Schedule.every(times),
            duration=float(times[-1] - times[0]),
            record=("a", "tau"),
            checked=self.checked,
        )
        torque = self.torque_of(phase)
        try:
            run = plan.run((q, v, None), torque, self.kernel, self.required, None, None)
        except SingularStartError:
            mode = toward if np.any(toward) else self.mode
            if mode is None:
                raise
            run = plan.run((q, v, mode), torque, self.kernel, self.required, None, None)
        self.checked = False
        return run
