"""Warnings that point at the line of the caller's which brought them about."""

from __future__ import annotations

import sys
import warnings

INSIDE = frozenset({__name__.partition(".")[0], "scipy", "numpy"})
"""Packages whose lines a caller did not write; scipy's solvers stand between `simulate` and its maps."""


def warn(message: str, category: type[Warning]) -> None:
    """`warnings.warn`, attributed to the innermost line outside this package.

    However deep the call and whatever solver it passes through, filters by module and the
    once-per-line default then see the caller's module and line. Where there is no line outside, as
    in a worker's thread, it is the outermost one.
    """
    frame = sys._getframe(1)
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in INSIDE:
        frame = frame.f_back
    module = frame.f_globals
    warnings.warn_explicit(
        message,
        category,
        frame.f_code.co_filename,
        frame.f_lineno,
        module.get("__name__", "<unknown>"),
        module.setdefault("__warningregistry__", {}),
    )
