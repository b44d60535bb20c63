"""Single steps of a phase by the kernel, from states on regular ground: cheap, as events need several."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.equations import Torque
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...dynamics.problem import Problem
from ...dynamics.tableau import Tableau
from ...errors import SimulationError
from ...kernel.simulation.batch import Outputs
from ...kernel.simulation.steps import NativeSteps
from ...kernel.structures import Reason
from ...maps.explicit import Counters
from ...maps.regular_path import RegularPath
from ...mechanism.coordinates.groups import groups_of
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..runs.initial_state import closed_by_kernel, is_plain, start_at
from .decision import State
from .phase_run import Steps

if TYPE_CHECKING:
    from .machine import Machines


class Partial:
    """Takes them, where the kernel can.

    Parameters
    ----------
    machines : Machines
    machine : Mechanism
        Of the phase.
    torque : HeldTorque, callable, array_like or None
        With what slipping joints and springs add.
    """

    def __init__(self, machines: Machines, machine: Mechanism, torque: Torque | ArrayLike | None) -> None:
        course, kernel = machines.course, machines.kernel
        self._machine, self._torque, self._choice = machine, torque, course.choice
        self._native: NativeSteps | None = None
        self._drive = machines.drive_of(machine)
        if kernel is not None and is_plain(machine):
            own = course.tableau if isinstance(course.tableau, Tableau) else None
            self._native = NativeSteps(kernel, torque, False, self._drive, own)
            groups = groups_of(machine)
            rest = machine if groups is None else groups.rest
            self._path = RegularPath(rest, np.arange(rest.nc), Counters())

    def step(self, start: State, end: float, held: Array | None) -> Steps | None:
        """One step from a state on; None where it is to be taken with more care.

        Parameters
        ----------
        held : ndarray (nv,) or None
            The torque, where it is held.
        """
        if self._native is None:
            return None
        if held is not None and isinstance(self._torque, HeldTorque):
            self._torque.value = held
        workspace = self._native.prepare(self._machine, self._path)
        if workspace is None:
            return None
        options, mechanism = self._choice.options, self._machine
        begun = closed_by_kernel(workspace, mechanism, start.q, start.v, options.zone, start.t)
        if begun is None:
            return None
        x, now = begun.x, begun.now
        if self._native.asks:
            place = start_at(mechanism, self._path, now.point)
            motion = Problem(place, self._torque, self._choice, self._drive)
            now = motion.equations.at_point(start.t, now.point)
        times = np.array([start.t, end])
        told = None if self._drive is None else self._drive.stages(times, workspace.shares)
        if told is not None and len(told) < 2:  # the motion has no numbers there: the run's own step says so
            return None
        outputs = Outputs.room(1, mechanism.nq, mechanism.nv, ("a", "tau", "work"))
        batch = workspace.run(times, x, now, outputs, options.zone, options, prescribed=told)
        if batch.failure is not None and isinstance(batch.failure, SimulationError):
            raise batch.failure
        if batch.reason is not Reason.DONE or batch.crossings or batch.trackers is not None:
            return None
        done, a, tau = outputs.work, outputs.a, outputs.tau
        assert done is not None and a is not None and tau is not None
        before = mechanism.tree.zero if now.tau is None else now.tau
        return Steps(
            mechanism.tree, times, np.array([now.point.q, outputs.q[0]]),
            np.array([now.v, outputs.v[0]]), np.array([now.a, a[0]]), np.array([before, tau[0]]),
            np.array([0.0, done[0]]),
            drive=np.zeros((2, 0)) if now.drive is None else np.array([now.drive, batch.now.drive]),
        )  # fmt: skip
