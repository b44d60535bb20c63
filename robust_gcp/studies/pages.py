"""Pages that the studies keep true: blocks between marks, and Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ..errors import OptionError


def renew(page: Path, blocks: Mapping[str, str]) -> bool:
    """Put each block between `<!-- begin: name -->` and `<!-- end: name -->` of a page.

    Returns
    -------
    bool
        Whether the page has marks of any of these names; a name without marks is left out.

    Raises
    ------
    OptionError
        When the marks of a name are not there once each, in this order.
    """
    found = marked(page, blocks)
    text = page.read_text(encoding="utf-8")
    for name in found:
        begin, end = _marks(name)
        head, rest = text.split(begin)
        text = f"{head}{begin}\n{blocks[name].strip()}\n\n{end}{rest.split(end)[1]}"
    page.write_text(text, encoding="utf-8")
    return bool(found)


def marked(page: Path, names: Iterable[str]) -> list[str]:
    """Those of the names whose marks the page has; raises as `renew`."""
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


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- begin: {name} -->\n", f"<!-- end: {name} -->"


def table(rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A Markdown table; the first row is its head, columns of `numbers` are set to the right."""
    lines = [" | ".join(cell.replace("\n", " ").replace("|", "\\|") for cell in row) for row in rows]
    rule = "".join("---:|" if i in numbers else "---|" for i in range(len(rows[0])))
    return "\n".join([f"| {lines[0]} |", f"|{rule}", *(f"| {line} |" for line in lines[1:])])
