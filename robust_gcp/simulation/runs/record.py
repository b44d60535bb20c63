"""What a simulation keeps: the outputs, the crossings and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...dynamics.equations import Evaluation, constraint_forces
from ...dynamics.problem import Problem
from ...kernel.simulation.batch import Outputs
from ...maps.classical import SingularityWarning
from ...maps.explicit import Crossing
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ...warning import warn
from ..events import Events
from ..trajectories.reactions import multipliers_of
from ..trajectories.trajectory import Trajectory
from .crossings import AT_ONCE, together
from .schedule import ALL, Keep, Schedule
from .stats import Stats

Rows = slice | NDArray[np.int64]

ROWS = ("_q", "_v", "_a", "_energy", "_multipliers", "_tau", "work", "_drive")
"""What a record has one row an output of, None where it is not wanted."""


class Record:
    """Outputs at the given times, filled one by one.

    Parameters
    ----------
    mechanism : Mechanism
    schedule : Schedule
        Steps and outputs.
    items : sequence of {"a", "energy", "multipliers", "tau"}
        What to keep besides q and v.
    motion : Problem
        Tells whether the state ends with the work done, and whether motions are prescribed.
    keep : Keep
        Which rows outlive `forget`.
    looked_into : bool
        Whether steps are: a and τ at their ends are then kept until the run is over.

    Attributes
    ----------
    mechanism : Mechanism
    count : int
        Outputs kept so far.
    at : int
        The last step's end that was accepted, kept or not; -1 before the start.
    last_state : ndarray
        The state there.
    work : ndarray or None
    wanted : tuple of str
        Which of `Outputs` besides q and v a batch is to bring.
    """

    def __init__(
        self, mechanism: Mechanism, schedule: Schedule, items: Sequence[str], motion: Problem,
        keep: Keep = ALL, looked_into: bool = False,
    ) -> None:  # fmt: skip
        n = len(schedule.outputs)
        self.mechanism, self._schedule, self._t = mechanism, schedule, schedule.outputs
        self._q, self._v = np.empty((n, mechanism.nq)), np.empty((n, mechanism.nv))
        self._told = tuple(items)
        self._a = np.empty((n, mechanism.nv)) if looked_into or "a" in items else None
        self._energy = np.empty(n) if "energy" in items else None
        self._multipliers = np.empty((n, mechanism.nc)) if "multipliers" in items else None
        self._tau = np.zeros((n, mechanism.nv)) if looked_into or "tau" in items else None
        self.work = np.empty(n) if motion.works else None
        self._driven = None if motion.drive is None else mechanism.iv_independent[motion.drive.driven]
        # NaN: no drive, which is not a drive that takes no effort
        self._drive = None if self._driven is None else np.full((n, mechanism.nv), np.nan)
        kept = self._a, self._energy, self._tau, self.work, self._drive
        named = zip(("a", "energy", "tau", "work", "effort"), kept, strict=True)
        names = [name for name, values in named if values is not None]
        self.wanted = tuple(names) if self._multipliers is None else (*names, "a", "tau")
        self._crossings: list[Crossing] = []
        self._warned = self._spun = False  # told once a run: a crank passes the place each turn
        self.keeps, self._gone, self._kept = keep, 0, dict[str, list[Array]]()
        self.count, self.at = 0, -1
        self.last_state: Array = np.zeros(0)

    def add(self, i: int, now: Evaluation, x: Array) -> None:
        """Accept the evaluation at the end of step i and state x, and keep it if it is an output."""
        row = int(self._schedule.row[i])
        if row >= 0:
            self.keep(row, now, x)
        self.at, self.last_state = i, x

    def keep(self, row: int, now: Evaluation, x: Array) -> None:
        """Keep an evaluation and its state as an output."""
        self._q[row], self._v[row] = now.point.q, now.v
        if self._a is not None:
            self._a[row] = now.a
        if self._energy is not None:
            self._energy[row] = self.mechanism.energy(now.point.q, now.v)
        if self._multipliers is not None:
            self._multipliers[row] = constraint_forces(self.mechanism, now.point.q, now.v, now.a, now.tau)
        if self._tau is not None:
            self._tau[row] = 0.0 if now.tau is None else now.tau
        if self.work is not None:
            self.work[row] = x[-1]
        if self._drive is not None:
            self._drive[row] = now.drive
        self.count = max(self.count, row + 1)  # the end of a step may be there before what lies within

    def end(self, t: float, now: Evaluation, x: Array) -> None:
        """The run ends at time t, before its outputs do: keep the state there as the last."""
        before = int(np.searchsorted(self._t[: self.count], t))  # steps of a batch may have gone further
        self._room(1)
        self._t, self.count = np.append(self._t[:before], t), before
        self.keep(before, now, x)
        self._crossings = [c for c in self._crossings if c.time <= t]

    @property
    def rows(self) -> Outputs | None:
        """Its own rows, for steps that write what is kept themselves; None where they cannot know it all."""
        if self._multipliers is not None or self._drive is not None or not self._schedule.plain:
            return None
        return Outputs(self._q, self._v, self._a, self._tau, self._energy, self.work)

    def steps(self, first: int) -> tuple[Array, ...]:
        """t, q, v, a, τ, work and what drives take of the outputs from one on; 0 and empty if not kept."""
        rows = slice(first, self.count)
        t, q, v = self._t[rows], self._q[rows], self._v[rows]
        more = [
            np.zeros_like(like) if kept is None else kept[rows]
            for kept, like in ((self._a, v), (self._tau, v), (self.work, t))
        ]
        return t, q, v, *more, np.zeros((len(t), 0)) if self._drive is None else self._drive[rows]

    def reach(self, i: int) -> None:
        """The ends of steps up to i are accepted, and written into `rows`."""
        self.at, self.count = i, i + 1

    def extend(self, i: int, outputs: Outputs, x: Array) -> None:
        """Accept the steps of a batch after time i, and keep outputs; x is the state at the last one."""
        schedule, n = self._schedule, len(outputs.q)
        rows = schedule.row[i + 1 : i + 1 + n]
        parts: list[tuple[Rows, Outputs, Rows]] = [(rows[rows >= 0], outputs, np.flatnonzero(rows >= 0))]
        if schedule.plain:
            parts = [(slice(i + 1, i + 1 + n), outputs, slice(None))]
        if outputs.within is not None:
            parts.append((schedule.rows_within(i, i + n), outputs.within.rows, slice(None)))
        for kept, given, chosen in parts:
            pairs = [
                (self._q, given.q),
                (self._v, given.v),
                (self._a, given.a),
                (self._energy, given.energy),
                (self._tau, given.tau),
                (self.work, given.work),
            ]
            for mine, values in pairs:
                if mine is not None and values is not None:
                    mine[kept] = values[chosen]
            if self._drive is not None and self._driven is not None and given.effort is not None:
                drive = np.full((len(given.effort[chosen]), self.mechanism.nv), np.nan)
                drive[:, self._driven] = given.effort[chosen]
                self._drive[kept] = drive
            if self._multipliers is not None:
                assert given.a is not None
                state = given.q[chosen], given.v[chosen], given.a[chosen]
                tau = None if given.tau is None else given.tau[chosen]
                self._multipliers[kept] = multipliers_of(self.mechanism, *state, tau)
        self.count = int(schedule.first[i + n] + (schedule.row[i + n] >= 0))
        self.at, self.last_state = i + n, x

    def cross(self, crossings: Sequence[Crossing]) -> None:
        """Log what was passed, y in the run's first coordinates; the first gap bridged is warned of.

        What is there at the start is left out.
        """
        own = self.mechanism.iq_numbers
        crossings = [c for c in crossings if c.time - self._schedule.times[0] > AT_ONCE]
        self._crossings += [replace(crossing, y=crossing.q[own]) for crossing in crossings]
        for crossing in crossings:
            if crossing.kind == "near miss" and not self._warned:
                self._warned = True
                warn(
                    f"at t = {crossing.time:.6g} s two modes pass with a gap of {crossing.certificate:.1g} "
                    "lengths, below geometric_tolerance: bridged as a crossing",
                    SingularityWarning,
                )
        self._tell_of_spins(crossings)

    def _tell_of_spins(self, crossings: Sequence[Crossing]) -> None:
        """Warn of the first place passed in a loop that has single velocities of a joint as coordinates."""
        if self._spun or not self.mechanism.chart_joints:
            return
        names = {joint.name for joint in self.mechanism.chart_joints}
        for crossing in crossings:
            own = () if crossing.cluster is None else self.mechanism.clusters[crossing.cluster].joints
            spun = sorted(names & set(own))
            if spun:
                self._spun = True
                warn(
                    f"at t = {crossing.time:.6g} s a singular place was passed in a loop with a velocity of "
                    f"{', '.join(spun)} among its coordinates: the motion is right to 1e-9 to 1e-4 there, "
                    "whatever the step; best with the component nearest to the axis of the spin",
                    SingularityWarning,
                )
                return

    @property
    def crossings(self) -> list[Crossing]:
        """Those logged so far; what one cluster passes at once is one."""
        return together(self._crossings) if self._crossings else []

    def grow(self, schedule: Schedule) -> None:
        """Go on to a schedule that begins with the present one."""
        self._room(len(schedule.outputs) - len(self._t))
        self._schedule, self._t = schedule, schedule.outputs

    def _room(self, more: int) -> None:
        """Make room for more outputs."""
        for name in ROWS:
            values: Array | None = getattr(self, name)
            if values is not None:
                setattr(self, name, np.concatenate([values, np.empty((more, *values.shape[1:]))]))

    def forget(self, n: int, schedule: Schedule) -> None:
        """Let the first n outputs go, but those that are kept; the schedule is that from the next one on."""
        chosen = self.keeps.among(self._gone, n)
        for name in ("_t", *ROWS):
            values: Array | None = getattr(self, name)
            if values is not None:
                self._kept.setdefault(name, []).append(values[chosen])
                if name != "_t":
                    values[: self.count - n] = values[n : self.count]  # moved: the kernel writes into these
        self._gone += n
        self.count, self.at = self.count - n, self.at - n
        self._schedule, self._t = schedule, schedule.outputs

    def state(self) -> tuple[Array, Array]:
        """q and v that were kept last."""
        return self._q[self.count - 1], self._v[self.count - 1]

    @property
    def time(self) -> float:
        """Of what was kept last, s."""
        return float(self._t[self.count - 1])

    def rewind(self, i: int) -> None:
        """Forget what came at the end of step i and later."""
        self.count, self.at = int(self._schedule.first[i]), i - 1
        self.forget_crossings(float(self._schedule.times[i]))

    def forget_crossings(self, t: float) -> None:
        """Forget those after the time t."""
        self._crossings = [c for c in self._crossings if c.time <= t]

    def trajectory(self, stats: Stats, events: Events) -> Trajectory:
        """What is kept so far."""
        chosen = self.keeps.shown(self._gone, self.count)
        rows: dict[str, Array] = {}
        for name in ("_t", *ROWS):
            values: Array | None = getattr(self, name)
            if values is not None:
                kept = self._kept.get(name, [])
                rows[name] = np.concatenate([*kept, values[chosen]]) if kept else values[chosen]
        return Trajectory(
            self.mechanism,
            rows["_t"],
            rows["_q"],
            rows["_v"],
            rows.get("_a") if "a" in self._told else None,  # else of steps that were looked into
            rows.get("_energy"),
            rows.get("_multipliers"),
            rows.get("work"),
            self.crossings,
            stats,
            rows.get("_drive"),
            *(events.found(self.mechanism) if events else ([], [], [])),
            events.ended_by,
            rows.get("_tau") if "tau" in self._told else None,
        )
