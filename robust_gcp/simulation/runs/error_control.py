"""A run's steps through zones without a bridge: with error control, on the true curve."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...dynamics.equations import Evaluation
from ...dynamics.problem import Problem, initial_value_problem
from ...errors import SimulationError
from ...kernel.simulation.guard import ErrorControl
from ...kernel.simulation.steps import NativeSteps
from ...maps.cluster.cluster_map import ClusterMap
from ...maps.cluster.product import turned
from ...mechanism.tree.tree import Array
from ..trajectories.trajectory import Trajectory
from .coordinates import in_coordinates
from .crossings import motion_at, placed_between, stretch_between
from .recovery import Checkpoint, Recovery
from .run import Run
from .solver_rates import Following
from .stats import extended
from .steppers import NoProgressError, SolverStep, solver_steps
from .within_steps import DenseStep

REFINED_RTOL, REFINED_ATOL = 1e-10, 1e-12
"""Tolerances of the error-controlled steps through a zone without a bridge."""

REFINED_EFFORT = 5_000
"""Right-hand sides that one such step may take."""

Before = tuple[float, bool]
"""The best conditioning of a motion so far, and whether its steps were taken with error control at last."""

MANY = 5
"""Steps with error control within one of the run's, after so many of which ẋ's rounding is measured."""


def _noise(f: Callable[[float, Array], Array], t: float, x: Array) -> Array:
    """How much ẋ differs between states that differ in the last digit, (2m,)."""
    here = f(t, x)
    # relative steps: a number that is 0 has no last digit; several, as one may round as x itself does
    beside = [f(t, x * (1.0 + ulps * np.finfo(float).eps)) for ulps in (-2.0, 1.0, 2.0)]
    return np.asarray(np.max(np.abs(np.array(beside) - here), axis=0))


class RefinedRun(Run):
    """A run that can take a step of its own with error control.

    Parameters
    ----------
    parts, options
        As for `Run`.
    """

    def __init__(self, motion: Problem, *parts: Any, **options: Any) -> None:
        super().__init__(motion, *parts, **options)
        self._native: NativeSteps | None = None
        self._following: Following | None = None  # while steps are taken with error control
        self._behind: Array = self._x  # the state before the last step
        self._renewed_at: float | None = None  # when the present step went on in other coordinates
        self._recovery = Recovery(self._on_toggle, Checkpoint(0, self._x, motion.start.point))

    @property
    def before(self) -> Before:
        """What another run that goes on from here is to know."""
        return self._recovery.best, self._recovery.error_controlled

    def goes_on(self, before: Before) -> None:
        """It is a part of a motion, and begins where another one ended."""
        self._recovery.best, self._recovery.error_controlled = max(self._recovery.best, before[0]), before[1]

    def _looked_for(self, i: int) -> bool:
        """Whether outputs or events may lie within the step that ends at time i."""
        return bool(self._events) or bool(self._schedule.within(i))

    def _accuracy(self) -> AbstractContextManager[None]:
        """What evaluations are made in: carefully, on the true curve of an uncertified zone."""
        return (
            self._cluster_map().following_true_curve() if self._recovery.error_controlled else nullcontext()
        )

    def _goes_natively(self, i: int) -> bool:
        """Whether steps with error control from time i on are the kernel's.

        They are Python's on the way to the first place where other coordinates serve, and where something
        lies within the step.
        """
        return self._native is not None and not self._recovery.changing and not self._looked_for(i + 1)

    def _control(self, i: int) -> ErrorControl:
        """How the kernel is to take steps from time i on."""
        # well-conditioned outputs before the obstacle do not end it: the first of them was gone back to
        return ErrorControl(REFINED_RTOL, REFINED_ATOL, self._recovery.met_at - i + 1)

    def _refined(self, i: int, begun: Evaluation) -> Array:
        """One step through an uncertified zone by an error-controlled method."""
        bridged, x, t, end = self._cluster_map(), self._x, float(self.times[i]), float(self.times[i + 1])
        if self._following is None or self._following.kept is not begun:  # the step before was none of these
            self._follow_from(begun)
        ended = False
        while t < end and not ended:
            with bridged.following_true_curve():
                try:
                    for step in self._refinements(x, np.array([t, end])):
                        x, t, ended = step.x, step.t1, self._look_inside(i + 1, step)
                        if ended or (t < end and self._renewed_within(i, begun, t, x)):
                            break  # what the solver knows of its steps is in the coordinates before
                except NoProgressError as error:
                    raise bridged.refusal() from error  # the map knows what stopped it
            if t < end and not ended:
                assert self._last is not None  # put into the new coordinates
                bridged, x = self._cluster_map(), self._x
                self._follow_from(self._last)
        self._count_refined(i, 1)
        return x

    def _look_inside(self, i: int, step: SolverStep) -> bool:
        """Keep outputs and events of a part of the step to time i; whether one ended the run."""
        rows = [row for row in self._schedule.within(i) if step.t0 < self._schedule.outputs[row] <= step.t1]
        if not rows and not self._events:
            return False
        assert self._following is not None and self._following.kept is not None  # at the end of the part
        now = self._following.kept
        within = DenseStep(self._motion.explicit, self._motion.mechanism.m, step)
        zeros = self._events.zeros(now.point.q, now.v, within) if self._events else []
        if zeros and zeros[-1].ends:  # later than that nobody logs what was passed
            self._cross(i, step.t1, now)
        self._keep_within(rows, within, zeros, now)
        return self._ended

    def _count_refined(self, i: int, steps: int) -> None:
        """Tell of steps with error control from time i on."""
        self._counters.refined_steps += steps
        self._stretches = extended(self._stretches, float(self.times[i]), float(self.times[i + steps]))

    def _refinements(self, x: Array, times: Array) -> Iterator[SolverStep]:
        """Steps with error control; a trial that is refused leaves the map where the step began.

        Where they become many, the rounding of ẋ is measured now and then, and no error below what it makes
        of a step is asked for: light bodies that idle beside heavy ones have it 1e6 times as large.
        """
        following, absolute = self._following, np.full(len(x), REFINED_ATOL)
        assert following is not None
        asked = REFINED_RTOL, absolute, REFINED_EFFORT
        rounding = partial(self._rounding, following)
        steps = solver_steps("DOP853", following.trial, x, times, *asked, rounding=rounding)
        for number, step in enumerate(steps, 1):
            following.keep(step.t1, step.x)
            following.share()
            yield step
            if number % MANY == 0 and step.t1 < times[-1]:
                made = (step.t1 - step.t0) * _noise(following, step.t1, step.x)
                absolute[:] = np.maximum(REFINED_ATOL, made)  # in place: the solver reads it before each step

    def _follow_from(self, now: Evaluation) -> None:
        """Follow the mode anew from an evaluation at the present state."""
        self._leave()
        self._following = Following(self._motion, self._native, self._coordinates, returns=False)
        self._following.begin(now, self._x)

    def _repartition(self, i: int, t: float, names: tuple[str, ...] | None) -> Checkpoint:
        self._leave()
        return super()._repartition(i, t, names)

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        self._leave()
        return super().trajectory(begun)

    def _leave(self) -> None:
        """No more steps with error control, for now."""
        if self._following is not None:
            self._following.drop()
        self._following = None

    def _renewed_within(self, i: int, begun: Evaluation, t: float, x: Array) -> bool:
        """Whether a step from time i, begun there, goes on at t in better coordinates, which are taken."""
        if not self._turns_back(self._motion.explicit.anchor):
            return False
        assert self._following is not None and self._following.kept is not None  # at the end of the step
        here = self._following.kept
        names = self._better(here.point)
        if names is None:
            return False
        self._cross(i + 1, t, here)  # in all clusters: the map that met their bridges is left
        self._last, self._renewed_at = here, t
        m, mechanism = self._motion.mechanism.m, in_coordinates(self._named, names)
        explicit = self._motion.explicit
        try:
            # beside an apex two sheets are as near as it is: a start found anew from K_d would be refused
            if isinstance(explicit, ClusterMap) and explicit.beside_apex(mechanism) is not None:
                first = turned(begun.point, mechanism)
                first_x = np.concatenate([first.y, first.ydot])
            else:
                start = initial_value_problem(mechanism, begun.point.q, begun.v, choice=self._motion.choice)
                first, first_x = start.start.point, start.x[: 2 * m]
            # where the step began is put into the new coordinates too: `Recovery` may go back to it
            self._x = x
            new = self._repartition(i, t, names).point
        except SimulationError:
            return False
        self._last = replace(here, point=new, ydd=here.a[self._motion.mechanism.iv_independent])
        state = np.concatenate([first_x, self._behind[2 * m :]])  # the work done is in no coordinates
        self._recovery.renewed(Checkpoint(i, state, first))
        return True

    def _cross(self, i: int, t: float, now: Evaluation) -> None:
        """Log what was passed until t in the step that ends at time i, or since coordinates changed in it."""
        explicit, mechanism, before = self._motion.explicit, self._motion.mechanism, self._last
        if before is None or not explicit.met:
            return
        since = self._renewed_at
        times = float(self.times[i - 1]) if since is None else since, t
        ends = (before.point, before.ydd), (now.point, now.ydd)
        stretch = stretch_between(explicit, mechanism, times, *ends)
        crossings = explicit.passed(before.point, now.point, stretch)
        states = (motion_at(*end) for end in ends)
        self._record.cross(placed_between(mechanism, crossings, times, *states))
