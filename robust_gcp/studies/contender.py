"""What a contender in the work-precision study offers: our methods and other tools alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array

Kind = Literal["fixed", "adaptive"]


@dataclass(frozen=True)
class Scene:
    """A motion to reproduce."""

    name: str
    mechanism: Mechanism
    # q0 (nq,), v0 (nv,): a closed start with K v0 = 0
    q0: Array
    v0: Array
    times: Array  # (401,): output times, equally spaced from 0, s. Fixed steps divide their spacing


@dataclass
class Outcome:
    """One run of a contender."""

    # q (n, nq), v (n, nv): in the spanning tree's joints at the first n of the scene's times; n < 401 when it
    # stopped early
    q: Array
    v: Array
    # wall time of stepping alone: without imports, loading, or reading the state out afterwards
    seconds: float
    rhs: int  # evaluations of the equations of motion (or of the engine's step) during these
    stopped: str = ""  # why it ended before the last time; empty when it did not


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
