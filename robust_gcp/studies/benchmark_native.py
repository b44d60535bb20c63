"""What a step of the compiled kernel costs, beside Pinocchio's own algorithms called from C++."""

from __future__ import annotations

import threading
import time

import numpy as np

from ..dynamics.equations import Evaluation
from ..dynamics.problem import set_out
from ..maps.cluster.options import BridgeOptions
from ..mechanism.mechanism import Mechanism
from ..native.library import Library, library
from ..native.workspace import Outputs, Workspace

ROUNDS = 50
"""Of each measurement; the smallest counts, that is the one least disturbed by other processes."""


class Batches:
    """The same batch of steps of one mechanism, again and again in one workspace.

    Parameters
    ----------
    mechanism : Mechanism
        Starts at home, at rest.
    steps : int
    h : float
        s.
    """

    def __init__(self, found: Library, mechanism: Mechanism, steps: int, h: float) -> None:
        motion = set_out(mechanism)
        self._x = motion.x
        self._now: Evaluation = motion.equations.evaluate(0.0, self._x)
        self._times = h * np.arange(steps + 1)
        self._outputs = Outputs.room(steps, mechanism.nq, mechanism.nv)
        self.workspace = Workspace(found, mechanism, motion.start.path)

    def run(self) -> tuple[float, float]:
        """Seconds per step and Newton iterations per right-hand side of one batch.

        Raises
        ------
        RuntimeError
            When the kernel stopped before the end.
        """
        begun = time.perf_counter()
        batch = self.workspace.run(self._times, self._x, self._now, self._outputs, BridgeOptions().zone)
        spent = time.perf_counter() - begun
        steps = len(self._times) - 1
        if batch.steps < steps:
            raise RuntimeError(f"the kernel stopped after {batch.steps} steps: {batch.reason.name}")
        return spent / steps, batch.counts["newton_iterations"] / batch.counts["rhs"]


def native_seconds(mechanism: Mechanism, h: float = 1e-4) -> dict[str, float]:
    """Seconds per RK4 step in the kernel and per right-hand side of Pinocchio's C++; empty without it."""
    found = library()
    if found is None:
        return {}
    batches = Batches(found, mechanism, max(20, 1000 // mechanism.nv), h)  # some ms
    rounds = [batches.run() for _ in range(ROUNDS)]
    v = mechanism.lift(mechanism.home, np.ones(mechanism.m))
    repeats = max(5, 2000 // mechanism.nv)
    return {
        "native_step": min(seconds for seconds, _ in rounds),
        "native_newton": rounds[0][1],
        "pinocchio_rhs": min(
            batches.workspace.time_pinocchio(mechanism.home, v, repeats) for _ in range(ROUNDS // 5)
        ),
    }


def thread_gain(mechanism: Mechanism, threads: int = 2, steps: int = 20_000, h: float = 1e-5) -> float:
    """How many times the work of one thread `threads` threads do in the same time, best of rounds."""
    found = library()
    if found is None:
        return float("nan")
    batches = [Batches(found, mechanism, steps, h) for _ in range(threads)]

    def seconds(workers: list[Batches]) -> float:
        running = [threading.Thread(target=worker.run) for worker in workers]
        begun = time.perf_counter()
        for thread in running:
            thread.start()
        for thread in running:
            thread.join()
        return time.perf_counter() - begun

    alone = min(seconds(batches[:1]) for _ in range(ROUNDS // 3))
    return threads * alone / min(seconds(batches) for _ in range(ROUNDS // 3))
