"""Where the rows of a batch were well conditioned last, and what was held since.

Beside modes that nearly meet γ bends sharply long before the kernel gives a row up. A `Simulation` goes back
then, as `runs.recovery` says; so does a row.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from ...kernel.simulation.row_state import RowState, Which
from ...maps.cluster.regular_ground import POOR
from ...mechanism.tree.tree import Array
from ..runs.recovery import good_from

MOST = 1000
"""Calls that are remembered: a row that is poorly conditioned for longer goes on from where it is."""


class SafeRows:
    """A state to go back to for each row, and what was held since by all of them.

    Parameters
    ----------
    state : RowState
        Of the rows.
    """

    def __init__(self, state: RowState) -> None:
        self._state, count = state, len(state.at)
        self._q, self._v, self._best = state.q.copy(), state.v.copy(), np.zeros(count)
        self._at, self._passed, self._since = (np.zeros(count, np.int64) for _ in range(3))
        self._calls: deque[tuple[int, Array]] = deque()
        self._first = 0  # number of the first call that is remembered

    def copy(self) -> SafeRows:
        """The same, which goes its own way."""
        other = SafeRows(self._state)
        other.take(self)
        return other

    def take(self, other: SafeRows) -> None:
        """Become what another one is."""
        for name in ("_q", "_v", "_best", "_at", "_passed", "_since"):
            getattr(self, name)[...] = getattr(other, name)
        self._calls, self._first = other._calls.copy(), other._first

    def begin(self, i: int) -> None:
        """A row begins anew."""
        self._best[i] = 0.0
        self.keep(np.array([i]))

    def keep(self, which: Which | slice) -> None:
        """Go back to where these rows are."""
        state = self._state
        self._q[which], self._v[which] = state.q[which], state.v[which]
        self._at[which], self._passed[which] = state.at[which], state.passed[which]
        self._since[which] = self._first + len(self._calls)

    def look(self, which: Which, conditioning: Array) -> None:
        """The same for those of some rows that are well conditioned."""
        best = self._best[which] = np.maximum(self._best[which], conditioning)
        # as a rule: one copy of all, and no call need be remembered
        if len(which) == len(self._best) and conditioning.min() >= POOR:
            self._first += len(self._calls)
            self._calls.clear()
            self.keep(slice(None))
            return
        self.keep(which[conditioning >= good_from(best)])

    def hold(self, n: int, rows: Which) -> None:
        """What is held now, over n steps of some rows, is remembered as long as one of them may need it."""
        while self._calls and (len(self._calls) >= MOST or not np.any(self._since[rows] <= self._first)):
            self._calls.popleft()
            self._first += 1
        self._calls.append((n, self._state.held.copy()))

    def best(self, i: int) -> float:
        """The best conditioning of a row so far."""
        return float(self._best[i])

    def back(self, i: int) -> Iterator[tuple[int, Array]] | None:
        """Put a row back; steps and what is to be held, one after the other. None where that is forgotten."""
        if self._since[i] < self._first:
            return None
        state = self._state
        state.q[i], state.v[i] = self._q[i], self._v[i]
        state.at[i], state.passed[i] = self._at[i], self._passed[i]
        return ((n, held[i]) for n, held in list(self._calls)[self._since[i] - self._first :])
