"""The command `modes`: the configuration space of a mechanism, as a table and a picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..analysis.space import SEEDS, trace_modes
from ..commands import listed, table
from ..drawing.figures.modes import plot_modes
from ..drawing.figures.style import DPI, require_file, save, style
from ..mechanism.folders.loader import load


def add_parser(subparsers: Any) -> None:
    """Register `modes`."""
    text = "trace the operation modes of a mechanism with one degree of freedom, and draw them"
    parser = subparsers.add_parser("modes", help=text, description=text)
    parser.add_argument("model", metavar="MODEL", help="a shipped model's name, or a folder")
    parser.add_argument("--out", type=Path, metavar="FILE", help="draw them: a .png or .pdf file")
    text = "rough configurations to start from; default: %(default)s"
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=text)
    text = "two or three joints to draw over"
    parser.add_argument("--coordinates", nargs="+", metavar="JOINT", help=text)
    parser.add_argument("--dpi", type=int, default=DPI, help="of a .png file; default: %(default)s")
    parser.set_defaults(run=_modes)


def _modes(args: argparse.Namespace) -> int:
    if args.out is not None:
        require_file(args.out)
    space = trace_modes(load(args.model), args.seeds)
    rows = []
    for mode in space.modes:
        turns = "closed, turns " + listed(mode.turns) if mode.closed else f"open: {mode.stop}"
        points = sorted({v.point + 1 for v in mode.visits})
        rows.append([mode.name, turns, ", ".join(map(str, points)) or "none"])
    print(f"{space.mechanism!r}\n\n{table(['mode', '', 'singular points'], rows, longest=len(rows))}")
    for i, point in enumerate(space.singular_points):
        print(f"singular point {i + 1}: q = {listed(point.q, 6)}")
        for name, tangent in zip(space.meeting(i), point.modes, strict=True):
            print(f"  mode {name} along {listed(tangent, 4)}")
    if args.out is not None:
        figure = plot_modes(space, coordinates=args.coordinates)
        with style():
            print(f"drew {save(figure, args.out, args.dpi)}")
    return 0
