"""A cost's gradient: a reverse sweep over the stages of its Runge–Kutta steps.

The recorded states are the checkpoints: the sweep takes a stretch of steps again, from a regular state, with
their derivatives, and goes through them backwards: the memory is that of one stretch, the effort one more run
with derivatives, whatever the number of torques and parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...dynamics.change_of_coordinates import Slope
from ...dynamics.discrete import Stage
from ...dynamics.equations import called_torque
from ...dynamics.parameters import Parameters
from ...dynamics.prescribed.drive import Drive
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...dynamics.problem import Problem, initial_value_problem
from ...dynamics.torque_feedback import AppliedSlopes, TorqueSlopes, followed
from ...errors import SimulationError
from ...kernel.derivatives.derivations import left_to_python
from ...kernel.derivatives.returned import by_parameters
from ...kernel.derivatives.step_derivatives import Derivation
from ...mechanism.building.variable_geometry import still_rows
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..trajectories.trajectory import Trajectory
from .accelerations import derivatives
from .cost import Cost, Gradient
from .cost_terms import Along
from .drive_derivatives import DriveSweep
from .kernel_sweep import Backwards, backwards, kernel_of
from .run_again import applied_again, coordinates_of, refined_until, require_answers, require_same
from .step_derivatives import WHAT, Follower, differentiated
from .step_of_motion import Acting, Moved

STRETCH = 25
"""Steps that are kept at once."""

REGULAR = 0.1
"""Conditioning of K_d from which a stretch may begin at a state."""


class ReverseSweep:
    """The reverse sweep of a gradient, see `gradient.gradient`."""

    def __init__(
        self,
        trajectory: Trajectory,
        cost: Cost,
        torque: Any,
        parameters: Sequence[str],
        torque_slopes: TorqueSlopes | None,
        mode: ArrayLike | None,
    ) -> None:
        self._run, self._cost, self._mode = trajectory, cost, mode
        self._mechanism, self._torque_slopes = trajectory.mechanism, torque_slopes
        self._parameters = Parameters(self._mechanism, parameters)
        steps = len(trajectory.t) - 1
        applied = applied_again(trajectory, torque, steps)
        self._function, self._table = called_torque(self._mechanism, applied.function), applied.table
        if self._function is not None and self._table is not None:
            require_answers(trajectory, self._function, self._table)
        self._held = HeldTorque(self._mechanism, self._mechanism.tree.zero)
        self._slopes_of = AppliedSlopes(self._mechanism, self._function, torque_slopes)
        motions = {} if trajectory.acted is None else trajectory.acted.motions
        self._drives = DriveSweep(trajectory.t, motions) if motions else None
        self._begun_with_end, self._value = False, 0.0
        self._adjoint: Array = np.zeros(2 * self._mechanism.m)
        self._by_torque: Array = np.zeros((steps, self._mechanism.nv))
        self._by_parameters: Array = np.zeros(len(self._parameters.names))

    def gradient(self) -> Gradient:
        """The sweep, stretch by stretch from the end."""
        run, end, m = self._run, len(self._run.t) - 1, self._mechanism.m
        for first, mechanism in reversed(coordinates_of(run)):
            if self._begun_with_end:
                self._change_to(mechanism, end)
            self._mechanism = mechanism
            drive = None if self._drives is None else self._drives.of(mechanism)
            kernel = kernel_of(mechanism, run, () if drive is None else drive.driven.tolist())
            while not self._begun_with_end or end > first:
                since = max(first, refined_until(run, end))  # steps with error control are not RK4's
                if since == end > first:
                    end = self._by_parts(end)
                    continue
                stretch = None
                if kernel is not None:
                    stretch = self._taken(kernel, since, end, drive)
                    if stretch is None and self._learned(kernel, end, since):
                        stretch = self._taken(kernel, since, end, drive)
                end = self._by_reference(end, since) if stretch is None else self._by_kernel(stretch)
        if self._mechanism.independent != run.mechanism.independent:
            self._change_to(run.mechanism, 0)
        found = dict(zip(self._parameters.names, self._by_parameters.tolist(), strict=True))
        if self._drives is not None:
            self._drives.begin(self._adjoint, run.mechanism)
        by_drive = None if self._drives is None else self._drives.found()
        by_start = self._adjoint[:m], self._adjoint[m:]
        return Gradient(float(self._value), *by_start, self._by_torque, found, by_drive)

    def _taken(self, kernel: Derivation, since: int, end: int, drive: Drive | None) -> Backwards | None:
        """The last steps up to an output, taken again by the kernel."""
        within = self._function if self._table is None else None
        staged = within is not None or len(self._parameters.names) > 0
        return backwards(kernel, self._run, (self._table, within), staged, since, end, drive)

    def _learned(self, kernel: Derivation, end: int, first: int) -> bool:
        """Whether the kernel is told of a mode at the last step before an output, that was new to it."""
        run = self._run
        try:
            _, motion = self._begun(max(first, end - 1), None, first)
            near = min(run.crossings, key=lambda crossing: abs(crossing.time - run.t[end]), default=None)
            places = [run.q[end - 1], run.q[end]]
            if near is not None:
                places.insert(0, near.q)  # the middle of a zone, where one is crossed
            return kernel.learn_beside(motion.start, places)
        except SimulationError:
            return False

    def _change_to(self, mechanism: Mechanism, i: int) -> None:
        """Take the adjoint at output i to other coordinates: δη = G δη' and δu = G δu' + ∂v/∂y' δη'."""
        mode = self._mode if i == 0 else None
        there = Slope.of(derivatives(mechanism, self._run.q[i], self._run.v[i], mode=mode))
        by_y, by_u = np.split(self._adjoint, 2)
        self._adjoint = there.of_rows(self._mechanism.iv_independent).pulled(by_y, by_u)

    def _begin_with_end(self, last: Slope) -> None:
        """Take up the terminal term, with the map's slopes there."""
        if not self._begun_with_end:
            self._begun_with_end = True
            q, v = self._run.q[-1], self._run.v[-1]
            self._value, (by_q, by_v, _) = self._cost.at_end(self._mechanism, q, v)
            self._adjoint = last.pulled(by_q, by_v)

    def _by_kernel(self, stretch: Backwards) -> int:
        """Sweep through a stretch that the kernel took again; returns where it begins."""
        begin, end = stretch.begin, stretch.end
        self._begin_with_end(Slope(stretch.G[-1], stretch.dv_dy[-1]))
        after = before = feedback = None
        if self._function is not None:
            feedback = self._followed(stretch)
        if self._cost.running is not None:
            half = 0.5 * np.diff(self._run.t[begin : end + 1])
            first, last = self._running_at(stretch)
            self._value += float(half @ (first.values + last.values))
            self._by_torque[begin:end] = half[:, None] * (first.by_tau + last.by_tau)
            before = half[:, None] * np.hstack([first.by_y, first.by_u])
            after = half[:, None] * np.hstack([last.by_y, last.by_u])
            if feedback is not None:
                before += np.einsum("sn,snk->sk", self._by_torque[begin:end], feedback)  # asked before it
        swept = stretch.sweep(self._adjoint, after, before, feedback)
        self._adjoint, by_torque, by_stage, by_drive = swept
        if by_drive is not None and self._drives is not None:
            self._drives.add(begin, by_drive)
        self._by_torque[begin:end] += by_torque
        if by_stage is not None and self._parameters.names:
            assert stretch.stages is not None  # by_stage is of these
            self._by_parameters += by_parameters(self._mechanism, self._parameters, stretch.stages, by_stage)
        return begin

    def _followed(self, stretch: Backwards) -> Array | None:
        """Tell how the torque follows the state within the steps; how it follows those before them."""
        run, function, begin, end = self._run, self._function, stretch.begin, stretch.end
        assert function is not None  # asked only then
        given, mechanism = self._torque_slopes, self._mechanism
        if self._table is None:
            stretch.follow(function, given)
            return None
        states = run.t[begin:end], run.q[begin:end], run.v[begin:end]
        return np.concatenate(
            followed(mechanism, function, given, states, stretch.G[:-1], stretch.dv_dy[:-1]), axis=2
        )

    def _by_reference(self, end: int, first: int) -> int:
        """Sweep through a stretch that ends at this output, not before `first`; returns where it begins."""
        run = self._run
        left_to_python(run.mechanism, WHAT)
        torque: Any = self._held if self._table is not None else self._function
        begin, motion = self._begun(max(first, end - STRETCH), torque, first)
        follower, taken = Follower(motion, self._acting(torque), float(run.t[begin])), []
        for i in range(begin, end):
            if self._table is not None:
                self._held.value = self._table[i]
            moved = follower.whole(float(run.t[i + 1] - run.t[i]))
            require_same(run, self._mechanism, i + 1, moved.q, moved.v)
            taken.append((i, moved))
        if not taken:  # coordinates were changed at the end
            self._begin_with_end(Slope.of(derivatives(self._mechanism, run.q[end], run.v[end])))
        for i, moved in reversed(taken):
            self._pull(i, moved)
        return begin

    def _by_parts(self, end: int) -> int:
        """Sweep through the step that ends at this output, which the run took with error control."""
        run, i = self._run, end - 1
        torque: Any = self._function if self._table is None else self._table[i]
        mode = self._mode if i == 0 else None
        t, h = float(run.t[i]), float(run.t[end] - run.t[i])
        state = run.q[i], run.v[i]
        acting, ahead = self._acting(torque), (run.q[end], run.v[end])
        moved = differentiated(self._mechanism, state, mode, acting, t, h, True, ahead)
        require_same(run, self._mechanism, end, moved.q, moved.v)
        self._pull(i, moved)
        return i

    def _begun(self, begin: int, torque: Any, first: int) -> tuple[int, Problem]:
        """The motion from an output, or from a regular one before it, not before the first."""
        mechanism, run = self._mechanism, self._run
        while True:
            drive = None if self._drives is None else self._drives.of(mechanism, begin)
            state = run.q[begin], run.v[begin], self._mode if begin == 0 else None
            try:
                motion = initial_value_problem(mechanism, *state, torque, drive=drive)
                if begin == first or motion.start.point.conditioning >= REGULAR:
                    return begin, motion
            except SimulationError:
                if begin == first:
                    raise
            begin = max(first, begin - 5)

    def _acting(self, torque: Any) -> Acting:
        """What acts, with its slopes within steps and those by the parameters."""
        by_more = None if not self._parameters.names else self._by_parameter
        still = still_rows(self._mechanism)
        drive = None if self._drives is None else self._drives.of(self._mechanism)
        if self._table is not None:  # held over each step
            return Acting(torque, by_more=by_more, held=still, drive=drive)
        return Acting(torque, self._function, self._torque_slopes, by_more, still, drive)

    def _by_parameter(self, stage: Stage) -> Array:
        return self._parameters.slopes(stage.now, stage.slopes)

    def _pull(self, i: int, moved: Moved) -> None:
        """Take the adjoint from after step i to before it."""
        first, last, half = moved.first, moved.last, 0.5 * float(self._run.t[i + 1] - self._run.t[i])
        self._begin_with_end(last)
        value_after, after, by_tau_after = self._running(i, i + 1, last)
        value_before, before, by_tau_before = self._running(i, i, first)
        self._value += half * (value_after + value_before)
        adjoint = self._adjoint + half * after
        by_torque = moved.B.T @ adjoint + half * (by_tau_after + by_tau_before)
        self._by_parameters += moved.P.T @ adjoint
        if self._drives is not None and moved.D is not None:
            self._drives.add(i, (moved.D.T @ adjoint).reshape(1, 5, 3, -1))
        self._adjoint = moved.A.T @ adjoint + half * before
        if self._function is not None and self._table is not None:  # asked at the state before the step
            by_q, by_v = self._slopes_of(float(self._run.t[i]), self._run.q[i], self._run.v[i])
            self._adjoint = self._adjoint + first.pulled(by_torque @ by_q, by_torque @ by_v)
        self._by_torque[i] = by_torque

    def _running(self, i: int, at: int, here: Slope) -> tuple[float, Array, Array]:
        """The running term at output `at` under the torque of step i, its slopes by the state and by τ."""
        t, q, v = float(self._run.t[at]), self._run.q[at], self._run.v[at]
        if self._table is not None:
            tau = self._table[i]
        else:
            assert self._function is not None  # there is one or the other
            tau = self._function(t, q, v)
        value, (by_q, by_v, by_tau) = self._cost.running_term.at(self._mechanism, t, q, v, tau)
        if self._table is None and np.any(by_tau):
            tau_q, tau_v = self._slopes_of(t, q, v)
            by_q, by_v = by_q + by_tau @ tau_q, by_v + by_tau @ tau_v
        return value, here.pulled(by_q, by_v), by_tau

    def _running_at(self, stretch: Backwards) -> tuple[Along, Along]:
        """The running term at the beginnings and at the ends of the steps of a stretch."""
        mechanism, since, till = self._mechanism, stretch.begin, stretch.end
        outputs = slice(since, till + 1)
        states = self._run.t[outputs], self._run.q[outputs].copy(), self._run.v[outputs].copy()
        table = None if self._table is None else self._table[since:till]
        if table is not None and np.any(table != table[0]):  # not the same at the end of a step as after it
            ends = [self._along(stretch, slice(k, till - since + k), table) for k in (0, 1)]
            return ends[0], ends[1]
        if table is not None:
            tau = np.vstack([table, table[-1:]])
        else:
            assert self._function is not None  # there is one or the other
            tau = self._function.over(*states)
        every = self._along(stretch, slice(0, till - since + 1), tau)
        if table is None and np.any(every.by_tau):
            assert self._function is not None
            by_y, by_u = followed(
                mechanism, self._function, self._torque_slopes, states, stretch.G, stretch.dv_dy
            )
            every = every._replace(
                by_y=every.by_y + np.einsum("sn,snm->sm", every.by_tau, by_y),
                by_u=every.by_u + np.einsum("sn,snm->sm", every.by_tau, by_u),
            )
        return Along(*(part[:-1] for part in every)), Along(*(part[1:] for part in every))

    def _along(self, stretch: Backwards, which: slice, tau: Array) -> Along:
        run = self._run
        outputs = slice(stretch.begin + which.start, stretch.begin + which.stop)
        states = run.t[outputs], run.q[outputs], run.v[outputs], tau
        return self._cost.running_term.along(self._mechanism, states, stretch.G[which], stretch.dv_dy[which])
