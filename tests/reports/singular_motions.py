"""Makes the set of motions through singular configurations: `python -m tests.reports.singular_motions`.

A motion of one coordinate under gravity and dry friction that does not turn back but at a stop: its energy
gives ẏ = √(2 (E − V − Σ F |q_j − q_j(0)|)/m), and t = ∫ dy/ẏ along its mode, on which m, V and γ are analytic
also where modes meet; towards a cusp they are in √y. Gauss and Legendre's quadrature in `exact.DIGITS`
digits, at nodes that are never the singular place itself.
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
from robust_gcp.reports.linkages import mechanism_of, rotation
from robust_gcp.reports.singular.scores import MOTIONS

from ..dynamics.gradient_problems import linkage, spatial
from ..exact import DIGITS, ONE, ZERO, Exact, Vector, pi, solve, turned
from ..exact_in_space import ExactInSpace

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
    """Follows a motion along its mode from a closed start, y growing or falling from stop to stop.

    Attributes
    ----------
    stop : (Decimal, Decimal), optional
        y there and the restitution.
    friction : dict
        F of joints by their numbers, N m.
    cusp : bool
        Whether the mode ends at y = 0.
    """

    exact: Exact
    q: Vector
    rate: Decimal
    stop: tuple[Decimal, Decimal] | None = None
    friction: dict[int, Decimal] = field(default_factory=dict)
    cusp: bool = False
    known: list[tuple[Decimal, Vector]] = field(init=False)
    last: Vector = field(init=False)

    def __post_init__(self) -> None:
        (self.own,) = self.exact.i
        self.q = self.exact.closed(self.q, [self.q[self.own]])
        self.known = [(self._parameter(self.q[self.own]), self.q)]
        self._begin(self.q[self.own], self.rate)

    def _begin(self, y: Decimal, rate: Decimal) -> None:
        inertia, potential, _ = self.at(y)
        self.begun = self.last
        self.energy = inertia * rate**2 / 2 + potential
        self.sign = ONE if rate > 0 else -ONE
        self.signs: dict[int, bool] = {}

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
        rate = self._speed(inertia, potential, G)
        return self.last, [rate * x for x in G]

    def time(self, start: Decimal, end: Decimal) -> Decimal:
        """From y to y, s."""
        one, two = self._parameter(start), self._parameter(end)
        total = ZERO
        for x, w in gauss():
            at = one + x * (two - one)
            total += w / self._rate(at * at) * 2 * at if self.cusp else w / self._rate(at)
        return (two - one) * total

    @property
    def end(self) -> Decimal:
        """When a cusp is reached, s."""
        assert self.cusp and self.sign < 0
        y, t = self.q[self.own], ZERO
        while y > 0:
            less = max(ZERO, y - WIDTH)
            y, t = less, t + self.time(y, less)
        return t

    def states(self, duration: Decimal) -> Iterator[tuple[Vector, Vector]]:
        """At equal times from the start on, up to a cusp."""
        y, t = self.q[self.own], ZERO
        end = self.end if self.cusp else duration
        yield self.state(y)
        for k in range(1, OUTPUTS + 1):
            goal = duration * k / OUTPUTS
            if goal > end:
                return
            while True:
                ahead = y + self.sign * WIDTH
                hits = self.stop is not None and (ahead - self.stop[0]) * self.sign > 0
                if self.stop is not None and hits:
                    ahead = self.stop[0]
                elif self.cusp:
                    ahead = max(ahead, ZERO)
                further = self.time(y, ahead)
                if t + further > goal:
                    break
                y, t = ahead, t + further
                if self.stop is not None and hits:
                    self._begin(y, -self.stop[1] * self._rate(y))
                    self.stop = None
            step = (goal - t) * self._rate(y)
            for _ in range(12):
                change = (goal - t - self.time(y, y + step)) * self._rate(y + step)
                step += change
                if abs(change) < Decimal(10) ** -(TOLD + 5):
                    break
            y, t = y + step, goal
            yield self.state(y)

    def _rate(self, y: Decimal) -> Decimal:
        return self._speed(*self.at(y))

    def _speed(self, inertia: Decimal, potential: Decimal, G: Vector) -> Decimal:
        energy = self.energy - potential
        for j, bound in self.friction.items():
            assert self.signs.setdefault(j, G[j] > 0) == (G[j] > 0), "a joint with friction turns back"
            energy -= bound * abs(self.last[j] - self.begun[j])
        return self.sign * (2 * energy / inertia).sqrt()

    def _parameter(self, y: Decimal) -> Decimal:
        """In which the mode is analytic."""
        return y.sqrt() if self.cusp else y

    def _keep(self, y: Decimal, q: Vector) -> None:
        place = self._parameter(y)
        if all(abs(known - place) > APART for known, _ in self.known):
            self.known.append((place, q))
            del self.known[: -6 * NODES]

    def _guess(self, at: Decimal) -> Vector:
        """By the polynomial through the nearest points that are known."""
        y = self._parameter(at)
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


def planar(name: str, parent: int, kind: str, place: list[float], length: float, mass: float = 1.0) -> Any:
    """A uniform bar on a hinge, or a block on a slide."""
    link = {"name": name, "parent": parent, "kind": kind, "place": place}
    return {**link, "mass": mass, "centre": [0.5 * length, 0.0], "inertia": mass * length**2 / 12.0}


def spatial_link(
    name: str, parent: int, kind: str, place: list[float], turn: list[int], centre: list[float]
) -> Any:
    """A body in space of 1 kg."""
    about = [[0.125, 0.0, 0.0], [0.0, 0.1875, 0.0], [0.0, 0.0, 0.25]]
    link = {"name": name, "parent": parent, "kind": kind, "place": place, "turn": turn}
    return {**link, "mass": 1.0, "centre": centre, "inertia": about}


def flat_foldable() -> dict[str, Any]:
    """Four creases that meet in a point, opposite angles between them π together: flat, two modes cross.

    The angles' tangents are 4/3, 12/5 and those of π less; the third crease is cut, 65/64 m from the vertex.
    """
    return {
        "joints": [
            spatial_link("crease1", -1, "RX", [0.0, 0.0, 0.0], [1, 0, 0, 0], [0.5, 0.25, 0.0]),
            spatial_link("crease2", 0, "RX", [0.0, 0.0, 0.0], [2, 0, 0, 1], [0.25, 0.5, 0.0]),
            spatial_link("crease4", -1, "RX", [0.0, 0.0, 0.0], [2, 0, 0, -3], [0.0, -0.5, 0.0]),
        ],
        "gravity": [0.0, 2.5, -9.5],
        "closures": [[[1, [0.390625, 0.9375, 0.0]], [2, [-0.609375, -0.8125, 0.0]]]],
        "independent": ["crease1"],
    }


def rssr() -> dict[str, Any]:
    """Two cranks about x and z, both in line with the rod between them, whose hinges are about x and z."""
    along = [0.0, 0.25, 0.0]
    return {
        "joints": [
            spatial_link("crank1", -1, "RX", [0.0, 0.0, 0.0], [1, 0, 0, 0], along),
            spatial_link("fork", 0, "RX", [0.0, 0.5, 0.0], [1, 0, 0, 0], [0.0, 0.0, 0.0625]),
            spatial_link("rod", 1, "RZ", [0.0, 0.0, 0.0], [1, 0, 0, 0], [0.0, 0.5, 0.0]),
            spatial_link("crank2", -1, "RZ", [0.0, 1.0, 0.0], [1, 0, 0, 0], along),
        ],
        "gravity": [0.0, 0.0, -9.8125],
        "closures": [[[2, [0.0, 1.0, 0.0]], [3, [0.0, 0.5, 0.0]]]],
        "independent": ["crank1"],
    }


def trammel() -> dict[str, Any]:
    """`examples.meetings.trammel` at the ellipse's vertex, with T at a quarter: contact of order 2."""
    return {
        "joints": [
            planar("foot", -1, "PY", [0.0, 0.0], 0.0, 0.125),
            planar("ladder", 0, "RX", [0.0, 0.0], 1.0),
            planar("head", -1, "PZ", [0.0, 0.0], 0.0, 0.125),
            planar("upper", -1, "RX", [0.0, -2.0], 1.25),
            planar("lower", 3, "RX", [1.25, 0.0], 1.0),
        ],
        "gravity": -9.8125,
        "closures": [[[1, [1.0, 0.0]], [2, [0.0, 0.0]]], [[4, [1.0, 0.0]], [1, [0.25, 0.0]]]],
        "independent": ["ladder"],
    }


