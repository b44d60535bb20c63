"""How a run was taken: in which coordinates, where with error control; whether a step is the same again."""

from __future__ import annotations

import numpy as np

from ..errors import OptionError
from ..mechanism.mechanism import Mechanism
from .moved import Moved
from .trajectory import Trajectory

SAME_TIME = 1e-12
"""s: times so near to each other are the same."""

SAME = 1e-7
"""How far a step that is taken again may end from the recorded state: rad or lengths, and relative for v."""


def coordinates_of(run: Trajectory) -> list[tuple[int, Mechanism]]:
    """From which output on a run has which independent joints."""
    found = [(0, run.mechanism)]
    for t, names in run.stats.repartitions:
        at = int(np.argmin(np.abs(run.t - t)))
        found = [part for part in found if part[0] < at] + [(at, run.mechanism.with_independent(names))]
    return found


def refined_until(run: Trajectory, end: int) -> int:
    """The last output until `end` that a step with error control led to; 0 where there is none."""
    times = run.t[: end + 1]
    stretches = [stretch for stretch in run.stats.refined if stretch[0] < times[-1] - SAME_TIME]
    ends = (min(int(np.searchsorted(times, stop - SAME_TIME)), end) for _, stop in stretches)
    return max(ends, default=0)


def require_same(run: Trajectory, mechanism: Mechanism, i: int, moved: Moved) -> None:
    """Refuse a step i that does not end where it did."""
    i = i + 1
    off = np.abs(mechanism.tree.difference(run.q[i], moved.q)) / mechanism.units
    fast = np.abs(moved.v - run.v[i]) / mechanism.units / (1.0 + np.abs(run.v[i]).max(initial=0.0))
    if not max(off.max(initial=0.0), fast.max(initial=0.0)) < SAME:
        raise OptionError(
            f"gradient: taken again, the step of RK4 to t = {run.t[i]:.6g} s ends {off.max():.1e} rad or "
            f"lengths and {fast.max():.1e} in v from the trajectory; give the torque of the run, and a "
            'run of stepper="rk4" with an output at each step'
        )
