"""The command line: `robust-gcp` or `python -m robust_gcp`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from . import __version__
from .arguments import number
from .commands.register import COMMANDS, REPORTS, add_commands
from .errors import RobustGcpError
from .printing import complain


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand; the exit code is 0 when done, 2 when refused or stopped by an error."""
    given = sys.argv[1:] if argv is None else argv
    for stream in (sys.stdout, sys.stderr):  # whatever the terminal's encoding, names are told
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if any("\0" in text for text in given):
        complain("a word holds a null character, which no name or path does; remove it")
        return 2
    if given and given[0] in {report.name for report in REPORTS}:
        new = f"reports {given[0]}"
        complain(
            f"warning: `{given[0]}` is now `{new}`; the next release no longer knows it without `reports`"
        )
        given = ["reports", *given]
    args = _parser().parse_args([shield(text) for text in given])
    try:
        args.check(args)
        return int(args.run(args))
    except BrokenPipeError:  # the reader of our output left, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (RobustGcpError, OSError) as error:
        complain(str(error))
        return 2
    except KeyboardInterrupt:
        complain("interrupted")
        return 130


def shield(text: str) -> str:
    """Put a space before a negative number, which argparse may take for an option (`-pi`)."""
    try:
        return f" {text}" if text.startswith("-") and number(text) <= 0.0 else text
    except ValueError:
        return text


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robust-gcp",
        description="Closed-loop mechanisms in minimal coordinates, straight through singular "
        "configurations.",
        epilog="robust-gcp COMMAND --help tells a command's options.",
    )
    parser.add_argument("--version", action="version", version=f"robust_gcp {__version__}")
    add_commands(parser, COMMANDS)
    return parser


if __name__ == "__main__":
    sys.exit(main())
