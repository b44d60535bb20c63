"""Random cases against the floor of their stepper: what they are judged by, and what they come to."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from robust_gcp.mechanism.tree.tree import Array

ROUNDING = 1e-11
"""rad: below this a floor measures the rounding of the reference, not the stepper's error."""


AT_AN_END = 1e-6
"""Turns: a crank that starts or ends so near to its crossing may count or not."""


Counts = NDArray[np.int64]


class RandomCase:
    """A case, a dataclass of its campaign: errors of the same steps on the closed form and by bridges."""

    crossings: int | tuple[int, ...]
    floor: float
    error: float
    failure: str

    @property
    def ratio(self) -> float:
        """Error over floor, the floor not below rounding."""
        return self.error / max(self.floor, ROUNDING)

    @property
    def good(self) -> bool:
        """Whether the case went as it ought to."""
        raise NotImplementedError


def passed(cranks: Array, centers: Array, logged: Counts) -> tuple[Counts, Counts]:
    """How often each crank passes its crossing, or that and whole turns, and what was logged.

    Parameters
    ----------
    cranks : ndarray (N, n)
        Angles by time, rad.
    centers : ndarray (n,)
        Where they cross, rad.
    logged : ndarray (n,)
        How often that was logged; returned as expected for those that start or end there.
    """
    turns = (cranks - centers) / (2.0 * np.pi)
    expected = np.abs(np.diff(np.floor(turns), axis=0)).astype(int).sum(axis=0)
    at_an_end = np.abs(turns - np.round(turns))[[0, -1]].min(axis=0) < AT_AN_END
    return expected, np.where(at_an_end, expected, logged)


def figures(cases: Sequence[RandomCase]) -> dict[str, float]:
    """What the cases come to."""
    return {
        "cases": len(cases),
        "good": sum(case.good for case in cases),
        "crossings passed": sum(int(np.sum(case.crossings)) for case in cases),
        "refused": sum(bool(case.failure) for case in cases),
        "largest error / floor": max((case.ratio for case in cases if not case.failure), default=0.0),
    }


def bad(cases: Sequence[RandomCase]) -> str:
    """The records of those that are not good, a line each."""
    return "\n".join(json.dumps(asdict(case) | {"ratio": case.ratio}) for case in cases if not case.good)
