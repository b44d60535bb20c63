"""What a subcommand is: a name, a line of help, and the module that is imported when it is called.

The module offers two functions:

- `arguments(add_to: Arguments) -> None` names its arguments, each with the check its values must pass;
- `run(args: argparse.Namespace) -> int` does the work and returns the exit code: 0 done, 1 done with a
  result that is not good, 2 refused or stopped (errors of the package need not be caught).
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..arguments import Arguments


@dataclass(frozen=True)
class Command:
    """A subcommand.

    Attributes
    ----------
    name, help : str
    module : str
        Relative to the package; empty for one that has subcommands of its own.
    parts : tuple of Command
    """

    name: str
    help: str
    module: str = ""
    parts: tuple[Command, ...] = ()


REPORTS = (
    Command(
        "paper",
        "draw Figures 4 to 7 of the paper, with the exact motion in the same panels",
        ".reports.paper",
    ),
    Command(
        "work-precision",
        "error against run time: our methods, the implicit equations and other tools",
        ".reports.work_precision.command",
    ),
    Command(
        "stability",
        "stiff and extreme cases against steppers: right, stopped with a reason, or wrong",
        ".reports.stability.command",
    ),
    Command("robots", "robots' files of a folder: which load and run as they are", ".reports.robots"),
    Command("growth", "time of a step against size, ours and of other tools", ".reports.growth"),
    Command(
        "costs",
        "which parts of the method each kind of scene runs, and what its steps cost",
        ".reports.costs",
    ),
    Command(
        "benchmark",
        "what steps cost on robots and of many starts, what derivatives cost, every way to a call",
        ".reports.benchmark",
    ),
    Command(
        "gradients",
        "score derivatives of closed-loop mechanisms against seventy-digit references",
        ".reports.gradients.scores",
    ),
    Command(
        "benchmarks",
        "published benchmarks with their own numbers: IFToMM A01 to A05, another suite, a test set",
        ".reports.published.command",
    ),
    Command(
        "singular",
        "score tools by motions through singular configurations, against 25-digit references",
        ".reports.singular.scores",
    ),
    Command("a02", "N four-bars in a row (IFToMM A02) against the closed form", ".reports.a02"),
)
"""What measures the project."""

COMMANDS = (
    Command(
        "simulate", "simulate a mechanism: a summary, tables, pictures, animations", ".commands.simulate"
    ),
    Command("analyse", "rank, kernel and operation modes at a configuration", ".commands.analyse"),
    Command("assemble", "close the loops of a model from a guess", ".commands.assemble"),
    Command("convert", "read a robot's file and write it as another format", ".commands.convert"),
    Command("export", "write a mechanism for programs without Python: C, FMU", ".commands.export"),
    Command(
        "modes",
        "trace the operation modes of a mechanism with one degree of freedom, and draw them",
        ".commands.modes",
    ),
    Command(
        "live", "a mechanism in your browser, with a slider for each independent joint", ".commands.live"
    ),
    Command("models", "list the shipped models", ".commands.models"),
    Command(
        "reports", "measure this package: figures of the paper, errors, costs, other tools", parts=REPORTS
    ),
)
"""What users call."""


def add_commands(parser: argparse.ArgumentParser, commands: Sequence[Command]) -> None:
    """Subcommands, of which only the one that is called is imported."""
    settings: dict[str, Any] = {"metavar": "COMMAND", "required": True, "parser_class": LateParser}
    subparsers = parser.add_subparsers(title="commands", **settings)
    for command in commands:
        subparsers.add_parser(command.name, command=command, help=command.help, description=command.help)


LONG = 6
"""Lines of a command's usage above which its options are left to the list of them."""


class LateParser(argparse.ArgumentParser):
    """A subcommand's parser, empty until words reach it: then its module is imported and fills it."""

    def __init__(self, *, command: Command, **settings: Any) -> None:
        super().__init__(**settings)
        self._command: Command | None = command

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse, after the arguments have been added."""
        command, self._command = self._command, None
        if command is not None and command.parts:
            add_commands(self, command.parts)
        elif command is not None:
            module = importlib.import_module(command.module, __package__.rpartition(".")[0])
            arguments = Arguments(self)
            module.arguments(arguments)
            if len(self.format_usage().splitlines()) > LONG:
                words = (str(a.metavar or a.dest) for a in self._get_positional_actions())
                self.usage = " ".join(["%(prog)s", "[options]", *words])
            self.set_defaults(check=arguments.check, run=module.run)
        return super().parse_known_args(args, namespace)
