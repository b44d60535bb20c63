"""The IFToMM benchmark A02, N rhombic four-bars in a row, against its closed form.

All N + 1 cranks turn alike, so with θ from the upright θ̈ = (g/L) ((3N + 1)/2)/((4N + 1)/3) sin θ: a
pendulum. Twice a turn all loops are singular at once, and the instantaneous freedom is N + 1.
Source: the library of computational benchmark problems of the IFToMM committee for multibody dynamics.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, dataclass

import numpy as np

from .. import OptionError, SimulationError, simulate
from ..arguments import DEFAULT, Arguments, file, number, positive, whole
from ..examples.linkages import n_four_bar
from ..maps.pendulum import pendulum
from ..printing import along, table, write_json

SIZES = (1, 2, 5, 10, 40)
GRAVITY = 9.81
LOW, HIGH = 1e-1, 1e-3
"""The benchmark's two precisions: largest error over 400 outputs, m and m/s."""
OUTPUTS = 400
LADDER = (0.1, 0.05, 0.025, 0.02, 0.0125, 0.01, 0.005, 0.0025, 0.002, 0.001)
"""Steps that are tried for the two precisions, s."""


@dataclass(frozen=True)
class Result:
    """One run."""

    n: int  # loops
    step: float  # s
    # position, velocity: largest error of B0, the tip of the first crank, m and m/s; infinite when the run
    # stopped
    position: float
    velocity: float
    closure: float  # max |φ|, m
    crossings: int
    seconds: float
    microseconds_per_step: float


def measure(n: int, step: float, duration: float = 20.0) -> Result:
    """Simulate A02: cranks upright, B0 at 1 m/s along the ground line, `duration` s."""
    mechanism = n_four_bar(n)
    v0 = mechanism.lift(mechanism.home, [-1.0])
    begun = time.perf_counter()
    try:
        run = simulate(mechanism, v0=v0, duration=duration, step=step)
    except SimulationError:
        return Result(n, step, np.inf, np.inf, np.inf, 0, time.perf_counter() - begun, np.nan)
    seconds = time.perf_counter() - begun
    every = max(1, (len(run.t) - 1) // OUTPUTS)
    t, angle, speed = run.t[::every], run.q[::every, 0], run.v[::every, 0]
    A, B = (4 * n + 1) / 3.0, (3 * n + 1) / 2.0 * GRAVITY
    exact, rate, _ = pendulum(t, np.pi / 2, -1.0, A, B)
    tip = np.exp(1j * angle) - np.exp(1j * exact)
    drift = speed * 1j * np.exp(1j * angle) - rate * 1j * np.exp(1j * exact)
    position, velocity = (float(np.abs(off).max()) for off in (tip, drift))
    closure = float(max(np.abs(mechanism.phi(q)).max() for q in run.q[::every]))
    pace = 1e6 * seconds / (len(run.t) - 1)
    return Result(n, step, position, velocity, closure, len(run.crossings), seconds, pace)


def largest_step(n: int, threshold: float, duration: float = 20.0) -> Result:
    """The largest step of the ladder whose position and velocity errors pass, else its last."""
    for step in (step for step in LADDER if step <= duration):
        result = measure(n, step, duration)
        if max(result.position, result.velocity) <= threshold:
            return result
    return result


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"numbers of loops; {DEFAULT}"
    add_to.add("--sizes", whole(1, 1000), type=int, nargs="+", default=list(SIZES), metavar="N", help=text)
    add_to.add("--step", positive, type=number, default=1e-3, metavar="S", help=f"s; {DEFAULT}")
    add_to.add("--duration", positive, type=number, default=20.0, metavar="S", help=f"s; {DEFAULT}")
    add_to.path("--out", file((".json",), "a record of runs"), "FILE", "write every run to this JSON file")


def run(args: argparse.Namespace) -> int:
    """Print the table and the exponent of the cost; exit code 1 when a run stopped."""
    if args.duration < max(args.step, LADDER[-1]):
        raise OptionError(f"--duration {args.duration:g} s is shorter than the steps that are tried")
    fine, low, high = [], [], []
    for n in along(args.sizes, "A02"):
        fine.append(measure(n, args.step, args.duration))
        low.append(largest_step(n, LOW, args.duration))
        high.append(largest_step(n, HIGH, args.duration))
    results = [*fine, *low, *high]
    header = [" N", " step [s]", " error [m]", " error [m/s]", " closure [m]", " crossings", " µs/step"]
    form = "{n}|{step:g}|{position:.1e}|{velocity:.1e}|{closure:.1e}|{crossings}|{microseconds_per_step:.0f}"
    print(table(header, [form.format(**vars(r)).split("|") for r in results], None))
    if len(fine) > 2:
        logs = np.log([[r.n, r.microseconds_per_step] for r in fine])
        slope = float(np.polyfit(logs[-3:, 0], logs[-3:, 1], 1)[0])
        print(f"cost per step grows as N^{slope:.2f} over the largest sizes")
    if args.out:
        write_json(args.out, [asdict(r) for r in results])
    return 0 if all(np.isfinite(r.position) for r in results) else 1
