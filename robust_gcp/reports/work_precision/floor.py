"""The floor: the same steppers on the exact reduced equations, where no mechanism is left to err."""

from __future__ import annotations

import numpy as np

from ... import SimulationError
from ...mechanism.tree.tree import Array
from ..contender import Kind, Outcome, Scene
from ..stepping import stepped
from .reduced import Reduced

FAMILY = "floor"


def named(what: str, stepper: str) -> str:
    """With its stepper."""
    return f"{what}, {'RK4' if stepper == 'rk4' else stepper}"


def name_of(stepper: str) -> str:
    """The floor's name among the points."""
    return named(FAMILY, stepper)


class Floor:
    """A stepper on the exact reduced equations of a scene.

    Its error is what is left when γ, G and g are exact: no method with this stepper, this setting and
    these coordinates errs less but by luck. Its seconds are those of a few scalar operations.
    """

    family = FAMILY
    tuning = "the stepper on the hand-written reduced equation"

    def __init__(self, stepper: str, reduced: Reduced | None) -> None:
        self.name, self.stepper, self._reduced = name_of(stepper), stepper, reduced
        self.kind: Kind = "fixed" if stepper == "rk4" else "adaptive"

    def refuses(self, scene: Scene) -> str:
        """Robots have no exact equation of their coordinates."""
        return "" if self._reduced else "no exact equation of its coordinates is known"

    def run(self, scene: Scene, setting: float) -> Outcome:
        """The step in s, or rtol = atol."""
        reduced, calls = self._reduced, [0]
        assert reduced is not None  # see `refuses`

        def rate(t: float, x: Array) -> Array:
            calls[0] += 1
            if not np.all(np.isfinite(x)):
                raise SimulationError(f"not finite at t = {t:.6g} s")
            return reduced.rate(t, x)

        states, seconds, stopped = stepped(rate, reduced.x0, scene.times, self.stepper, setting)
        q, v = (np.array(part) for part in zip(*map(reduced.read, states), strict=True))
        return Outcome(q, v, seconds, calls[0], stopped)
