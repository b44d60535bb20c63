"""The record of a run through phases: all stretches as one trajectory.

Where a phase ends there are two outputs: the last state before it, one rounding earlier than the event, and
the first state after it, so that times increase and everything between two outputs is smooth.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from ...maps.explicit import Crossing
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree.tree import Array
from ..events import Events
from ..runs.crossings import AT_ONCE, together
from ..runs.stats import Stats
from ..trajectories.reactions import multipliers_of
from ..trajectories.trajectory import Trajectory
from .decision import Phase
from .grid import Chosen
from .happening import Happening
from .phase_run import Steps
from .rows import Rows

WHAT = ("t", "q", "v", "a", "tau", "work", "smooth", "forces", "u", "drive")


@dataclass
class Block:
    """Outputs of a part of a phase.

    Attributes
    ----------
    t, q, v, a, tau
        tau is all that acts besides gravity and what is held.
    work : ndarray (N,)
        Of that, since the first of them, J.
    held : ndarray (N, n)
        Forces of the rows that are held.
    bounds : ndarray (N, n)
        F of each row.
    heat : ndarray (N,)
        What friction that is a share of reactions dissipates since the first of them, J.
    drive : ndarray (N, nv or 0)
        What drives take, a part of tau.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    work: Array
    held: Array
    bounds: Array
    heat: Array
    drive: Array

    @classmethod
    def of(cls, steps: Steps, held: Array, bounds: Array, heat: Array) -> Block:
        """Ends of steps."""
        work = steps.work - steps.work[0]
        return cls(steps.t, steps.q, steps.v, steps.a, steps.tau, work, held, bounds, heat, steps.drive)

    def first(self, n: int) -> Block:
        """The first n rows."""
        return Block(**{item.name: getattr(self, item.name)[:n] for item in fields(Block)})

    def with_rows(self, inner: Sequence[tuple[int, Block]]) -> Block:
        """With the last rows of others, each of which begins at a row of this one, after that row."""
        if not inner:
            return self
        at = [k + 1 for k, _ in inner]
        more = {f.name: [getattr(part, f.name)[-1] for _, part in inner] for f in fields(Block)}
        for name in ("work", "heat"):
            more[name] = [getattr(self, name)[k] + getattr(part, name)[-1] for k, part in inner]
        parts = {name: np.insert(getattr(self, name), at, rows, axis=0) for name, rows in more.items()}
        return Block(**parts)


