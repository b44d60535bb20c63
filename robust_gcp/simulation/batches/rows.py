"""The rows of a batch: in the kernel, or each by a simulation of its own where more has to be looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...checks import shown
from ...errors import ClosureError, OptionError, PerformanceWarning, RobustGcpError, SingularStartError
from ...kernel.library import Library
from ...kernel.simulation.row_state import RowState
from ...kernel.structures import Reason
from ...mechanism.mechanism import Mechanism
from ...mechanism.tolerances import NEARLY_CLOSED
from ...mechanism.tree.tree import Array
from ...warning import warn
from ..runs.initial_state import Given
from ..runs.stepped import SteppedRun
from ..simulation import Simulation
from .row_charts import NOWHERE, BatchCharts, Place, Which
from .safe_rows import SafeRows

Made = Callable[[Given, float, int, bool], Simulation]
"""A simulation of a row, from its start, time and number; quietly but for the first one."""

Failure = tuple[int, RobustGcpError]


@dataclass(frozen=True)
class Kept:
    """What `save` keeps of them."""

    owner: BatchRows
    state: RowState
    before: Which
    places: dict[int, Place]
    simulations: dict[int, tuple[Simulation, Any]]
    safe: SafeRows


class BatchRows:
    """The rows of a batch.

    Parameters
    ----------
    library : Library or None
    named : Mechanism
        In the user's coordinates.
    made : callable
    state : RowState
    threads : int
    """

    def __init__(
        self, library: Library | None, named: Mechanism, made: Made, state: RowState, threads: int
    ) -> None:
        self._named, self._made, self._state, self._compiled = named, made, state, library is not None
        self._charts = BatchCharts(library, named, state, threads)
        self._before = np.zeros(len(state.at), np.int64)  # places passed before a row's simulation began
        self._alone: dict[int, Simulation] = {}
        self._last: tuple[Any, Place] | None = None  # a start that was found, for those that are the same
        self._begun = self._told = False
        self._safe = SafeRows(state)

    def crossings(self) -> Which:
        """Singular places passed."""
        passed = self._state.passed.copy()
        for i, simulation in self._alone.items():
            passed[i] = self._before[i] + len(simulation.crossings)
        return passed

    def coordinates(self, which: Which) -> list[Mechanism]:
        """The mechanism in the coordinates in which each of some rows moves."""
        charts, alone = self._charts, self._alone
        return [alone[i].mechanism if i in alone else charts.mechanism_of(i) for i in which.tolist()]

    def specialise(self, wanted: bool | None) -> None:
        """Have steps compiled for the mechanism: at once, when it pays (None), or never.

        Raises
        ------
        OptionError
            Where they are wanted at once, and that cannot be.
        """
        if wanted is not None and not isinstance(wanted, bool):
            raise OptionError(f"specialise = {shown(wanted)} must be True, False or None")
        why = self._charts.specialise(wanted)
        if wanted and why is not None:
            raise OptionError(f"specialise=True: no steps are compiled for this mechanism: {why}")

    def begin(self, i: int, start: Given, t0: float) -> None:
        """A row begins anew."""
        state, key = self._state, _key(start)
        known = self._last is not None and key == self._last[0]
        place = self._last[1] if self._last is not None and known else self._charts.begun(start)
        # made before anything is written: where it raises the row is as it was
        simulation = None if place is not None else self._made(start, t0, i, self._begun)
        self._begun = True
        state.t0[i], state.at[i], state.left[i], state.passed[i], self._before[i] = t0, 0, 0, 0, 0
        state.status[i] = Reason.DONE
        self._leave(i)
        if simulation is not None:
            self._alone[i] = simulation
            self._hand_back(i)
        elif place is not None:
            self._charts.put(i, place)
            self._charts.told(i)
        self._safe.begin(i)
        self._safe.look(*self._charts.conditioning(np.array([i])))
        if self._charts.of[i] != NOWHERE:
            self._last = key, self._charts.where(i)

    def advance(self, which: Which, n: int, pool: ThreadPoolExecutor | None) -> Iterator[Failure]:
        """So many steps of some rows; gives those that stopped."""
        there = self._charts.of[which] != NOWHERE
        self._safe.hold(n, which[there])
        for i in self._charts.advance(which, n, pool):
            error = self._take_over(i)
            if error is not None:
                yield i, error
        yield from self._left_open(which)
        for i in which[~there].tolist():
            error = self._by_simulation(i, [(n, self._state.held[i])])
            if error is not None:
                yield i, error
        self._safe.look(*self._charts.conditioning(which))

    def save(self) -> Kept:
        """Where all rows are."""
        there = np.flatnonzero(self._charts.of != NOWHERE).tolist()
        places = {i: self._charts.where(i) for i in there}
        simulations = {i: (simulation, simulation.save()) for i, simulation in self._alone.items()}
        return Kept(self, self._state.copy(), self._before.copy(), places, simulations, self._safe.copy())

    def restore(self, kept: Any) -> bool:
        """Whether these rows went back to where they were when they were kept."""
        if not isinstance(kept, Kept) or kept.owner is not self:
            return False
        self._state.take(kept.state)
        self._before[:] = kept.before
        self._safe.take(kept.safe)
        for i in range(len(self._before)):
            self._leave(i)
        for i, place in kept.places.items():
            self._charts.put(i, place)
        for i, (simulation, saved) in kept.simulations.items():
            self._alone[i] = simulation.restore(saved)
        return True

    def _leave(self, i: int) -> None:
        """A row is nowhere."""
        self._charts.leave(i)
        self._alone.pop(i, None)

    def _time(self, i: int) -> float:
        state = self._state
        return float(state.t0[i] + state.step * state.at[i])  # no sum, whose rounding would grow

    def _left_open(self, which: Which) -> Iterator[Failure]:
        """Rows of which loops are open that the dependent joints cannot close."""
        looked = self._charts.open_loops(which)
        if not looked:
            return
        gaps = np.abs(self._named.phi(self._state.q[looked])) / self._named.row_scale
        for i in np.array(looked)[~(gaps.max(axis=1) <= NEARLY_CLOSED)].tolist():
            try:
                self._named.require_closed(self._state.q[i], NEARLY_CLOSED, f"at t = {self._time(i):.6g} s")
            except ClosureError as error:
                yield i, error

    def _take_over(self, i: int) -> RobustGcpError | None:
        """A simulation goes on with a row that the kernel gave up; what it says where it cannot.

        From where the row was well conditioned last.
        """
        state, tangent = self._state, self._charts.tangent(i)
        steps = self._safe.back(i) or [(int(state.left[i]), state.held[i])]
        place = state.q[i].copy(), state.v[i].copy()
        self._leave(i)
        try:
            try:
                self._alone[i] = self._made((*place, None), self._time(i), i, True)
            except SingularStartError:  # v tells no mode, as at rest
                self._alone[i] = self._made((*place, tangent), self._time(i), i, True)
        except RobustGcpError as error:
            return error
        self._before[i], run = state.passed[i], self._alone[i]._run
        if isinstance(run, SteppedRun):
            run.goes_on((self._safe.best(i), False))  # good is relative to the best so far
        return self._by_simulation(i, steps)

    def _by_simulation(self, i: int, steps: Iterable[tuple[int, Array]]) -> RobustGcpError | None:
        """Steps of a row by its simulation, under what is held; what it says where it stops."""
        state, simulation = self._state, self._alone[i]
        nv, begun = state.v.shape[1], simulation.t
        try:
            for n, held in steps:
                begun, controls = simulation.t, held[nv:]
                powered = len(controls) and not np.isnan(controls).any()
                if n:
                    simulation.step(held[:nv], n, ctrl=controls if powered else None)  # NaN: no power
                state.at[i] += n
        except RobustGcpError as error:
            last = error.trajectory
            if last is not None and len(last.t):
                state.q[i], state.v[i] = last.q[-1], last.v[-1]
                state.at[i] += round((float(last.t[-1]) - begun) / state.step)
            return error
        self._hand_back(i)
        return None

    def _hand_back(self, i: int) -> None:
        """Write where a row's simulation is, and give the row to the kernel where that can go on alone."""
        simulation, state = self._alone[i], self._state
        state.q[i], state.v[i] = simulation.q, simulation.v
        run, place = simulation._run, None
        if isinstance(run, SteppedRun) and not simulation._held.stride:
            found = run.standing(run.last)
            place = None if found is None else self._charts.place_of(*found, run.last)
        if place is None:
            self._tell(simulation)
            return
        state.passed[i] = self._before[i] + len(simulation.crossings)
        self._leave(i)
        self._charts.put(i, place)
        self._safe.keep(np.array([i]))

    def _tell(self, simulation: Simulation) -> None:
        """Warn, once, where rows stay with simulations."""
        run = simulation._run
        why = (
            "actuators with activations"
            if simulation._held.stride
            else "forces and actuators that are functions"
        )
        if not isinstance(run, SteppedRun):
            why = "stops, friction and locks"
        elif not simulation._held.stride and not run.asks:
            return
        if self._compiled and not self._told:
            self._told = True
            warn(
                f"the rows of this batch are stepped one after the other, as with {why} the compiled kernel "
                "does not take many at once; that takes 5 to 50 times as long",
                PerformanceWarning,
            )


def _key(start: Given) -> Any:
    """What tells starts apart; nothing is equal to what is no array."""
    if any(isinstance(part, Mapping) for part in start):
        return object()
    try:
        given = [np.asarray(part) for part in start]
    except ValueError:  # no table of numbers, as is told where it is read
        return object()
    return tuple((part.shape, part.dtype.str, part.tobytes()) for part in given)
