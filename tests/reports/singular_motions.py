"""Makes the set of motions through singular configurations: `python -m tests.reports.singular_motions`.

A motion of one coordinate, without forces but gravity, that does not turn back: its energy gives
ẏ = √(2 (E − V)/m), and t = ∫ dy/ẏ along its mode, on which m, V and γ are analytic also where modes cross.
Gauss and Legendre's quadrature in `exact.DIGITS` digits, at nodes that are never the singular place itself.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import robust_gcp as rg
from robust_gcp.examples.linkages import add_link, four_bar, n_four_bar
from robust_gcp.reports.singular import MOTIONS

from ..dynamics.gradient_problems import exactly, linkage, spatial
from ..exact import DIGITS, ONE, ZERO, Exact, Vector, pi, solve, turned

OUTPUTS, TOLD = 20, 25
"""Instants of a motion after its start, and the digits that are written of their states."""

NODES, WIDTH = 16, Decimal("0.125")
"""Of the quadrature in intervals of so many rad: it errs by 1e-30."""

HISTORY, APART = 8, Decimal("1e-3")
"""Points that the next one is extrapolated from, and how far apart they are, rad."""


@cache
def gauss() -> list[tuple[Decimal, Decimal]]:
    """Nodes and weights of Gauss and Legendre's rule on (0, 1)."""
    found = []
    for k in range(NODES):
        x = turned(pi() * (Decimal(k) + Decimal("0.75")) / (NODES + Decimal("0.5")))[0]
        for _ in range(8):
            before, now = ONE, x
            for n in range(2, NODES + 1):
                before, now = now, ((2 * n - 1) * x * now - (n - 1) * before) / n
            slope = NODES * (x * now - before) / (x * x - 1)
            x -= now / slope
        found.append(((ONE - x) / 2, ONE / ((1 - x * x) * slope * slope)))
    return found


@dataclass
class Motion:
    """Follows a motion along its mode from a closed start, y growing or falling all the way."""

    exact: Exact
    q: Vector
    rate: Decimal
    known: list[tuple[Decimal, Vector]] = field(init=False)
    last: Vector = field(init=False)

    def __post_init__(self) -> None:
        (self.own,) = self.exact.i
        self.q = self.exact.closed(self.q, [self.q[self.own]])
        self.known = [(self.q[self.own], self.q)]
        self.energy = ZERO
        inertia, potential, _ = self.at(self.q[self.own])
        self.energy = inertia * self.rate**2 / 2 + potential
        self.sign = ONE if self.rate > 0 else -ONE

    def at(self, y: Decimal) -> tuple[Decimal, Decimal, Vector]:
        """m, V and G at y on the mode."""
        q = self.last = self.exact.closed(self._guess(y), [y])
        self._keep(y, q)
        _, K = self.exact.loops(q)
        right = solve([[row[k] for k in self.exact.d] for row in K], [[-row[self.own]] for row in K])
        G = [ZERO] * self.exact.nv
        G[self.own] = ONE
        for (value,), k in zip(right, self.exact.d, strict=True):
            G[k] = value
        M, potential = self.exact.inertia(q)
        return (
            sum(a * x * b for a, row in zip(G, M, strict=True) for x, b in zip(row, G, strict=True)),
            potential,
            G,
        )

    def state(self, y: Decimal) -> tuple[Vector, Vector]:
        """q and v at y."""
        inertia, potential, G = self.at(y)
        rate = self._speed(inertia, potential)
        return self.last, [rate * x for x in G]

    def time(self, start: Decimal, end: Decimal) -> Decimal:
        """From y to y, s."""
        return (end - start) * sum(w / self._rate(start + x * (end - start)) for x, w in gauss())

    def states(self, duration: Decimal) -> Iterator[tuple[Vector, Vector]]:
        """At equal times from the start on."""
        y, t = self.q[self.own], ZERO
        yield self.state(y)
        for k in range(1, OUTPUTS + 1):
            goal = duration * k / OUTPUTS
            while True:
                further = self.time(y, y + self.sign * WIDTH)
                if t + further > goal:
                    break
                y, t = y + self.sign * WIDTH, t + further
            step = (goal - t) * self._rate(y)
            for _ in range(12):
                change = (goal - t - self.time(y, y + step)) * self._rate(y + step)
                step += change
                if abs(change) < Decimal(10) ** -(TOLD + 5):
                    break
            y, t = y + step, goal
            yield self.state(y)

    def _rate(self, y: Decimal) -> Decimal:
        inertia, potential, _ = self.at(y)
        return self._speed(inertia, potential)

    def _speed(self, inertia: Decimal, potential: Decimal) -> Decimal:
        return self.sign * (2 * (self.energy - potential) / inertia).sqrt()

    def _keep(self, y: Decimal, q: Vector) -> None:
        if all(abs(place - y) > APART for place, _ in self.known):
            self.known.append((y, q))
            del self.known[: -6 * NODES]

    def _guess(self, y: Decimal) -> Vector:
        """By the polynomial through the nearest points that are known."""
        near = sorted(self.known, key=lambda known: abs(known[0] - y))[:HISTORY]
        weights = []
        for i, (place, _) in enumerate(near):
            weight = ONE
            for j, (other, _) in enumerate(near):
                if i != j:
                    weight *= (y - other) / (place - other)
            weights.append(weight)
        return [sum(w * q[k] for w, (_, q) in zip(weights, near, strict=True)) for k in range(self.exact.nv)]


