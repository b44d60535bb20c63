"""Several coordinates: clusters in zones at once, floating bases, couplings; against exact equations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache

import numpy as np
import pinocchio as pin

from ... import CouplingClosure, Mechanism, SimulationError, Stats
from ...examples.families import four_bars
from ...mechanism.tree.tree import Array
from ..stepping import stepped
from ..work_precision.reduced import Curves, Read, Reduced, SeveralDof, joints_reader
from ..work_precision.references import integrate
from ..work_precision.scenes import CHANGE_POINT, floating_reader, loops
from .case import Case, Families, Setting, family, made, row
from .extreme_tools import columns

FAMILIES: Families = {}

STEPS = (200, 50)
"""Of RK4 in each run."""

SHARE, OTHER, LEAST, NUDGE, SENSITIVE = 1.2, 100.0, 1e-10, 1e-12, 10.0
"""Of the floor; of the floor in other coordinates, which a free body is stepped in; of rounding, rad; of the
start, and times its effect that rounding may have."""


@family("clusters in zones at once", FAMILIES)
def clusters(quick: bool) -> Iterator[Case]:
    """Two and three linkages, side by side or each on the one before, that cross 0 … 0.1 rad apart."""
    kinds = (("side by side", [-1, -1]), ("on each other", [-1, 0]), ("three", [-1, 0, 1]))
    offsets = (1e-8,) if quick else (0.0, 1e-12, 1e-8, 1e-4, 1e-2, 0.03, 0.1)
    for name, parents in kinds[1:2] if quick else kinds:
        for offset in offsets:
            y = math.pi - 0.35 - offset * np.arange(len(parents))
            spread = y.tolist()
            mechanism = four_bars([CHANGE_POINT] * len(y), spread, parents, spacing=9.0)
            system, curves = loops(mechanism, [CHANGE_POINT] * len(y), parents)
            case = f"{name}, {offset:g} rad apart"
            yield _row(case, mechanism, system, y, np.full(len(y), 2.0), joints_reader(curves))


@family("floating bases", FAMILIES)
def floating(quick: bool) -> Iterator[Case]:
    """A change-point linkage on a free body a thousand times lighter to heavier, spinning up to 100 rad/s."""
    for mass in (1.0,) if quick else (1e-3, 1.0, 1e3):
        for spin in (1.0,) if quick else (0.0, 1.0, 100.0):
            base = pin.Inertia(mass, np.zeros(3), 0.3 * mass * np.eye(3))
            mechanism = four_bars([CHANGE_POINT], [math.pi - 0.3], floating=base)
            system, curves = loops(mechanism, [CHANGE_POINT], [-1], base)
            y, ydot = np.array([0.0, 0.0, 0.0, math.pi - 0.3]), np.array([0.4, 3.0, spin, 2.0])
            name = f"base of {mass:g} kg, {spin:g} rad/s"
            yield _row(name, mechanism, system, y, ydot, floating_reader(curves), 0.5 / max(1.0, 0.1 * spin))


@family("couplings", FAMILIES)
def couplings(quick: bool) -> Iterator[Case]:
    """The cranks of two change-point linkages geared together: m = 1, two loops that cross at other times."""
    for ratio in (-1.0,) if quick else (1.0, -1.0, 2.0, -0.5, 10.0, 1e-3):
        y = np.array([math.pi - 0.3])
        other = ratio * float(y[0])
        plain = four_bars([CHANGE_POINT] * 2, [float(y[0]), other], spacing=9.0)
        gear = CouplingClosure("crank1", "crank0", ratio)
        mechanism = Mechanism(plain.model, [*plain.closures, gear], ["crank0"], home=plain.home)
        system, free = loops(plain, [CHANGE_POINT] * 2, [-1, -1])
        tied = _geared(free, ratio)
        system = SeveralDof(system.bodies, tied)
        yield _row(f"ratio {ratio:g}", mechanism, system, y, np.array([2.0]), joints_reader(tied))


def _geared(free: Curves, ratio: float) -> Curves:
    """γ of the first crank alone."""
    lead = np.array([[1.0], [ratio]])

    def curves(y: Array) -> tuple[Array, Array, Array]:
        q, G, D = free(lead[:, 0] * y[0])
        return q, G @ lead, D @ lead**2

    return curves


def _row(
    name: str, mechanism: Mechanism, system: SeveralDof, y: Array, ydot: Array, read: Read,
    duration: float = 0.5,
) -> Case:  # fmt: skip
    """RK4 against the exact equation; allowed is what the same steps make of that equation, and rounding."""
    reduced = system.lagrange(y, ydot, read)

    @cache
    def exact(count: int) -> Array:
        return integrate(reduced, np.linspace(0.0, duration, count), rtol=1e-12, atol=1e-13)[1]

    def allowed(setting: Setting, stats: Stats) -> float:
        times = setting.step * np.arange(round(duration / setting.step) + 1)
        found = _stepped(reduced, reduced.x0, times)
        moved = _stepped(reduced, reduced.x0 + NUDGE * np.maximum(1.0, np.abs(reduced.x0)), times)
        sensitivity = float(np.abs(moved - found).max())
        floor = float(np.abs(found - exact(len(times))).max())
        share = SHARE if mechanism.tree.vector_space else OTHER
        return share * floor + SENSITIVE * sensitivity + LEAST

    settings = columns(duration, STEPS, ())
    start = mechanism, *read(reduced.x0)
    return row(name, made(start), duration, settings, allowed, lambda t: exact(len(t)))


def _stepped(reduced: Reduced, x: Array, times: Array) -> Array:
    states, _, stopped = stepped(reduced.rate, x, times, "rk4", float(times[1]))
    if stopped:
        raise SimulationError(f"the exact equation is not stepped: {stopped}")
    return np.array([reduced.read(state)[0] for state in states])
