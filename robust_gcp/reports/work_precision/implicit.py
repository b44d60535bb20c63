"""The implicit equations (2) as a contender, without and with Baumgarte's stabilisation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ... import Mechanism, SimulationError
from ...mechanism.tolerances import STRUCTURAL
from ...mechanism.tree.tree import Array
from ..contender import Kind, Outcome, Scene
from ..stepping import stepped

RATES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""What α = β is scanned over, in units of 1/(T/10): from slower than the motion to much faster."""

LARGEST_SCANNED = 30

SCAN_STEPS = 2
"""Steps in each output interval during the scan."""


class Equations:
    """[[M, Kᵀ], [K, 0]] [a; −λ] = [τ − C; k − 2 α K v − β² φ] for the state (q, v); α and β in 1/s.

    Solved directly into a matrix that is allocated once; by least norm where K has redundant rows
    everywhere, or the matrix is singular. The mechanism has one number in q for each in v.
    """

    def __init__(self, mechanism: Mechanism, alpha: float, beta: float, redundant: bool) -> None:
        n, c = mechanism.nv, mechanism.nc
        self._mechanism, self._gains, self._redundant = mechanism, (2.0 * alpha, beta**2), redundant
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
        residual = mechanism.implicit.residual() if any(self._gains) else None
        matrix[n:, :n], matrix[:n, n:] = K, K.T
        right[:n] = -tree.rnea(q, v, tree.zero)
        right[n:] = mechanism.implicit.bias()
        if residual is not None:
            right[n:] -= self._gains[0] * (K @ v) + self._gains[1] * residual
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
    """Eq. (2) in all joints of the tree, with fixed gains α, β of Baumgarte, 1/s."""

    family = "implicit"

    def __init__(self, name: str, stepper: str, gains: tuple[float, float] = (0.0, 0.0)) -> None:
        self.name, self.stepper, self._gains = name, stepper, gains
        self.kind: Kind = "fixed" if stepper == "rk4" else "adaptive"
        self.tuning = "no stabilisation; direct solve, least norm where singular"
        if any(gains):
            equal = f"α = β = {gains[0]:g}/s (critically damped, the usual default)"
            self.tuning = f"k − 2 α K v − β² φ with {equal}"

    def refuses(self, scene: Scene) -> str:
        """A tree has no closure to stabilise; joints with more numbers in q than in v are not covered."""
        if scene.mechanism.nc == 0 and any(self._gains):
            return "no loop: nothing to stabilise"
        return "" if scene.mechanism.nq == scene.mechanism.nv else "q is no vector"

    def gains(self, scene: Scene) -> tuple[float, float]:
        """α and β, 1/s."""
        return self._gains

    def run(self, scene: Scene, setting: float) -> Outcome:
        """The step in s, or rtol = atol."""
        return self.run_with(scene, setting, self.gains(scene))

    def run_with(self, scene: Scene, setting: float, gains: tuple[float, float]) -> Outcome:
        """A run with the given gains."""
        s = np.linalg.svd(scene.mechanism.K(scene.q0), compute_uv=False)
        rate = Equations(scene.mechanism, *gains, bool(np.any(s <= STRUCTURAL * s.max(initial=0.0))))
        x, n = np.concatenate([scene.q0, scene.v0]), scene.mechanism.nv
        states, seconds, stopped = stepped(rate, x, scene.times, self.stepper, setting)
        return Outcome(states[:, :n], states[:, n:], seconds, rate.calls, stopped)


class TunedImplicit(Implicit):
    """Eq. (2) with the gains that err least on the very scene, whose q is exact(scene): found by a scan."""

    def __init__(self, name: str, stepper: str, exact: Callable[[Scene], Array]) -> None:
        super().__init__(name, stepper)
        self._exact, self._best = exact, dict[str, tuple[float, float]]()
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

    def gains(self, scene: Scene) -> tuple[float, float]:
        """The best of the scan, kept for the scene."""
        if scene.name not in self._best:
            exact, scan = self._exact(scene), Implicit(self.name, "rk4")
            step, unit = float(scene.times[1]) / SCAN_STEPS, 10.0 / float(scene.times[-1])

            def error(gain: float) -> float:
                q = scan.run_with(scene, step, (gain, gain)).q
                return float(np.abs(q - exact).max()) if len(q) == len(exact) else np.inf

            best = min((factor * unit for factor in RATES), key=error)
            self._best[scene.name] = (best, best)
        return self._best[scene.name]
