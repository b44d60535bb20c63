"""Steps per second of many starts of one mechanism, beside `mujoco.rollout`, and what threads gain."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from .. import Batch, Mechanism, load, simulate
from ..checks import real_array
from ..printing import along, table, write_json
from ..simulation.batches.many import Start, simulate_many
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

HEADER = ("mechanism", " threads", " simulate_many", " Batch", " mujoco.rollout", " ratio", "note")


def tell(count: int, quick: bool, out: Path | None) -> None:
    """Print the table of so many starts, and write it where that is wanted."""
    steps, step, rounds = (50, 1e-3, 1) if quick else (500, 1e-3, 3)
    threads = sorted({1, os.cpu_count() or 1})
    rows = [
        measured(name, load(name), count, steps, step, many, rounds)
        for name, many in along(list(itertools.product(MANY, threads)), "benchmark")
    ]
    print(f"steps per second of RK4, {count} starts of {steps} steps of {step:g} s, best of {rounds} rounds;")
    print("MuJoCo: RK4 with connect as hard as it goes")
    print(table(HEADER, rows, None))
    if out:
        write_json(out, [dict(zip(map(str.strip, HEADER), row, strict=True)) for row in rows])


def starts_of(mechanism: Mechanism, count: int) -> list[Start]:
    """Home, with velocities all around; reproducible."""
    rng = np.random.default_rng(0)
    speeds = [rng.normal(0.0, 0.5, mechanism.m) for _ in range(count)]
    return [(mechanism.home, mechanism.lift(mechanism.home, u)) for u in speeds]


def measured(
    name: str, mechanism: Mechanism, count: int, steps: int, step: float, threads: int, rounds: int
) -> list[str]:
    """A line under `HEADER`: the best of some rounds, each in turn.

    Parameters
    ----------
    count, steps : int
        Starts, and steps of each.
    step : float
        s.
    """
    starts = starts_of(mechanism, count)
    contenders: dict[str, Callable[[], None]] = {
        "many": lambda: _ours(mechanism, starts, steps * step, step, threads),
        "batch": _batch(mechanism, starts, steps, step, threads),
    }
    try:
        contenders["theirs"] = _theirs(mechanism, starts, steps, step, threads)
        note = ""
    except (ImportError, ValueError) as error:
        note = str(error)[:60]
    works = {who: partial(seconds, run, time.perf_counter) for who, run in contenders.items()}
    pace = {who: count * steps / best for who, best in in_turn(works, rounds).items()}
    theirs, ratio = (
        (f"{pace['theirs']:.3g}", f"{pace['batch'] / pace['theirs']:.3g}") if not note else ("", "")
    )
    return [name, str(threads), f"{pace['many']:.3g}", f"{pace['batch']:.3g}", theirs, ratio, note]


def _ours(mechanism: Mechanism, starts: Sequence[Start], duration: float, step: float, threads: int) -> None:
    runs = simulate_many(mechanism, starts, duration, step, threads=threads)
    for error in runs.errors.values():
        raise error


def _batch(
    mechanism: Mechanism, starts: Sequence[Start], steps: int, step: float, threads: int
) -> Callable[[], None]:
    """Rows that begin again where they were, and take all steps in one call."""
    q0, v0 = (np.array([real_array(part) for part in parts]) for parts in zip(*starts, strict=True))
    batch = Batch(mechanism, len(starts), q0, v0, step, threads=threads)
    begun = batch.save()

    def run() -> None:
        batch.restore(begun).step(None, steps)
        for error in batch.errors.values():
            raise error

    run()  # steps are compiled once
    return run


def _theirs(
    mechanism: Mechanism, starts: Sequence[Start], steps: int, step: float, threads: int
) -> Callable[[], None]:
    """MuJoCo's RK4 with `connect` as hard as it goes, from the same states."""
    import mujoco
    from mujoco import rollout

    from .peers.mujoco import SHORTEST, compiled
    from .peers.parts import has_simple_joints

    if not has_simple_joints(mechanism) or any(c.kind not in ("3d", "revolute") for c in mechanism.closures):
        raise ValueError("joints or closures that the adapter to MuJoCo has not")
    model = compiled(mechanism, "RK4", True)
    model.opt.timestep = step
    model.eq_solref[:] = (SHORTEST * step, 1.0)
    data = [mujoco.MjData(model) for _ in range(threads)]
    states = np.array([np.concatenate([[0.0], real_array(q), real_array(v)]) for q, v in starts])

    def run() -> None:
        rollout.rollout(model, data, states, nstep=steps)

    return run