def collapsing_cell() -> dict[str, Any]:
    """A rhombus with a vertex on the ground, the opposite one on a slide: its arms come free at once."""
    return {
        "joints": [
            planar("left", -1, "RX", [0.0, 0.0], 1.0),
            planar("left fore", 0, "RX", [1.0, 0.0], 1.0, 0.5),
            planar("right", -1, "RX", [0.0, 0.0], 1.0),
            planar("right fore", 2, "RX", [1.0, 0.0], 1.0),
            planar("slide", -1, "PY", [0.0, 0.0], 0.0, 0.75),
        ],
        "gravity": -9.8125,
        "closures": [[[1, [1.0, 0.0]], [4, [0.0, 0.0]]], [[3, [1.0, 0.0]], [4, [0.0, 0.0]]]],
        "independent": ["slide"],
    }


def cusp_cam() -> dict[str, Any]:
    """`examples.meetings.cam` with z = 1 − x³/2: below x = 0 the rods do not reach."""
    return {
        "joints": [
            planar("x", -1, "PZ", [0.0, 0.0], 0.0, 0.75),
            planar("z", -1, "PY", [0.0, 0.0], 0.0, 0.25),
            planar("crank", -1, "RX", [0.0, 0.0], 0.625),
            planar("rod", 2, "RX", [0.625, 0.0], 0.375),
        ],
        "gravity": -9.8125,
        "closures": [[[3, [0.375, 0.0]], [1, [0.0, 0.0]]]],
        "couplings": [["z", "x", [1.0, 0.0, 0.0, -0.5]]],
        "independent": ["x"],
    }


