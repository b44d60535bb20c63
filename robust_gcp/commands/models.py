"""The command `models`: what is shipped."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence

from ..arguments import Arguments
from ..io.loader import load, model_names, models_folder
from ..io.yaml_text import parsed_yaml
from ..printing import say, table

WIDTH = 100
"""Columns of the brief table."""


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.add("--full", action="store_true", help="every joint and closure by name")


def run(args: argparse.Namespace) -> int:
    """List the shipped models."""
    rows = []
    for name in model_names():
        mechanism = load(name)
        own = parsed_yaml(models_folder() / name / "robot.yaml").get("robust_gcp") or {}
        closures = [f"{c.frame1} – {c.frame2} ({c.kind})" for c in mechanism.loops]
        columns = (
            (mechanism.joint_names, "joint", 10),
            (mechanism.independent, "joint", 8),
            (closures, "closure", 30),
        )
        cells = (brief(words, what, None if args.full else width) for words, what, width in columns)
        rows.append([name, *cells, own.get("description", "")])
    header = ["name", "joints", "y", "closures", "description"]
    if not args.full:
        taken = max(len(line) for line in table(header[:-1], [row[:-1] for row in rows], None).splitlines())
        for row in rows:
            row[-1] = textwrap.shorten(row[-1], WIDTH - taken - 2, placeholder=" …")
    say(table(header, rows, None))
    return 0


def brief(words: Sequence[str], what: str, width: int | None) -> str:
    """The words, or how many there are where they take more than `width` columns."""
    text = ", ".join(words)
    if width is None or len(text) <= width:
        return text
    return f"{len(words)} {what}{'s' * (len(words) > 1)}"
