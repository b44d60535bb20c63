"""What the study found, as Markdown, CSV and JSON."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from ...printing import finite, write
from .. import pages
from ..pages import table
from .bound import Bound, Stride
from .case import Cell, Verdict
from .judge import RIGHT

VERDICTS: tuple[Verdict, ...] = ("right", "coarse", "stopped", "wrong")
SYMBOLS: dict[Verdict, str] = {"right": "✓", "coarse": "○", "stopped": "■", "wrong": "✗"}
MEANING: dict[Verdict, str] = {
    "right": f"right: errs by at most {RIGHT:g} rad or m",
    "coarse": "as good as its step, which is coarse",
    "stopped": "stopped with a named reason, or warned",
    "wrong": "wrong without saying so",
}

SHOWN: tuple[Verdict, ...] = ("right", "coarse")
"""Those whose cells show a figure, not a reason."""

MOST_ROWS = 40
"""Cases of a family that are shown one by one; more are counted, and are in the CSV."""


def record(cell: Cell) -> dict[str, Any]:
    """Plain values, in the order of the columns."""
    names = [field.name for field in fields(cell)][2:]
    judged = {name: getattr(cell, name) for name in names} | {"seconds": round(cell.seconds, 4)}
    return finite(
        {"family": cell.case.family, "case": cell.case.name, "setting": cell.setting.label} | judged
    )


def write_study(
    folder: Path, cells: Sequence[Cell], bounds: Sequence[Bound], strides: Sequence[Stride]
) -> None:
    """Write stability.csv, stability.json and stability.md."""
    records = [record(cell) for cell in cells]
    whole = {
        "cells": records,
        "bounds": [
            {"name": b.name, "real": b.eigenvalue.real, "imag": b.eigenvalue.imag,
             "predicted": b.predicted, "measured": b.measured} for b in bounds
        ],
        "strides": [vars(s) for s in strides],
    }  # fmt: skip
    sections = blocks(cells, bounds, strides)
    text = "\n\n".join(f"## {name}\n\n{block}" for name, block in sections.items())
    pages.write_records(folder / "stability", records, whole)
    write(folder / "stability.md", f"# Stability\n\n{text}\n")


def blocks(cells: Sequence[Cell], bounds: Sequence[Bound], strides: Sequence[Stride]) -> dict[str, str]:
    """The report's tables by name: summary, one for each family, bounds, steps and reasons."""
    families = {family: family_table(mine) for family, mine in by_family(cells).items()}
    bounded = {"bounds": bound_table(bounds)} if bounds else {}
    strode = {"strides": stride_table(strides)} if strides else {}
    return {"summary": summary(cells), **families, **bounded, **strode, "reasons": reason_table(cells)}


def by_family(cells: Iterable[Cell]) -> dict[str, list[Cell]]:
    """The cells of each family, in order of appearance."""
    found: dict[str, list[Cell]] = {}
    for cell in cells:
        found.setdefault(cell.case.family, []).append(cell)
    return found


def axes(cells: Iterable[Cell]) -> tuple[list[str], list[str]]:
    """Names of cases and labels of settings, in order of appearance."""
    found = {cell.case.name: None for cell in cells}, {cell.setting.label: None for cell in cells}
    return list(found[0]), list(found[1])


def count(cells: Iterable[Cell]) -> dict[Verdict, int]:
    """Cells of each verdict."""
    counted = Counter(cell.verdict for cell in cells)
    return {verdict: counted[verdict] for verdict in VERDICTS}


def summary(cells: Sequence[Cell]) -> str:
    """How many cells of each family have which colour."""
    rows = [["family", "cells", *(f"{SYMBOLS[v]} {MEANING[v]}" for v in VERDICTS)]]
    for family, mine in by_family(cells).items():
        rows.append([family, str(len(mine)), *map(str, count(mine).values())])
    rows.append(["**all**", f"**{len(cells)}**", *(f"**{n}**" for n in count(cells).values())])
    return table(rows)


def sentence(cells: Sequence[Cell]) -> str:
    """The counts in words, for a page that tells of the study."""
    n = count(cells)
    return (
        f"Of {len(cells)} stiff and extreme cases {n['right']} err by at most {RIGHT:g} rad or m, "
        f"{n['coarse']} err by more, as their step does on the exact equation, {n['stopped']} stop with a "
        f"named reason or warn, and {n['wrong']} are wrong without saying so."
    )


