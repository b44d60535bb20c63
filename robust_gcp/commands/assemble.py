"""The command `assemble`: a configuration that closes all loops, and what the mechanism is there."""

from __future__ import annotations

import argparse

from ..arguments import NUMBERS, Arguments, number
from ..mechanism.tree.joints import in_q
from ..printing import fixed, say, table
from .model import add_model, joints, loaded


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)
    text = f"guess, {NUMBERS}; default: the model's home"
    add_to.add("--q", nargs="+", type=number, metavar="Q", help=text)
    text = "joints that keep their value; default: the independent ones"
    add_to.add("--hold", type=joints, metavar="JOINT,…", help=text)


def run(args: argparse.Namespace) -> int:
    """Print the configuration."""
    mechanism = loaded(args)
    q = mechanism.home
    if args.q is not None or args.hold is not None:
        q = mechanism.assemble(q if args.q is None else args.q, args.hold)
    rows = [[component.name, fixed(q[component.iq]), component.unit] for component in in_q(mechanism.joints)]
    say(f"{mechanism!r}\n")
    say(table(["joint", " q", ""], rows, longest=len(rows)))
    say(f"\nclosed to {mechanism.closure_residual(q):.1e} of {mechanism.length:.3g} m")
    return 0
