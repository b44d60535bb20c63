"""The arguments of every command that takes a model, and how it is loaded."""

from __future__ import annotations

import argparse

from ..arguments import MODEL, Arguments
from ..errors import ModelWarning
from ..io.loader import load
from ..mechanism.mechanism import Mechanism
from ..printing import clean_warnings


def add_model(add_to: Arguments) -> None:
    """Name the model, its base and its coordinates."""
    add_to.add("model", metavar="MODEL", help=MODEL)
    text = "what the robot stands on; default: as its file says"
    add_to.add("--base", choices=("fixed", "free"), help=text)
    text = "joints, or components of joints, that are the coordinates; auto: the best conditioned"
    add_to.add("--independent", type=joints, metavar="JOINT,…", help=text)
    add_to.add("--limits", action="store_true", help="stop joints at the ranges of the file")
    add_to.add("--friction", action="store_true", help="brake joints by the dry friction of the file")
    add_to.add("--strict", action="store_true", help="refuse a file with parts that are not simulated")


def joints(text: str) -> list[str] | str:
    """Names between commas, or auto."""
    return text if text == "auto" else [name for name in text.split(",") if name]


def loaded(args: argparse.Namespace) -> Mechanism:
    """The model that the arguments name; what it leaves out is told in one line."""
    with clean_warnings((ModelWarning,)):
        return load(
            args.model, args.independent, args.base, args.strict, limits=args.limits, friction=args.friction
        )
