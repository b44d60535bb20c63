"""Any stepper on any first-order equations, over given output times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import SimulationError
from ..mechanism.tree.tree import Array
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
