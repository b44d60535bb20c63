"""The least accurate way to each call, against digits that are not of this package's making."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from .. import Batch, Cost, Mechanism, Simulation, gradient, motion_point, simulate, simulate_many, step
from ..errors import RobustGcpError
from ..mechanism.tree.tree import Array
from ..simulation.derivatives.accelerations import derivatives, forward_dynamics
from .gradients.scores import Problem, error, problems
from .singular.scores import FINE, Motion, followed, motions

HEADER = ("what", "against", "least", "where", "largest", "where", "cases", "refused")

STEPS = 20 * FINE
"""Between a motion's instants: their truncation is below what is told of them."""

STENCIL = (2100.0, -600.0, 150.0, -25.0, 2.0)
"""Of differences of order 10, at 1 to 5 widths; over 2520 widths."""

WIDTH, SLOPE_STEPS = 0.004, 1600
"""Of these, rad and rad/s, and of their runs: what rounding and the widths leave is 1e-9 and less."""


@dataclass(frozen=True)
class Errors:
    """A call's least and largest error, and where they are."""

    what: str
    against: str  # what is taken for exact
    least: tuple[float, str]
    largest: tuple[float, str]
    cases: int
    refused: list[str]  # where it stopped, with the reason

    @property
    def cells(self) -> list[str]:
        """A row of the table."""
        told = [f"{self.least[0]:.0e}", self.least[1], f"{self.largest[0]:.0e}", self.largest[1]]
        return [self.what, self.against, *told, str(self.cases), str(len(self.refused))]


def errors(every: int = 1) -> Iterator[Errors]:
    """All calls; of each set's cases each n-th."""
    given, runs = problems()[::every], motions()[::every]
    digits = "70 digits, over the largest entry"
    for what, ask in AT_STATES.items():
        yield _errors(what, digits, {f"{p.name} ({p.kind})": partial(ask, p) for p in given})
    places = "25 digits, rad and m, at 20 instants"
    for what, take in RUNS.items():
        yield _errors(what, places, {m.name: partial(_off, take, m) for m in runs if not m.joints})
    parts = {m.name: partial(_off, _run, m) for m in runs if m.joints}
    if parts:
        yield _errors("simulate, joints=", places, parts)
    for what, close in CLOSED.items():
        yield _errors(what, "25 digits, over the largest entry", {m.name: partial(close, m) for m in runs})
    slopes = "differences of order 10 of runs, good to 1e-9"
    cases = {m.name: partial(_slopes, m) for m in runs if m.name in SLOPED}
    if cases:
        yield _errors("gradient by y0 and u0", slopes, cases)


def _errors(what: str, against: str, cases: Mapping[str, Callable[[], float]]) -> Errors:
    found, refused = list[tuple[float, str]](), list[str]()
    for where, ask in cases.items():
        try:
            off = ask()
            found.append((off if np.isfinite(off) else np.inf, where))
        except RobustGcpError as why:
            refused.append(f"{where}: {why}")
    nothing = (float("nan"), "")
    return Errors(
        what, against, min(found, default=nothing), max(found, default=nothing), len(cases), refused
    )


# --------------------------------------------------------------------------- at states


