"""The package's own methods as contenders: `simulate`, the implicit equations (2), and the floor."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ... import Mechanism, OptionError, SimulationError, backends, simulate
from ...maps.choice import Method
from ...maps.classical import NewtonStart, SingularityWarning
from ...maps.four_bar import draw_four_bar
from ...mechanism.tolerances import STRUCTURAL
from ...mechanism.tree.tree import Array
from ..contender import Contender, Kind, Outcome, Scene, clock
from ..stepping import stepped
from .reduced import Reduced

FIXED = "rk4"
FLOOR = "floor"


def named(what: str, stepper: str) -> str:
    """With its stepper."""
    return f"{what}, {'RK4' if stepper == FIXED else stepper}"


def kind_of(stepper: str) -> Kind:
    """What its settings mean."""
    return "fixed" if stepper == FIXED else "adaptive"


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
        self.kind = kind_of(self.stepper)

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


# --------------------------------------------------------------------------- the implicit equations

RATES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""What α = β is scanned over, in units of 1/(T/10): from slower than the motion to much faster."""

LARGEST_SCANNED = 30

SCAN_STEPS = 2
"""Steps in each output interval during the scan."""


class Equations:
    """[[M, Kᵀ], [K, 0]] [a; −λ] = [τ − C; k − 2 α K v − α² φ] for the state (q, v); α in 1/s.

    Solved directly into a matrix that is allocated once; by least norm where K has redundant rows
    everywhere, or the matrix is singular. The mechanism has one number in q for each in v.
    """

    def __init__(self, mechanism: Mechanism, gain: float, redundant: bool) -> None:
        n, c = mechanism.nv, mechanism.nc
        self._mechanism, self._gain, self._redundant = mechanism, gain, redundant
        self._matrix, self._right = np.zeros((n + c, n + c)), np.zeros(n + c)
        self.calls = 0

    def __call__(self, t: float, x: Array) -> Array:
        """(v, a)."""
        mechanism, tree, n = self._mechanism, self._mechanism.tree, self._mechanism.nv
        q, v = x[:n], x[n:]
        if not np.all(np.isfinite(x)):
            raise SimulationError(f"not finite at t = {t:.6g} s")
        self.calls += 1
        matrix, right = self._matrix, self._right
        tree.jacobians(q)
        K = mechanism.implicit.jacobian()
        residual = mechanism.implicit.residual() if self._gain else None
        matrix[n:, :n], matrix[:n, n:] = K, K.T
        right[:n] = -tree.rnea(q, v, tree.zero)
        right[n:] = mechanism.implicit.bias()
        if residual is not None:
            right[n:] -= 2.0 * self._gain * (K @ v) + self._gain**2 * residual
        if mechanism.applied is not None:
            right[:n] += mechanism.applied.torque_at(q, v)[0]
        matrix[:n, :n] = tree.crba(q)
        return np.concatenate([v, self._solve()[:n]])

    def _solve(self) -> Array:
        if not self._redundant:
            try:
                solution = np.linalg.solve(self._matrix, self._right)
            except np.linalg.LinAlgError:
                pass
            else:
                if np.all(np.isfinite(solution)):
                    return solution
        least: Array = np.linalg.lstsq(self._matrix, self._right, rcond=STRUCTURAL)[0]
        return least


