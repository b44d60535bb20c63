"""Pages that reports keep true: blocks between marks, and Markdown tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import OptionError
from ..printing import write, write_json


def marked(page: Path, names: Iterable[str]) -> list[str]:
    """Those of the names whose marks the page has; raises as `refresh`."""
    text = page.read_text(encoding="utf-8")
    found = []
    for name in names:
        begin, end = _marks(name)
        counts = text.count(begin), text.count(end)
        if counts == (0, 0):
            continue
        if counts != (1, 1) or text.index(begin) > text.index(end):
            raise OptionError(
                f"{page}: needs the lines {begin.strip()!r} and {end!r}, once each, in this order"
            )
        found.append(name)
    return found


def require_marks(page: Path | None, names: Iterable[str], option: str = "--refresh") -> None:
    """Refuse a page to refresh that has no marks of any of these names."""
    if page is not None and not marked(page, names):
        raise OptionError(f"{option} {page}: there are no marks of a block named {' or '.join(names)}")


def require_pages(root: Path | None, pages: Mapping[str, Iterable[str]]) -> None:
    """Refuse documents (`--docs`) where one of these pages is missing or has no marks of its blocks."""
    if root is None:
        return
    for page, names in pages.items():
        if not (root / page).is_file():
            raise OptionError(f"--docs {root}: there is no {page} to refresh")
        require_marks(root / page, names, "--docs")


def refresh(page: Path | None, blocks: Mapping[str, str]) -> None:
    """Put each block between `<!-- begin: name -->` and `<!-- end: name -->` of a page, and tell.

    A name without marks is left out; without a page nothing is done.

    Raises
    ------
    OptionError
        When the marks of a name are not there once each, in this order.
    """
    found = [] if page is None else marked(page, blocks)
    if page is None or not found:
        return
    text = page.read_text(encoding="utf-8")
    for name in found:
        begin, end = _marks(name)
        head, rest = text.split(begin)
        text = f"{head}{begin}\n{blocks[name].strip()}\n\n{end}{rest.split(end)[1]}"
    page.write_text(text, encoding="utf-8")
    print(f"renewed {page}")


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- begin: {name} -->\n", f"<!-- end: {name} -->"


def write_records(stem: Path, records: Sequence[Mapping[str, Any]], whole: Mapping[str, Any]) -> None:
    """Write the records as stem.csv, one line each, and `whole` as stem.json."""
    lines = io.StringIO()
    writer = csv.DictWriter(lines, list(records[0]) if records else [])
    writer.writeheader()
    writer.writerows(records)
    write(stem.with_suffix(".csv"), lines.getvalue())
    write_json(stem.with_suffix(".json"), whole)


def table(rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A Markdown table; the first row is its head, columns of `numbers` are set to the right."""
    lines = [" | ".join(cell.replace("\n", " ").replace("|", "\\|") for cell in row) for row in rows]
    rule = "".join("---:|" if i in numbers else "---|" for i in range(len(rows[0])))
    return "\n".join([f"| {lines[0]} |", f"|{rule}", *(f"| {line} |" for line in lines[1:])])
