"""Random cases against the floor of their stepper: what such studies judge by, ask for and print."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..arguments import DEFAULT, Arguments, file, pathname, whole
from ..mechanism.tree import Array
from ..printing import table, write_json

ROUNDING = 1e-11
"""rad: below this a floor measures the rounding of the reference, not the stepper's error."""


AT_AN_END = 1e-6
"""Turns: a crank that starts or ends so near to its crossing may count or not."""


Counts = NDArray[np.int64]


class RandomCase:
    """A case, a dataclass of the study's, with errors of the same steps on the closed form and by bridges."""

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

    def record(self) -> dict[str, object]:
        """Plain values for JSON."""
        return asdict(self) | {"ratio": self.ratio, "good": self.good}  # type: ignore[call-overload]


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


def arguments(add_to: Arguments, count: int, cases: str) -> None:
    """Name the arguments of a study that draws so many cases when it is not told."""
    add_to.add("--count", whole(1), type=int, default=count, metavar="N", help=f"how many; {DEFAULT}")
    add_to.add("--seed", whole(0), type=int, default=20, metavar="N", help=f"of the drawing; {DEFAULT}")
    text = f"write every {cases.removesuffix('s')} to this JSON file"
    add_to.add("--out", file((".json",), f"a record of {cases}"), type=pathname, metavar="FILE", help=text)


def report(
    cases: Sequence[RandomCase], rows: Sequence[Sequence[str]], seconds: float, out: Path | None
) -> int:
    """Print the rows, how far the worst is off, and what is not good; exit code 1 when something is not."""
    ratios = np.array([case.ratio for case in cases if not case.failure])
    judged = ["largest error / floor", f"{ratios.max(initial=0.0):.4f}"]
    print(table(["", " "], [*rows, judged, ["wall time", f"{seconds:.1f} s"]]))
    bad = [case for case in cases if not case.good]
    for case in bad:
        print(json.dumps(case.record()))
    if out:
        write_json(out, [case.record() for case in cases])
    return 1 if bad else 0
