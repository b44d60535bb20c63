"""Pinocchio's constrained dynamics on the spanning tree, with the classical Runge-Kutta method in Python.

Closures are rigid constraint models: CONTACT_3D for a point, CONTACT_6D for a frame, and for a cut hinge
two points on its axis. Springs, dampers and drives enter through τ, as in this package's own methods.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...errors import SimulationError
from ...mechanism.closures import Closure
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from ..contender import Contender, Kind, Outcome, Outputs, Scene, division
from .parts import Place, closure_places, held_points

Acceleration = Callable[[Array, Array], Array]


@dataclass
class ConstraintDynamics:
    """`pin.constraintDynamics` with RK4."""

    name: str
    tuning: str
    mu: float  # proximal regularisation of the constraint forces' equation
    accuracy: float  # at which its iterations stop
    iterations: int  # at most
    # (scene, step) -> float: of the Baumgarte terms ω² and 2 ω (critical damping), 1/s
    omega: Callable[[Scene, float], float]
    family: str = "Pinocchio"
    stepper: str = "rk4"
    kind: Kind = "fixed"

    def refuses(self, scene: Scene) -> str:
        """Why not: only for joints with several numbers in q, or a repetition without loops."""
        if not scene.mechanism.tree.vector_space:
            return "the adapter steps q as a vector, and a joint here has more numbers in q than velocities"
        if not scene.mechanism.closures and self.name != DEFAULTS:
            return f"no loop to close, so it is the same as {DEFAULTS!r}"
        return ""

    def run(self, scene: Scene, setting: float) -> Outcome:
        """RK4 with the step nearest to `setting`, s."""
        substeps, h = division(scene, setting)
        settings = pin.ProximalSettings(self.accuracy, self.mu, self.iterations)
        f = acceleration(scene.mechanism, self.omega(scene, h), settings)
        outputs, count = Outputs(scene), 0
        q, v = scene.q0.copy(), scene.v0.copy()
        why = "the state left the finite numbers"
        with np.errstate(all="ignore"):  # a run that blows up is an outcome, not an error
            begun = time.perf_counter()
            try:
                for _ in scene.times[1:]:
                    for _ in range(substeps):
                        q, v = rk4(f, q, v, h)
                    count += 4 * substeps
                    if not outputs.put(q, v):
                        break
            except SimulationError as error:  # by the springs
                why = str(error)
            seconds = time.perf_counter() - begun
        return outputs.outcome(seconds, count, why)


def rk4(f: Acceleration, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """One step for q̈ = f(q, v) on a vector space; f's result is used up before its next call."""
    half = 0.5 * h
    a = f(q, v)
    v2, slope = v + half * a, a.copy()
    a = f(q + half * v, v2)
    v3 = v + half * a
    slope += 2.0 * a
    a = f(q + half * v2, v3)
    v4 = v + h * a
    slope += 2.0 * a
    slope += f(q + h * v3, v4)
    return q + (h / 6.0) * (v + 2.0 * (v2 + v3) + v4), v + (h / 6.0) * slope


def acceleration(mechanism: Mechanism, omega: float, settings: pin.ProximalSettings) -> Acceleration:
    """q̈(q, v) of the mechanism, a view that the next call overwrites; all memory is allocated here."""
    model, data = mechanism.model, mechanism.model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure, places in zip(mechanism.loops, closure_places(mechanism), strict=True):
        for constraint in constraints(mechanism, closure, places):
            constraint.setBaumgarteCorrectorParameters(
                pin.BaumgarteCorrectorParameters(omega**2, 2.0 * omega)
            )
            models.append(constraint)
            datas.append(constraint.createData())
    pin.initConstraintDynamics(model, data, models, datas)
    solve = pin.constraintDynamics
    if mechanism.applied is None:
        zero = np.zeros(model.nv)
        return lambda q, v: solve(model, data, q, v, zero, models, datas, settings)
    tau = mechanism.applied.tau
    return lambda q, v: solve(model, data, q, v, tau(q, v), models, datas, settings)


def constraints(
    mechanism: Mechanism, closure: Closure, places: tuple[Place, Place]
) -> list[pin.RigidConstraintModel]:
    """The rigid constraint models of a closure."""
    (joint1, place1), (joint2, place2) = places
    if closure.kind not in ("3d", "6d", "revolute"):
        raise ValueError(f"Pinocchio has no rigid constraint model for a closure of type {closure.kind!r}")
    kind = pin.ContactType.CONTACT_6D if closure.kind == "6d" else pin.ContactType.CONTACT_3D
    found = []
    for shift in held_points(mechanism, closure):
        one, two = (place * pin.SE3(np.eye(3), shift) for place in (place1, place2))
        ends = (joint1, one, joint2, two, pin.ReferenceFrame.LOCAL)
        found.append(pin.RigidConstraintModel(kind, mechanism.model, *ends))
    return found


DEFAULTS = "Pinocchio, defaults"
EXAMPLE = 10.0**0.5
"""ω of Pinocchio's own example of a closed chain, Kp = 10 and Kd = 2 √Kp, 1/s."""

TURNS, LARGEST = 200.0, 0.5
"""As `scan` chose them: ω in 1/duration, and its bound in 1/step; RK4 is stable with ω h < 2.8."""


def tuned_omega(scene: Scene, step: float) -> float:
    """Baumgarte's ω, 1/s, at critical damping."""
    return min(TURNS / float(scene.times[-1]), LARGEST / step)


def contenders() -> list[Contender]:
    """Default settings, Pinocchio's own example, mu > 0 without gains, and what the scan chose."""
    proximal = "mu = 1e-8, at most 10 iterations to 1e-12; RK4 in Python"
    rule = f"omega = {TURNS:g} / duration, at most {LARGEST:g} / step"
    example = (
        "settings of Pinocchio's simulation-closed-kinematic-chains.py: Kp = 10, Kd = 2 √Kp, mu = 1e-10, "
        "at most 10 iterations to 1e-8; RK4 in Python"
    )
    plain = "constraintDynamics as it comes: no Baumgarte terms, mu = 0, RK4 in Python"
    gains = f"critically damped Baumgarte terms, {rule}; {proximal}"
    return [
        ConstraintDynamics(DEFAULTS, plain, 0.0, 1e-12, 1, lambda scene, step: 0.0),
        ConstraintDynamics("Pinocchio, example", example, 1e-10, 1e-8, 10, lambda scene, step: EXAMPLE),
        ConstraintDynamics(
            "Pinocchio, mu > 0", f"no Baumgarte terms, {proximal}", 1e-8, 1e-12, 10, lambda scene, step: 0.0
        ),
        ConstraintDynamics("Pinocchio, tuned", gains, 1e-8, 1e-12, 10, tuned_omega),
    ]
