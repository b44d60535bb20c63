"""`python -m robust_gcp reports benchmarks`: published benchmarks, judged as they say."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path

import numpy as np

from ... import Mechanism, backends
from ...arguments import Arguments, existing_file, folder, number, part, positive
from ...mechanism.tree.tree import Array
from ...printing import along, table, write, write_json
from .. import pages
from ..contender import Contender, Outcome
from ..machine import footer, machine
from ..tools import tools
from ..work_precision import ours
from ..work_precision.measure import settings_of
from ..work_precision.references import Motion
from .problems import PROBLEMS, Problem
from .values import VALUES, Value

REPEATED = 3
"""Timed runs of a setting that is good enough; their least counts."""

REACHED = ("problem", "allowed", "tool", "reached", "energy, J", "step or tolerance", "time, s")
PUBLISHED = ("published by", "what", "theirs", "ours", "apart", "why")


@dataclass(frozen=True)
class Reached:
    """What a contender needs for one of the two precisions of a problem."""

    problem: str
    contender: str
    family: str
    # allowed, error: largest error of what the results file holds, m and m/s; NaN where no setting was good
    # enough
    allowed: float
    error: float = np.nan
    setting: float = np.nan  # step, s, or relative tolerance
    seconds: float = np.nan  # processor time
    energy: float = np.nan  # largest change of the energy, J; NaN where it is not constant


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    names = [problem.name for problem in PROBLEMS]
    text = f"of {', '.join(names)}; default: all"
    add_to.add("--problem", nargs="+", choices=names, default=names, metavar="NAME", help=text)
    text = "tools whose name or family contains it; default: all that are installed"
    add_to.add("--method", part, nargs="+", default=[], metavar="PART", help=text)
    text = "no finer settings of a tool once a run takes longer, s; default: 4"
    add_to.add("--cap", positive, type=number, default=4.0, metavar="S", help=text)
    text = "results files as the library asks for them, what to submit with them, and figures as JSON"
    add_to.path("--out", folder, "DIR", text)
    add_to.path("--refresh", existing_file, "PAGE", "renew the blocks of these names in a page")


def run(args: argparse.Namespace) -> int:
    """Measure, print both tables, write the files."""
    pages.require_marks(args.refresh, ["published values", "published benchmarks"])
    values = [value() for value in VALUES]
    published = [value_row(value) for value in values]
    print(table(PUBLISHED, published, None))
    own = ours.COMPILED if backends()["native"].available else "bridge, RK4"
    where, today = machine(), date.today().isoformat()
    best: list[Reached] = []
    known = {problem.name: problem for problem in PROBLEMS}
    for name in along(args.problem, "benchmarks"):
        best += _best_of(known[name], args, own, where)
    rows = [reached_row(one) for one in best]
    print(table(REACHED, rows, None))
    foot = footer(where, today)
    print(foot)
    if args.out is not None:
        write_json(args.out / "benchmarks.json", {
            "machine": where, "date": today,
            "values": [asdict(value) for value in values], "reached": [asdict(one) for one in best],
        })  # fmt: skip
    pages.refresh(args.refresh, {
        "published values": pages.table([PUBLISHED, *published], (2, 3, 4)),
        "published benchmarks": pages.table([REACHED, *rows], range(3, len(REACHED))) + f"\n\n*{foot}*",
    })  # fmt: skip
    return 0


def _best_of(problem: Problem, args: argparse.Namespace, own: str, where: dict[str, str]) -> list[Reached]:
    """The fastest of each family, and the files where they are wanted."""
    motion = problem.motion()
    found: list[Reached] = []
    for tool in tools(lambda scene: motion.reference.q, args.method, [own]):
        if tool.refuses(motion.scene):
            continue
        reached = list(measured(problem, motion, tool, args.cap))
        found += reached
        good = [one for one in reached if np.isfinite(one.error)]
        if args.out is not None and tool.name == own and good:
            _deliver(args.out, problem, motion, tool, good[-1], where)
    return fastest(found)


def reached_row(one: Reached) -> list[str]:
    """Cells of `REACHED`."""
    stated = next(problem.stated for problem in PROBLEMS if problem.name == one.problem)
    allowed = f"{one.allowed:.0e}" + ("" if stated else " (ours)")
    energy = "–" if np.isnan(one.energy) else f"{one.energy:.1e}"
    numbers = f"{one.error:.1e}", energy, f"{one.setting:.3g}", f"{one.seconds:.3g}"
    return [one.problem, allowed, one.contender, *numbers]


def value_row(value: Value) -> list[str]:
    """Cells of `PUBLISHED`."""
    numbers = f"{value.theirs:.12g}", f"{value.ours:.12g}", f"{value.apart:.1e}"
    return [value.source, value.what, *numbers, value.why]


def _deliver(
    out: Path, problem: Problem, motion: Motion, tool: Contender, best: Reached, where: dict[str, str]
) -> None:
    """The results file of our most precise run, and what the library's form asks for."""
    outcome = tool.run(motion.scene, best.setting)
    columns = problem.delivered(motion.scene.mechanism, outcome.q, outcome.v)
    rows = np.column_stack([motion.scene.times, columns])
    lines = ["\t".join(f"{x:.12e}" for x in row) for row in rows]
    write(out / f"{problem.name}_solution.txt", "\n".join(lines) + "\n")
    energy = "" if np.isnan(best.energy) else f"Energy changes by at most {best.energy:.1e} J.\n"
    write(
        out / f"{problem.name}_submit.txt",
        f"{problem.name}: {problem.title}\n\n"
        "The library (iftomm-multibody.org, Benchmark, Submit a solution) asks for:\n\n"
        f"Accuracy: {best.error:.2e} (largest error of {', '.join(problem.columns)} at 401 instants)\n"
        f"Exact motion: {motion.reference.source}\n"
        f"CPU time: {best.seconds:.3g} s (least of {REPEATED}, one thread; step {best.setting:.3g} s)\n"
        f"CPU / GPU: {where['cpu']}\nOperating system: {where['os']}\n"
        f"Results file: {problem.name}_solution.txt (time, {', '.join(problem.columns)}; SI units)\n"
        "Method description: minimal coordinates by generalized coordinate partitioning, loops closed to "
        "rounding at every evaluation, certified bridges through singular configurations, RK4; "
        f"robust_gcp {where['robust_gcp']} (commit {where['commit']}), on Pinocchio's models.\n{energy}",
    )