@dataclass(frozen=True)
class Start:
    """A motion of the set before it is followed; `home` is closed, but for what Newton does to it."""

    name: str
    singular: str
    linkage: dict[str, Any]
    home: np.ndarray
    rate: float
    duration: float
    cusp: bool = False


def of(name: str, what: str, mech: rg.Mechanism, rate: float, duration: float) -> Start:
    return Start(name, what, linkage(mech), mech.home, rate, duration)


def starts() -> Iterator[Start]:
    """All motions."""
    rhombus = rg.load("rhombus")
    rhombus.home = np.array([0.25, -0.25, 0.25])
    yield of("rhombus", "modes cross at a right angle", rhombus, -6.0, 2.0)
    crossed = four_bar(2.0, 1.0, 2.0, 1.0, y=0.5, assembly=-1)
    yield of("antiparallelogram", "a curved mode crosses a straight one", crossed, -6.0, 1.5)
    point = four_bar(4.0, 2.0, 3.0, 3.0, y=2.5)
    yield of("change point", "two curved modes cross", point, 6.0, 1.5)
    kite = four_bar(2.0, 1.0, 1.0, 2.0, y=1.0)
    yield of("kite", "modes cross at 0 and π", kite, -6.0, 1.5)
    yield of("two crossed parallelograms", "corank 2: both fold at once", two_crossed(), -6.0, 1.0)
    yield of("five four-bars", "corank 5: all loops at once", n_four_bar(5), -3.0, 2.0)
    for seed, mode in ((4, 0), (4, 1), (13, 0), (13, 1)):
        mech = beside(spatial(seed, 4, True), mode, -0.25)
        yield of(f"in space {seed}, mode {mode + 1}", "modes of a spatial loop cross", mech, 4.0, 0.125)
    for name, what, given, rate, duration in (
        ("RSSR", "two cranks and a rod in line, modes cross", rssr(), 4.0, 0.25),
        ("flat-foldable vertex", "a spherical loop, flat; one row too many", flat_foldable(), 10.0, 0.5),
    ):
        mech = beside(mechanism_of(given, np.zeros(len(given["joints"]))), 0, -0.25)
        yield Start(name, what, given, mech.home, rate, duration)
    away = -np.arctan2(0.25, 0.75)  # of the ladder from upright
    yield Start("trammel", "modes in contact of order 2", trammel(), ladder(away), -4.0, 0.25)
    half = np.arccos(0.25)
    arms = np.array([half, -2.0 * half, -half, 2.0 * half, 0.5])
    yield Start("collapsing cell", "a mode of two freedoms is met", collapsing_cell(), arms, -3.0, 0.5)
    depth = 0.5**7
    bend = 2.0 * np.arcsin(np.sqrt(depth * (2.0 - depth) / (4.0 * 0.625 * 0.375)))
    crank = np.arctan2(-0.375 * np.sin(bend), 0.625 + 0.375 * np.cos(bend))
    at = np.array([0.25, 1.0 - depth, crank, bend])
    yield Start("cusp", "the mode ends in a cusp", cusp_cam(), at, -2.5, 0.125, cusp=True)
    stops = {**linkage(point), "stops": [{"joint": "q1", "upper": 3.375, "restitution": 0.5}]}
    yield Start("over centre, stop", "a stop behind a crossing of modes", stops, point.home, 6.0, 0.5)
    rubbing = {**linkage(kite), "friction": {"q1": 1.5, "q3": 0.75}}
    yield Start("kite, dry friction", "modes cross at 0", rubbing, kite.home, -6.0, 0.5)


