"""What a step costs on robots, beside Pinocchio's own C++ in the same run."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from .. import BridgeOptions, Mechanism, RobustGcpError, implicit_dynamics, load
from ..dynamics.problem import initial_value_problem
from ..kernel.library import library
from ..kernel.loop_arrays import NotNativeError
from ..kernel.simulation.batch import Outputs
from ..kernel.simulation.workspace import Workspace
from ..mechanism.tree.tree import Array
from ..printing import along, table, write_json
from .machine import in_turn, seconds
from .peers.compiled import Loop, Settings, knows, why_not
from .peers.pinocchio import ADAPTED
from .robots import robots_in

Batch = Callable[[], tuple[float, float]]
"""Does a batch of steps: seconds per step and Newton iterations per right-hand side."""

SHIPPED = ("stewart", "strandbeest")
"""Robots among the shipped models, for a run without a folder."""

STEP = 1e-4
"""s."""

SPEED = 1.0
"""Largest entry of v, rad/s or m/s, at the start: so fast that predictions are not exact."""

BATCH = 4e-3
"""s that one batch of steps takes, about."""

RIGHT = 1e-9
"""Largest error of an acceleration, relative to its largest entry, with which a setting counts as right."""

MUS, ITERATIONS = (1e-12, 1e-10, 1e-8, 1e-6), (1, 2, 3, 5)
"""Settings of constraintDynamics that are tried; the cheapest right one counts."""


@dataclass
class Row:
    """One robot; times in µs, NaN where there is none."""

    robot: str
    # nv, m, clusters: velocities, independent velocities, loop clusters
    nv: int = 0
    m: int = 0
    clusters: int = 0
    step: float = np.nan  # an RK4 step in the kernel
    newton: float = np.nan  # Newton iterations per right-hand side
    # aba, constrained: one evaluation of `aba` (of the open tree) and of `constraintDynamics`: a quarter of
    # an RK4 step in a C++ loop
    aba: float = np.nan
    constrained: float = np.nan
    note: str = ""  # why something is missing

    @property
    def ratio(self) -> float:
        """A step of ours over one evaluation of theirs."""
        return self.step / (self.constrained if np.isfinite(self.constrained) else self.aba)

    @property
    def cells(self) -> list[str]:
        """A line of the table under `HEADER`."""
        numbers = [self.step, self.newton, self.aba, self.constrained, self.ratio]
        shown = ["" if np.isnan(x) else f"{x:.3g}" for x in numbers]
        return [self.robot, str(self.nv), str(self.m), str(self.clusters), *shown, self.note]


HEADER = (
    *("robot", " nv", " m", " clusters", " step", " Newton", " aba", " constraintDynamics", " ratio", "note"),
)


def measured(name: str | Path, shown: str, base: str | None, rounds: int) -> Row:
    """A robot loaded and timed; what cannot be is a note."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mechanism = load(name, base=base)
    except RobustGcpError as error:
        return Row(shown, note=str(error).splitlines()[0][:90])
    row = Row(shown, mechanism.nv, mechanism.m, len(mechanism.clusters))
    if mechanism.m == 0:
        row.note = "no degree of freedom"
        return row
    v = start_velocity(mechanism)
    contenders: dict[str, Callable[[], float]] = {}
    try:
        steps = sized(mechanism, v)
        row.newton = steps()[1]
        contenders["step"] = lambda: steps()[0]
    except (NotNativeError, RobustGcpError, RuntimeError) as error:
        row.note = str(error)[:90]
    if why_not():
        row.note = row.note or why_not()[:90]
    elif not knows(mechanism) or any(c.kind not in ADAPTED for c in mechanism.closures):
        row.note = row.note or "joints or closures that Pinocchio's loop has not"
    else:
        loop = Loop(mechanism)
        contenders["aba"] = evaluations(loop, mechanism, v, Settings("aba"))
        how = cheapest_right(loop, mechanism, v) if mechanism.closures else None
        if how is not None:
            contenders["constrained"] = evaluations(loop, mechanism, v, how)
        elif mechanism.closures:
            row.note = row.note or "constraintDynamics is right with no setting tried"
    for what, best in in_turn(contenders, rounds).items():
        setattr(row, what, 1e6 * best)
    return row


