"""What a scene does not need is not computed: which parts run, how often, and what a step costs.

Scenes go from one pendulum to everything at once. Parts are counted twice over: by `Trajectory.stats`,
and by a profiler that sees every call of the functions named in `PARTS` between the first output and
the last one. Times are taken without it.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from cProfile import Profile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from .. import JointDamper, JointSpring, Mechanism, Stats, analyse, backends, load, simulate
from ..arguments import Arguments, existing_file, folder
from ..dynamics.equations import Evaluation, constraint_forces
from ..examples.linkages import add_link, n_four_bar, swinging_four_bar
from ..maps.choice import Method
from ..maps.cluster.jet import null_pairing
from ..mechanism.forces.applied_forces import AppliedForces
from ..mechanism.tree.tree import Tree
from ..printing import along, write, write_json
from . import pages
from .contender import clock
from .growth import QUICK, step_seconds
from .stability.truth import with_forces
from .work_precision.ours import Ours

PARTS: dict[str, tuple[Callable[..., Any], ...]] = {
    "RNEA": (Tree.rnea,),
    "CRBA": (Tree.crba,),
    "forces": (AppliedForces.torque_at,),
    "SVD": (np.linalg.svd,),
    "2nd order": (analyse, null_pairing),
    "energies": (Mechanism.energy,),
    "a": (Evaluation.a.fget,),  # type: ignore[attr-defined]
    "multipliers": (constraint_forces,),
}
"""Functions whose calls are counted."""

SHARES = ("robust_gcp", "pinocchio", "numpy", "scipy")
"""Packages whose time to load is told apart; `pinocchio` with the collision library `coal` that it loads."""


@dataclass(frozen=True)
class Cost:
    """What a scene's steps cost."""

    scene: str
    steps: int  # outputs after the first one
    calls: dict[str, int]  # calls of each of `PARTS` during the steps
    stats: Stats  # of the whole run, its start included
    crossings: int
    microseconds: float  # of a step, the least of some rounds


def measure(scene: str, rounds: int = 3) -> Cost:
    """Counts and time of a scene, by the Python reference."""
    mechanism, arguments = SCENES[scene]()
    profile, begun = Profile(), [0.0]

    def count(fraction: float) -> None:
        if fraction == 0.0:
            profile.enable()
        elif fraction == 1.0:  # what follows is done once a run
            profile.disable()

    def begin(fraction: float) -> None:
        if fraction == 0.0:
            begun[0] = clock()

    try:
        run = simulate(mechanism, backend="python", progress=count, **arguments)
    finally:
        profile.disable()
    steps, times = len(run.t) - 1, []
    for _ in range(rounds):
        simulate(mechanism, backend="python", progress=begin, **arguments)
        times.append((clock() - begun[0]) / steps)
    called = {entry.code: entry.callcount for entry in profile.getstats()}
    calls = {part: sum(called.get(_code(f), 0) for f in functions) for part, functions in PARTS.items()}
    return Cost(scene, steps, calls, run.stats, len(run.crossings), 1e6 * min(times))


def _code(function: Any) -> Any:
    return getattr(function, "__wrapped__", function).__code__


# --------------------------------------------------------------------------- scenes

RECORDS = ("a", "energy", "multipliers")


def _pendulum() -> Mechanism:
    model = pin.Model()
    add_link(model, 0, 0.0, "q1", 1.0)
    return Mechanism.from_pinocchio(model, home=[0.5])


def _with_forces(mechanism: Mechanism) -> Mechanism:
    """A spring and a damper on the first joint."""
    return with_forces(mechanism, [JointSpring("q1", 5.0, 0.2), JointDamper("q1", 0.1)])


def _brake(t: float, q: Any, v: Any) -> Any:
    """A torque against the motion of the first joint, N m."""
    return np.concatenate([[-0.1 * v[0]], np.zeros(len(v) - 1)])


def _far(**more: Any) -> dict[str, Any]:
    """0.1 s of a four-bar away from singular configurations."""
    return {"duration": 0.1, "step": 1e-3} | more


