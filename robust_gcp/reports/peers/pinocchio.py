"""Pinocchio's constrained dynamics on the spanning tree, in a C++ loop of the classical Runge-Kutta method.

Closures are rigid constraint models: CONTACT_3D for a point, CONTACT_6D for a frame, and for a cut revolute
joint two points on its axis. Springs, dampers and drives are computed in the loop. A tree without loops is
run by `aba`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from ...mechanism.tree.tree import Array
from ..contender import Contender, Kind, Outcome, Scene, clock, division, reached
from .compiled import Loop, Settings, knows, why_not

Omega = Callable[[Scene, float], float]
"""(scene, step) -> ω of the Baumgarte terms ω² and 2 ω (critical damping), 1/s."""

ADAPTED = ("3d", "6d", "revolute")
"""Closures that Pinocchio has rigid constraint models for."""


@dataclass
class ConstraintDynamics:
    """`constraintDynamics`, or another of Pinocchio's algorithms, with RK4."""

    name: str
    tuning: str
    omega: Omega
    how: Settings
    family: str = "Pinocchio"
    stepper: str = "rk4"
    kind: Kind = "fixed"

    def refuses(self, scene: Scene) -> str:
        """Why not: joints or closures that the loop has not, or a repetition without loops."""
        mechanism = scene.mechanism
        if scene.joints:
            return "Pinocchio has no stops and no dry friction"
        if not knows(mechanism):
            return "the adapter knows revolute, prismatic and spherical joints and free-flyers"
        if any(closure.kind not in ADAPTED for closure in mechanism.closures):
            return "the adapter closes points, frames and hinges"
        if not mechanism.closures and self.name != DEFAULTS:
            return f"no loop to close, so it is the same as {DEFAULTS!r}"
        why = why_not()
        return why and f"Pinocchio's loop in C++ is not there: {why}"

    def settings(self, scene: Scene, step: float) -> Settings:
        """Algorithm and gains for a step, s."""
        algorithm = self.how.algorithm if scene.mechanism.closures else "aba"
        return replace(self.how, algorithm=algorithm, omega=self.omega(scene, step))

    def run(self, scene: Scene, setting: float) -> Outcome:
        """RK4 with the step nearest to `setting`, s."""
        return timed(scene, setting, self.settings(scene, division(scene, setting)[1]))


def timed(scene: Scene, setting: float, how: Settings) -> Outcome:
    """A run of the loop with these settings."""
    substeps, h = division(scene, setting)
    found, outputs = loop(scene.mechanism), len(scene.times) - 1
    begun = clock()
    q, v = found.run(scene.q0, scene.v0, h, substeps, outputs, how)
    seconds = clock() - begun
    return reached(scene, zip(q[1:], v[1:], strict=True), seconds, 4 * substeps * min(len(q), outputs))


loop = functools.lru_cache(maxsize=16)(Loop)
"""The compiled loop of a mechanism."""


# --------------------------------------------------------------------------- gains

DEFAULTS = "Pinocchio, defaults"
EXAMPLE = 10.0**0.5
"""ω of Pinocchio's own example of a closed chain, Kp = 10 and Kd = 2 √Kp, 1/s."""

TURNS, LARGEST = 200.0, 0.5
"""As `scan` chose them: ω in 1/duration, and its bound in 1/step; RK4 is stable with ω h < 2.8."""

CRITICAL = 0.2
"""ω h of the rule that follows the step."""

PER_STEP, PER_DURATION = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0), (20.0, 100.0, 500.0, 2000.0)
MUS = (1e-6, 1e-8, 1e-10, 1e-12)
LARGEST_SCANNED = 30
MOST_SCANNED = 8
"""Steps in an output interval up to which gains are scanned; finer ones take the rule that was best there."""


def per_duration(turns: float) -> Omega:
    """ω = turns / duration, at most `LARGEST` / step."""
    return lambda scene, step: min(turns / float(scene.times[-1]), LARGEST / step)


