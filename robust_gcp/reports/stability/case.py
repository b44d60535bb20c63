"""What the stability study runs: a case is a row of a map, a setting a column, a cell what came out.

A module of cases offers `FAMILIES: dict[str, Callable[[bool], list[Case]]]`: for each family a
function of `quick` (a short excerpt) that lists its cases.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ... import Mechanism, Stats
from ...maps.choice import Method
from ...mechanism.tree.tree import Array

Verdict = Literal["right", "coarse", "stopped", "wrong"]
Start = tuple[Mechanism, Array, Array]
"""Mechanism, q0 and v0."""


@dataclass(frozen=True)
class Setting:
    """A column of a map: how a case is simulated."""

    method: Method = "bridge"
    stepper: str = "rk4"  # "rk4" or one of SciPy's
    step: float = 1e-3  # of rk4, else the spacing of the output, s
    # rtol, atol: of the adaptive steppers
    rtol: float = 1e-8
    atol: float = 1e-10
    name: str = ""  # heading of the column; made from stepper and step or tolerance when empty

    @property
    def options(self) -> dict[str, Any]:
        """As `simulate` takes it."""
        named = {name: getattr(self, name) for name in ("step", "method", "stepper", "rtol", "atol")}
        return {**named, "on_toggle": "error"}  # truths are functions of y, which ends where y turns back

    @property
    def finer(self) -> Setting:
        """Half the step; a hundredth of the tolerances, as far as rounding permits."""
        if self.stepper == "rk4":
            return replace(self, step=0.5 * self.step)
        return replace(self, rtol=max(1e-2 * self.rtol, 3e-14), atol=1e-2 * self.atol)

    @property
    def label(self) -> str:
        """Heading of the column; cells of one family with the same label share it."""
        if self.name:
            return self.name
        return f"RK4 {self.step:g} s" if self.stepper == "rk4" else f"{self.stepper} {self.rtol:g}"


Allowed = float | Callable[[Setting, Stats], float]
"""A bound, or one that depends on the column, such as C h⁴, and on the steps that the run took."""


@dataclass(frozen=True)
class Case:
    """A row of a map.

    A cell is right when each figure that the case bounds is within its bound and it errs by at most
    `judge.RIGHT`; coarse when it errs by more than that and within the bound: as the same stepper with the
    same step does on the exact equation; stopped when a typed error came, or a warning told of it beforehand;
    else wrong.
    """

    # family, name: the map, and the row's short label, e.g. "k = 1e6"
    family: str
    name: str
    # () -> (mechanism, q0, v0): may raise a RobustGcpError, which makes all cells of the row stopped
    # ("refused")
    build: Callable[[], Start]
    duration: float  # s
    settings: tuple[Setting, ...]
    allowed: Allowed | None  # largest error of q over the run, rad or m. None: the error is not judged
    # (t) -> q (len(t), nq), or None: the truth. None: errors are found by a second run, with half the step or
    # a hundredth of the tolerances (self-convergence)
    reference: Callable[[Array], Array] | None = None
    energy_allowed: float | None = None  # largest |energy error|, relative to `energy_scale`
    energy_scale: float | None = None  # J; None: the range of the kinetic energy over the run
    closure_allowed: float = 1e-9  # largest max |φ| in characteristic lengths of the mechanism
    crossings: int | None = None  # how many must be logged; None: any number
    # (q (n, nq)) -> bool, or None: whether the motion stayed on its operation mode
    mode_kept: Callable[[Array], bool] | None = None
    # further arguments of `simulate`, such as mode, torque or on_toggle
    more: Mapping[str, Any] = field(default_factory=dict)


Family = Callable[[bool], list[Case]]
Families = dict[str, Family]
row = functools.partial(Case, "")
"""A case whose family is told by `family`."""


def family(name: str, into: Families) -> Callable[[Callable[[bool], Iterable[Case]]], Family]:
    """Make a generator of rows the function that lists them as cases of a family, and enter it."""

    def enter(rows: Callable[[bool], Iterable[Case]]) -> Family:
        @functools.wraps(rows)
        def cases(quick: bool) -> list[Case]:
            return [replace(case, family=name) for case in rows(quick)]

        into[name] = cases
        return cases

    return enter


def at_rest(mechanism: Mechanism) -> Start:
    """At home, without motion."""
    return mechanism, mechanism.home, np.zeros(mechanism.nv)


def made(start: Start) -> Callable[[], Start]:
    """Builds what is there."""
    return lambda: start


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
