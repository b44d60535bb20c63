"""`python -m robust_gcp reports work-precision`: measure, tell, draw."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...arguments import Arguments, existing_folder, folder, number, part, positive, whole
from ...drawing.figures import style as plots
from ...printing import along, write
from .. import pages, peers
from ..contender import Contender
from ..machine import THREADS, footer
from ..tools import tools
from . import figures, verdicts
from .measure import Judge, Point, Store, climb, settings_of
from .ours import FLOOR, Floor
from .references import Motion
from .scenes import MOTIONS
from .verdicts import OURS

SCENES = tuple(MOTIONS)
QUICK_SCENES = ("antiparallelogram", "crank_rocker")
QUICK_STEPS, QUICK_TOLERANCES = (1, 2, 4, 8), (1e-5, 1e-8, 1e-11)

MARK = "work-precision"
"""The block that this study renews."""

PAGES = {"README.md": [MARK], "docs/work-precision.md": [MARK]}
"""Where it stands."""

STORY = "antiparallelogram"
"""The scene that pages show."""

FIVE = (
    "antiparallelogram",
    "change point 4, 2, 3, 3",
    "5 four-bars in a row (A02)",
    "Bricard (A04)",
    "delta robot (m = 3)",
)
"""Scenes of the table that README shows: two with crossings, three without."""


@dataclass
class Study:
    """Scenes, contenders and points of one run."""

    scenes: Sequence[str]
    wanted: Sequence[str]  # parts of contenders' names or families; all when empty
    store: Store
    repeats: int  # timed runs of each point
    quick: bool  # a short ladder
    cap: float | None = None  # longest run, s; each scene's own when None
    refused: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.motions = {name: MOTIONS[name]() for name in self.scenes}
        self.contenders = tools(lambda scene: self.motions[scene.name].reference.q, self.wanted)

    def run(self) -> None:
        """Measure what is missing, with a bar; floors last, at the settings that ours were run at."""
        plan: list[tuple[Motion, Contender, list[float]]] = []
        for name, motion in self.motions.items():
            compared: dict[str, list[float]] = {}
            for contender in self.contenders:
                why = contender.refuses(motion.scene)
                if why:
                    self.refused.setdefault(name, []).append(f"{contender.name}: {why}")
                else:
                    ladder = (QUICK_STEPS, QUICK_TOLERANCES) if self.quick else (motion.steps,)
                    settings = settings_of(contender, motion.scene, *ladder)
                    plan.append((motion, contender, settings))
                    if contender.family == OURS and motion.floor is not None:
                        compared[contender.stepper] = settings
            plan += [(motion, Floor(s, motion.floor), settings) for s, settings in compared.items()]
        for each in along(plan, "work-precision"):
            for point in self._points(*each):
                self.store.add(point)

    def _points(self, motion: Motion, contender: Contender, settings: list[float]) -> Iterator[Point]:
        name = motion.scene.name
        judge = Judge(motion.scene, motion.reference)
        known = self.store.known(name, contender.name)
        cap = motion.cap if self.cap is None else self.cap
        if contender.family != FLOOR:
            return climb(contender, motion, judge, settings, known, self.repeats, cap)
        reached = {
            p.setting
            for p in self.store.points.values()
            if p.scene == name and p.family == OURS and p.stepper == contender.stepper and p.good
        }
        settings = [setting for setting in settings if setting in reached]
        return climb(contender, motion, judge, settings, known, 1, np.inf)  # its time is of no interest


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"of {', '.join(SCENES)}; default: all"
    add_to.add("--scene", nargs="+", choices=SCENES, metavar="NAME", help=text)
    text = "contenders whose name or family contains it"
    add_to.add("--method", part, nargs="+", default=[], metavar="PART", help=text)
    add_to.add(
        "--quick", action="store_true", help="two scenes, a short ladder, one timed run: about a minute"
    )
    add_to.path("--out", folder, "DIR", "points, tables and figures", required=True)
    text = "timed runs of each point; default: 3, quick: 1"
    add_to.add("--repeats", whole(1), type=int, metavar="N", help=text)
    text = "leave out runs predicted longer than this, s; default: by scene"
    add_to.add("--cap", positive, type=number, metavar="S", help=text)
    add_to.add("--fresh", action="store_true", help="forget the points in DIR instead of going on from them")
    add_to.path("--docs", existing_folder, "ROOT", "also refresh README.md and docs/ of this checkout")


def run(args: argparse.Namespace) -> int:
    """Measure, print verdicts and table, write data and figures."""
    plots.require_matplotlib()
    pages.require_pages(args.docs, PAGES)
    if not any(name in os.environ for name in THREADS):
        return _single_threaded(args)
    scenes = args.scene or (QUICK_SCENES if args.quick else SCENES)
    repeats = args.repeats or (1 if args.quick else 3)
    settings = {"repeats": repeats, "quick": args.quick, "cap": args.cap}
    store = Store(args.out, settings, args.fresh)
    if store.points:
        print(f"going on from {len(store.points)} points in {args.out}")
    study = Study(scenes, args.method, store, repeats, args.quick, args.cap)
    study.run()
    tell(study, args.docs)
    return 0


def _single_threaded(args: argparse.Namespace) -> int:
    """The same command in a process whose BLAS has one thread: it reads that when it is loaded."""
    command = [sys.executable, "-m", "robust_gcp", "reports", "work-precision", "--out", str(args.out)]
    for name in ("scene", "method", "quick", "fresh", "repeats", "cap", "docs"):
        given = getattr(args, name)
        if given:
            values = given if isinstance(given, (list, tuple)) else [] if given is True else [given]
            command += [f"--{name}", *map(str, values)]
    return subprocess.run(command, env=os.environ | dict.fromkeys(THREADS, "1"), check=False).returncode


def tell(study: Study, docs: Path | None) -> None:
    """Print the tables, write everything."""
    store, out = study.store, study.store.folder
    foot = footer(store.header["machine"], store.header["begun"])
    found = ((name, verdicts.curves_of(store.points.values(), name)) for name in study.motions)
    motions = study.motions
    rows = {name: (motions[name].title, known, motions[name].reference) for name, known in found if known}
    tables = [verdicts.ratios([*rows.values()]), verdicts.seconds([*rows.values()])]
    print("\n".join([tables[0], "", tables[1], "", foot]))
    for name, row in rows.items():
        for suffix in plots.FORMATS:
            print(f"wrote {figures.draw(*row, foot, out / f'work_precision_{name}{suffix}')}")
    tuning = [f"- **{c.name}**: {c.tuning}" for c in study.contenders]
    sections = {
        "Contenders": [*tuning, *(f"- {sentence}" for sentence in peers.missing())],
        "Contenders that do not run a scene, and why": [
            f"- {name}: {'; '.join(reasons)}" for name, reasons in study.refused.items()
        ],
        "References": [f"- **{title}**: {r.source}; {r.accuracy:.0e}" for title, _, r in rows.values()],
    }
    told = [part for title, content in sections.items() for part in (f"## {title}", "\n".join(content))]
    write(out / "report.md", "\n\n".join(["# Error against run time", foot, *tables, *told]) + "\n")
    write(out / "table.md", f"{tables[0]}\n\n{foot}\n")
    records = [point.record() for point in store.points.values()]
    whole = store.header | {
        "references": {title: {"source": r.source, "accuracy": r.accuracy} for title, _, r in rows.values()},
        "contenders": {c.name: {"family": c.family, "tuning": c.tuning} for c in study.contenders},
        "points": records,
    }
    pages.write_records(out / "points", records, whole)
    if docs is not None:
        if STORY in rows:
            path = docs / "docs" / "figures" / f"work_precision_{STORY}.png"
            print(f"wrote {figures.draw(*rows[STORY], foot, path, whole=False)}")
        for page, shown in zip(PAGES, ([in_short(tables[0])], tables), strict=True):
            pages.refresh(docs / page, {MARK: "\n\n".join([*shown, f"*Measured {foot}.*"])})


def in_short(table: str) -> str:
    """Of the table of all scenes the rows of `FIVE` that it has, as far as 1e-8."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    head, named = rows[0], {row[1]: row for row in rows[2:] if len(row) > 1}
    shown = [row[1:5] for row in (head, *(named[name] for name in FIVE if name in named))]
    return pages.table(shown)