def _share(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _given(problem: Problem, rows: int) -> tuple[Mechanism, Array, Array, Array]:
    """The state and torques, of some states the same if any."""
    mech, q, v = problem.state
    if not rows:
        return mech, q, v, problem.tau
    return mech, np.tile(q, (rows, 1)), np.tile(v, (rows, 1)), np.tile(problem.tau, (rows, 1))


def _accelerations(problem: Problem, rows: int = 0) -> float:
    scale = max(float(np.abs(part).max()) for part in (problem.udot, problem.da_dy, problem.da_dv))
    found = forward_dynamics(*_given(problem, rows), problem.mode)
    return float(np.abs(found - problem.udot).max()) / scale


def _derivatives(problem: Problem, rows: int = 0) -> float:
    found = derivatives(*_given(problem, rows), mode=problem.mode)
    answer = found.udot, found.da_dy, found.da_dv, found.da_dtau
    if not rows:
        return error(problem, answer)
    return max(error(problem, tuple(part[k] for part in answer)) for k in range(rows))


def _point(problem: Problem) -> float:
    found = motion_point(*_given(problem, 0), mode=problem.mode)
    return _share(found.by_tau, problem.da_dtau)


AT_STATES: dict[str, Callable[[Problem], float]] = {
    "forward_dynamics": _accelerations,
    "forward_dynamics, 3 states": partial(_accelerations, rows=3),
    "derivatives": _derivatives,
    "derivatives, 3 states": partial(_derivatives, rows=3),
    "motion_point": _point,
}


# --------------------------------------------------------------------------- runs

Take = Callable[[Motion], Array]
"""q at a motion's instants as far as it goes."""


def _step(motion: Motion) -> float:
    return float(motion.times[1]) / STEPS


def _off(take: Take, motion: Motion) -> float:
    found = take(motion)
    return float((np.abs(found - motion.q[: len(found)]) / motion.mechanism.units).max())


def _run(motion: Motion, backend: Literal["native", "python"] = "native") -> Array:
    return followed(motion.scene, backend)[:: STEPS // FINE]


def _stepped(motion: Motion) -> Array:
    sim = Simulation(motion.mechanism, motion.q[0], motion.v[0], step=_step(motion))
    found = [motion.q[0]]
    for _ in motion.times[1:]:
        for _ in range(STEPS):
            sim.step()
        found.append(sim.q)
    return np.array(found)


def _batched(motion: Motion) -> Array:
    q0, v0 = (np.tile(part, (3, 1)) for part in (motion.q[0], motion.v[0]))
    batch, found = Batch(motion.mechanism, 3, q0, v0, step=_step(motion)), [motion.q[0]]
    for _ in motion.times[1:]:
        batch.step(n=STEPS)
        if 2 in batch.errors:
            raise batch.errors[2]
        found.append(batch.q[2].copy())
    return np.array(found)


def _many(motion: Motion) -> Array:
    starts = [(motion.q[0], motion.v[0])] * 3
    runs = simulate_many(motion.mechanism, starts, float(motion.times[-1]), _step(motion))
    return runs[2].q[::STEPS]


def _single(motion: Motion) -> Array:
    q, v, h = motion.q[0], motion.v[0], _step(motion)
    found = [q]
    for _ in motion.times[1:]:
        for _ in range(STEPS):
            after = step(motion.mechanism, q, v, h=h)
            q, v = after.q, after.v
        found.append(q)
    return np.array(found)


RUNS: dict[str, Take] = {
    "simulate": _run,
    "simulate, backend='python'": partial(_run, backend="python"),
    "Simulation.step": _stepped,
    "Batch": _batched,
    "simulate_many": _many,
    "step after step": _single,
}


# --------------------------------------------------------------------------- loops


def _assembled(motion: Motion, rows: int = 0) -> float:
    mech = motion.mechanism
    guess = motion.q.copy()
    guess[:, mech.iv_dependent] += 1e-3
    if rows:
        return _share(mech.assemble(guess, hold=mech.independent), motion.q)
    return max(
        _share(mech.assemble(q, hold=mech.independent), exact)
        for q, exact in zip(guess, motion.q, strict=True)
    )


def _lifted(motion: Motion) -> float:
    mech = motion.mechanism
    return max(
        _share(mech.lift(q, v[mech.iv_independent]), v) for q, v in zip(motion.q, motion.v, strict=True)
    )


CLOSED: dict[str, Callable[[Motion], float]] = {
    "assemble": _assembled,
    "assemble, 20 states": partial(_assembled, rows=1),
    "lift": _lifted,
}


# --------------------------------------------------------------------------- gradients

SLOPED = ("rhombus", "kite", "two crossed parallelograms", "in space 4, mode 1", "RSSR")
"""Motions whose slopes are taken, to their ends."""


def _slopes(motion: Motion) -> float:
    mech, own = motion.mechanism, motion.mechanism.iv_independent[0]
    until = float(motion.times[-1])

    def end(y: float, u: float) -> Array:
        q = motion.q[0].copy()
        q[own] += y
        q = mech.assemble(q, hold=mech.independent)
        run = simulate(mech, q, mech.lift(q, [motion.v[0, own] + u]), until, until / SLOPE_STEPS)
        return np.array([run.q[-1, own]])

    pick = np.eye(mech.nv)[own]
    cost = Cost(terminal=lambda q, v: float(q[own]), terminal_slopes=lambda q, v: (pick, np.zeros(mech.nv)))
    run = simulate(mech, motion.q[0], motion.v[0], until, until / SLOPE_STEPS)
    found = gradient(run, cost)
    exact = [
        sum(w * (end(*(k * WIDTH * way)) - end(*(-k * WIDTH * way))) for k, w in enumerate(STENCIL, 1))
        / (2520.0 * WIDTH)
        for way in np.eye(2)
    ]
    return _share(np.concatenate([found.dy, found.dv]), np.concatenate(exact))
