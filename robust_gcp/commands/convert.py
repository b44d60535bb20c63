"""The command `convert`: a mechanism from one format to another."""

from __future__ import annotations

import argparse

from ..arguments import Arguments
from ..printing import say
from .model import add_model, loaded


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)
    add_to.add("to", metavar="FILE", help=".xml (MJCF), .urdf, or a folder without a suffix")


def run(args: argparse.Namespace) -> int:
    """Read, write, and say what is there."""
    mechanism = loaded(args)
    path = mechanism.write(args.to)
    say(f"{mechanism!r}\nwrote {path}")
    return 0
