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
    """A column of a map: how a case is simulated.

    Attributes
    ----------
    method : {"bridge", "projection", "classical", "closed_form"}
    stepper : str
        "rk4" or one of SciPy's.
    step : float
        Of rk4, else the spacing of the output, s.
    rtol, atol : float
        Of the adaptive steppers.
    name : str
        Heading of the column; made from the others when empty.
    """

    method: Method = "bridge"
    stepper: str = "rk4"
    step: float = 1e-3
    rtol: float = 1e-8
    atol: float = 1e-10
    name: str = ""

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

    Attributes
    ----------
    family, name : str
        The map, and the row's short label, e.g. "k = 1e6".
    build : callable () -> (mechanism, q0, v0)
        May raise a RobustGcpError, which makes all cells of the row stopped ("refused").
    duration : float
        s.
    settings : tuple of Setting
    allowed : float, callable (Setting) -> float, or None
        Largest error of q over the run, rad or m. None: the error is not judged.
    reference : callable (t) -> q (len(t), nq), or None
        The truth. None: errors are found by a second run, with half the step or a hundredth of the
        tolerances (self-convergence).
    energy_allowed : float, callable or None
        Largest |energy error|, relative to `energy_scale`.
    energy_scale : float or None
        J; None: the range of the kinetic energy over the run.
    closure_allowed : float
        Largest max |φ| in characteristic lengths of the mechanism.
    crossings : int or None
        How many must be logged; None: any number.
    mode_kept : callable (q (n, nq)) -> bool, or None
        Whether the motion stayed on its operation mode.
    torque : callable (t, q, v) -> (nv,), or None
    more : mapping
        Further arguments of `simulate`, such as mode or on_toggle.
    note : str
        What the row shows, for the report.
    """

    family: str
    name: str
    build: Callable[[], tuple[Mechanism, Array, Array]]
    duration: float
    settings: tuple[Setting, ...]
    allowed: Allowed | None
    reference: Callable[[Array], Array] | None = None
    energy_allowed: Allowed | None = None
    energy_scale: float | None = None
    closure_allowed: float = 1e-9
    crossings: int | None = None
    mode_kept: Callable[[Array], bool] | None = None
    torque: Torque | None = None
    more: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""


Families = dict[str, Callable[[bool], list[Case]]]


@dataclass
class Cell:
    """What came out of a case with a setting.

    Attributes
    ----------
    verdict : {"right", "stopped", "wrong"}
    error : float
        Largest error of q, rad or m; NaN where it is unknown.
    energy_drift : float
        Largest |energy error| relative to the energy scale.
    closure_error : float
        Largest max |φ| in characteristic lengths.
    crossings : int
    mode_kept : bool or None
        None where the case does not say how to tell.
    reason : str
        Why it stopped, or what is wrong; empty when right.
    rhs : int
        Right-hand sides evaluated.
    seconds : float
        Wall time of the run.
    """

    case: Case
    setting: Setting
    verdict: Verdict
    error: float = float("nan")
    energy_drift: float = float("nan")
    closure_error: float = float("nan")
    crossings: int = 0
    mode_kept: bool | None = None
    reason: str = ""
    rhs: int = 0
    seconds: float = 0.0
