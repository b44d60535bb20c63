"""Where the kernel writes a run's outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mechanism.tree.tree import Array
from ..structures import OutputRows, Request, address

NAMES = tuple(field[0] for field in OutputRows._fields_)


@dataclass(frozen=True)
class Outputs:
    """Rows for several outputs at once, C-contiguous; None where not wanted."""

    q: Array
    v: Array
    a: Array | None = None
    tau: Array | None = None
    energy: Array | None = None
    work: Array | None = None
    effort: Array | None = None  # of driven joints
    within: Within | None = None

    @classmethod
    def room(cls, n: int, nq: int, nv: int, wanted: Sequence[str] = (), driven: int = 0) -> Outputs:
        """Room for n outputs; `wanted` names those besides q and v."""
        widths = {"a": (n, nv), "tau": (n, nv), "energy": (n,), "work": (n,), "effort": (n, driven)}
        more: dict[str, Any] = {name: np.zeros(widths[name]) for name in wanted}
        return cls(np.empty((n, nq)), np.empty((n, nv)), **more)

    def written_by(self, request: Request) -> None:
        """Have the kernel write into these rows, from the first on."""
        within, targets = self.within, [(request.ends, self)]
        request.before = None
        if within is not None:
            targets.append((request.within, within.rows))
            request.times_within, request.before = address(within.times), address(within.before)
            request.prescribed_within = address(within.prescribed)
        for rows, own in targets:
            for name in NAMES:
                setattr(rows, name, address(getattr(own, name)))

    def first(self, n: int) -> Outputs:
        """The first n of them."""
        if n == len(self.q):
            return self
        within = None if self.within is None else self.within.first(n)
        return replace(self.between(0, n), within=within)

    def between(self, first: int, end: int) -> Outputs:
        """Those from `first` to before `end`, at the ends of steps alone."""
        kept = {name: getattr(self, name) for name in NAMES}
        cut: dict[str, Any] = {name: None if rows is None else rows[first:end] for name, rows in kept.items()}
        return Outputs(**cut)


@dataclass(frozen=True)
class Within:
    """Outputs within steps.

    Attributes
    ----------
    times : ndarray (k,)
        Increasing, s.
    before : ndarray of int (n + 1,)
        How many of them come before the first step's start and each of the n steps' ends.
    rows : Outputs
    prescribed : ndarray (k, 3, driven) or None
        y, ẏ and ÿ there of what moves as prescribed.
    """

    times: Array
    before: NDArray[np.int64]
    rows: Outputs
    prescribed: Array | None = None

    def first(self, n: int) -> Within:
        """Those within the first n steps."""
        k = int(self.before[n])
        return Within(self.times[:k], self.before[: n + 1], self.rows.between(0, k))
