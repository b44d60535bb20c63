"""What a contender in the work-precision study offers: our methods and other tools alike."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from .. import JointFriction, Mechanism, Stop
from ..mechanism.tree.tree import Array

Kind = Literal["fixed", "adaptive"]

clock = time.process_time
"""s of processor time: what else a machine does is not in it. All contenders have one thread."""


@dataclass(frozen=True)
class Scene:
    """A motion to reproduce."""

    name: str
    mechanism: Mechanism
    # q0 (nq,), v0 (nv,): a closed start with K v0 = 0
    q0: Array
    v0: Array
    times: Array  # (401,): output times, equally spaced from 0, s. Fixed steps divide their spacing
    joints: tuple[Stop | JointFriction, ...] = ()


@dataclass
class Outcome:
    """One run of a contender."""

    # q (n, nq), v (n, nv): in the spanning tree's joints at the first n of the scene's times; n < 401 when it
    # stopped early
    q: Array
    v: Array
    # processor time of stepping alone: without imports, loading, or reading the state out afterwards
    seconds: float
    rhs: int  # evaluations of the equations of motion (or of the engine's step) during these
    stopped: str = ""  # why it ended before the last time; empty when it did not

    def error(self, exact: Array) -> float:
        """Largest difference of a joint from the exact q; infinite where the run stopped early."""
        return float(np.abs(self.q - exact).max()) if len(self.q) == len(exact) else np.inf


BOUND = 1e8
"""A coordinate or velocity beyond it, in SI units, has left every scene here: the run has blown up."""


def division(scene: Scene, step: float) -> tuple[int, float]:
    """How many equal steps lie between two outputs, and their length, s: the nearest to `step`."""
    spacing = float(scene.times[-1]) / (len(scene.times) - 1)
    count = max(1, round(spacing / step))
    return count, spacing / count


def reached(
    scene: Scene, states: Iterable[tuple[Array, Array]], seconds: float, rhs: int,
    why: str = "the state left the finite numbers",
) -> Outcome:  # fmt: skip
    """The start and the states (q, v) after it, until the run has blown up.

    Where some are missing, `why` with the time at which the first is.
    """
    kept = [(scene.q0, scene.v0)]
    for q, v in states:
        if not (np.abs(q).max() < BOUND and np.abs(v).max() < BOUND):  # so written for NaN's sake
            break
        kept.append((q, v))
    n = len(kept)
    stopped = "" if n == len(scene.times) else f"{why} before t = {scene.times[n]:.6g} s"
    return Outcome(np.array([q for q, _ in kept]), np.array([v for _, v in kept]), seconds, rhs, stopped)


class Contender(Protocol):
    """A method or tool that can run scenes."""

    name: str  # short and unique, as in legends: "bridge", "MuJoCo connect, tuned"
    family: str  # "ours", "implicit", "Pinocchio", "MuJoCo", "Exudyn": colours and panels
    stepper: str  # "rk4", "DOP853", …, or the tool's own
    kind: Kind  # what the ladder's settings mean: a step in s, or a relative tolerance
    tuning: str  # one sentence: model and parameters, as printed in the report

    def refuses(self, scene: Scene) -> str:
        """Why this contender cannot run this scene; empty when it can."""
        ...

    def run(self, scene: Scene, setting: float) -> Outcome:
        """Run the scene with this step (s) or relative tolerance.

        Whatever can be prepared once a scene (models, compiled code) is cached on the contender, so that
        a second call times stepping only.
        """
        ...
