"""What a study leaves: data, verdicts, the table, figures; and the block in the documents."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...drawing.figures import style as plots
from .. import pages, peers
from ..machine import footer
from . import figures, verdicts

if TYPE_CHECKING:
    from .command import Study

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


def write(study: Study, docs: Path | None) -> list[Path]:
    """Print the tables, write everything; returns the paths."""
    store, out = study.store, study.store.folder
    foot = footer(store.header["machine"], store.header["begun"])
    rows, paths = [], []
    for name, motion in study.motions.items():
        curves = verdicts.curves_of(store.points.values(), name)
        if curves:
            rows.append((motion.title, curves, study.reference(name)))
            files = [out / f"work_precision_{name}{suffix}" for suffix in plots.FORMATS]
            paths += [figures.draw(*rows[-1], foot, file) for file in files]
    text, told_seconds = verdicts.ratios(rows), verdicts.seconds(rows)
    tuning = [f"- **{c.name}**: {c.tuning}" for c in study.contenders]
    sections = {
        "Contenders": [*tuning, *(f"- {sentence}" for sentence in peers.missing())],
        "Contenders that do not run a scene, and why": [
            f"- {name}: {'; '.join(reasons)}" for name, reasons in study.refused.items()
        ],
        "References": [f"- **{title}**: {r.source}; {r.accuracy:.0e}" for title, _, r in rows],
    }
    told = [part for title, content in sections.items() for part in (f"## {title}", "\n".join(content))]
    contents = {
        "report.md": "\n\n".join(["# Error against run time", foot, text, told_seconds, *told]),
        "table.md": f"{text}\n\n{foot}",
    }
    for name, content in contents.items():
        (out / name).write_text(content + "\n", encoding="utf-8")
        paths.append(out / name)
    records = [point.record() for point in store.points.values()]
    whole = store.header | {
        "references": {title: {"source": r.source, "accuracy": r.accuracy} for title, _, r in rows},
        "contenders": {c.name: {"family": c.family, "tuning": c.tuning} for c in study.contenders},
        "points": records,
    }
    paths += pages.write_records(out / "points", records, whole)
    print("\n".join([text, "", told_seconds, "", foot]))
    if docs is not None:
        paths += _refresh(docs, rows, [text, told_seconds], foot)
    return paths


def _refresh(root: Path, rows: Sequence[verdicts.Row], tables: Sequence[str], foot: str) -> list[Path]:
    """The marked blocks of README.md and docs/work-precision.md, and the figures that they show."""
    written = []
    for title, curves, reference in rows:
        if next(iter(curves.values()))[0].scene == STORY:
            path = root / "docs" / "figures" / f"work_precision_{STORY}.png"
            written.append(figures.draw(title, curves, reference, foot, path, whole=False))
    measured = f"*Measured {foot}.*"
    blocks = {
        "README.md": f"{in_short(tables[0])}\n\n{measured}",
        "docs/work-precision.md": "\n\n".join([*tables, measured]),
    }
    for page, block in blocks.items():
        pages.refresh(root / page, {MARK: block})
    return written


def in_short(table: str) -> str:
    """Of the table of all scenes the rows of `FIVE` that it has, as far as 1e-8."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    head, named = rows[0], {row[1]: row for row in rows[2:] if len(row) > 1}
    shown = [row[1:5] for row in (head, *(named[name] for name in FIVE if name in named))]
    return pages.table(shown)
