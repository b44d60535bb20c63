"""What a contender in the work-precision study offers: our methods and other tools alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from ..mechanism.mechanism import Mechanism
from ..mechanism.tree import Array

Kind = Literal["fixed", "adaptive"]


@dataclass(frozen=True)
class Scene:
    """A motion to reproduce.

    Attributes
    ----------
    name : str
    mechanism : Mechanism
    q0, v0 : ndarray (nq,), (nv,)
        A closed start with K v0 = 0.
    times : ndarray (401,)
        Output times, equally spaced from 0, s. Fixed steps divide their spacing.
    """

    name: str
    mechanism: Mechanism
    q0: Array
    v0: Array
    times: Array


@dataclass
class Outcome:
    """One run of a contender.

    Attributes
    ----------
    q, v : ndarray (n, nq), (n, nv)
        In the spanning tree's joints at the first n of the scene's times; n < 401 when it stopped early.
    seconds : float
        Wall time of stepping alone: without imports, loading, or reading the state out afterwards.
    rhs : int
        Evaluations of the equations of motion (or of the engine's step) during these.
    stopped : str
        Why it ended before the last time; empty when it did not.
    """

    q: Array
    v: Array
    seconds: float
    rhs: int
    stopped: str = ""


class Contender(Protocol):
    """A method or tool that can run scenes.

    Attributes
    ----------
    name : str
        Short and unique, as in legends: "bridge", "MuJoCo connect, tuned".
    family : str
        "ours", "implicit", "Pinocchio", "MuJoCo", "Exudyn": colours and panels.
    stepper : str
        "rk4", "DOP853", …, or the tool's own.
    kind : {"fixed", "adaptive"}
        What the ladder's settings mean: a step in s, or a relative tolerance.
    tuning : str
        One sentence: model and parameters, as printed in the report.
    """

    name: str
    family: str
    stepper: str
    kind: Kind
    tuning: str

    def refuses(self, scene: Scene) -> str:
        """Why this contender cannot run this scene; empty when it can."""
        ...

    def run(self, scene: Scene, setting: float) -> Outcome:
        """Run the scene with this step (s) or relative tolerance.

        Whatever can be prepared once a scene (models, compiled code) is cached on the contender, so that
        a second call times stepping only.
        """
        ...
