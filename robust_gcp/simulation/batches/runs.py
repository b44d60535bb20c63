"""What came of many starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...errors import RobustGcpError
from ..trajectories.trajectory import Trajectory


@dataclass(frozen=True)
class Runs(Sequence[Trajectory | None]):
    """What came of many starts.

    `runs[i]`, `len(runs)` and iteration give the trajectories.

    Attributes
    ----------
    trajectories : list of Trajectory or None
        By start: up to where it stopped, None where it did not begin.
    errors : dict of int to RobustGcpError
        Why a start stopped or did not begin.
    """

    trajectories: list[Trajectory | None]
    errors: dict[int, RobustGcpError] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.trajectories)

    def __getitem__(self, i: Any) -> Any:
        return self.trajectories[i]

    def __iter__(self) -> Iterator[Trajectory | None]:
        return iter(self.trajectories)

    def __repr__(self) -> str:
        return f"Runs: {len(self)} starts, {len(self.errors)} of them with errors"
