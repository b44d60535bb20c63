"""`robust-gcp reports descriptions`: each scene in other coordinates, cuts, trees, axes and units."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict

from ...arguments import DEFAULT, Arguments, file, names, pathname, whole
from ...errors import OptionError
from ...printing import along, table, write_json
from .judge import STEPPERS, Report, compare
from .scenes import SCENES, Scene


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"only these, between commas: {', '.join(scene.name.replace(',', '') for scene in SCENES)}"
    add_to.add("--scenes", type=names, metavar="NAMES", help=text)
    text = f"choices of coordinates, and of trees, of each scene at most; {DEFAULT}"
    add_to.add("--most", whole(1), type=int, default=20, metavar="N", help=text)
    add_to.add("--seed", whole(0), type=int, default=1, metavar="N", help=f"of the samples; {DEFAULT}")
    add_to.add("--steppers", action="store_true", help=f"also by {', '.join(STEPPERS)}")
    text = "write every description to this JSON file"
    add_to.add(
        "--out", file((".json",), "a record of descriptions"), type=pathname, metavar="FILE", help=text
    )


def run(args: argparse.Namespace) -> int:
    """Print a line a scene and the descriptions that differ; exit code 1 when one does."""
    begun = time.perf_counter()
    steppers = STEPPERS if args.steppers else ()
    reports = [
        compare(scene, args.most, args.seed, steppers) for scene in along(_chosen(args.scenes), "scenes")
    ]
    print(table(HEADER, [row(report) for report in reports], None))
    findings = [finding for report in reports for finding in report.findings]
    different = [finding for finding in findings if not finding.same]
    for f in different:
        words = f.refused or "; ".join(w for w in (f.crossings, f.open, f.told) if w)
        print(f"{f.scene}, {f.description}: {f.difference:.1e} {words}")
    spent = time.perf_counter() - begun
    print(f"{len(findings)} descriptions of {len(reports)} scenes, {len(different)} differ, in {spent:.0f} s")
    if args.out:
        write_json(args.out, [asdict(report) for report in reports])
    return 1 if different else 0


HEADER = ["scene", " descriptions", " order", " worst", " crossings agree", " refused", " silently wrong"]


def row(report: Report) -> list[str]:
    """The line of a scene."""
    found = report.findings
    done = [f for f in found if not f.refused]
    own = [f.difference for f in done if f.description not in STEPPERS]
    return [
        report.scene,
        str(len(found)),
        f"{report.order:.2f}",
        f"{max(own, default=float('nan')):.1e}",
        f"{sum(not f.crossings for f in done)}/{len(done)}",
        str(len(found) - len(done)),
        str(sum(f.silently_wrong for f in found)),
    ]


def _chosen(wanted: Sequence[str] | None) -> Sequence[Scene]:
    known = {scene.name.replace(",", ""): scene for scene in SCENES}
    if wanted is None:
        return SCENES
    for name in wanted:
        if name not in known:
            raise OptionError(f"--scenes: {name!r} is unknown; use one of {', '.join(known)}")
    return [known[name] for name in wanted]