def tell(folder: Path | None, shipped: bool, base: str | None, rounds: int, out: Path | None) -> None:
    """Print the table of the robots in a folder, and of shipped ones; write it where that is wanted."""
    found: list[tuple[str | Path, str]] = [(name, name) for name in SHIPPED if shipped]
    if folder is not None:
        found += [(path, str(path.relative_to(folder))) for path in robots_in(folder)]
    rows = [measured(*one, base, rounds) for one in along(found, "benchmark")]
    print(f"µs, smallest of {rounds} rounds. step: RK4 step of {STEP:g} s in the kernel; aba (open tree),")
    print(
        "constraintDynamics (cheapest right setting): a quarter of an RK4 step in a C++ loop; ratio: a step"
    )
    print("of ours over one evaluation of constraintDynamics, of aba where nothing is closed")
    print(table(HEADER, [row.cells for row in rows], None))
    if out:
        write_json(out, [asdict(row) | {"ratio": row.ratio} for row in rows])


def start_velocity(mechanism: Mechanism) -> Array:
    """A velocity that moves everything, the same in each run; at rest where home has no G."""
    u = np.random.default_rng(1).normal(size=mechanism.m)
    try:
        v = mechanism.lift(mechanism.home, u)
    except RobustGcpError:
        return np.zeros(mechanism.nv)
    return v * (SPEED / np.abs(v).max())


def batches(mechanism: Mechanism, steps: int, h: float = STEP, v: Array | None = None) -> Batch:
    """The same batch of steps of h, s, in the kernel, from home at rest or with v, again and again.

    Raises
    ------
    RuntimeError
        Where the kernel is not there; of the batch, when it stopped before the end.
    """
    found = library()
    if found is None:
        raise RuntimeError("no compiled kernel")
    motion = initial_value_problem(mechanism, None, v)
    now, times = motion.equations.evaluate(0.0, motion.x), h * np.arange(steps + 1)
    outputs = Outputs.room(steps, mechanism.nq, mechanism.nv)
    workspace = Workspace(found, mechanism, motion.start.path, works=motion.works)

    def run() -> tuple[float, float]:
        begun = time.perf_counter()
        batch = workspace.run(times, motion.x, now, outputs, BridgeOptions().zone)
        spent = time.perf_counter() - begun
        if batch.steps < steps:
            raise RuntimeError(f"the kernel stopped after {batch.steps} steps: {batch.reason.name}")
        return spent / steps, batch.counts["newton_iterations"] / batch.counts["rhs"]

    return run


def sized(mechanism: Mechanism, v: Array) -> Batch:
    """Batches from home with v that take `BATCH` or so."""
    first, _ = batches(mechanism, 10, v=v)()
    return batches(mechanism, int(np.clip(BATCH / max(first, 1e-7), 5, 200)), v=v)


def evaluations(loop: Loop, mechanism: Mechanism, v: Array, how: Settings) -> Callable[[], float]:
    """Steps of the C++ loop; a call gives seconds per evaluation of one of Pinocchio's algorithms."""

    def run(steps: int) -> float:
        call = partial(loop.run, mechanism.home, v, 1e-7, steps, 1, how)
        return seconds(call, time.perf_counter) / (4 * steps)

    return partial(run, int(np.clip(BATCH / max(4.0 * run(5), 1e-7), 5, 1000)))


def cheapest_right(loop: Loop, mechanism: Mechanism, v: Array) -> Settings | None:
    """The fewest iterations with which constraintDynamics is right at home, and the mu for it; or None."""
    exact = implicit_dynamics(mechanism, mechanism.home, v)[0]
    for iterations in ITERATIONS:
        for mu in MUS:
            how = Settings(mu=mu, iterations=iterations, accuracy=1e-14)
            error = np.abs(loop.acceleration(mechanism.home, v, how) - exact).max()
            if error <= RIGHT * max(float(np.abs(exact).max()), 1.0):
                return how
    return None
