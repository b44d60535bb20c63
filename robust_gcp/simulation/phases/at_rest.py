"""A phase in which nothing can move: only the forces of what is held are watched."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ...errors import SimulationError
from ...mechanism.tree.tree import Array
from ..events import Events
from .admissible import Seen
from .decision import Phase, State
from .machine import Machines
from .record import Block
from .watch import Holding


class Rested(NamedTuple):
    """What came of it.

    Attributes
    ----------
    block : Block
    until : float
        s.
    broke : bool
        Whether torques became too much there for what is held.
    seen : Seen
    fault : SimulationError or None
        That a torque function raised there.
    """

    block: Block
    until: float
    broke: bool
    seen: Seen
    fault: SimulationError | None


@dataclass(frozen=True)
class Still:
    """A state in which nothing moves, as a motion in which events are looked for."""

    q: Array
    v: Array
    t0: float = 0.0
    t1: float = 0.0

    def state(self, t: float) -> tuple[Array, Array]:
        """Always the same."""
        return self.q, self.v

    def ended(self, events: Events, times: Array) -> float | None:
        """Keep the user's events between these times, and tell when one of them ends the run."""
        events.begin(float(times[0]), self.q, self.v)
        for t0, t1 in pairwise(times.tolist()):
            for zero in events.zeros(self.q, self.v, replace(self, t0=t0, t1=t1)):
                events.add(zero, self.q, self.v)
                if zero.ends:
                    return zero.t
        return None


def rested(machines: Machines, phase: Phase, start: State, times: Array) -> Rested:
    """Nothing moves until torques that change with time are too much for what is held.

    Parameters
    ----------
    times : ndarray (N,)
        Outputs, from the start on.
    """
    q, zero = start.q, np.zeros_like(start.v)
    holding, acting = Holding(machines.bounds, phase), machines.acting(phase)
    constant = machines.bounds.constant  # what slips is at rest too, and none
    still = Seen(zero, zero, start.seen.toward)

    def forces(t: float) -> tuple[Array, Array, float]:
        tau = acting(t, q, zero, constant)
        return (tau, *holding.forces(t, q, zero, zero, tau, still))

    def margin(t: float) -> float:
        return holding.margin(t, q, zero, zero, acting(t, q, zero, constant), still)

    broken: float | None = None
    fault: SimulationError | None = None
    found = [forces(start.t)]
    for before, t in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        try:
            found.append(forces(t) if machines.varies else found[0])
        except SimulationError as error:
            fault = error
            break
        if machines.varies and holding.limited and found[-1][2] < 0.0:
            broken = before if margin(before) <= 0.0 else float(brentq(margin, before, t, xtol=1e-14))
            found[-1] = forces(broken)
            break
    n = len(found)
    t_kept = times[:n].copy()
    if broken is not None:
        t_kept[-1] = np.nextafter(broken, -np.inf)
        if t_kept[-1] <= t_kept[-2]:  # broken at once: the start is the output before it
            n -= 1
    taus, held, _ = (np.array(part) for part in zip(*found[:n], strict=True))
    flat, none = np.zeros((n, len(zero))), np.zeros(n)
    bounds = np.tile(constant, (n, 1))
    block = Block(
        t_kept[:n], np.tile(q, (n, 1)), flat, flat, taus, none, held, bounds, none, np.zeros((n, 0))
    )
    return Rested(block, float(times[-1]) if broken is None else broken, broken is not None, still, fault)
