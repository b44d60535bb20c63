"""The rows of a batch that the kernel steps alone, each in coordinates that serve it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from ...dynamics.equations import Evaluation
from ...dynamics.prescribed.zero_order_hold import HeldTorque
from ...dynamics.problem import Problem
from ...kernel.description import follows_zones
from ...kernel.library import Library
from ...kernel.loop_arrays import NotNativeError
from ...kernel.simulation.guard import Watch
from ...kernel.simulation.row_state import RowState, Standing
from ...kernel.simulation.rows import MotionRows
from ...kernel.simulation.steps import limits_of
from ...kernel.structures import Reason
from ...maps.cluster.options import BridgeOptions
from ...maps.explicit import Counters
from ...maps.regular_path import RegularPath
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..runs.coordinates import Coordinates, in_coordinates
from ..runs.initial_state import Given, closed_by_kernel, is_plain, rest_of

Which = NDArray[np.int64]

NOWHERE = -1
"""In place of the number of a choice of coordinates."""

Place = tuple[int, Standing]
"""The number of a choice of coordinates, and where a row is in them."""


class BatchCharts:
    """Rows by the coordinates that they are in.

    Parameters
    ----------
    library : Library or None
        None: no row is here.
    named : Mechanism
        In the user's coordinates.
    state : RowState
    threads : int

    Attributes
    ----------
    of : ndarray of int (N,)
        Which coordinates a row is in; `NOWHERE` where it is not here.
    """

    def __init__(self, library: Library | None, named: Mechanism, state: RowState, threads: int) -> None:
        self._library, self._named, self._state, self._threads = library, named, state, threads
        self._charts: list[MotionRows] = []
        self._compiles = True
        self.of: Which = np.full(len(state.at), NOWHERE)

    def advance(self, which: Which, n: int, pool: ThreadPoolExecutor | None) -> list[int]:
        """So many steps of some rows; those that the kernel gave up before."""
        state, given_up, of = self._state, list[int](), self.of[which]  # where they begin
        for c in np.unique(of[of != NOWHERE]).tolist():
            # one call for all rows in these; those that leave them on the way come to their end one by one
            rows, chart = which[of == c], self._charts[c]
            chart.advance(rows, n, pool)
            given_up += [i for i in rows[state.status[rows] != Reason.DONE].tolist() if not self._ends(i)]
        return given_up

    def specialise(self, wanted: bool | None) -> str | None:
        """Have steps compiled for the mechanism: at once, when it pays (None), or never; why they are not."""
        self._compiles = wanted is not False
        for chart in self._charts:
            chart.compiles = self._compiles
        if not wanted:
            return None
        return self._charts[0].specialise() if self._charts else "the compiled kernel does not take its rows"

    def put(self, i: int, place: Place) -> None:
        """A row is there now."""
        self.leave(i)
        chart, standing = place
        self.of[i] = chart
        self._charts[chart].put(i, standing)

    def leave(self, i: int) -> None:
        """A row is not here any more."""
        if self.of[i] != NOWHERE:
            self._charts[self.of[i]].let_go(i)
            self.of[i] = NOWHERE

    def where(self, i: int) -> Place:
        """Where a row is."""
        chart = int(self.of[i])
        return chart, self._charts[chart].where(i)

    def tangent(self, i: int) -> Array:
        """That of its mode, (nv, m)."""
        return self._charts[self.of[i]].point(i).G

    def mechanism_of(self, i: int) -> Mechanism:
        """The mechanism in a row's coordinates."""
        return self._charts[self.of[i]].mechanism

    def conditioning(self, which: Which) -> tuple[Which, Array]:
        """Those of some rows that are here, and how K_d is conditioned there."""
        of = self.of[which]
        if len(self._charts) == 1 and of.min(initial=0) != NOWHERE:
            return which, self._charts[0].conditioning(which)
        here, of = which[of != NOWHERE], of[of != NOWHERE]
        found = np.empty(len(here))
        for c in np.unique(of).tolist():
            chosen = of == c
            found[chosen] = self._charts[c].conditioning(here[chosen])
        return here, found

    def told(self, i: int) -> None:
        """Write where a row is, as it begins."""
        self._state.q[i], self._state.v[i] = self._charts[self.of[i]].state_of(i)

    def open_loops(self, which: Which) -> list[int]:
        """Those of some rows to be looked at, as rows of φ do not determine their dependent joints."""
        open_ = [c for c, chart in enumerate(self._charts) if chart.path.mechanism.nc > chart.path.nd]
        found: list[int] = which[np.isin(self.of[which], open_)].tolist() if open_ else []
        return found

    def begun(self, start: Given) -> Place | None:
        """A start on regular ground in the coordinates of the first row; None where it is none."""
        q0, v0, mode = start
        if not self._charts or mode is not None or not is_plain(self._charts[0].mechanism):
            return None
        named, chart = self._named, self._charts[0]
        q = named.home if q0 is None else named.configuration(q0, "q0")
        v = named.tree.zero if v0 is None else named.velocity(v0, "v0")
        begun = closed_by_kernel(chart.workspace, chart.mechanism, q, v, chart.zone, options=chart.options)
        return None if begun is None else (0, chart.begun(begun))

    def place_of(self, motion: Problem, x: Array, watch: Watch | None, now: Evaluation) -> Place | None:
        """Where a motion is; None where the kernel does not take its coordinates.

        `watch` tells up to where these serve.
        """
        trackers = motion.trackers
        if trackers is not None and not follows_zones(motion.path):
            return None
        c = self._chart(motion.mechanism, motion.path, *limits_of(motion.choice))
        if c is None:
            return None
        return c, self._charts[c].standing_at(x, now, None if trackers is None else trackers(), watch)

    # --------------------------------------------------------------------- coordinates

    def _ends(self, i: int) -> bool:
        """Whether a row came to the end of its steps in other coordinates."""
        state = self._state
        while state.status[i] == Reason.CHART and self._in_better(i):
            if not state.left[i]:
                state.status[i] = Reason.DONE
                break
            self._charts[self.of[i]].advance(np.array([i]), int(state.left[i]), None)
        return bool(state.status[i] == Reason.DONE)

    def _in_better(self, i: int) -> bool:
        """Whether a row was put into better coordinates, or is in those that it has with more patience."""
        chart = self._charts[self.of[i]]
        watch = chart.watch(i)
        if watch is None:
            return False
        look = Coordinates(chart.mechanism, self._named.independent, Counters())
        look.watch = watch
        names = look.better(chart.point(i))
        # those present are the best: looked at again when they are worse by some way
        if names is None:
            chart.set_watch(i, look.watch)
            return True
        return self._recharted(i, in_coordinates(self._named, names), chart)

    def _recharted(self, i: int, mechanism: Mechanism, before: MotionRows) -> bool:
        """Whether a row is in the coordinates of `mechanism` now."""
        if not is_plain(mechanism):
            return False
        rest, state = rest_of(mechanism), self._state
        path = RegularPath(rest, np.arange(rest.nc), Counters())  # all rows: it is plain
        c = self._chart(mechanism, path, before.options, before.zone)
        if c is None:
            return False
        chart = self._charts[c]
        begun = closed_by_kernel(chart.workspace, mechanism, state.q[i], state.v[i], chart.zone)
        if begun is None:
            return False
        self.put(i, (c, chart.begun(begun)))
        return True

    def _chart(
        self, mechanism: Mechanism, path: RegularPath, options: BridgeOptions | None, zone: float
    ) -> int | None:
        """The number of these coordinates; None where the kernel does not take them."""
        for c, chart in enumerate(self._charts):
            if chart.mechanism is mechanism and np.array_equal(chart.path.rows, path.rows):
                return c
        if self._library is None or options is None:
            return None
        watch = Coordinates(mechanism, self._named.independent, Counters()).watch
        with suppress(NotNativeError):
            more = HeldTorque(mechanism), self._state, options, zone, watch, self._threads
            self._charts.append(MotionRows(self._library, mechanism, path, *more))
            self._charts[-1].compiles = self._compiles
            return len(self._charts) - 1
        return None
