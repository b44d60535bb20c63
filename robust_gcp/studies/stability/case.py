"""What the stability study runs: a case is a row of a map, a setting a column, a cell what came out.

A module of cases offers `FAMILIES: dict[str, Callable[[bool], list[Case]]]`: for each family a
function of `quick` (a short excerpt) that lists its cases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ...dynamics.equations import Torque
from ...maps.choice import Method
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array

Verdict = Literal["right", "stopped", "wrong"]


@dataclass(frozen=True)
class Setting:
    """A column of a map: how a case is simulated."""

    method: Method = "bridge"
    stepper: str = "rk4"  # "rk4" or one of SciPy's
    step: float = 1e-3  # of rk4, else the spacing of the output, s
    # rtol, atol: of the adaptive steppers
    rtol: float = 1e-8
    atol: float = 1e-10
    name: str = ""  # heading of the column; made from the others when empty

    @property
    def label(self) -> str:
        """Heading of the column; cells of one family with the same label share it."""
        if self.name:
            return self.name
        stepper = f"RK4 {self.step:g} s" if self.stepper == "rk4" else f"{self.stepper} {self.rtol:g}"
        return stepper if self.method == "bridge" else f"{stepper} {self.method}"


Allowed = float | Callable[[Setting], float]
"""A bound, or one that depends on the column, such as C h⁴."""


@dataclass(frozen=True)
class Case:
    """A row of a map.

    A cell is right when each figure that the case bounds is within its bound; stopped when a typed
    error came, or a warning told of it beforehand; else wrong.
    """

    # family, name: the map, and the row's short label, e.g. "k = 1e6"
    family: str
    name: str
    # () -> (mechanism, q0, v0): may raise a RobustGcpError, which makes all cells of the row stopped
    # ("refused")
    build: Callable[[], tuple[Mechanism, Array, Array]]
    duration: float  # s
    settings: tuple[Setting, ...]
    allowed: Allowed | None  # largest error of q over the run, rad or m. None: the error is not judged
    # (t) -> q (len(t), nq), or None: the truth. None: errors are found by a second run, with half the step or
    # a hundredth of the tolerances (self-convergence)
    reference: Callable[[Array], Array] | None = None
    energy_allowed: Allowed | None = None  # largest |energy error|, relative to `energy_scale`
    energy_scale: float | None = None  # J; None: the range of the kinetic energy over the run
    closure_allowed: float = 1e-9  # largest max |φ| in characteristic lengths of the mechanism
    crossings: int | None = None  # how many must be logged; None: any number
    # (q (n, nq)) -> bool, or None: whether the motion stayed on its operation mode
    mode_kept: Callable[[Array], bool] | None = None
    torque: Torque | None = None  # (t, q, v) -> (nv,), or None
    # further arguments of `simulate`, such as mode or on_toggle
    more: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""  # what the row shows, for the report


Families = dict[str, Callable[[bool], list[Case]]]


@dataclass
class Cell:
    """What came out of a case with a setting."""

    case: Case
    setting: Setting
    verdict: Verdict
    error: float = float("nan")  # largest error of q, rad or m; NaN where it is unknown
    energy_drift: float = float("nan")  # largest |energy error| relative to the energy scale
    closure_error: float = float("nan")  # largest max |φ| in characteristic lengths
    crossings: int = 0
    mode_kept: bool | None = None  # None where the case does not say how to tell
    reason: str = ""  # why it stopped, or what is wrong; empty when right
    rhs: int = 0  # right-hand sides evaluated
    seconds: float = 0.0  # wall time of the run
