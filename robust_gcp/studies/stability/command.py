"""`robust-gcp stability`: cases × steppers, as maps and tables."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...arguments import Arguments, existing_folder, folder, pathname, word
from ...drawing.figures import style as plots
from ...errors import OptionError
from ...printing import table
from .. import pages
from . import maps, report
from .bound import Bound, measure, systems
from .case import Case, Cell
from .families import families
from .judge import judge_all
from .steps import Stride, strides

PAGE = "stability.md"


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"only this family; may be repeated: {', '.join(families())}"
    add_to.add("--case", word(families()), action="append", metavar="FAMILY", help=text)
    add_to.add("--quick", action="store_true", help="a short excerpt, below a minute")
    text = "folder for tables and maps"
    add_to.add("--out", folder, type=pathname, required=True, metavar="DIR", help=text)
    text = f"refresh {PAGE} and figures/ in this folder of documentation as well"
    add_to.add("--docs", existing_folder, type=pathname, metavar="DIR", help=text)


def run(args: argparse.Namespace) -> int:
    """Write tables and maps, print the summary; exit code 1 when a cell is wrong."""
    plots.require_matplotlib()
    page = None if args.docs is None else args.docs / PAGE
    if page is not None and not page.is_file():
        raise OptionError(f"--docs {args.docs}: there is no {PAGE} to refresh")
    cases = chosen(args.case, args.quick)
    whole = args.case is None
    cells = judge_all(cases)
    bounds: list[Bound] = [measure(system) for system in systems(args.quick)] if whole else []
    found: list[Stride] = strides(args.quick) if whole else []
    paths = report.write(args.out, cells, bounds, found)
    paths += draw(args.out, cells)
    if page is not None:
        sections = report.blocks(cells, bounds, found)
        pages.renew(page, sections)
        paths += [page, *draw(args.docs / "figures", cells)]
    _tell(cells)
    for path in paths:
        print(f"wrote {path}")
    return 1 if report.count(cells)["wrong"] else 0


def chosen(names: Sequence[str] | None, quick: bool) -> list[Case]:
    """The cases of the named families, or of all."""
    known = families()
    return [case for name in names or known for case in known[name](quick)]


def draw(folder: Path, cells: Sequence[Cell]) -> list[Path]:
    """One map a family; the summary where there are several."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for family in report.families_of(cells):
        mine = [cell for cell in cells if cell.case.family == family]
        paths.append(maps.draw_family(mine, folder / f"stability_{maps.slug(family)}.png"))
    if len(paths) > 1:
        paths.append(maps.draw_summary(cells, folder / "stability_summary.png"))
    return paths


def _tell(cells: Sequence[Cell]) -> None:
    head = ["family", *(f" {verdict}" for verdict in report.VERDICTS)]
    rows = []
    for family in report.families_of(cells):
        counted = report.count(cell for cell in cells if cell.case.family == family)
        rows.append([family, *map(str, counted.values())])
    rows.append(["all", *map(str, report.count(cells).values())])
    print(table(head, rows, None))
    for cell in cells:
        if cell.verdict == "wrong":
            print(f"wrong: {cell.case.family}, {cell.case.name}, {cell.setting.label}: {cell.reason}")