def per_step(share: float) -> Omega:
    """ω = share / step."""
    return lambda scene, step: share / step


@dataclass
class Scanned(ConstraintDynamics):
    """With the gains and the mu that err least on the very scene at the very step: found by a scan."""

    # scene -> its exact q (n, nq)
    exact: Callable[[Scene], Array] | None = None
    _best: dict[tuple[str, int], tuple[Omega, float]] = field(default_factory=dict)

    def refuses(self, scene: Scene) -> str:
        """As without the scan, and what would take longer than all else, or has no exact motion."""
        if scene.mechanism.nv > LARGEST_SCANNED:
            return f"gains are scanned on mechanisms of at most {LARGEST_SCANNED} joints"
        return super().refuses(scene) or ("" if self.exact else "no exact motion to scan by")

    def settings(self, scene: Scene, step: float) -> Settings:
        """The best settings at this step."""
        substeps = min(division(scene, step)[0], MOST_SCANNED)
        if (scene.name, substeps) not in self._best:
            self._best[scene.name, substeps] = self._scan(scene, substeps)
        omega, mu = self._best[scene.name, substeps]
        return replace(self.how, omega=omega(scene, step), mu=mu)

    def _scan(self, scene: Scene, substeps: int) -> tuple[Omega, float]:
        assert self.exact is not None
        q, setting = self.exact(scene), float(scene.times[1]) / substeps

        def error(rule: tuple[Omega, float]) -> float:
            how = replace(self.how, omega=rule[0](scene, setting), mu=rule[1])
            return timed(scene, setting, how).error(q)

        return min(_rules(), key=error)


def _rules() -> Iterator[tuple[Omega, float]]:
    for mu in MUS:
        yield from ((rule, mu) for rule in map(per_step, PER_STEP))
        yield from ((rule, mu) for rule in map(per_duration, PER_DURATION))


def contenders(exact: Callable[[Scene], Array] | None = None) -> list[Contender]:
    """Defaults, Pinocchio's own example, mu > 0 without gains, two rules for gains, the best of a scan."""
    how, none, rule = Settings(), per_step(0.0), f"omega = {TURNS:g} / duration, at most {LARGEST:g} / step"
    plain = "constraintDynamics as it comes: no Baumgarte terms, mu = 0; aba for a tree"
    example = (
        "settings of Pinocchio's simulation-closed-kinematic-chains.py: Kp = 10, Kd = 2 √Kp, mu = 1e-10, "
        "at most 10 iterations to 1e-8"
    )
    proximal, gains = "mu = 1e-8, at most 10 iterations to 1e-12", "critically damped Baumgarte terms"
    critical = f"{gains}, omega = {CRITICAL:g} / step; {proximal}"
    scanned = (
        f"{gains}, omega over {PER_STEP} / step and {PER_DURATION} / duration, mu over {MUS}: what errs "
        f"least on the very scene, at each step down to {MOST_SCANNED} in an output interval"
    )
    return [
        ConstraintDynamics(DEFAULTS, plain, none, Settings(mu=0.0, iterations=1)),
        ConstraintDynamics(
            "Pinocchio, example", example, lambda scene, step: EXAMPLE, Settings(mu=1e-10, accuracy=1e-8)
        ),
        ConstraintDynamics("Pinocchio, mu > 0", f"no Baumgarte terms, {proximal}", none, how),
        ConstraintDynamics("Pinocchio, tuned", f"{gains}, {rule}; {proximal}", per_duration(TURNS), how),
        ConstraintDynamics("Pinocchio, 0.2/h", critical, per_step(CRITICAL), how),
        Scanned("Pinocchio, scanned", scanned, none, how, exact=exact),
        ConstraintDynamics("Pinocchio lcaba", f"lcaba, {critical}", per_step(CRITICAL), Settings("lcaba")),
    ]
