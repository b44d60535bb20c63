"""A run with one of scipy's solvers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...dynamics.linearise import ReducedJacobian
from ...errors import NonFiniteError, ToggleError
from ...kernel.simulation.steps import NativeSteps
from ...maps.explicit import Stretch
from ...mechanism.tree.tree import Array
from ..events import Zero
from ..trajectories.trajectory import Trajectory
from .crossings import in_new_chart, numbers, placed
from .recovery import Checkpoint
from .run import Run
from .solver_rates import Following
from .steppers import SolverStep, solver_steps
from .within_steps import DenseStep


class AdaptiveRun(Run):
    """A run with one of scipy's solvers.

    Parameters
    ----------
    stepper : str
    rtol, atol : float
    native : NativeSteps or None
        Gives the right-hand sides.
    more, options
        As for `Run`.
    """

    fixed = False

    def __init__(
        self, stepper: str, rtol: float, atol: float, native: NativeSteps | None, *more: Any, **options: Any
    ) -> None:
        super().__init__(*more, **options)
        self.stepper = stepper
        self._solver, self._native = (stepper, rtol, atol), native
        self._behind: Array = self._x
        self._following = Following(self._motion, native, self._coordinates)

    def go(self) -> None:
        """The solver, started anew after a change of coordinates; output at the times."""
        stepper, rtol, atol = self._solver
        times, begun = self.times, float(self.times[0])
        first = self._motion.equations.evaluate(begun, self._x)
        self._accept(0, first)
        if self._events:
            self._events.begin(begun, first.point.q, first.v)
        self._following.begin(first, self._x)
        # In other coordinates the memory of a solver means nothing: it begins anew at the last output.
        safe, safe_at = Checkpoint(0, self._x, first.point), begun
        names = self._better(first.point)
        if names is not None:
            safe = self._repartition(0, begun, names)
        i, changed_at = 0, -np.inf
        while i + 1 < len(times):
            try:
                jacobian = ReducedJacobian(self._motion.equations, rate=self._following)
                self._behind = self._x
                ahead = np.concatenate([[begun], times[i + 1 :]])
                for step in solver_steps(
                    stepper, self._following.trial, self._x, ahead, rtol, atol, jacobian=jacobian
                ):
                    plain = self._following.plain and not self._events
                    if not plain:
                        self._rounding(self._following, rtol)
                    self._look_behind(step, plain)  # before outputs and events, which move the map
                    if self._events:  # which the map in Python is asked for, at many times in the step
                        self._following.share()
                    within, zeros = self._zeros(step)
                    end = zeros[-1].t if zeros and zeros[-1].ends else np.inf
                    for x in step.outputs:
                        if times[i + 1] > end:  # the solver went on beyond the event
                            break
                        i += 1
                        if not np.all(np.isfinite(x)):
                            raise NonFiniteError(f"{stepper} left the finite numbers at t = {times[i]:.6g} s")
                        self._x = x
                        now = self._following.keep(float(times[i]), x)
                        self._accept(i, now)
                        safe, safe_at = Checkpoint(i, x, now.point), float(times[i])
                    for zero in zeros:
                        self._keep_zero(zero, within)
                    if end < np.inf:
                        return
                    more = not plain and i + 1 < len(times)  # `plain` includes that no chart is outgrown
                    if more and np.all(np.isfinite(step.x)) and self._outgrown(i, step):
                        begun = safe_at = step.t1
                        safe = Checkpoint(i, self._x, self._motion.explicit.anchor)
                        break
            except ToggleError:
                if self._on_toggle == "error" or safe_at == changed_at:  # no others served there either
                    raise
                self._motion.explicit.anchor, self._x = safe.point, safe.x
                self._record.forget_crossings(safe_at)
                self._events.forget(safe_at)
                if self._events:
                    self._events.begin(safe_at, safe.point.q, safe.point.G.dot(safe.point.ydot))
                i, begun, changed_at = safe.i, safe_at, safe_at
                safe = self._repartition(i, safe_at, self._others(safe.point))

    def _outgrown(self, i: int, step: SolverStep) -> bool:
        """Whether the solver has to begin anew after a step, in a new chart or in other coordinates."""
        self._following.share()
        explicit = self._motion.explicit
        if not self._suspicious(explicit.anchor) and not explicit.outgrown(explicit.anchor):
            return False
        here = self._following.keep(step.t1, step.x)
        self._following.share()
        names = None if self._following.on_bridge else self._better(here.point)
        if names is None and not explicit.outgrown(here.point):
            self._following.looked()
            return False
        self._following.drop()
        _, self._x = in_new_chart(explicit, here, step.x)
        if names is not None:
            self._repartition(i, step.t1, names)
        return True

    def _zeros(self, step: SolverStep) -> tuple[DenseStep, list[Zero]]:
        """The motion within a step, and the events there."""
        explicit, m, x = self._motion.explicit, self._motion.mechanism.m, step.x
        within = DenseStep(explicit, m, step, self._following.near)
        if not self._events or not np.all(np.isfinite(x)):
            return within, []
        self._following.near(x)
        point = explicit.point_at(x[:m], x[m : 2 * m])
        return within, self._events.zeros(point.q, point.G.dot(point.ydot), within)

    def _repartition(self, i: int, t: float, names: tuple[str, ...] | None) -> Checkpoint:
        self._following.drop()
        safe = super()._repartition(i, t, names)
        self._following = Following(self._motion, self._native, self._coordinates)
        return safe

    def trajectory(self, begun: float) -> Trajectory:
        """What was recorded so far."""
        self._following.drop()
        return super().trajectory(begun)

    def _look_behind(self, step: SolverStep, plain: bool) -> None:
        """Log what an accepted step of a solver passed, whatever the outputs are."""
        behind, self._behind = self._behind, step.x
        explicit, m = self._motion.explicit, self._motion.mechanism.m
        if plain or not np.all(np.isfinite(step.x)):
            return
        passed = self._following.passed(step, behind)
        if passed is not None:
            self._record.cross(passed)
            return
        self._following.share()
        if not explicit.met:
            return
        self._following.near(behind)  # the map stands where the solver's last trial was
        before, after = (explicit.point_at(x[:m], x[m : 2 * m]) for x in (behind, step.x))
        stretch = Stretch(step.t0, step.t1, lambda t: numbers(explicit, step.between(t)[:m]))
        crossings = explicit.passed(before, after, stretch)
        self._record.cross(placed(explicit, crossings, lambda t: step.between(t)[:m]))
        self._following.looked()
