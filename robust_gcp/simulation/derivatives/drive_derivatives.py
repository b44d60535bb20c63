"""How a cost changes with the motions of driven joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...checks import hint, shown
from ...dynamics.discrete import STAGES
from ...dynamics.prescribed.drive import Drive
from ...dynamics.prescribed.motion import Motion
from ...errors import OptionError
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array

PLACES = len(STAGES) + 1
"""At which a step asks for prescribed motions: its stages and its end."""


@dataclass(frozen=True)
class DriveSlopes:
    """∂J/∂(p, ṗ, p̈) of the prescribed motions at each time at which they were asked for.

    Attributes
    ----------
    names : tuple of str
    times : ndarray (K,)
        s; a time at which one step ends and another begins is there for both.
    weights : ndarray (K, 3, driven)
    """

    names: tuple[str, ...]
    times: Array
    weights: Array

    def of(self, names: tuple[str, ...]) -> DriveSlopes:
        """Those of some of the joints."""
        which = [self.names.index(name) for name in names]
        return DriveSlopes(names, self.times, self.weights[:, :, which])

    def along(self, changes: Any) -> float:
        """Σ weights · (δp, δṗ, δp̈).

        Raises
        ------
        OptionError
            For joints that were not driven, and what is no motion.
        """
        if not isinstance(changes, Mapping) or not changes:
            raise OptionError(f"by_drive: {shown(changes)} must be {{joint: rg.Motion(change)}}")
        total = 0.0
        for name, motion in changes.items():
            if name not in self.names:
                raise OptionError(f"by_drive: {shown(name)} was not driven{hint(name, self.names)}")
            if not isinstance(motion, Motion):
                raise OptionError(
                    f"by_drive[{name!r}] = {shown(motion)} is no Motion; give rg.Motion(change)"
                )
            total += float(np.sum(self.weights[:, :, self.names.index(name)] * motion.over(self.times).T))
        return total


class DriveSweep:
    """Collects `DriveSlopes` as a reverse sweep goes through a run.

    Parameters
    ----------
    times : ndarray (N + 1,)
        Of the outputs, s.
    motions : mapping of str to Motion
        Of the joints that moved as prescribed.
    """

    def __init__(self, times: Array, motions: Mapping[str, Motion]) -> None:
        self._times, self._motions = times, motions
        self._by: Array = np.zeros((len(times) - 1, PLACES, 3, len(motions)))
        self._at_start: Array = np.zeros((3, len(motions)))

    def of(self, mechanism: Mechanism, i: int = 0) -> Drive:
        """In a mechanism's coordinates, from output i on."""
        return Drive(mechanism, self._motions, float(self._times[i]))

    def add(self, first: int, by_drive: Array) -> None:
        """Of steps from `first` on, (N, 5, 3, driven)."""
        self._by[first : first + len(by_drive)] += by_drive

    def begin(self, adjoint: Array, mechanism: Mechanism) -> None:
        """Take what multiplies (η, u) of driven joints at the start out of the adjoint (2m,)."""
        driven = self.of(mechanism).driven
        for kind, places in enumerate((driven, mechanism.m + driven)):
            self._at_start[kind] += adjoint[places]
            adjoint[places] = 0.0

    def found(self) -> DriveSlopes:
        """All of it."""
        steps = np.diff(self._times)
        times = self._times[:-1, None] + np.multiply.outer(steps, np.array((*STAGES, 1.0)))
        times[:, -1] = self._times[1:]
        weights = np.concatenate([self._at_start[None], self._by.reshape(-1, *self._at_start.shape)])
        return DriveSlopes(tuple(self._motions), np.append(self._times[0], times), weights)
