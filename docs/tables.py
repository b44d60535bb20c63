"""The tables of docs/method.md: `python docs/tables.py floors | options | thresholds | gaps`.

Every error is max |q − exact| over the run, rad, against the closed form integrated by DOP853 with
rtol = atol = 1e-13.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

import robust_gcp as rg
from robust_gcp import scenes

STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4)
DEFAULT = rg.BridgeOptions()
EXACT: dict[str, Any] = {
    "method": "closed_form",
    "stepper": "DOP853",
    "rtol": 1e-13,
    "atol": 1e-13,
}


class Study:
    """Errors of runs of one mechanism from its home, at rest.

    Parameters
    ----------
    mechanism : Mechanism
    duration, output : float
        s; `output` is a multiple of every step.
    """

    def __init__(self, mechanism: rg.Mechanism, duration: float, output: float = 1e-2) -> None:
        self.mechanism, self.duration, self.output = mechanism, duration, output
        self.exact = rg.simulate(mechanism, duration=duration, step=output, **EXACT)

    def error(self, step: float, **options: Any) -> str:
        """Error of a run, or when it stopped."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.SingularityWarning)
            try:
                run = rg.simulate(self.mechanism, duration=self.duration, step=step, **options)
            except rg.SimulationError as error:
                reached = 0.0 if error.trajectory is None else error.trajectory.t[-1]
                return f"{type(error).__name__} at {reached:.2f} s"
        every = round(self.output / step)
        return f"{np.abs(run.q[::every] - self.exact.q).max():.2e}"


def floors(quick: bool) -> Iterator[list[str]]:
    """Bridge, floor and the older methods over the step."""
    yield ["mechanism", "h [s]", "bridge", "floor", "Eq. (7)", "classical", "classical, previous"]
    cases = {
        "change_point": (rg.load("change_point"), 5.0),
        "antiparallelogram 1, 2, 1, 2": (scenes.four_bar(1, 2, 1, 2, y=1.0, assembly=-1), 10.0),
        "antiparallelogram 2, 1, 2, 1": (scenes.four_bar(2, 1, 2, 1, y=1.0, assembly=-1), 10.0),
    }
    methods: list[dict[str, Any]] = [
        {"method": "bridge"},
        {"method": "closed_form"},
        {"method": "projection"},
        {"method": "classical"},
        {"method": "classical", "newton_start": "previous"},
    ]
    for name, (mechanism, duration) in cases.items():
        study = Study(mechanism, 0.1 * duration if quick else duration)
        for step in STEPS[: 1 if quick else None]:
            yield [name, f"{step:g}", *(study.error(step, **options) for options in methods)]


def options(quick: bool) -> Iterator[list[str]]:
    """The bridge's choices, one at a time."""
    yield ["choice", "value", "error", "error / floor"]
    study = Study(rg.load("change_point"), 0.5 if quick else 5.0)
    floor = study.error(2e-3, method="closed_form")
    yield ["floor", "", floor, "1"]
    values: dict[str, list[Any]] = {
        "zone": [0.015, 0.025, 0.05, 0.1, 0.15],
        "nodes": [(1.0, 1.6), (1.0, 1.3, 1.6), (1.0, 1.6, 2.2), (1.0, 2.0, 3.0), (1.0, 1.4, 1.8, 2.2)],
        "closure_tolerance": [1e-13, 1e-12, 1e-11],
        "geometric_tolerance": [1e-10, 1e-9, 1e-8],
        "transversality": [1e-5, 1e-4, 1e-3],
    }
    for choice, tried in values.items():
        for value in tried[: 1 if quick else None]:
            found = study.error(2e-3, options=replace(DEFAULT, **{choice: value}))
            ratio = float(found) / float(floor) if found[0].isdigit() else float("nan")
            yield [choice, str(value), found, f"{ratio:.4f}"]


def thresholds(quick: bool) -> Iterator[list[str]]:
    """The one choice of Eq. (7), for comparison."""
    yield ["threshold", "h = 0.002 s", "h = 0.001 s"]
    study = Study(rg.load("change_point"), 0.5 if quick else 5.0)
    for threshold in (1e-5, 1e-4, 1e-3, 1e-2)[: 1 if quick else None]:
        errors = (study.error(h, method="projection", threshold=threshold) for h in (2e-3, 1e-3))
        yield [f"{threshold:g}", *errors]


def gaps(quick: bool) -> Iterator[list[str]]:
    """Near misses: the crossing of the change-point linkage opened by a length error of l0."""
    yield ["gap [m]", "bridge", "floor", "crossings", "refined steps"]
    for gap in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10, 1e-12)[: 1 if quick else None]:
        mechanism = scenes.four_bar(4.0 - gap, 2.0, 3.0, 3.0, y=2.5)
        study = Study(mechanism, 0.2 if quick else 1.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.SingularityWarning)
            run = rg.simulate(mechanism, duration=study.duration, step=2e-3)
        kinds = ", ".join(c.kind for c in run.crossings) or "none"
        floor = study.error(2e-3, method="closed_form")
        yield [f"{gap:g}", study.error(2e-3), floor, kinds, str(run.stats.refined_steps)]


TABLES = {table.__name__: table for table in (floors, options, thresholds, gaps)}


def main() -> None:
    """Print one table as Markdown, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", choices=TABLES)
    parser.add_argument("--quick", action="store_true", help="a short excerpt")
    given = parser.parse_args()
    for i, row in enumerate(TABLES[given.table](given.quick)):
        print(f"| {' | '.join(row)} |", flush=True)
        if i == 0:
            print("|" + "---|" * len(row))


if __name__ == "__main__":
    main()
