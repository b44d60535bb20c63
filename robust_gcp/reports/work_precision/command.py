"""`python -m robust_gcp reports work-precision`: measure, tell, draw."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...arguments import Arguments, existing_folder, folder, number, part, pathname, positive, whole
from ...drawing.figures import style as plots
from ...mechanism.tree.tree import Array
from ...printing import along
from .. import pages
from ..contender import Contender, Scene
from ..machine import THREADS
from ..tools import tools
from . import floor, report
from .measure import Judge, Point, climb, settings_of
from .references import Motion, Reference
from .scenes import MOTIONS
from .store import Store
from .verdicts import OURS

SCENES = tuple(MOTIONS)
QUICK_SCENES = ("antiparallelogram", "crank_rocker")
QUICK_STEPS, QUICK_TOLERANCES = (1, 2, 4, 8), (1e-5, 1e-8, 1e-11)


@dataclass
class Study:
    """Scenes, contenders and points of one run."""

    scenes: Sequence[str]
    wanted: Sequence[str]  # parts of contenders' names or families; all when empty
    store: Store
    repeats: int  # timed runs of each point
    quick: bool  # a short ladder
    cap: float | None = None  # longest run, s; each scene's own when None
    references: dict[str, Reference] = field(default_factory=dict)
    refused: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.motions = {name: MOTIONS[name]() for name in self.scenes}
        self.contenders = tools(self._exact, self.wanted)

    def _exact(self, scene: Scene) -> Array:
        return self.reference(scene.name).q

    def reference(self, name: str) -> Reference:
        """The scene's exact motion, computed once."""
        if name not in self.references:
            self.references[name] = self.motions[name].solve()
        return self.references[name]

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
            plan += [(motion, floor.Floor(s, motion.floor), settings) for s, settings in compared.items()]
        for each in along(plan, "work-precision"):
            for point in self._points(*each):
                self.store.add(point)

    def _points(self, motion: Motion, contender: Contender, settings: list[float]) -> Iterator[Point]:
        name = motion.scene.name
        judge = Judge(motion.scene, self.reference(name))
        known = self.store.known(name, contender.name)
        cap = motion.cap if self.cap is None else self.cap
        if contender.family != floor.FAMILY:
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
    text = "points, tables and figures"
    add_to.add("--out", folder, type=pathname, required=True, metavar="DIR", help=text)
    text = "timed runs of each point; default: 3, quick: 1"
    add_to.add("--repeats", whole(1), type=int, metavar="N", help=text)
    text = "leave out runs predicted longer than this, s; default: by scene"
    add_to.add("--cap", positive, type=number, metavar="S", help=text)
    add_to.add("--fresh", action="store_true", help="forget the points in DIR instead of going on from them")
    text = "also refresh README.md and docs/ of this checkout"
    add_to.add("--docs", existing_folder, type=pathname, metavar="ROOT", help=text)


def run(args: argparse.Namespace) -> int:
    """Measure, print verdicts and table, write data and figures."""
    plots.require_matplotlib()
    pages.require_pages(args.docs, report.PAGES)
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
    for path in report.write(study, args.docs):
        print(f"wrote {path}")
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