def family_table(cells: Sequence[Cell]) -> str:
    """Cases down, settings across: symbol, error and, where it stopped, why; many cases are counted."""
    names, labels = axes(cells)
    if len(names) > MOST_ROWS:
        return _counted_table(cells)
    rows = [["case", *labels]]
    for name in names:
        mine = {cell.setting.label: cell for cell in cells if cell.case.name == name}
        rows.append([name, *(spelled(mine[label]) if label in mine else "" for label in labels)])
    return table(rows)


def _counted_table(cells: Sequence[Cell]) -> str:
    """What came out, how often, and the median and the largest error of it."""

    def outcome(cell: Cell) -> str:
        return cell.verdict if cell.verdict in SHOWN else short_reason(cell)

    rows = [["outcome", "cells", "median error", "largest error"]]
    for kind, number in Counter(map(outcome, cells)).most_common():
        mine = [cell for cell in cells if outcome(cell) == kind]
        errors = sorted(c.error for c in mine if math.isfinite(c.error))
        shown = [f"{errors[len(errors) // 2]:.0e}", f"{errors[-1]:.0e}"] if errors else ["", ""]
        rows.append([f"{SYMBOLS[mine[0].verdict]} {kind}", str(number), *shown])
    return table(rows)


def spelled(cell: Cell) -> str:
    """A cell in a few characters: its symbol, and the error or the kind of its reason."""
    return f"{SYMBOLS[cell.verdict]} {figure(cell) if cell.verdict in SHOWN else short_reason(cell)}"


def figure(cell: Cell) -> str:
    """The error, else the energy drift, else the closure error."""
    named = (("", cell.error), ("E ", cell.energy_drift), ("φ ", cell.closure_error))
    return next((f"{name}{value:.0e}" for name, value in named if math.isfinite(value)), "")


def short_reason(cell: Cell) -> str:
    """The error's type without its ending, or "warned"; for a wrong cell the figure that is wrong."""
    if cell.verdict == "wrong":
        return figure(cell)
    if cell.reason.startswith(("warned", "told")):
        return cell.reason.split(":")[0]
    words = cell.reason.removeprefix("refused: ").split(":")[0]
    return ("refused " if cell.reason.startswith("refused") else "") + words.removesuffix("Error")


def reason_table(cells: Sequence[Cell]) -> str:
    """Each kind of reason with how often it came and one example in full."""
    stopped = [cell for cell in cells if cell.verdict not in SHOWN]
    kinds = Counter(short_reason(cell) for cell in stopped)
    rows = [["reason", "cells", "example"]]
    for kind, number in kinds.most_common():
        cell = next(cell for cell in stopped if short_reason(cell) == kind)
        rows.append([kind, str(number), f"{cell.case.name}, {cell.setting.label}: {cell.reason}"])
    return table(rows)


def bound_table(bounds: Sequence[Bound]) -> str:
    """Predicted and measured largest stable steps."""
    rows = [["start", "λ [1/s]", "h\\* predicted [s]", "h\\* bisected [s]", "bisected / predicted"]]
    for b in bounds:
        value = f"{b.eigenvalue.real:.4g}" if b.eigenvalue.real else ""
        if b.eigenvalue.imag:
            value += f" ± {abs(b.eigenvalue.imag):.4g}i"
        rows.append([b.name, value.strip(), f"{b.predicted:.4g}", f"{b.measured:.4g}", f"{b.ratio:.4f}"])
    return table(rows)


def stride_table(strides: Sequence[Stride]) -> str:
    """Steps of the implicit steppers in RK4's largest."""
    rows = [
        ["motion", "RK4's bound h\\* [s]", "stepper", "rtol", "error", "mean step / h\\*",
         "largest step / h\\*", "right-hand sides", "of RK4 at h\\*"]
    ]  # fmt: skip
    for s in strides:
        lead = [s.name, f"{s.bound:.2g}", s.stepper]
        if math.isnan(s.mean):
            rows.append([*lead, "", "", "below 1", "", "", f"{s.rk4_rhs:.2g}"])
            continue
        rows.append(
            [*lead, f"{s.rtol:.0e}", f"{s.error:.0e}", f"{s.ratio:.3g}",
             f"{s.largest / s.bound:.3g}", str(s.rhs), f"{s.rk4_rhs:.2g}"]
        )  # fmt: skip
    return table(rows)
