"""The command `live`: a mechanism in a browser, with a slider for each independent joint."""

from __future__ import annotations

import argparse
import time

from ..arguments import Arguments, number, positive, whole
from ..printing import say
from .model import add_model, loaded


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_model(add_to)
    add_to.add("--open", action="store_true", help="open the page in your browser")
    text = "of this machine; default: a free one"
    add_to.add("--port", whole(0, 65535), type=int, default=0, metavar="N", help=text)
    text = "end after so long; default: when interrupted (Ctrl-C)"
    add_to.add("--seconds", positive, type=number, metavar="S", help=text)


def run(args: argparse.Namespace) -> int:
    """Serve the page, on this machine alone."""
    from ..drawing.replay.live import live

    mechanism = loaded(args)
    end = float("inf") if args.seconds is None else time.monotonic() + args.seconds
    with live(mechanism, args.port, args.open, sliders=True) as viewer:
        say(f"{mechanism.name} at {viewer.url}; its sliders: {', '.join(mechanism.independent)}; Ctrl-C ends")
        while time.monotonic() < end:
            time.sleep(min(0.2, max(0.0, end - time.monotonic())))
        say("q = " + ", ".join(f"{number:.9g}" for number in viewer.q))
    return 0