def two_crossed() -> rg.Mechanism:
    """Two crossed parallelograms, the rocker of one the crank of the other: both fold flat at once."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    add_link(model, add_link(model, 0, 0.0, "q1", 1.0), 1.0, "q2", 2.0)
    rocker = add_link(model, 0, 2.0, "q3", 1.0)
    add_link(model, rocker, 1.0, "q4", 2.0)
    add_link(model, 0, 4.0, "q5", 1.0)
    closures = [rg.PointClosure("q2_tip", "q3_tip"), rg.PointClosure("q4_tip", "q5_tip")]
    turns = [0.4]
    for _ in range(2):
        turns.append(-2.0 * np.arctan(3.0 * np.tan(turns[-1] / 2.0)))
    cranks = np.exp(1j * np.array(turns))
    couplers = np.angle(2.0 + np.diff(cranks)) - turns[:2]
    home = [turns[0], couplers[0], turns[1], couplers[1], turns[2]]
    mech = rg.Mechanism.from_pinocchio(model, closures, ["q1"], home=home)
    mech.home = mech.assemble(home)
    return mech


def beside(mech: rg.Mechanism, mode: int, y: float) -> rg.Mechanism:
    """A linkage that is singular at q = 0, at home at y on one of its modes."""
    tangent = rg.analyse(mech, np.zeros(mech.nq)).modes[mode]
    tangent = tangent / tangent[mech.iv_independent[0]]
    run = rg.simulate(mech, np.zeros(mech.nq), 20.0 * y * tangent, duration=0.1, step=1e-3)
    at = run.q[np.argmin(np.abs(run.q[:, mech.iq_independent[0]] - y))].copy()
    at[mech.iq_independent] = y
    mech.home = mech.assemble(at, hold=mech.independent)
    return mech


def scenes() -> Iterator[tuple[str, str, rg.Mechanism, float, float]]:
    """Name, what is singular, mechanism at its start, first rate, duration."""
    rhombus = rg.load("rhombus")
    rhombus.home = np.array([0.25, -0.25, 0.25])
    yield "rhombus", "modes cross at a right angle", rhombus, -6.0, 2.0
    yield (
        "antiparallelogram",
        "a curved mode crosses a straight one",
        four_bar(2.0, 1.0, 2.0, 1.0, y=0.5, assembly=-1),
        -6.0,
        1.5,
    )
    yield "change point", "two curved modes cross", four_bar(4.0, 2.0, 3.0, 3.0, y=2.5), 6.0, 1.5
    yield "kite", "modes cross at 0 and π", four_bar(2.0, 1.0, 1.0, 2.0, y=1.0), -6.0, 1.5
    yield "two crossed parallelograms", "corank 2: both fold at once", two_crossed(), -6.0, 1.0
    yield "five four-bars", "corank 5: all loops at once", n_four_bar(5), -3.0, 2.0
    for seed, mode in ((4, 0), (4, 1), (13, 0), (13, 1)):
        mech = beside(spatial(seed, 4, True), mode, -0.25)
        yield f"in space {seed}, mode {mode + 1}", "modes of a spatial loop cross", mech, 4.0, 0.125


def made(name: str, what: str, mech: rg.Mechanism, rate: float, duration: float) -> dict[str, Any]:
    """A motion of the set."""
    exact = exactly(mech)
    motion = Motion(exact, [Decimal(float(x)) for x in mech.home], Decimal(rate))
    states = list(motion.states(Decimal(duration)))

    def told(part: Vector) -> list[str]:
        return [f"{x:.{TOLD - 1}e}" for x in part]

    return {
        "name": name,
        "singular": what,
        "linkage": linkage(mech),
        "times": [duration * k / OUTPUTS for k in range(OUTPUTS + 1)],
        "energy": f"{motion.energy:.{TOLD - 1}e}",
        "q": [told(q) for q, _ in states],
        "v": [told(v) for _, v in states],
    }


if __name__ == "__main__":
    wanted = sys.argv[1:]
    found = []
    for scene in scenes():
        if not wanted or scene[0] in wanted:
            found.append(made(*scene))
            print(scene[0], found[-1]["q"][-1], flush=True)
    assert DIGITS == 70
    if not wanted:
        lines = ",\n".join(json.dumps(one, separators=(",", ":")) for one in found)
        Path(MOTIONS).write_text(f"[\n{lines}\n]\n", encoding="utf-8")
