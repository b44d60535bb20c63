"""A motion of the study: a scene, its exact motion, and the ladder of steps or tolerances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...mechanism.tree.tree import Array
from ..contender import Scene
from .reduced import Reduced
from .references import Reference

OUTPUTS = 400
STEPS = (1, 2, 3, 4, 6, 8, 16, 32, 64, 128)
"""Steps in each output interval, coarse to fine."""

SLOW_STEPS, SLOW_CAP = (1, 2, 3, 4, 5, 6, 8, 16, 32), 1.2
"""Of scenes whose evaluations cost ten times those of a four-bar; the cap in s."""

TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13)


@dataclass(frozen=True)
class Motion:
    """A scene with its exact motion."""

    scene: Scene
    title: str  # for figures and tables
    floor: Reduced | None  # the exact reduced equations, which floors are integrated from
    solve: Callable[[], Reference]
    steps: tuple[int, ...] = STEPS  # steps in each output interval
    cap: float = 0.5  # longest run that is timed, s


def times_of(duration: float) -> Array:
    """The output times."""
    return np.linspace(0.0, duration, OUTPUTS + 1)