def ladder(away: float) -> np.ndarray:
    """The trammel where its ladder leans so far from upright, rad, the dyad bent to one side."""
    theta = 0.5 * np.pi + away
    T = np.array([0.75 * np.cos(theta), 0.25 * np.sin(theta)])
    reach = T + [0.0, 2.0]
    far = np.hypot(*reach)
    bend = np.arccos((far**2 - 1.25**2 - 1.0) / 2.5)
    upper = np.arctan2(reach[1], reach[0]) - np.arctan2(np.sin(bend), 1.25 + np.cos(bend))
    return np.array([np.cos(theta), np.pi - theta, np.sin(theta), upper, bend])


def exactly(given: dict[str, Any], home: np.ndarray) -> Exact:
    """In seventy digits; turns that are quaternions without rounding."""
    mech = mechanism_of(given, home)
    if not isinstance(given["gravity"], list):
        return Exact(mech)
    exact = ExactInSpace(mech)
    for k, joint in enumerate(given["joints"]):
        if np.ndim(joint["turn"]) == 1:
            turn = np.array([Decimal(x) for x in joint["turn"]])
            exact.frames[k] = (rotation(turn), exact.frames[k][1])
    return exact


def quadrature(given: dict[str, Any], home: np.ndarray, rate: float, cusp: bool) -> Motion:
    """Of a linkage that starts at home."""
    exact = exactly(given, home)
    names = [joint["name"] for joint in given["joints"]]
    stop = None
    for told in given.get("stops", []):
        assert [told["joint"]] == given["independent"]
        stop = Decimal(told.get("upper", told.get("lower"))), Decimal(told["restitution"])
    friction = {names.index(joint): Decimal(bound) for joint, bound in given.get("friction", {}).items()}
    return Motion(exact, [Decimal(float(x)) for x in home], Decimal(rate), stop, friction, cusp)


def made(start: Start) -> dict[str, Any]:
    """A motion of the set."""
    motion = quadrature(start.linkage, start.home, start.rate, start.cusp)
    energy, states = motion.energy, list(motion.states(Decimal(start.duration)))

    def told(part: Vector) -> list[str]:
        return [f"{x:.{TOLD - 1}e}" for x in part]

    return {
        "name": start.name,
        "singular": start.singular,
        "linkage": start.linkage,
        "times": [start.duration * k / OUTPUTS for k in range(OUTPUTS + 1)],
        "energy": f"{energy:.{TOLD - 1}e}",
        **({"end": f"{motion.end:.{TOLD - 1}e}"} if start.cusp else {}),
        "q": [told(q) for q, _ in states],
        "v": [told(v) for _, v in states],
    }


if __name__ == "__main__":
    wanted = sys.argv[1:]
    found = []
    for start in starts():
        if not wanted or start.name in wanted:
            found.append(made(start))
            print(start.name, found[-1]["q"][-1], len(found[-1]["q"]), found[-1].get("end"), flush=True)
    assert DIGITS == 70
    if not wanted:
        lines = ",\n".join(json.dumps(one, separators=(",", ":")) for one in found)
        Path(MOTIONS).write_text(f"[\n{lines}\n]\n", encoding="utf-8")
