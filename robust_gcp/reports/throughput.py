"""Steps per second of many starts of one mechanism, beside `mujoco.rollout`, and what threads gain."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from .. import Batch, Mechanism, load, simulate
from ..mechanism.tree.tree import Array
from ..printing import along, table, write_json
from ..simulation.batches.many import simulate_many
from .machine import in_turn, seconds


def thread_gain(mechanism: Mechanism, quick: bool = False) -> float:
    """How many times the work of one thread two threads do in the same time, best of rounds."""
    work = partial(simulate, mechanism, duration=5e-3 if quick else 0.2, step=1e-5)

    def run(count: int) -> float:
        running = [threading.Thread(target=work) for _ in range(count)]
        begun = time.perf_counter()
        for thread in running:
            thread.start()
        for thread in running:
            thread.join()
        return time.perf_counter() - begun

    alone, together = (min(run(count) for _ in range(2 if quick else 7)) for count in (1, 2))
    return 2.0 * alone / together


MANY = ("crank_rocker", "rhombus", "five_bar", "slider_crank", "walker", "stewart")
"""Shipped models that are timed."""

STEP = 1e-3
"""s."""

HEADER = ("mechanism", " threads", " simulate_many", " Batch", " mujoco.rollout", " ratio", "note")


def tell(count: int, quick: bool, out: Path | None) -> None:
    """Print the table of so many starts, and write it where that is wanted."""
    steps, rounds = (50, 1) if quick else (500, 3)
    cases = list(itertools.product(MANY, sorted({1, os.cpu_count() or 1})))
    rows = [measured(name, count, steps, threads, rounds) for name, threads in along(cases, "benchmark")]
    print(f"steps per second of RK4, {count} starts of {steps} steps of {STEP:g} s, best of {rounds} rounds;")
    print("MuJoCo: RK4 with connect as hard as it goes")
    print(table(HEADER, rows, None))
    if out:
        write_json(out, [dict(zip(map(str.strip, HEADER), row, strict=True)) for row in rows])


def measured(name: str, count: int, steps: int, threads: int, rounds: int) -> list[str]:
    """A line under `HEADER`: the best of some rounds of so many starts and steps of each, in turn.

    From home, with velocities all around; reproducible.
    """
    mechanism, rng = load(name), np.random.default_rng(0)
    q0 = np.tile(mechanism.home, (count, 1))
    v0 = np.array([mechanism.lift(mechanism.home, rng.normal(0.0, 0.5, mechanism.m)) for _ in range(count)])
    contenders: dict[str, Callable[[], None]] = {
        "many": partial(_ours, mechanism, q0, v0, steps, threads),
        "batch": _batch(mechanism, q0, v0, steps, threads),
    }
    try:
        contenders["theirs"] = _theirs(mechanism, q0, v0, steps, threads)
        note = ""
    except (ImportError, ValueError) as error:
        note = str(error)[:60]
    works = {who: partial(seconds, run, time.perf_counter) for who, run in contenders.items()}
    pace = {who: count * steps / best for who, best in in_turn(works, rounds).items()}
    theirs, ratio = (
        (f"{pace['theirs']:.3g}", f"{pace['batch'] / pace['theirs']:.3g}") if not note else ("", "")
    )
    return [name, str(threads), f"{pace['many']:.3g}", f"{pace['batch']:.3g}", theirs, ratio, note]


def _ours(mechanism: Mechanism, q0: Array, v0: Array, steps: int, threads: int) -> None:
    starts = list(zip(q0, v0, strict=True))
    for error in simulate_many(mechanism, starts, steps * STEP, STEP, threads=threads).errors.values():
        raise error


def _batch(mechanism: Mechanism, q0: Array, v0: Array, steps: int, threads: int) -> Callable[[], None]:
    """Rows that begin again where they were, and take all steps in one call."""
    batch = Batch(mechanism, len(q0), q0, v0, STEP, threads=threads)
    begun = batch.save()

    def run() -> None:
        batch.restore(begun).step(None, steps)
        for error in batch.errors.values():
            raise error

    run()  # steps are compiled once
    return run


def _theirs(mechanism: Mechanism, q0: Array, v0: Array, steps: int, threads: int) -> Callable[[], None]:
    """MuJoCo's RK4 with `connect` as hard as it goes, from the same states."""
    import mujoco
    from mujoco import rollout

    from .peers.mujoco import SHORTEST, compiled
    from .peers.parts import has_simple_joints

    if not has_simple_joints(mechanism) or any(c.kind not in ("3d", "revolute") for c in mechanism.closures):
        raise ValueError("joints or closures that the adapter to MuJoCo has not")
    model = compiled(mechanism, "RK4", True)
    model.opt.timestep = STEP
    model.eq_solref[:] = (SHORTEST * STEP, 1.0)
    data = [mujoco.MjData(model) for _ in range(threads)]
    states = np.column_stack([np.zeros(len(q0)), q0, v0])

    def run() -> None:
        rollout.rollout(model, data, states, nstep=steps)

    return run