class Implicit:
    """Eq. (2) in all joints of the tree, with a fixed gain α = β of Baumgarte, 1/s."""

    family = "implicit"

    def __init__(self, name: str, stepper: str, gain: float = 0.0) -> None:
        self.name, self.stepper, self.kind, self._gain = name, stepper, kind_of(stepper), gain
        self.tuning = "no stabilisation; direct solve, least norm where singular"
        if gain:
            equal = f"α = β = {gain:g}/s (critically damped, the usual default)"
            self.tuning = f"k − 2 α K v − β² φ with {equal}"

    def refuses(self, scene: Scene) -> str:
        """A tree has no closure to stabilise; joints with more numbers in q than in v are not covered."""
        if scene.mechanism.nc == 0 and self._gain:
            return "no loop: nothing to stabilise"
        return "" if scene.mechanism.nq == scene.mechanism.nv else "q is no vector"

    def gain(self, scene: Scene) -> float:
        """α = β, 1/s."""
        return self._gain

    def run(self, scene: Scene, setting: float) -> Outcome:
        """The step in s, or rtol = atol."""
        gain = self.gain(scene)
        s = np.linalg.svd(scene.mechanism.K(scene.q0), compute_uv=False)
        rate = Equations(scene.mechanism, gain, bool(np.any(s <= STRUCTURAL * s.max(initial=0.0))))
        x, n = np.concatenate([scene.q0, scene.v0]), scene.mechanism.nv
        states, seconds, stopped = stepped(rate, x, scene.times, self.stepper, setting)
        return Outcome(states[:, :n], states[:, n:], seconds, rate.calls, stopped)


class TunedImplicit(Implicit):
    """Eq. (2) with the gain that errs least on the very scene, whose q is exact(scene): found by a scan."""

    def __init__(self, name: str, stepper: str, exact: Callable[[Scene], Array]) -> None:
        super().__init__(name, stepper)
        self._exact, self._best = exact, dict[str, float]()
        self.tuning = (
            f"α = β scanned on each scene with RK4 over {RATES[0]:g} … {RATES[-1]:g} times 10/T, "
            "the least path-wise error is taken"
        )

    def refuses(self, scene: Scene) -> str:
        """As without tuning, and mechanisms whose scan would take longer than all else."""
        if scene.mechanism.nc == 0:
            return "no loop: nothing to stabilise"
        if scene.mechanism.nv > LARGEST_SCANNED:
            return f"gains are scanned on mechanisms of at most {LARGEST_SCANNED} joints"
        return super().refuses(scene)

    def gain(self, scene: Scene) -> float:
        """The best of the scan, kept for the scene."""
        if scene.name not in self._best:
            exact, step = self._exact(scene), float(scene.times[1]) / SCAN_STEPS

            def error(gain: float) -> float:
                return Implicit(self.name, FIXED, gain).run(scene, step).error(exact)

            self._best[scene.name] = min((10.0 / float(scene.times[-1]) * rate for rate in RATES), key=error)
        return self._best[scene.name]


# --------------------------------------------------------------------------- the floor


class Floor:
    """A stepper on the exact reduced equations of a scene.

    Its error is what is left when γ, G and g are exact: no method with this stepper, this setting and
    these coordinates errs less but by luck. Its seconds are those of a few scalar operations.
    """

    family = FLOOR
    tuning = "the stepper on the hand-written reduced equation"

    def __init__(self, stepper: str, reduced: Reduced | None) -> None:
        self.name, self.stepper, self.kind = named(FLOOR, stepper), stepper, kind_of(stepper)
        self._reduced = reduced

    def refuses(self, scene: Scene) -> str:
        """Robots have no exact equation of their coordinates."""
        return "" if self._reduced else "no exact equation of its coordinates is known"

    def run(self, scene: Scene, setting: float) -> Outcome:
        """The step in s, or rtol = atol."""
        reduced, calls = self._reduced, [0]
        assert reduced is not None  # see `refuses`

        def rate(t: float, x: Array) -> Array:
            calls[0] += 1
            if not np.all(np.isfinite(x)):
                raise SimulationError(f"not finite at t = {t:.6g} s")
            return reduced.rate(t, x)

        states, seconds, stopped = stepped(rate, reduced.x0, scene.times, self.stepper, setting)
        q, v = (np.array(part) for part in zip(*map(reduced.read, states), strict=True))
        return Outcome(q, v, seconds, calls[0], stopped)


# --------------------------------------------------------------------------- all

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
    found += [Implicit("KKT (2) Baumgarte, RK4", FIXED, 10.0)]
    found += [TunedImplicit("KKT (2) Baumgarte tuned, RK4", FIXED, exact)]
    found += [TunedImplicit("KKT (2) Baumgarte tuned, DOP853", "DOP853", exact)]
    return found
