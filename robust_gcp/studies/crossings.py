"""Crossings by the thousand: random change-point linkages against the closed form."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass

import numpy as np
from scipy.optimize import brentq

from ..arguments import DEFAULT, Arguments, file, pathname, whole
from ..errors import OptionError, RobustGcpError
from ..examples.linkages import four_bar
from ..maps.closed_form import FourBar
from ..mechanism.mechanism import Mechanism
from ..printing import along, table, write_json
from ..simulation.simulate import simulate

ROUNDING = 1e-11
"""rad: below this a floor measures the rounding of the reference, not the stepper's error."""

MOST_STEPS = 100
"""Steps before the crossing, at the most: keeps a thousand cases to some minutes."""


@dataclass(frozen=True)
class Case:
    """One random crossing and how it went."""

    lengths: tuple[float, float, float, float]  # l0, l1, l2, l3, m; a change-point linkage
    assembly: int
    # y, speed: start, rad and rad/s
    y: float
    speed: float
    step: float  # s
    landing: bool  # whether the start was chosen so that a step ends within 1e-12 rad of the crossing
    crossings: int = 0  # crossings logged
    nearest: float = np.inf  # smallest distance of an accepted y from the crossing, rad
    # floor, error: largest error of q over the run, rad: of the same stepper on the closed form, and of the
    # bridge
    floor: float = np.nan
    error: float = np.nan
    failure: str = ""  # the message of an error, else empty

    @property
    def ratio(self) -> float:
        """Error over floor, the floor not below rounding."""
        return self.error / max(self.floor, ROUNDING)

    @property
    def good(self) -> bool:
        """No failure, and the error within ten times the floor."""
        return not self.failure and self.ratio <= 10.0

    def record(self) -> dict[str, object]:
        """Plain values for JSON."""
        return asdict(self) | {"ratio": self.ratio, "good": self.good}


def random_crossings(count: int, seed: int) -> tuple[list[Case], float]:
    """Simulate `count` random crossings, with a bar; returns the cases and the seconds that it took."""
    rng = np.random.default_rng(seed)
    begun = time.perf_counter()
    cases = [_run(_draw(rng)) for _ in along(range(count), "crossings")]
    return cases, time.perf_counter() - begun


def _draw(rng: np.random.Generator) -> Case:
    """A change-point linkage, started up to 0.6 rad beside its crossing and moving towards it.

    l0 + l1 = l2 + l3 meets its other mode at y = π, |l0 − l1| = |l2 − l3| at y = 0. Lengths that
    make one link coincide with another to a few per cent are drawn anew: two crossings would merge.
    """
    while True:
        l1, l2, l3 = rng.uniform(0.5, 3.0, 3)
        at_pi = bool(rng.random() < 0.5)
        if at_pi:
            l0, center = l2 + l3 - l1, np.pi
        else:
            l0, center = l1 + abs(l2 - l3) * (1.0 if rng.random() < 0.5 else -1.0), 0.0
        lengths = (float(l0), float(l1), float(l2), float(l3))
        pairs = [abs(a - b) for i, a in enumerate(lengths) for b in lengths[i + 1 :]]
        if l0 < 0.3 or min(pairs) < 0.1 or max(lengths) > 0.95 * (sum(lengths) - max(lengths)):
            continue
        step = float(10.0 ** rng.uniform(-4.0, np.log10(2e-2)))
        pace = float(rng.uniform(2.0, 6.0))
        offset = min(float(rng.uniform(0.15, 0.6)), MOST_STEPS * step * pace)
        offset *= 1.0 if rng.random() < 0.5 else -1.0
        try:
            for assembly in (1, -1):
                linkage = FourBar(*lengths, assembly)
                for side in (offset, -offset):
                    linkage.evaluate(center + side)
                    linkage.evaluate(center + 1.5 * side)
        except OptionError:
            continue
        speed = -float(np.sign(offset)) * pace
        assembly = 1 if rng.random() < 0.5 else -1
        landing = bool(rng.random() < 0.2)
        case = Case(lengths, assembly, center + offset, speed, step, landing)
        return _landed(case, center) if landing else case


