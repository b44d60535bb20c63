"""The command `modes`: the configuration space of a mechanism, as a table and a picture."""

from __future__ import annotations

import argparse

from ..analysis.space import SEEDS, trace_modes
from ..arguments import DEFAULT, Arguments, file, whole
from ..printing import listed, say, table, telling
from .model import add_model, loaded

LARGEST_DPI = 1200
"""A finer picture takes more memory than most machines have."""


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)
    add_to.path("--out", file((".png", ".pdf"), "a figure"), "FILE", "draw them: a .png or .pdf file")
    text = f"rough configurations to start from; {DEFAULT}"
    add_to.add("--seeds", whole(0), type=int, default=SEEDS, metavar="N", help=text)
    text = "two or three joints to draw over"
    add_to.add("--coordinates", nargs="+", metavar="JOINT", help=text)
    text = "of a .png file; default: 300"
    add_to.add("--dpi", whole(1, LARGEST_DPI), type=int, metavar="N", help=text)


def run(args: argparse.Namespace) -> int:
    """Print the table, and draw."""
    mechanism = loaded(args)
    if args.out is not None or args.coordinates is not None:
        from ..drawing.figures import modes as figures
        from ..drawing.figures.style import DPI, require_matplotlib, save, style

        require_matplotlib()
        figures.chosen_coordinates(mechanism, args.coordinates)
    with telling(f"tracing the modes of {mechanism.name}"):
        space = trace_modes(mechanism, args.seeds)
    rows = []
    for mode in space.modes:
        turns = "closed, turns " + listed(mode.turns) if mode.closed else f"open: {mode.stop}"
        points = sorted({v.point + 1 for v in mode.visits})
        rows.append([mode.name, turns, ", ".join(map(str, points)) or "none"])
    say(f"{space.mechanism!r}\n\n{table(['mode', '', 'singular points'], rows, None)}")
    say(f"{space.summary}\n{space.search}\n")
    for i, point in enumerate(space.singular_points):
        say(f"singular point {i + 1}: q = {listed(point.q, 6)}")
        for name, tangent in zip(space.meeting(i), point.modes, strict=True):
            say(f"  mode {name} along {listed(tangent, 4)}")
    if args.out is not None:
        with telling(f"drawing {args.out}"), style():
            save(figures.plot_modes(space, coordinates=args.coordinates), args.out, args.dpi or DPI)
        say(f"drew {args.out}")
    return 0
