"""Steps on equations that are exact: any stepper over given output times, and those of a run once more."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from .. import SimulationError, Stats
from ..dynamics.equations import EquationsOfMotion
from ..mechanism.tree.tree import Array
from ..simulation.runs.error_control import REFINED_ATOL, REFINED_RTOL
from ..simulation.runs.steppers import adaptive, rk4_step
from .contender import clock


def stepped(
    rate: Callable[[float, Array], Array], x: Array, times: Array, stepper: str, setting: float
) -> tuple[Array, float, str]:
    """Integrate from x over the output times.

    Parameters
    ----------
    stepper : str
        "rk4", or one of SciPy's.
    setting : float
        The step, s, a part of the outputs' spacing; else rtol = atol.

    Returns
    -------
    states : ndarray (n, len(x))
        Up to the first that is not finite, n ≤ len(times).
    seconds : float
    stopped : str
        Why it stopped, or empty.
    """
    states, stopped = [x], ""
    begun = clock()
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            if stepper == "rk4":
                every = round(float(times[1]) / setting)
                for i in range(every * (len(times) - 1)):
                    t = i * setting
                    x = rk4_step(rate, t, x, setting, rate(t, x))
                    if (i + 1) % every == 0:
                        states.append(x)
            else:
                states.extend(adaptive(stepper, rate, x, times, setting, setting))
    except (SimulationError, np.linalg.LinAlgError) as error:
        stopped = f"{type(error).__name__}: {error}"
    seconds = clock() - begun
    kept = np.array([state for state in states if np.all(np.isfinite(state))])
    if len(kept) < len(states):
        stopped = stopped or "left the finite numbers"
    return kept, seconds, stopped


LATE = 1e-9
"""Steps before the end of one within which a change of coordinates belongs to the next."""

Other = Callable[[EquationsOfMotion, Array, Sequence[str]], tuple[EquationsOfMotion, Array]]
"""Equations and state in the coordinates of other joints."""


def same_steps(
    equations: EquationsOfMotion,
    x: Array,
    times: Array,
    stats: Stats,
    other: Other | None = None,
    loose: float = 1.0,
) -> Iterator[Array]:
    """q at each of the times, by RK4, with error control where the run took its steps so.

    Parameters
    ----------
    equations : EquationsOfMotion
        With an exact map.
    x : ndarray (2m,)
        State at times[0].
    times : ndarray (n,)
        Outputs of the run, a step apart, s.
    stats : Stats
        Of the run.
    other : callable, optional
        Changes coordinates where the run did.
    loose : float
        Times the tolerances of the run, for steps with error control: which it chooses by itself.
    """
    f = equations
    yield _configuration(f, x)
    coming = [] if other is None else list(stats.repartitions)
    for begun, end in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        t, h = begun, end - begun
        refined = any(t0 < 0.5 * (t + end) < t1 for t0, t1 in stats.refined)
        while other is not None and coming and coming[0][0] < end - LATE * h:
            when, names = coming.pop(0)
            if when > t:  # within a step with error control
                t, x = when, _refined(f, x, t, when, loose)
            f, x = other(f, x, names)
        x = _refined(f, x, t, end, loose) if refined else rk4_step(f, t, x, end - t, f(t, x))
        yield _configuration(f, x)


def _configuration(f: EquationsOfMotion, x: Array) -> Array:
    return f.explicit.point_at(x[: f.m], x[f.m :]).q


def _refined(f: EquationsOfMotion, x: Array, t: float, end: float, loose: float) -> Array:
    """The state at the end of steps with error control."""
    return next(adaptive("DOP853", f, x, np.array([t, end]), loose * REFINED_RTOL, loose * REFINED_ATOL))