# --------------------------------------------------------------------------- from coarse steps to fine ones


def measured(problem: Problem, motion: Motion, contender: Contender, cap: float) -> Iterator[Reached]:
    """Both precisions; settings are left once one takes longer than `cap` seconds."""
    exact = motion.reference
    wanted = problem.delivered(motion.scene.mechanism, exact.q, exact.v)
    settings = settings_of(contender, motion.scene, motion.steps)
    left = list(problem.allowed)
    contender.run(motion.scene, settings[0])  # what is prepared once
    for setting in settings:
        outcome = contender.run(motion.scene, setting)
        error = _error(problem, motion.scene.mechanism, outcome, wanted)
        while left and error <= left[0]:
            again = [contender.run(motion.scene, setting).seconds for _ in range(REPEATED - 1)]
            seconds = min(outcome.seconds, *again)
            energy = _energy(motion.scene.mechanism, outcome) if problem.conserves else np.nan
            yield Reached(
                problem.name, contender.name, contender.family, left.pop(0), error, setting, seconds, energy
            )
        if not left or outcome.seconds > cap:
            break
    for allowed in left:
        yield Reached(problem.name, contender.name, contender.family, allowed)


def fastest(found: Sequence[Reached]) -> list[Reached]:
    """Of each precision and family of contenders the one that takes least time; those that get there."""
    best: dict[tuple[float, str], Reached] = {}
    for one in found:
        key = one.allowed, one.family
        if np.isfinite(one.error) and (key not in best or one.seconds < best[key].seconds):
            best[key] = one
    return list(best.values())


def _error(problem: Problem, mechanism: Mechanism, outcome: Outcome, wanted: Array) -> float:
    """Infinite where the run stopped early."""
    if len(outcome.q) < len(wanted):
        return np.inf
    return float(np.abs(problem.delivered(mechanism, outcome.q, outcome.v) - wanted).max())


def _energy(mechanism: Mechanism, outcome: Outcome) -> float:
    energies = np.array([mechanism.energy(q, v) for q, v in zip(outcome.q, outcome.v, strict=True)])
    return float(np.abs(energies - energies[0]).max())
