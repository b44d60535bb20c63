"""What a run through phases remembers of the instants where one ends and another begins, for derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ...mechanism.tree.tree import Array
from .decision import Phase

if TYPE_CHECKING:
    from .machine import Machines

LATCH, START, SWITCH, BREAK = -4, -3, -2, -1
"""In place of a row's number: an event closes a lock, the run begins, a time has come, what is held gives."""


@dataclass(frozen=True, eq=False)
class Turn:
    """An instant where a phase ends and another begins.

    Attributes
    ----------
    t : float
        s.
    why : int
        The row whose function vanishes, or `START`, `SWITCH`, `BREAK`.
    q : ndarray (nq,)
    before, after : ndarray (nv,)
        v just before and just after.
    phase : Phase
        That begins.
    """

    t: float
    why: int
    q: Array
    before: Array
    after: Array
    phase: Phase


@dataclass(eq=False)
class Passed:
    """The phases that a run went through, and what can take their steps again.

    Attributes
    ----------
    machines : Machines
    turns : list of Turn
    """

    machines: Machines
    turns: list[Turn] = field(default_factory=list)

    def __reduce__(self) -> tuple[type[Forgotten], tuple[()]]:
        """Pickles and copies hold no code."""
        return Forgotten, ()

    def __deepcopy__(self, memo: object) -> Passed:
        return self


class Forgotten:
    """In place of `Passed` in pickles."""
