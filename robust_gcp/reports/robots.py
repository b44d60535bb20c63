"""The command `robots`: which robots' files of a folder load and run as they are, and how well.

Each file is loaded without any argument and simulated from its home with a random velocity of its loops, as
`simulate` does where no step is named, and then once more with half the step, or with tolerances a hundred
times tighter where error control took over. What is done right shows in the loops, which stay closed to
rounding, and in the energy, whose error falls with h⁴ (with the tolerances) or is rounding already.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import Mechanism, RobustGcpError, StateError, load, simulate
from ..arguments import Arguments, known_folder, number, positive
from ..io.robot_file import READERS
from ..mechanism.tree.tree import Array
from ..printing import table

CLOSED = 1e-10
"""max |φ| / length that a run may leave."""

ROUNDED = 1e-11
"""Energy error, against what moves to and fro, that no step makes smaller."""

ORDER = 3.5
"""Least order by which the energy error falls."""

TIGHTER = 1e-2
"""Tolerances of the second run with error control, as a share of those of the first."""

FALLS = 0.2
"""Share of the energy error that these may leave."""

HEADER = (
    "file", " nv", " rows", " m", " load s", "step", " run s", " closure", " energy", " finer", "verdict"
)  # fmt: skip
AWAY = 0.05
"""rad or lengths that a home is left by where it is singular: coordinates determine no velocity there."""

WORDS = 70
"""Letters of a refusal that the table shows."""


@dataclass
class Entry:
    """What became of one file."""

    file: str
    verdict: str = "refused"  # else "runs", "falls short", "stops"
    mechanism: Mechanism | None = None
    seconds: list[float] = field(default_factory=list)  # to load, and for the first run
    step: str = ""  # that was taken, ms, or what took over
    closure: float = float("nan")  # largest max |φ| / length of both runs
    energy: list[float] = field(default_factory=list)  # largest error of each run, J
    why: str = ""  # what refused it or stopped it

    def cells(self) -> list[str]:
        """A row of the table."""
        mech = self.mechanism
        sizes = ["", "", ""] if mech is None else [str(mech.nv), str(mech.nc), str(mech.m)]
        load, run = [f"{s:.2f}".replace("nan", "") for s in (*self.seconds, np.nan, np.nan)[:2]]
        errors = [f"{e:.1e}".replace("nan", "") for e in (self.closure, *self.energy, np.nan, np.nan)[:3]]
        verdict = f"{self.verdict}{': ' if self.why else ''}{self.why[:WORDS]}"
        return [self.file, *sizes, load, self.step, run, *errors, verdict]


def thrown(mech: Mechanism, speed: float) -> tuple[Array, Array]:
    """Home, or beside it where it is singular, closed, and a velocity of the loops at random."""
    rng = np.random.default_rng(0)
    ydot = speed * rng.normal(size=mech.m)
    try:
        return mech.home, mech.lift(mech.home, ydot)
    except StateError:
        step = AWAY * rng.normal(size=mech.nv) * mech.units
        q = mech.assemble(mech.tree.integrate(mech.home, step), [])
        return q, mech.lift(q, ydot)


def tried(file: Path, name: str, duration: float, step: float | None, speed: float = 0.3) -> Entry:
    """Load a file and run it twice from `thrown`; a step of None is left to `simulate`."""
    entry, begun = Entry(name), time.perf_counter()
    try:
        entry.mechanism = mech = load(file)
        entry.seconds.append(time.perf_counter() - begun)
        entry.verdict, begun = "stops", time.perf_counter()
        q0, v0 = thrown(mech, speed)
        motion = simulate(mech, q0, v0, duration=duration, step=step, record=("energy",))
        entry.seconds.append(time.perf_counter() - begun)
        stats = motion.stats
        entry.step = stats.stepper if stats.step is None else f"{1e3 * stats.step:.4g}"
        if stats.step is None:
            rtol, atol = TIGHTER * 1e-8, TIGHTER * 1e-10
            finer = simulate(mech, q0, v0, duration=duration, stepper=stats.stepper, rtol=rtol, atol=atol)
        else:
            finer = simulate(mech, q0, v0, duration=duration, step=0.5 * stats.step)
        for found in (motion, finer):
            entry.closure = float(np.fmax(entry.closure, found.closure_error().max(initial=0.0)))
            entry.energy.append(float(np.abs(found.energy_error()).max()))
        kinetic = max(mech.tree.kinetic(q, v) for q, v in zip(motion.q[::10], motion.v[::10], strict=True))
        scale = max(kinetic, abs(mech.energy(mech.home, np.zeros(mech.nv))))
    except RobustGcpError as error:
        words = str(error)
        if words.startswith(str(file)):  # it is named in the table already
            words = words.partition(": ")[2]
        entry.why = f"{type(error).__name__}: {words}"
        return entry
    first, second = entry.energy
    share = FALLS if stats.step is None else 0.5**ORDER
    falls = second <= ROUNDED * max(scale, 1e-3) or second < share * first
    entry.verdict = "runs" if falls and entry.closure < CLOSED else "falls short"
    return entry


def robots_in(folder: Path) -> Iterator[Path]:
    """What `load` takes in a folder and those below it: folders with robot.yaml, and robots' other files."""
    model = (folder / "robot.yaml").is_file()
    if model:
        yield folder
    for path in sorted(folder.glob("*")):
        if path.is_dir():
            yield from robots_in(path)
        elif path.suffix in READERS and not (model and path.suffix in (".urdf", ".xml")):
            yield path


def files_below(folder: Path) -> Iterator[Path]:
    """Those that are models by themselves: other *.xml are parts of models."""
    for path in robots_in(folder):
        if path.suffix != ".xml" or "<worldbody" in path.read_text(encoding="utf-8", errors="replace"):
            yield path


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.path("folder", known_folder, "FOLDER", "models and robots' files")
    add_to.add("--duration", positive, type=number, default=0.3, metavar="T", help="s; default: 0.3")
    add_to.add("--speed", positive, type=number, default=0.3, metavar="V", help="rad/s or m/s; default: 0.3")
    add_to.add("--step", positive, type=number, metavar="H", help="s; default: as simulate chooses")


def run(args: argparse.Namespace) -> int:
    """Print the table; 1 where a run falls short of what it ought to be."""
    entries: list[Entry] = []
    for file in files_below(args.folder):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is not simulated: the table is about what is
            entries.append(
                tried(file, str(file.relative_to(args.folder)), args.duration, args.step, args.speed)
            )
    print(table(HEADER, [entry.cells() for entry in entries], longest=None))
    counted = sum(entry.verdict == "runs" for entry in entries)
    print(f"\n{counted} of {len(entries)} files run {args.duration:g} s as they are")
    return int(any(entry.verdict == "falls short" for entry in entries))
