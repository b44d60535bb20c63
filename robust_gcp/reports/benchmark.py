"""What steps cost on robots and of many starts at once, what derivatives cost, and every way to a call."""

from __future__ import annotations

import argparse

from .. import OptionError
from ..arguments import Arguments, existing_file, file, known_folder, whole, word
from . import derivative_cost, derivative_paths, robot_speed, throughput

ROUNDS = 50
"""Of each measurement in the kernel; the smallest counts, that is the one least disturbed."""

TABLES = {
    "starts": (),
    "derivatives": ("robots", "base", "refresh"),
    "paths": ("refresh",),
    "robots": ("shipped", "base"),
    "shipped": ("robots", "base"),
}
"""What is measured, and which other options go with it."""


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = "write the figures to this JSON file"
    add_to.path("--out", file((".json",), "a record of figures"), "FILE", text)
    add_to.add("--quick", action="store_true", help="short rounds, for a smoke test")
    add_to.heading("what is measured")
    text = "time the robots in this folder and those below it against Pinocchio's aba and constraintDynamics"
    add_to.path("--robots", known_folder, "DIR", text)
    add_to.add("--shipped", action="store_true", help="the same for shipped robots; so without options")
    text = "steps per second of so many starts at once, beside mujoco.rollout"
    add_to.add("--starts", whole(2, 100_000), type=int, metavar="N", help=text)
    text = "what derivatives cost: of some models, of the robots where they are given"
    add_to.add("--derivatives", action="store_true", help=text)
    text = "every way to calls beside the plain one, why it takes longer, and the largest errors"
    add_to.add("--paths", action="store_true", help=text)
    add_to.heading("how")
    text = "with --derivatives or --paths: renew the tables in this document"
    add_to.path("--refresh", existing_file, "FILE", text)
    text = "what robots stand on: fixed or free; as their files say when left out"
    add_to.add("--base", word(("fixed", "free")), metavar="BASE", help=text)


def run(args: argparse.Namespace) -> int:
    """Print the table that is asked for; exit code 1 where a path is slow without a warning or a reason."""
    what = _asked(args)
    if what == "starts":
        throughput.tell(args.starts, args.quick, args.out)
    elif what == "paths":
        return derivative_paths.tell(2 if args.quick else ROUNDS, not args.quick, args.out, args.refresh)
    elif what == "derivatives":
        derivative_cost.tell(args.robots, args.base, 3 if args.quick else 4 * ROUNDS, args.out, args.refresh)
    else:
        shipped = args.shipped or what == "shipped"
        robot_speed.tell(args.robots, shipped, args.base, 3 if args.quick else ROUNDS, args.out)
    return 0


def _asked(args: argparse.Namespace) -> str:
    """Which of `TABLES`; refuses options that it would not look at."""
    given = [name for name in (*TABLES, "base", "refresh") if getattr(args, name) not in (None, False)]
    what = next((name for name in TABLES if name in given), "shipped")
    for name in given:
        if name != what and name not in TABLES[what]:
            raise OptionError(f"--{name} does not go with --{what}")
    return what
