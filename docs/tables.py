"""The tables of docs/method.md: `python docs/tables.py floors`, `options`, `thresholds`, `gaps`, `gains`.

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
from robust_gcp.examples import linkages

STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4)
DEFAULT = rg.BridgeOptions()
EXACT: dict[str, Any] = {
    "method": "closed_form",
    "stepper": "DOP853",
    "rtol": 1e-13,
    "atol": 1e-13,
}


class Study:
    """Errors of runs of one mechanism from its home.

    Parameters
    ----------
    mechanism : Mechanism
    duration : float
        s.
    ydot : float
        Initial velocity of the independent joint, rad/s.
    output : float
        s; a multiple of every step. Runs are compared at these times.
    """

    def __init__(
        self, mechanism: rg.Mechanism, duration: float, ydot: float = 0.0, output: float = 1e-2
    ) -> None:
        self.mechanism, self.duration, self.output = mechanism, duration, output
        self.v0 = mechanism.lift(mechanism.home, [ydot])
        self.exact = self.run(output, **EXACT)

    def run(self, step: float, **options: Any) -> Any:
        """q at the output times, (N + 1, nq)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.SingularityWarning)
            run = rg.simulate(self.mechanism, v0=self.v0, duration=self.duration, step=step, **options)
        self.last = run
        return run.q[:: round(self.output / step)]

    def error(self, step: float, **options: Any) -> str:
        """Error of a run, or when and why it stopped."""
        try:
            return f"{np.abs(self.run(step, **options) - self.exact).max():.2e}"
        except rg.SimulationError as error:
            reached = 0.0 if error.trajectory is None else float(error.trajectory.t[-1])
            return f"{type(error).__name__} at {reached:.2f} s"


def floors(quick: bool) -> Iterator[list[str]]:
    """Bridge, floor and the older methods over the step."""
    yield ["mechanism", "h [s]", "bridge", "floor", "Eq. (7)", "classical", "classical, previous"]
    cases = {
        "change point 4, 2, 3, 3": (rg.load("change_point"), 0.0, 5.0),
        "antiparallelogram 1, 2, 1, 2": (linkages.four_bar(1, 2, 1, 2, 1.0, -1), 0.0, 10.0),
        "antiparallelogram 2, 1, 2, 1": (linkages.four_bar(2, 1, 2, 1, 0.1, -1), -2.0, 10.0),
    }
    methods: list[dict[str, Any]] = [
        {"method": "bridge"},
        {"method": "closed_form"},
        {"method": "projection"},
        {"method": "classical"},
        {"method": "classical", "newton_start": "previous"},
    ]
    for name, (mechanism, ydot, duration) in cases.items():
        study = Study(mechanism, 0.2 * duration if quick else duration, ydot)
        for step in STEPS[: 1 if quick else None]:
            yield [name, f"{step:g}", *(study.error(step, **options) for options in methods)]


def options(quick: bool) -> Iterator[list[str]]:
    """The bridge's choices, one at a time."""
    yield ["choice", "value", "error", "distance from the floor's run"]
    study = Study(rg.load("change_point"), 1.0 if quick else 5.0)
    step = 1e-2 if quick else 2e-3
    floor = study.run(step, method="closed_form")
    yield ["floor", "", f"{np.abs(floor - study.exact).max():.2e}", "0"]
    values: dict[str, list[Any]] = {
        "zone": [0.015, 0.025, 0.05, 0.1, 0.15],
        "nodes": [
            (1.0, 1.6),
            (1.0, 1.3, 1.6),
            (1.0, 1.6, 2.2),
            (1.0, 2.0, 3.0),
            (1.0, 1.4, 1.8, 2.2),
        ],
        "closure_tolerance": [1e-13, 1e-12, 1e-11],
        "geometric_tolerance": [1e-10, 1e-9, 1e-8],
        "transversality": [1e-5, 1e-4, 1e-3],
    }
    for choice, tried in values.items():
        for value in tried[: 1 if quick else None]:
            q = study.run(step, options=replace(DEFAULT, **{choice: value}))
            errors = (np.abs(q - other).max() for other in (study.exact, floor))
            yield [choice, str(value), *(f"{error:.2e}" for error in errors)]


