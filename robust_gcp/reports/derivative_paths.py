"""Every way to derivatives, single steps and runs: its time over the plain one, and what is told of it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import Cost, Mechanism, Wrench, analyse, backends, gradient, linearise, load, motion_point, simulate
from ..errors import PerformanceWarning
from ..examples.families import planar_linkage
from ..examples.six_bars import joined_by_dyad
from ..mechanism.tree.tree import Array
from ..printing import along, table, write_json
from ..simulation.derivatives.accelerations import derivatives, forward_dynamics
from ..simulation.derivatives.one_step import step, step_jacobians
from ..simulation.derivatives.parameter_derivatives import by_parameters
from ..simulation.derivatives.second_derivatives import second_derivatives
from ..simulation.trajectories.trajectory import Trajectory
from . import pages, path_accuracy, run_paths
from .machine import footer, least, machine
from .run_paths import EACH, MANY, Call

FEW = 16
"""Each so many-th problem and motion, in a quick round."""

BOUND = 20.0
"""Ratio from which a path has to warn of its price."""

HEADER = ("what", "where", "µs", "ratio", "why")

CALLS: dict[str, Callable[..., object]] = {
    "forward_dynamics": forward_dynamics,
    "derivatives": derivatives,
    "motion_point": motion_point,
    "linearise": linearise,
    "step": partial(step, h=1e-3),
    "step_jacobians": partial(step_jacobians, step=1e-3),
}
"""Of a state and torques, with `mode=`."""


@dataclass(frozen=True)
class Way:
    """A call's µs, over those of the plain one; whether it warned, or why it takes as long as it does."""

    what: str
    where: str
    micro: float
    ratio: float
    warned: bool
    why: str = ""

    @property
    def cells(self) -> list[str]:
        """A row of the table."""
        why = self.why or ("warned" if self.warned else "")
        return [self.what, self.where, f"{self.micro:.0f}", f"{self.ratio:.1f}", why]

    @property
    def good(self) -> bool:
        """Whether it is fast, or it is said why not."""
        return self.ratio <= BOUND or self.warned or bool(self.why)


def ways(rounds: int) -> list[Way]:
    """All that are known, each after its compiled one."""
    found = list[Way]()
    for what, usual, others in along([*_groups(), *run_paths.analyses(), *run_paths.groups()], "benchmark"):
        base, _ = _timed(usual, rounds)
        found.append(Way(what, "regular", 1e6 * base, 1.0, False))
        for where, call in others.items():
            time, warned = _timed(call, rounds)
            time /= MANY if where == EACH else 1
            why = run_paths.REASONS.get(where, "")
            found.append(Way(what, where, 1e6 * time, time / base, warned, why))
    return found


def tell(rounds: int, full: bool, out: Path | None, refresh: Path | None) -> int:
    """Print the tables; 1 where a path is slow without a warning or a reason.

    Parameters
    ----------
    rounds : int
        Timed calls of each way.
    full : bool
        Whether errors are those of all cases, or of a few.
    out, refresh : Path, optional
        Everything as JSON; a page whose blocks `worst paths` and `errors of paths` are renewed.
    """
    pages.require_marks(refresh, ["worst paths", "errors of paths"])
    if not backends()["native"].available:
        print(f"no compiled kernel: {backends()['native'].reason}")
        return 0
    found = ways(rounds)
    print("Least times, over those of the same call at a regular state, of the plain run:")
    print(table(HEADER, [row.cells for row in found], None))
    bad = [row for row in found if not row.good]
    print(f"{len(bad)} paths above {BOUND:g} times the plain one without a warning or a reason")
    print("Least and largest errors of calls, over all problems and motions of the reports' sets:")
    off = list(path_accuracy.errors(1 if full else FEW))
    print(table(path_accuracy.HEADER, [row.cells for row in off], None))
    for row in off:
        for why in row.refused:
            print(f"refused: {row.what}: {why}")
    where = machine()
    if out:
        told = {"ways": [asdict(row) for row in found], "errors": [asdict(row) for row in off]}
        write_json(out, {"machine": where, **told})
    blocks = {
        "worst paths": pages.table([HEADER, *(row.cells for row in worst(found))], (2, 3)),
        "errors of paths": pages.table([path_accuracy.HEADER, *(row.cells for row in off)], (2, 4, 6, 7)),
    }
    pages.refresh(refresh, {name: f"{block}\n\n*{footer(where)}*" for name, block in blocks.items()})
    return 1 if bad else 0


def worst(found: Sequence[Way]) -> list[Way]:
    """Of each call the plain way, and its slowest and its fastest other one."""
    rows = list[Way]()
    for what in dict.fromkeys(way.what for way in found):
        plain, *others = (way for way in found if way.what == what)
        ends = sorted(others, key=lambda way: way.ratio)
        rows += [plain, *ends[:1], *(ends[-1:] if len(ends) > 1 else [])]
    return rows


