"""A cut joint of which some rows are left out, as the others imply them up to a file's rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.typing import NDArray

from .closures import AXES, AxisClosure, Closure, Direction, Term, closure_kinds


@dataclass(frozen=True)
class PartialClosure(AxisClosure):
    """Some of the rows of another kind of cut joint, all of them fixed to the bodies.

    Parameters
    ----------
    frame1, frame2 : str
        Names of frames of the spanning tree.
    axis : tuple of float
        That of the whole cut joint, where it has one.
    whole : str
        Its kind.
    along : tuple of int
        Which of its position rows are kept; of a shared origin those along the axes of frame 2.
    turns : tuple of int
        Which of its rotation rows.
    """

    whole: str = "6d"
    along: tuple[int, ...] = (0, 1, 2)
    turns: tuple[int, ...] = (0, 1, 2)
    kind: ClassVar[str] = "partial"

    @classmethod
    def of(cls, closure: Closure) -> PartialClosure:
        """All rows of a cut joint."""
        axis = closure.axis if isinstance(closure, AxisClosure) else AXES[2]
        turns = tuple(sorted({term[0] for term in closure.rotation_terms()}))
        along = tuple(range(len(closure.position_rows())))
        return cls(closure.frame1, closure.frame2, axis, closure.kind, along, turns)

    def position_rows(self) -> Sequence[int | Direction]:
        """The origins do not come apart along these directions of frame 2."""
        whole = self.all_rows()
        # Rows along the world's axes turn against the loop, and which of them others imply turns too.
        rows = AXES if whole.holds else whole.position_rows()
        return [rows[i] for i in self.along]

    def rotation_terms(self) -> list[Term]:
        """Those of the whole whose rows are kept."""
        return [term for term in self.all_rows().rotation_terms() if term[0] in self.turns]

    def is_proper(self, turn: NDArray[Any]) -> bool:
        """As of the whole."""
        return self.all_rows().is_proper(turn)

    @property
    def joins(self) -> bool:
        """As of the whole: what others imply holds too."""
        return self.all_rows().joins

    def all_rows(self) -> Closure:
        """The cut joint that it is a part of."""
        kind = next(kind for kind in closure_kinds() if kind.kind == self.whole)
        more = {"axis": self.axis} if issubclass(kind, AxisClosure) else {}
        return kind(self.frame1, self.frame2, **more)
