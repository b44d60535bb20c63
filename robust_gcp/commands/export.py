"""The command `export`: a mechanism for programs without Python."""

from __future__ import annotations

import argparse

from ..arguments import Arguments, number, positive, whole
from ..errors import OptionError
from ..printing import say
from .model import add_model, loaded


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)
    add_to.add("to", metavar="FILE", help=".rgcp (the C library), .fmu (co-simulation) or .c (tables in C99)")
    text = "of RK4 within a unit for co-simulation, s; default: 1e-3"
    add_to.add("--step", positive, type=number, metavar="S", help=text)
    text = "version of the standard that a unit for co-simulation is of; default: 2"
    add_to.add("--fmi", whole(2, 3), type=int, metavar="N", help=text)


def run(args: argparse.Namespace) -> int:
    """Read, write, and say what is there."""
    given = {name: getattr(args, name) for name in ("step", "fmi") if getattr(args, name) is not None}
    if given and not args.to.endswith(".fmu"):
        raise OptionError(f"--{next(iter(given))} goes with a unit for co-simulation, a .fmu file alone")
    mechanism = loaded(args)
    path = mechanism.export(args.to, **given)
    say(f"{mechanism!r}\nwrote {path} ({path.stat().st_size / 1000:.1f} kB)")
    return 0