def _timed(call: Call, rounds: int) -> tuple[float, bool]:
    """s, the least, once all that is kept was made; and whether a PerformanceWarning was given."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        call()
        call()
        time = least(call, rounds)
    return time, any(issubclass(w.category, PerformanceWarning) for w in told)


def _groups() -> Iterator[tuple[str, Call, dict[str, Call]]]:
    """What is called, at a regular state and elsewhere."""
    rocker, bars = load("crank_rocker"), load("rhombus")
    regular, drag = (rocker, rocker.home, rocker.lift(rocker.home, [1.0])), -0.1 * np.eye(3)
    flat, mode = np.zeros(3), np.array(analyse(bars, np.zeros(3)).modes[0])
    across = bars, flat, 2.0 * mode
    places: dict[str, tuple[Mechanism, Array, Array, dict[str, Any]]] = {
        "mode= at a regular state": (*regular, {"mode": rocker.G(rocker.home)[:, 0]}),
        "singular, moving": (*across, {}),
        "singular, at rest with mode=": (bars, flat, 0.0 * mode, {"mode": mode}),
        "beside a dead point": (*dead_point(), {}),
        "beside a singular surface, two coordinates": (*at_a_surface(0.01), {}),
        "at a singular surface, two coordinates": (*at_a_surface(0.0), {}),
        "beside an apex, two coordinates": (*five_bar_in_line(), {}),
    }
    push = [Wrench("q2", np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))]

    def follow(t: float, q: Array, v: Array) -> Array:
        return drag @ v

    for what, call in CALLS.items():
        others: dict[str, Call] = {}
        for where, (mech, q, fast, options) in places.items():
            others[where] = partial(call, mech, q, fast, np.zeros(mech.nv), **options)
        if what != "linearise":  # of one state
            rows = [np.tile(part, (MANY, 1)) for part in (*regular[1:], np.zeros(3))]
            others[EACH] = partial(call, rocker, *rows)
        if what in ("derivatives", "linearise"):
            others["a wrench"] = partial(call, *regular, np.zeros(3), wrenches=push)
            others["a torque function"] = partial(call, *regular, follow)
        yield what, partial(call, *regular, np.zeros(3)), others

    def by(place: tuple[Mechanism, Array, Array], parameter: str, h: float | None = None) -> Call:
        return partial(by_parameters, *place, None, [parameter], h=h)

    usual = partial(derivatives, *regular, np.zeros(3))
    parameters = {
        "a mass": by(regular, "q2.mass"),
        "geometry": by(regular, "q2.placement.y"),
        "a mass, of a step": by(regular, "q2.mass", 1e-3),
        "geometry, of a step": by(regular, "q2.placement.y", 1e-3),
        "a mass, singular": by(across, "q2.m"),
        "a mass, of a step, singular": by(across, "q2.m", 1e-3),
    }
    yield "by_parameters, beside derivatives", usual, parameters
    twice = partial(second_derivatives, *regular, np.zeros(3), dy=[1.0])
    yield "second_derivatives, beside 16 derivatives", lambda: [usual() for _ in range(16)], {"": twice}
    crank = partial(simulate, *regular, duration=0.2, step=1e-3)
    yield from _gradients(crank, crank(torque=follow), partial(simulate, bars, duration=0.3, step=1.5e-3))


def _gradients(
    crank: Callable[[], Trajectory], pushed: Trajectory, cross: Callable[[], Trajectory]
) -> Iterator[tuple[str, Call, dict[str, Call]]]:
    """Those of runs of 200 steps, beside their runs: plain, under a torque function, through a crossing."""
    cost = Cost(terminal=lambda q, v: float(q[0]), terminal_slopes=lambda q, v: (np.eye(3)[0], np.zeros(3)))
    plain = partial(gradient, crank(), cost)
    others: dict[str, Call] = {
        "": plain,
        "masses": partial(plain, parameters=["q2.mass"]),
        "geometry": partial(plain, parameters=["q2.placement.y"]),
        "a torque function": partial(gradient, pushed, cost),
    }
    yield "gradient, beside its run", crank, others
    yield "gradient, beside its run through a crossing", cross, {"": partial(gradient, cross(), cost)}


def five_bar_in_line() -> tuple[Mechanism, Array, Array]:
    """Two coordinates in a loop, stretched along a line and a little beside."""
    points = {"A": (0.0, 0.0), "B": (1.0, 0.0), "C": (2.5, 0.0), "D": (2.0, 0.0), "E": (1.0, 0.0)}
    links = {"ground": ["A", "E"], "a": ["A", "B"], "b": ["B", "C"], "c": ["E", "D"], "d": ["D", "C"]}
    joints = [
        ("q1", "ground", "a"),
        ("q2", "a", "b"),
        ("q3", "ground", "c"),
        ("q4", "c", "d"),
        ("q5", "b", "d"),
    ]
    mech = planar_linkage(points, links, joints, ["q1", "q3"], cuts=["q5"])
    q = mech.assemble([0.0015, 0.003, -0.0012, -0.003], hold=["q1", "q3"])
    return mech, q, mech.lift(q, [1.0, -0.5])


def at_a_surface(apart: float) -> tuple[Mechanism, Array, Array]:
    """Two four-bars that a dyad joins, one of them so far from flat, rad, and moving across it."""
    mech = joined_by_dyad((np.pi - apart, 2.5))
    if apart:
        return mech, mech.home, mech.lift(mech.home, [1.0, -0.5])
    mode = np.array(analyse(mech, mech.home).modes[0])
    return mech, mech.home, mode @ np.linalg.solve(mode[mech.iv_independent], [1.0, -0.5])


def dead_point() -> tuple[Mechanism, Array, Array]:
    """The crank-rocker by its rocker, beside where that turns back."""
    mech = load("crank_rocker")
    straight = float(np.arccos((3.5**2 + 4.0**2 - 3.0**2) / (2.0 * 3.5 * 4.0)))
    q = mech.assemble([straight + 0.01, 0.0, np.pi - 1.0], hold=["q1"])
    return mech.with_independent(["q3"]), q, mech.lift(q, [1.0])