def thresholds(quick: bool) -> Iterator[list[str]]:
    """The one choice of Eq. (7), for comparison."""
    yield ["threshold", "h = 0.002 s", "h = 0.001 s"]
    study = Study(rg.load("change_point"), 0.5 if quick else 5.0)
    for threshold in (1e-5, 1e-4, 1e-3, 1e-2)[: 1 if quick else None]:
        errors = (study.error(h, method="projection", threshold=threshold) for h in (2e-3, 1e-3))
        yield [f"{threshold:g}", *errors]


def gaps(quick: bool) -> Iterator[list[str]]:
    """Near misses: the change-point linkage with its ground link short by a gap."""
    yield ["gap [m]", "bridge", "fixed steps on the closed form", "crossings", "refined steps"]
    tried = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10, 1e-12)
    for gap in tried[: 1 if quick else None]:
        study = Study(linkages.four_bar(4.0 - gap, 2.0, 3.0, 3.0, y=2.5), 0.2 if quick else 1.0)
        floor, ours = study.error(2e-3, method="closed_form"), study.error(2e-3)
        kinds = ", ".join(c.kind for c in study.last.crossings) or "none"
        yield [f"{gap:g}", ours, floor, kinds, str(study.last.stats.refined_steps)]


def gains(quick: bool) -> Iterator[list[str]]:
    """The implicit system with Baumgarte's stabilisation, over its gains: K a = k − 2 α K v − β² φ."""
    yield ["α, β [1/s]", "h = 0.01 s", "h = 0.001 s"]
    study = Study(linkages.four_bar(2, 1, 2, 1, 0.1, -1), 0.1 if quick else 10.0, -2.0)
    pairs = [(x, x) for x in (0, 10, 20, 50, 100, 200)] + [(100, 20), (20, 100)]
    for alpha, beta in pairs[: 1 if quick else None]:
        found = []
        for step in (1e-2, 1e-3):
            with np.errstate(all="ignore"):
                error = np.abs(baumgarte(study, step, alpha, beta) - study.exact).max()
            found.append(f"{error:.2e}" if np.isfinite(error) else "NaN")
        yield [f"{alpha}, {beta}", *found]


def baumgarte(study: Study, step: float, alpha: float, beta: float) -> Any:
    """q at the output times by RK4, NaN after a failure."""
    mechanism = study.mechanism
    n, tree = mechanism.nv, mechanism.tree

    def rate(x: Any) -> Any:
        q, v = x[:n], x[n:]
        K, phi, k = mechanism.K(q), mechanism.phi(q), mechanism.k(q, v)
        M, C = tree.crba(q).copy(), tree.rnea(q, v, np.zeros(n)).copy()
        matrix = np.block([[M, K.T], [K, np.zeros((len(K), len(K)))]])
        right = np.concatenate([-C, k - 2.0 * alpha * (K @ v) - beta**2 * phi])
        return np.concatenate([v, np.linalg.solve(matrix, right)[:n]])

    x = np.concatenate([mechanism.home, study.v0])
    every, found = round(study.output / step), np.full_like(study.exact, np.nan)
    found[0] = mechanism.home
    for i in range(1, every * (len(found) - 1) + 1):
        try:
            k1 = rate(x)
            k2 = rate(x + 0.5 * step * k1)
            k3 = rate(x + 0.5 * step * k2)
            x = x + (step / 6.0) * (k1 + 2.0 * (k2 + k3) + rate(x + step * k3))
        except (rg.StateError, np.linalg.LinAlgError):  # no longer finite, or singular
            return found
        if i % every == 0:
            found[i // every] = x[:n]
    return found


TABLES = {table.__name__: table for table in (floors, options, thresholds, gaps, gains)}


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