@dataclass
class Joined:
    """What is kept of a run.

    Attributes
    ----------
    rows : Rows
    record : sequence of str
        What the user asked for.
    chosen : Chosen
        Which outputs are kept.
    controls : callable (t, q, v) -> ndarray (N, n)
        Controls and activations of the actuators.
    """

    rows: Rows
    record: Sequence[str]
    chosen: Chosen
    controls: Callable[[Array, Array, Array], Array]
    happenings: list[Happening] = field(default_factory=list)
    stats: Stats = field(default_factory=Stats)

    def __post_init__(self) -> None:
        self._kept: dict[str, list[Array]] = {name: [] for name in WHAT}
        self._last: dict[str, Array] = {}
        self._work = self._smooth = 0.0
        self.crossings: list[Crossing] = []
        self.to_the_end = self.chosen.keep.last and self.chosen.times is None

    def copied(self) -> Joined:
        """A copy that goes its own way: rows are never written to."""
        other = copy.copy(self)
        other.happenings, other.crossings = list(self.happenings), list(self.crossings)
        other.stats = copy.deepcopy(self.stats)
        other._kept = {name: list(values) for name, values in self._kept.items()}
        return other

    @property
    def sums(self) -> tuple[float, float]:
        """Work and smooth losses so far, J."""
        return self._work, self._smooth

    def take_work(self, work: float) -> None:
        """Work at an instant, J, as of the impulses of drives."""
        self._work += work

    def back_to(self, sums: tuple[float, float]) -> None:
        """What comes next takes the place of all since these sums."""
        self._work, self._smooth = sums

    @property
    def dissipated(self) -> float:
        """Energy lost so far, J."""
        return self._smooth + sum(happening.loss for happening in self.happenings)

    @property
    def last(self) -> dict[str, Array]:
        """The last row, kept or not, by the names of `WHAT`."""
        return {name: values[0] for name, values in self._last.items()}

    def add(self, block: Block, phase: Phase, first: int = 0) -> None:
        """Keep outputs of a block from row `first` on, in place of those kept from that time on.

        Work and losses go on from the last block's end.
        """
        forces = block.held + phase.push(self.rows, block.q, block.v, block.bounds)
        smooth = self._smooth + self._lost(block, phase)
        work = self._work + block.work
        self._work, self._smooth = float(work[-1]), float(smooth[-1])
        new = {
            "t": block.t, "q": block.q, "v": block.v, "a": block.a,
            "tau": block.tau + block.held @ self.rows.E, "work": work, "smooth": smooth, "forces": forces,
            "u": self.controls(block.t, block.q, block.v), "drive": block.drive,
        }  # fmt: skip
        self._last = {name: values[-1:].copy() for name, values in new.items()}
        rows = np.arange(first, len(block.t))
        if not self.chosen.all:
            rows = rows[self.chosen.among(block.t[rows])]
        if not len(rows):
            return
        self._cut(float(block.t[rows[0]]))
        for name, values in new.items():
            self._kept[name].append(values[rows])

    def _cut(self, t: float) -> None:
        """Drop what is kept from the time t on."""
        times = self._kept["t"]
        while times and times[-1][-1] >= t:
            n = int(np.searchsorted(times[-1], t))
            for values in self._kept.values():
                values[-1] = values[-1][:n]
                if not n:
                    values.pop()

    def _lost(self, block: Block, phase: Phase) -> Array:
        """What slipping joints and dampers of springy stops dissipate from the block's start on, J.

        ∫ F |ṙ| dt is F |Δr|; ∫ k d δ δ̇² dt of dampers by the trapezoidal rule with end corrections.
        """
        rows, total = self.rows, block.heat.copy()
        if not (phase.slip or phase.touching):
            return total
        r = rows.values(block.q)
        for i, sign in phase.slip.items():
            if not rows.rows[i].coefficient:  # else in the heat
                total += rows.bounds[i] * sign * (r[:, i] - r[0, i])
        h = np.diff(block.t)
        for i in phase.touching:
            row, side = rows.rows[i], rows.side[i]
            rate = row.stiffness * row.damping
            d = -rows.gaps(block.q)[:, i]
            d1, d2 = -side * (block.v @ rows.E[i]), -side * (block.a @ rows.E[i])
            power, slope = rate * d * d1**2, rate * (d1**3 + 2.0 * d * d1 * d2)
            steps = 0.5 * h * (power[1:] + power[:-1]) + h**2 / 12.0 * (slope[:-1] - slope[1:])
            total[1:] += np.cumsum(steps)
        return total

    def count(self, run: Trajectory, end: float) -> None:
        """Keep crossings and changes of coordinates of a stretch up to the time `end`, and count its cost."""
        mechanism, other = self.rows.mechanism, run.mechanism
        self.stats.stepper = run.stats.stepper
        for crossing in run.crossings:
            if crossing.time <= end + AT_ONCE:  # the leg went on beyond the event that ends it
                cluster = _cluster(mechanism, other, crossing.cluster)
                self.crossings.append(replace(crossing, y=crossing.q[mechanism.iq_numbers], cluster=cluster))
        for item in fields(Stats):
            if item.type == "int":
                total = getattr(self.stats, item.name) + getattr(run.stats, item.name)
                setattr(self.stats, item.name, total)
        self.stats.repartitions += [change for change in run.stats.repartitions if change[0] <= end]
        self.stats.refined += [(begun, min(until, end)) for begun, until in run.stats.refined if begun < end]

    def _rows_kept(self) -> dict[str, Array]:
        """All that is kept, by the names of `WHAT`."""
        mechanism, n = self.rows.mechanism, len(self.rows.rows)
        sizes = {"q": mechanism.nq, "forces": n, "u": len(mechanism.actuators)}
        sizes |= dict.fromkeys(("v", "a", "tau", "drive"), mechanism.nv)
        parts = self._kept
        if self.to_the_end and self._last and not self.chosen.all:
            times = parts["t"]
            if not times or times[-1][-1] < self._last["t"][0]:
                parts = {name: [*values, self._last[name]] for name, values in parts.items()}
        kept = {
            name: np.concatenate(values) if values else np.zeros((0, sizes[name]) if name in sizes else 0)
            for name, values in parts.items()
        }
        if self.chosen.times is not None:
            asked = self.chosen.among(kept["t"])
            kept["t"] = np.where(asked, self.chosen.nearest(kept["t"]), kept["t"])
            # at an event both its outputs are nearest to one time: the state after it is that of the time
            last = np.append(np.diff(kept["t"]) > 0.0, True)[: len(kept["t"])]
            kept = {name: values[last] for name, values in kept.items()}
        return kept

    def trajectory(self, events: Events) -> Trajectory:
        """All that is kept."""
        rows, mechanism, kept = self.rows, self.rows.mechanism, self._rows_kept()
        t, q, v, a, tau = (kept[name] for name in ("t", "q", "v", "a", "tau"))
        losses = np.array([0.0, *np.cumsum([happening.loss for happening in self.happenings])])
        when = np.array([happening.time for happening in self.happenings])
        columns = rows.by_column(kept["forces"])
        return Trajectory(
            mechanism,
            t,
            q,
            v,
            a,
            np.array([mechanism.energy(*state) for state in zip(q, v, strict=True)])
            if "energy" in self.record
            else None,
            multipliers_of(mechanism, q, v, a, tau) if "multipliers" in self.record else None,
            kept["work"] + kept["smooth"],
            together(self.crossings),
            self.stats,
            t_events=[np.array(times) for times in events.t],
            q_events=[np.array(values).reshape(-1, mechanism.nq) for values in events.q],
            v_events=[np.array(values).reshape(-1, mechanism.nv) for values in events.v],
            drive_torque=None if rows.drive is None else kept["drive"],
            ended_by=events.ended_by,
            tau=tau if "tau" in self.record else None,
            happenings=list(self.happenings),
            # the output just before an instant has its loss yet to come
            dissipated=kept["smooth"] + losses[np.searchsorted(when, t, side="right")],
            part_names=tuple(columns),
            part_forces=np.array(list(columns.values())).reshape(len(columns), len(t)).T,
            u=None if np.all(np.isnan(kept["u"])) else kept["u"],
        )


def _cluster(mechanism: Mechanism, other: Mechanism, index: int | None) -> int | None:
    """The cluster of the mechanism that has joints of another's, in which more is held."""
    if index is None or other is mechanism:
        return index
    names = set(other.clusters[index].joints)
    return next((c.index for c in mechanism.clusters if names.intersection(c.joints)), None)