def _moving(name: str) -> dict[str, Any]:
    """A robot as its model recommends to start it."""
    recommended = load(name).recommended
    return _far(v0=recommended.v0)


def _rhombus(**more: Any) -> dict[str, Any]:
    """0.4 s of the fall through its first singular configuration."""
    return _far(q0=[0.2, -0.2, 0.2], duration=0.4, **more)


def _swinging() -> tuple[Mechanism, dict[str, Any]]:
    mechanism = swinging_four_bar(4.0, 2.0, 3.0, 3.0, 0.1, np.pi - 0.3)
    v0 = mechanism.lift(mechanism.home, [0.1, 3.0])
    return mechanism, _far(v0=v0, duration=0.2)


def _toggling() -> tuple[Mechanism, dict[str, Any]]:
    """A crank-rocker driven through the turning point of its rocker, which is the coordinate."""
    driven = load("crank_rocker")
    q0 = driven.assemble([1.5, *driven.home[1:]])
    start = {"q0": q0, "v0": driven.lift(q0, [6.0])}
    return driven.with_independent(["q3"]), _far(**start, duration=0.4, on_toggle="repartition")


SCENES: dict[str, Callable[[], tuple[Mechanism, dict[str, Any]]]] = {
    "one pendulum": lambda: (_pendulum(), _far()),
    "a pendulum with spring and damper": lambda: (_with_forces(_pendulum()), _far()),
    "one loop, far from singular": lambda: (load("crank_rocker"), _far()),
    "… with spring and damper": lambda: (_with_forces(load("crank_rocker")), _far()),
    "… with a torque": lambda: (load("crank_rocker"), _far(torque=_brake)),
    "… recording a": lambda: (load("crank_rocker"), _far(record=("a",))),
    "… recording the energy": lambda: (load("crank_rocker"), _far(record=("energy",))),
    "… recording λ": lambda: (load("crank_rocker"), _far(record=("multipliers",))),
    "… by DOP853": lambda: (load("crank_rocker"), _far(stepper="DOP853")),
    "three loops in a row": lambda: (n_four_bar(3), _far()),
    "two coordinates, far from singular": lambda: (load("five_bar"), _far()),
    "one closure row too many (Bricard)": lambda: (load("bricard"), _far()),
    "a delta robot, far from singular": lambda: (load("delta"), _moving("delta")),
    "a walker's two clusters, far from singular": lambda: (load("walker"), _moving("walker")),
    "a floating walker, far from singular": lambda: (load("walker", base="free"), _far()),
    "through a crossing": lambda: (load("rhombus"), _rhombus()),
    "two coordinates, through a crossing": _swinging,
    "the coordinate turns back: repartition": _toggling,
    "everything on": lambda: (_with_forces(load("rhombus")), _rhombus(torque=_brake, record=RECORDS)),
}
"""A mechanism and the arguments of `simulate`, by names for the table."""


# --------------------------------------------------------------------------- the method

FAR: dict[str, Callable[[], Mechanism]] = {
    "a four-bar": lambda: load("crank_rocker"),
    "forty four-bars in a row": lambda: n_four_bar(40, 1.2),
    "a delta robot": lambda: load("delta"),
    "a walker": lambda: load("walker"),
}
"""Mechanisms far from their singular configurations."""

LONG = 40e-3
"""s that a timed run of theirs takes, at most: the clock's noise is some 0.1 ms."""


def method_costs(rounds: int) -> dict[str, tuple[float, float]]:
    """µs of a step by classical GCP, and the method over it where no bridge is needed: medians, in turns."""
    methods: tuple[Method, ...] = ("classical", "bridge")
    backend: Any = "native" if backends()["native"].available else "python"
    pair = [Ours(method, "", method, "rk4", "", backend=backend) for method in methods]
    found = {}
    for name in along(list(FAR), "method"):
        mechanism = FAR[name]()
        times = np.array(
            [
                [step_seconds(c, mechanism, rounds, LONG) or np.nan for c in pair]
                for _ in range(1 if rounds == QUICK else rounds)
            ]
        )
        found[name] = float(1e6 * np.median(times[:, 0])), float(np.median(times[:, 1] / times[:, 0]))
    return found


