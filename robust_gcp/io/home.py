"""The home of a file's mechanism closed, and coordinates for it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..errors import ClosureError, PartitionError
from ..mechanism.assembly.assembly import assembled
from ..mechanism.assembly.ranges import assembled_within
from ..mechanism.constraint.rank import singular_words
from ..mechanism.constraint.rounding import ROUNDED, without_rounded_rows
from ..mechanism.contents import FileContents
from ..mechanism.coordinates.independent import completed, regular_near
from ..mechanism.loops import ClosedLoops
from ..mechanism.mechanism import Mechanism
from ..mechanism.tolerances import NEARLY_CLOSED
from ..mechanism.tree.tree import Array


def closed_home(
    loops: ClosedLoops, start: Array, spreads: tuple[float, ...]
) -> tuple[ClosedLoops, Array, list[str]]:
    """The loops without rows that others imply up to rounding, a home that closes them, and what was left."""
    every = np.arange(loops.nv)
    try:
        home = assembled_within(loops, start, every, "home", spreads)
    except ClosureError as failure:
        # rows that are redundant but for the rounding of a file's numbers contradict each other by it
        if failure.nearest is None or loops.closure_residual(failure.nearest) > ROUNDED:
            raise
        freed, rounded = without_rounded_rows(loops, failure.nearest)
        if not rounded:
            raise
        home = failure.nearest
    else:
        freed, rounded = without_rounded_rows(loops, home)
    return freed, assembled(freed, home, every, "home") if rounded else home, rounded


def with_coordinates(
    contents: FileContents,
    loops: ClosedLoops,
    home: Array,
    name: str,
    independent: Sequence[str] | Literal["auto"] | None,
    wanted: Sequence[str],
    as_named: bool,
) -> Mechanism:
    """The mechanism in the coordinates that are asked for, or in the wanted ones, completed.

    At a singular home, on which motion the wanted ones serve is open: they are tried as they are first, and
    completed for a configuration beside it.
    """
    if independent is not None:
        return Mechanism.from_contents(contents, independent, home, name, loops)
    place = home
    if loops.closure_residual(home) <= NEARLY_CLOSED and singular_words(loops, home):
        place = regular_near(loops, home)
    if (as_named or place is not home) and wanted:
        with contextlib.suppress(PartitionError):
            return Mechanism.from_contents(contents, wanted, home, name, loops)
    chosen, _ = completed(loops, place, wanted, name)
    return Mechanism.from_contents(contents, chosen, home, name, loops)
