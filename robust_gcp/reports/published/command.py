"""`python -m robust_gcp reports benchmarks`: published benchmarks, judged as they say."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from datetime import date
from pathlib import Path

import numpy as np

from ...arguments import Arguments, existing_file, folder, number, part, pathname, positive
from ...kernel import backends
from ...printing import along, table, write, write_json
from .. import pages
from ..contender import Contender
from ..machine import footer, machine
from ..tools import tools
from ..work_precision import ours
from ..work_precision.motion import Motion
from ..work_precision.references import Reference
from .ladder import REPEATED, Reached, fastest, measured
from .problems import PROBLEMS, Problem
from .values import VALUES, Value

REACHED = ("problem", "allowed", "tool", "reached", "energy, J", "step or tolerance", "time, s")
PUBLISHED = ("published by", "what", "theirs", "ours", "apart", "why")


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
    add_to.add("--out", folder, type=pathname, metavar="DIR", help=text)
    text = "renew the blocks of these names in a page"
    add_to.add("--refresh", existing_file, type=pathname, metavar="PAGE", help=text)


def run(args: argparse.Namespace) -> int:
    """Measure, print both tables, write the files."""
    pages.require_marks(args.refresh, ["published values", "published benchmarks"])
    values = [value() for value in VALUES]
    print(table(PUBLISHED, [value_row(value) for value in values], None))
    own = ours.COMPILED if backends()["native"].available else "bridge, RK4"
    where, today = machine(), date.today().isoformat()
    best: list[Reached] = []
    known = {problem.name: problem for problem in PROBLEMS}
    for name in along(args.problem, "benchmarks"):
        best += _measured(known[name], args, own, where)
    print(table(REACHED, [reached_row(one) for one in best], None))
    print(footer(where, today))
    if args.out is not None:
        write_json(args.out / "benchmarks.json", {
            "machine": where, "date": today,
            "values": [asdict(value) for value in values], "reached": [asdict(one) for one in best],
        })  # fmt: skip
        print(f"wrote {args.out}")
    if args.refresh is not None:
        _refresh(args.refresh, values, best, footer(where, today))
    return 0


def _measured(problem: Problem, args: argparse.Namespace, own: str, where: dict[str, str]) -> list[Reached]:
    """The fastest of each family, and the files where they are wanted."""
    motion = problem.motion()
    exact = motion.solve()
    found: list[Reached] = []
    for tool in tools(lambda scene: exact.q, args.method, [own]):
        if tool.refuses(motion.scene):
            continue
        reached = list(measured(problem, motion, exact, tool, args.cap))
        found += reached
        good = [one for one in reached if np.isfinite(one.error)]
        if args.out is not None and tool.name == own and good:
            args.out.mkdir(parents=True, exist_ok=True)
            _deliver(args.out, problem, motion, exact, tool, good[-1], where)
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
    out: Path, problem: Problem, motion: Motion, exact: Reference, tool: Contender, best: Reached,
    where: dict[str, str],
) -> None:  # fmt: skip
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
        f"Exact motion: {exact.source}\n"
        f"CPU time: {best.seconds:.3g} s (least of {REPEATED}, one thread; step {best.setting:.3g} s)\n"
        f"CPU / GPU: {where['cpu']}\nOperating system: {where['os']}\n"
        f"Results file: {problem.name}_solution.txt (time, {', '.join(problem.columns)}; SI units)\n"
        "Method description: minimal coordinates by generalized coordinate partitioning, loops closed to "
        "rounding at every evaluation, certified bridges through singular configurations, RK4; "
        f"robust_gcp {where['robust_gcp']} (commit {where['commit']}), on Pinocchio's models.\n{energy}",
    )


def _refresh(page: Path, values: Sequence[Value], best: Sequence[Reached], last: str) -> None:
    rows = [reached_row(one) for one in best]
    blocks = {
        "published values": pages.table([PUBLISHED, *map(value_row, values)], (2, 3, 4)),
        "published benchmarks": pages.table([REACHED, *rows], range(3, len(REACHED))) + f"\n\n*{last}*",
    }
    if pages.renew(page, blocks):
        print(f"renewed {page}")
