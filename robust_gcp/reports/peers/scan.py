"""The scan behind the peers' tuned parameters: `python -m robust_gcp.reports.peers.scan TOOL`.

Each candidate runs regular mechanisms and others through their singular configurations, from several
starts and with several steps. Its score is its mean number of correct digits, −log10 of the largest error
of any joint over all outputs, between 0 (also for runs that stop) and 16.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ... import Mechanism, load, simulate
from ...examples.linkages import four_bar
from ...mechanism.tree.tree import Array
from ...printing import along, table
from ..contender import Contender, Scene
from .pinocchio import per_duration, per_step

REGULAR = ("crank_rocker", "andrews", "bricard")
SINGULAR = ("rhombus", "parallelogram", "antiparallelogram", "change_point")
SHIFTS = (0.0, 0.013, 0.031)
"""Of the first coordinate's start, rad: whether a run survives a singularity can hang on the last digit."""
DIVISIONS = (2, 4, 8, 16)
"""Steps between outputs."""


@dataclass(frozen=True)
class Score:
    """How a candidate did."""

    name: str
    # regular, singular: mean correct digits
    regular: float
    singular: float
    stopped: int
    runs: int


def scenes(names: Sequence[str], shifts: Sequence[float]) -> Iterator[tuple[Scene, Array]]:
    """Free motion from starts near home, and its q at the output times by DOP853."""
    for name in names:
        mechanism = _mechanism(name)
        duration = 0.03 if name == "andrews" else 5.0
        for shift in shifts:
            guess = mechanism.home.copy()
            guess[mechanism.iq_independent[0]] += shift
            q0 = mechanism.assemble(guess) if shift else mechanism.home
            fine: dict[str, Any] = {"stepper": "DOP853", "rtol": 1e-12, "atol": 1e-13}
            run = simulate(mechanism, q0, duration=duration, step=duration / 400, **fine)
            yield Scene(name, mechanism, run.q[0], run.v[0], run.t), run.q


def _mechanism(name: str) -> Mechanism:
    if name == "antiparallelogram":
        return four_bar(1.0, 2.0, 1.0, 2.0, assembly=-1)
    return load(name)


def digits(contender: Contender, scene: Scene, q: Array, divisions: Sequence[int]) -> Iterator[float]:
    """Correct digits with each step; NaN for a run that stopped."""
    for count in divisions:
        outcome = contender.run(scene, float(scene.times[1]) / count)
        right = np.clip(-np.log10(max(outcome.error(q), 1e-16)), 0.0, 16.0)
        yield float("nan") if outcome.stopped else float(right)


def score(
    contender: Contender,
    regular: Sequence[tuple[Scene, Array]],
    singular: Sequence[tuple[Scene, Array]],
    divisions: Sequence[int] = DIVISIONS,
) -> Score:
    """Run a candidate on all scenes."""
    found = [
        np.array([list(digits(contender, scene, q, divisions)) for scene, q in group])
        for group in (regular, singular)
    ]
    means = [float(np.nan_to_num(group).mean()) for group in found]
    stopped = sum(int(np.isnan(group).sum()) for group in found)
    return Score(contender.name, means[0], means[1], stopped, sum(group.size for group in found))


def _tuned(package: str) -> Any:
    """The contender that the scan is about; a dataclass of its adapter."""
    made = importlib.import_module(f"{__package__}.{package}").contenders()
    return next((c for c in made if c.name.endswith("tuned")), made[0])


def pinocchio_candidates() -> list[Contender]:
    """Baumgarte's ω as a multiple of the scene's duration or of the step, and mu."""
    tuned = _tuned("pinocchio")
    many, few = (100.0, 200.0, 500.0, 1000.0, 2000.0), (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    mus = (1e-6, 1e-10, 1e-12)
    return [
        *(replace(tuned, name=f"ω = {n:g}/T, at most 0.5/h", omega=per_duration(n)) for n in many),
        *(replace(tuned, name=f"ω = {c:g}/h", omega=per_step(c)) for c in few),
        *(replace(tuned, name=f"tuned, but mu = {mu:g}", how=replace(tuned.how, mu=mu)) for mu in mus),
        tuned,
    ]


def mujoco_candidates() -> list[Contender]:
    """The constraints' time constant in steps and in seconds, and the integrator."""
    tuned = _tuned("mujoco")

    def linear(name: str, per_step: float, seconds: float) -> Contender:
        return replace(tuned, name=name, time_constant=lambda step: per_step * step + seconds)

    return [
        *(linear(f"RK4, solref = {n:g} h", n, 0.0) for n in (2.0, 3.0, 4.0, 6.0, 10.0)),
        *(linear(f"RK4, solref = {seconds:g} s", 0.0, seconds) for seconds in (0.02, 0.05)),
        *(replace(tuned, name=f"{kind}, tuned", stepper=kind) for kind in ("Euler", "implicitfast")),
    ]


def exudyn_candidates() -> list[Contender]:
    """Spectral radius, Newton's kind and tolerance."""
    names = ("generalizedAlpha.spectralRadius", "newton.useModifiedNewton", "newton.relativeTolerance")
    return [
        replace(
            _tuned("exudyn"),
            name=f"ρ = {radius:g}, {'modified' if modified else 'full'} Newton to {tolerance:g}",
            integration=dict(zip(names, (radius, modified, tolerance), strict=True)),
        )
        for radius in (0.6, 0.8, 0.9, 1.0)
        for modified in (True, False)
        for tolerance in (1e-8, 1e-10)
    ]


CANDIDATES = {"pinocchio": pinocchio_candidates, "mujoco": mujoco_candidates, "exudyn": exudyn_candidates}


def main() -> int:
    """Print the table of one tool's candidates."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("tool", choices=CANDIDATES)
    args = parser.parse_args()
    regular, singular = (list(scenes(names, SHIFTS)) for names in (REGULAR, SINGULAR))
    candidates = CANDIDATES[args.tool]()
    rows = [
        [s.name, f"{s.regular:.2f}", f"{s.singular:.2f}", f"{s.stopped} of {s.runs}"]
        for s in (score(c, regular, singular) for c in along(candidates, args.tool))
    ]
    print(table(["candidate", " regular", " singular", " stopped"], rows, None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