def _build(case: Case, y: float) -> Mechanism:
    return four_bar(*case.lengths, y=y, assembly=case.assembly)


def _landed(case: Case, center: float) -> Case:
    """The case with its start moved so that the fourth step of the closed form ends on the crossing."""
    duration = 4.0 * case.step

    def miss(y: float) -> float:
        mechanism = _build(case, y)
        v0 = _velocity(case, y)
        run = simulate(mechanism, v0=v0, duration=duration, step=case.step, method="closed_form")
        return float(run.q[-1, 0]) - center

    near = center - 1.3 * case.speed * duration
    far = center - 0.7 * case.speed * duration
    try:
        if miss(near) * miss(far) < 0.0:
            y = float(brentq(miss, near, far, xtol=1e-15, rtol=1e-14))
            return Case(case.lengths, case.assembly, y, case.speed, case.step, True)
    except RobustGcpError:
        pass
    return Case(case.lengths, case.assembly, case.y, case.speed, case.step, False)


def _velocity(case: Case, y: float) -> np.ndarray:
    _, G, _ = FourBar(*case.lengths, case.assembly).evaluate(y)
    return G * case.speed


def _run(case: Case) -> Case:
    center = np.pi if abs(case.y - np.pi) < abs(case.y) else 0.0
    mechanism = _build(case, case.y)
    v0 = _velocity(case, case.y)
    reach = 2.0 * abs(case.y - center) / abs(case.speed)
    duration = case.step * max(8.0, np.ceil(reach / case.step))
    output = duration / round(duration / case.step)
    common = {"v0": v0, "duration": duration, "step": output}
    try:
        exact = simulate(mechanism, **common, method="closed_form", stepper="DOP853", rtol=1e-13, atol=1e-13)
        floor = simulate(mechanism, **common, method="closed_form")
        ours = simulate(mechanism, **common)
    except RobustGcpError as error:
        return Case(**{**asdict(case), "failure": f"{type(error).__name__}: {error}"})
    result = {
        "crossings": len(ours.crossings),
        "nearest": float(np.abs(ours.q[:, 0] - center).min()),
        "floor": float(np.abs(floor.q - exact.q).max()),
        "error": float(np.abs(ours.q - exact.q).max()),
    }
    return Case(**{**asdict(case), **result})


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.add("--count", whole(1), type=int, default=1000, metavar="N", help=f"how many; {DEFAULT}")
    add_to.add("--seed", whole(0), type=int, default=20, metavar="N", help=f"of the drawing; {DEFAULT}")
    text = "write every case to this JSON file"
    add_to.add("--out", file((".json",), "a record of cases"), type=pathname, metavar="FILE", help=text)


def run(args: argparse.Namespace) -> int:
    """Print the summary; exit code 1 when a case is not good."""
    cases, seconds = random_crossings(args.count, args.seed)
    bad = [case for case in cases if not case.good]
    ratios = np.array([case.ratio for case in cases if not case.failure])
    nearest = np.array([case.nearest for case in cases])
    rows = [
        ["cases, seed", f"{len(cases)}, {args.seed}"],
        ["good: no failure, error within 10 floors", f"{len(cases) - len(bad)}"],
        ["crossings passed", f"{sum(case.crossings for case in cases)}"],
        ["landed within 1e-12 rad of the crossing", f"{int((nearest <= 1e-12).sum())}"],
        ["largest error / floor", f"{ratios.max(initial=0.0):.4f}"],
        ["wall time", f"{seconds:.1f} s"],
    ]
    print(table(["", " "], rows))
    for case in bad:
        print(json.dumps(case.record()))
    if args.out:
        write_json(args.out, [case.record() for case in cases])
    return 1 if bad else 0
