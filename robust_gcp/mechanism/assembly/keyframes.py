"""States that a robot's file names, with their loops closed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ...checks import hint, shown
from ...errors import ClosureError, ModelError
from ..constraint.rank import opening
from ..loops import ClosedLoops
from ..tree.tree import Array
from .assembly import assembled

DIGITS = 1e-2
"""Residual, rad and lengths of the loop, below which a keyframe means a closed configuration."""


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A state that a file names.

    Attributes
    ----------
    q, v : ndarray (nq,), (nv,)
        Where `closed`, the nearest closed configuration, and the part of the file's velocity that keeps it
        closed; else what the file has.
    closed : bool
        Whether the loops are closed at q. They are where the file leaves them open by 1e-2 at most (rad and
        lengths of the loop), as files with few digits do, and a closed configuration is found beside it.
    open : float
        What the file leaves them open by.
    """

    q: Array
    v: Array
    closed: bool
    open: float

    def __repr__(self) -> str:
        told = "closed" if self.closed else f"open by {self.open:.2g}"
        return f"Keyframe({told}, q = {np.array2string(self.q, precision=4, threshold=12)})"


class Keyframes(dict[str, Keyframe]):
    """Keyframes by name; a ModelError for a name that there is not."""

    def __missing__(self, name: object) -> Keyframe:
        known = ", ".join(self) or "none"
        raise ModelError(f"there is no keyframe {shown(name)}{hint(str(name), list(self))}; it has {known}")


def keyframes_of(loops: ClosedLoops, given: Iterable[tuple[str, Array]], v: Mapping[str, Array]) -> Keyframes:
    """Keyframes closed where they are meant to be.

    Parameters
    ----------
    given : iterable of (name, ndarray (nq,))
    v : mapping of str to ndarray (nv,)
        Zero where a name is not in it.
    """
    found, every = Keyframes(), np.arange(loops.nv)
    for name, q in given:
        rates = v.get(name, np.zeros(loops.nv))
        left = loops.closure_residual(q) if loops.nc else 0.0
        closed = left <= DIGITS
        if closed and loops.nc:
            try:
                # no other start: that pose is meant
                q = assembled(loops, q, every, f"keyframe {name!r}", (0.0,))
            except ClosureError:
                closed = False
        if closed and loops.nc:
            rates = rates - opening(loops, q, rates)  # K v = 0 by the least change of v
        found[name] = Keyframe(q, rates, closed, float(left))
    return found
