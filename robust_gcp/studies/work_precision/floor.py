"""The floor: the same steppers on the exact reduced equations, where no mechanism is left to err."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ...errors import SimulationError
from ...mechanism.tree import Array
from ...simulation.steppers import adaptive, rk4_step
from ..contender import Kind, Outcome, Scene
from .reduced import Reduced

STEPPERS = ("rk4", "DOP853", "Radau", "LSODA")
FAMILY = "floor"


def name_of(stepper: str) -> str:
    """The floor's name among the points."""
    return f"floor, {'RK4' if stepper == 'rk4' else stepper}"


class Floor:
    """A stepper on the exact reduced equations of a scene.

    Its error is what is left when γ, G and g are exact: no method with this stepper, this setting and
    these coordinates errs less but by luck. Its seconds are those of a few scalar operations.
    """

    family = FAMILY
    tuning = "the stepper on the hand-written reduced equation"

    def __init__(self, stepper: str, reduced: Callable[[str], Reduced]) -> None:
        self.name, self.stepper, self._reduced = name_of(stepper), stepper, reduced
        self.kind: Kind = "fixed" if stepper == "rk4" else "adaptive"

    def refuses(self, scene: Scene) -> str:
        """Every scene has one."""
        return ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        """The step in s, or rtol = atol."""
        reduced, times, calls = self._reduced(scene.name), scene.times, [0]

        def rate(t: float, x: Array) -> Array:
            calls[0] += 1
            if not np.all(np.isfinite(x)):
                raise SimulationError(f"not finite at t = {t:.6g} s")
            return reduced.rate(t, x)

        states, stopped = [reduced.x0], ""
        begun = time.perf_counter()
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                if self.kind == "adaptive":
                    states.extend(adaptive(self.stepper, rate, reduced.x0, times, setting, setting))
                else:
                    every, x = round(float(times[1]) / setting), reduced.x0
                    for i in range(every * (len(times) - 1)):
                        x = rk4_step(rate, i * setting, x, setting, rate(i * setting, x))
                        if (i + 1) % every == 0:
                            states.append(x)
        except SimulationError as error:
            stopped = f"{type(error).__name__}: {error}"
        seconds = time.perf_counter() - begun
        poses = [reduced.read(x) for x in states if np.all(np.isfinite(x))]
        q, v = (np.array([pose[i] for pose in poses]) for i in (0, 1))
        return Outcome(q, v, seconds, calls[0], stopped)
