"""A warning where fixed steps were too long for the motion."""

from __future__ import annotations

from itertools import repeat

import numpy as np

from ...mechanism.mechanism import Mechanism, energies_of
from ...mechanism.tree.tree import Array
from ...warning import warn
from ..trajectories.trajectory import Trajectory

FARTHEST = 1.0
"""Largest motion of a joint in one step, rad or characteristic lengths, that is not warned of: RK4 errs
by 1e-2 of a circle's radius there, and two crossings may lie so close together."""

LOOKS = 9
"""Outputs at which energy is weighed: some 60 µs of a four-bar."""

LEAK = 3e-3
"""Energy out of nothing, as a share of what moves, that is warned of: joints are then off by 0.05 rad."""

ROUNDING = 1e-9
"""Share of all energy at rest that is never taken for a leak."""

SOUND = 1e-4
"""The share that the recommended step leaves, as errors fall with the fourth power of it."""


class CoarseStepWarning(RuntimeWarning):
    """Fixed steps are so long that crossings in them may be missing, or that the motion is wrong."""


class Coarse:
    """Whether the steps of a run are too long; each of the two reasons is told once.

    Parameters
    ----------
    mechanism : Mechanism
    step : float
        s.
    """

    def __init__(self, mechanism: Mechanism, step: float) -> None:
        self._step, self._pace = step, 1.0 / mechanism.units
        self._pace_of_step = self._pace * step
        self._loops = mechanism.nc > 0
        self._far, self._leaked = not self._loops, False  # without loops no crossing can be missing

    def judge(self, run: Trajectory) -> None:
        """Warn of a whole run."""
        fault = self.fault(run)
        if fault is not None:
            warn(fault, CoarseStepWarning)

    def fault(self, run: Trajectory) -> str | None:
        """What tells that the steps of a whole run were too long: how far they go, else its energy."""
        if len(run.t) < 2:
            return None
        # at least the largest motion of a joint in a step: cheaper than a look at each step
        fastest = float((np.abs(run.v).max(axis=0) * self._pace_of_step).max(initial=0.0))
        if not self._far and not fastest <= FARTHEST:
            # outputs may be nearer than steps, and then tell of no more than their share of one
            far = np.abs(run.v[:-1] * self._pace).max(axis=1) * np.minimum(np.diff(run.t), self._step)
            i = int(np.argmax(far))
            found = self._jump(float(run.t[i]), float(far[i]))
            if found is not None:
                return found
        return None if self._loops and self._far else self._leak(run)

    def look(self, t: float, v: Array) -> None:
        """Warn where a step from time t on takes a joint of a loop further than `FARTHEST`."""
        if not self._far:
            far = v * self._pace_of_step
            # |v| ≥ max |v_i|: one product in each step, and a closer look where that is large
            fault = None if far.dot(far) < FARTHEST**2 else self._jump(t, float(np.abs(far).max()))
            if fault is not None:
                warn(fault, CoarseStepWarning)

    def weigh(self, run: Trajectory) -> None:
        """Warn where a run gained or lost more energy than its torques account for."""
        fault = self._leak(run)
        if fault is not None:
            warn(fault, CoarseStepWarning)

    def _leak(self, run: Trajectory) -> str | None:
        last = len(run.t) - 1
        if self._leaked or last < 1:
            return None
        rows = np.arange(last + 1) if last < LOOKS else last * np.arange(LOOKS) // (LOOKS - 1)
        mechanism = run.mechanism
        # plain floats: arrays of so few cost more than the energies themselves
        moving, resting = zip(*map(energies_of, repeat(mechanism), run.q[rows], run.v[rows]), strict=True)
        done = run.work_left
        work = [0.0] * len(rows) if done is None else done[rows].tolist()
        total = [k + u - w for k, u, w in zip(moving, resting, work, strict=True)]
        leak = max(max(total) - total[0], total[0] - min(total))
        # the zero of potential energy is arbitrary: its range counts, not its size
        at_work = max(*moving, max(resting) - min(resting))
        if not leak > max(LEAK * at_work, ROUNDING * max(map(abs, resting))):
            return None
        self._leaked = True
        share, step = leak / at_work, self._step
        return (
            f"energy is off by {leak:.2g} J, {100.0 * share:.2g} % of what moves: the step of {step:g} s is "
            f"too long for this motion; one of {step * (SOUND / share) ** 0.25:.1g} s would do, or an "
            'error-controlled stepper="DOP853"'
        )

    def _jump(self, t: float, far: float) -> str | None:
        if not far > FARTHEST:
            return None
        self._far = True
        return (
            f"the step at t = {t:.6g} s takes a joint {far:.2g} rad (or lengths) far: the stepper's error is "
            "large there, and crossings in such a step may be missing from the list; use a step of "
            f"{0.1 * FARTHEST * self._step / far:.1g} s"
        )
