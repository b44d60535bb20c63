"""The package's own methods as contenders: `simulate` with a method, a stepper and a backend."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ... import OptionError, SimulationError, backends, simulate
from ...maps.choice import Method
from ...maps.classical import NewtonStart, SingularityWarning
from ...maps.four_bar import draw_four_bar
from ...mechanism.tree.tree import Array
from ..contender import Contender, Kind, Outcome, Scene, clock
from .floor import named
from .implicit import Implicit, TunedImplicit

FIXED = "rk4"


@dataclass
class Ours:
    """`simulate` as a contender."""

    name: str
    family: str
    method: Method
    stepper: str
    tuning: str
    newton_start: NewtonStart = "tangent"  # of the classical method
    backend: Literal["auto", "python", "native"] = "python"  # of `simulate`
    kind: Kind = field(init=False)

    def __post_init__(self) -> None:
        self.kind = "fixed" if self.stepper == FIXED else "adaptive"

    def refuses(self, scene: Scene) -> str:
        """No loop: all methods are one; the closed form: planar four-bars only."""
        mechanism = scene.mechanism
        if mechanism.nc == 0 and self.method != "bridge":
            return "no loop: all explicit maps are the same"
        if scene.joints and (self.method != "bridge" or self.kind != "fixed"):
            return "stops and friction go with fixed steps and the bridge"
        if self.method == "closed_form":
            try:
                draw_four_bar(mechanism)
            except OptionError:
                return "the closed form is for planar four-bars"
        if self.backend == "native":
            try:  # one step
                simulate(mechanism, scene.q0, scene.v0, 1e-6, 1e-6, method=self.method, backend="native")
            except OptionError as error:
                return str(error)
        return ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        """The step in s, or rtol = atol."""
        outputs = scene.times
        every, step = 1, float(outputs[1])
        options: dict[str, Any] = {"stepper": self.stepper, "rtol": setting, "atol": setting}
        if self.kind == "fixed":
            every, step, options = round(step / setting), setting, {"stepper": FIXED}
        options |= {"method": self.method, "newton_start": self.newton_start, "backend": self.backend}
        options["joints"] = list(scene.joints) or None
        stopped = ""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SingularityWarning)
            begun = clock()
            try:
                run = simulate(scene.mechanism, scene.q0, scene.v0, float(outputs[-1]), step, **options)
            except SimulationError as error:
                if error.trajectory is None:
                    raise
                run, stopped = error.trajectory, f"{type(error).__name__}: {error}"
            seconds = clock() - begun
        at: slice | Array = slice(None, None, every)
        if scene.joints or stopped:  # outputs around events too
            at = nearest(run.t, outputs[outputs <= run.t[-1]])
        return Outcome(run.q[at], run.v[at], seconds, run.stats.rhs, stopped)


def nearest(t: Array, times: Array) -> Array:
    """Which of the ascending t lie nearest to these times."""
    after = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    return np.asarray(after - (times - t[after - 1] < t[after] - times))


COMPILED = "bridge compiled, RK4"
DEFAULTS = "no gains, no thresholds: the defaults"
EXACT = "γ, G and g of the planar four-bar in closed form, M and C from Pinocchio"
PUBLISHED = "rank threshold 1e-3, g = 0 at the singularity, as published"
PREVIOUS = "Newton on the dependent joints from the previous ones, as published"
PREDICTED = "Newton on the dependent joints from the tangent's prediction"
OURS: tuple[tuple[str, str, Method, str, tuple[str, ...], dict[str, Any]], ...] = (
    ("bridge", "bridge", "bridge", DEFAULTS, (FIXED, "DOP853", "Radau", "LSODA"), {}),
    ("bridge compiled", "bridge", "bridge", DEFAULTS, (FIXED,), {"backend": "native"}),
    ("closed form", "closed form", "closed_form", EXACT, (FIXED, "DOP853"), {}),
    ("Eq. (7)", "published", "projection", PUBLISHED, (FIXED, "DOP853"), {}),
    ("classical GCP", "published", "classical", PREVIOUS, (FIXED,), {"newton_start": "previous"}),
    ("classical GCP, tangent", "published", "classical", PREDICTED, (FIXED, "DOP853"), {}),
)
"""Name before the stepper, family, method, tuning, steppers and other settings; in the legend's order."""


def contenders(exact: Callable[[Scene], np.ndarray]) -> list[Contender]:
    """Ours and the implicit equations, in the order of the legend; gains are tuned by a scene's exact q."""
    found: list[Contender] = []
    for name, family, method, tuning, steppers, more in OURS:
        if backends()[more.get("backend", "python")].available:
            found += [Ours(named(name, s), family, method, s, tuning, **more) for s in steppers]
    found += [Implicit("KKT (2), RK4", FIXED), Implicit("KKT (2), DOP853", "DOP853")]
    found += [Implicit("KKT (2) Baumgarte, RK4", FIXED, (10.0, 10.0))]
    found += [TunedImplicit("KKT (2) Baumgarte tuned, RK4", FIXED, exact)]
    found += [TunedImplicit("KKT (2) Baumgarte tuned, DOP853", "DOP853", exact)]
    return found
