"""`robust-gcp reports stability`: cases × steppers, as maps and tables."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...arguments import Arguments, existing_folder, folder, word
from ...drawing.figures import style as plots
from ...printing import table
from .. import pages
from . import extreme_bodies, extreme_motion, extreme_several, extreme_starts, maps, report, stiff
from .bound import measure, strides, systems
from .case import Cell, Families
from .judge import judge_all

PAGE = "stability.md"


def families() -> Families:
    """Name → function of `quick` that lists the family's cases, in the order of the report."""
    modules = (stiff, extreme_bodies, extreme_motion, extreme_starts, extreme_several)
    return {name: cases for module in modules for name, cases in module.FAMILIES.items()}


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"only this family; may be repeated: {', '.join(families())}"
    add_to.add("--case", word(families()), action="append", metavar="FAMILY", help=text)
    add_to.add("--quick", action="store_true", help="a short excerpt, below a minute")
    add_to.path("--out", folder, "DIR", "folder for tables and maps", required=True)
    text = f"refresh {PAGE} and figures/ in this folder of documentation as well"
    add_to.path("--docs", existing_folder, "DIR", text)


def run(args: argparse.Namespace) -> int:
    """Write tables and maps, print the summary; exit code 1 when a cell is wrong."""
    plots.require_matplotlib()
    known, whole = families(), args.case is None
    pages.require_pages(args.docs, {PAGE: args.case or known})
    cells = judge_all([case for name in args.case or known for case in known[name](args.quick)])
    bounds = [measure(*system) for system in systems(args.quick).items()] if whole else []
    found = strides(args.quick) if whole else []
    _tell(cells)
    report.write_study(args.out, cells, bounds, found)
    draw(args.out, cells, whole)
    if args.docs is not None:
        sections = report.blocks(cells, bounds, found)
        if not whole:  # of all families
            sections = {name: text for name, text in sections.items() if name not in ("summary", "reasons")}
        pages.refresh(args.docs / PAGE, sections)
        draw(args.docs / "figures", cells, whole)
        readme = args.docs.parent / "README.md"
        if whole and readme.is_file():
            pages.refresh(readme, {"stability": report.sentence(cells)})
    return 1 if report.count(cells)["wrong"] else 0


def draw(folder: Path, cells: Sequence[Cell], whole: bool) -> None:
    """One map a family; the summary of a whole study."""
    for family, mine in report.by_family(cells).items():
        print(f"wrote {maps.draw_family(mine, folder / f'stability_{maps.slug(family)}.png')}")
    if whole:
        print(f"wrote {maps.draw_summary(cells, folder / 'stability_summary.png')}")


def _tell(cells: Sequence[Cell]) -> None:
    head = ["family", *(f" {verdict}" for verdict in report.VERDICTS)]
    counted = {family: report.count(mine) for family, mine in report.by_family(cells).items()}
    counted["all"] = report.count(cells)
    rows = [[family, *map(str, counts.values())] for family, counts in counted.items()]
    print(table(head, rows, None))
    for cell in cells:
        if cell.verdict == "wrong":
            print(f"wrong: {cell.case.family}, {cell.case.name}, {cell.setting.label}: {cell.reason}")
