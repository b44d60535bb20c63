"""How a mechanism is best simulated where the caller does not say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..checks import check_positive
from .tree.tree import Array


@dataclass(frozen=True)
class Recommended:
    """What `simulate` takes for arguments that are left out.

    Attributes
    ----------
    duration, step : float
        s.
    v0 : ndarray (nv,) or None
        Velocity at home, for runs of which neither start nor mode is named; at rest when None.

    Raises
    ------
    OptionError
        When duration or step is not a positive, finite number.
    """

    duration: float = 1.0
    step: float = 1e-3
    v0: Array | None = None

    def __post_init__(self) -> None:
        check_positive("duration", self.duration)
        check_positive("step", self.step)

    def run(self, duration: float | None, step: float | None) -> tuple[float, float]:
        """Duration and step, s: those that are given, else the recommended ones."""
        return (
            self.duration if duration is None else duration,
            self.step if step is None else step,
        )

    def velocity(self, q0: Any, mode: Any) -> Array | None:
        """The velocity to begin with where nothing else of the start is given."""
        return self.v0 if q0 is None and mode is None else None