def method_table(found: dict[str, tuple[float, float]]) -> str:
    """What the method costs where it is not needed."""
    rows = [["far from singular", "classical GCP, µs a step", "the method adds"]]
    rows += [[name, f"{micro:.3g}", f"{over - 1.0:+.1%}"] for name, (micro, over) in found.items()]
    return pages.table(rows, (1, 2))


def markdown(
    costs: list[Cost], milliseconds: dict[str, float], method: dict[str, tuple[float, float]]
) -> str:
    """The tables of docs/costs.md."""
    head = (
        *("scene", "µs per step", "ratio", "rhs", "φ and K", "RNEA", "CRBA", "forces"),
        *("a, energy, λ", "SVD", "2nd order", "marching", "bridges", "refined", "crossings"),
    )
    rows: list[Sequence[str]] = [head]
    for cost in costs:
        stats, calls = cost.stats, cost.calls
        per_step = (stats.rhs, stats.constraint_evaluations, calls["RNEA"], calls["CRBA"])
        outputs = ", ".join(str(round(calls[part] / cost.steps)) for part in ("a", "energies", "multipliers"))
        rare = (
            *(calls["SVD"], calls["2nd order"], stats.marching_steps, stats.bridges_built),
            *(stats.refined_steps, cost.crossings),
        )
        cells = [cost.scene, f"{cost.microseconds:.0f}", f"{cost.microseconds / costs[0].microseconds:.1f}"]
        cells += [_brief(value / cost.steps) for value in (*per_step, stats.force_evaluations)]
        rows.append([*cells, outputs, *map(str, rare)])
    total = sum(milliseconds.values())
    shares = ", ".join(f"{name} {value / total:.0%}" for name, value in milliseconds.items())
    lines = f"`import robust_gcp`: {total:.0f} ms on the same machine; {shares}.\n"
    parts = pages.table(rows, range(1, len(head))), method_table(method), lines
    return "\n\n".join(parts)


def _brief(value: float) -> str:
    """Two digits after the point, none where it is zero."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if value else "0"


def import_milliseconds(rounds: int = 3) -> dict[str, float]:
    """Milliseconds of the import in a fresh interpreter by package, the least of some rounds.

    From `python -X importtime`, which itself slows imports down by a little: the shares travel, the
    sum is an upper bound.
    """
    script = f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r}); import robust_gcp"
    words, found = [sys.executable, "-X", "importtime", "-c", script], []
    for _ in range(rounds):
        done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=300)
        total: Counter[str] = Counter()
        for own, name in re.findall(r"^import time: +(\d+) \|.*\| +(\w+)", done.stderr, re.MULTILINE):
            package = "pinocchio" if name == "coal" else name
            total[package if package in SHARES else "others"] += int(own)
        found.append({name: total[name] / 1e3 for name in (*SHARES, "others")})
    return min(found, key=lambda shares: sum(shares.values()))


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    add_to.path("--out", folder, "DIR", "write costs.md and costs.json there")
    add_to.path("--refresh", existing_file, "FILE", "renew the tables in this document")
    add_to.add("--quick", action="store_true", help="one round, for a smoke test")


def run(args: argparse.Namespace) -> int:
    """Print the tables, and write what was asked for."""
    pages.require_marks(args.refresh, ["costs"])
    rounds = 1 if args.quick else 5
    load("crank_rocker")  # what is loaded late is loaded now
    costs = [measure(scene, rounds) for scene in along(list(SCENES), "costs")]
    milliseconds = import_milliseconds(rounds)
    method = method_costs(QUICK if args.quick else 4)
    text = markdown(costs, milliseconds, method)
    print(text, end="")
    if args.out is not None:
        write(args.out / "costs.md", text)
        figures = {"import_milliseconds": milliseconds, "method": method}
        write_json(args.out / "costs.json", figures | {"scenes": [asdict(cost) for cost in costs]})
    pages.refresh(args.refresh, {"costs": text})
    return 0
