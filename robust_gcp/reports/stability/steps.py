"""How much larger the steps of Radau, BDF and LSODA are than RK4's bound, at equal accuracy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ... import Mechanism, linearise
from ...dynamics.equations import Torque
from ...dynamics.linearise import ReducedJacobian
from ...dynamics.problem import initial_value_problem
from ...maps.choice import MapChoice
from ...mechanism.tree.tree import Array
from ...simulation.runs.steppers import IMPLICIT
from .stiff import drive, driven
from .truth import SHAFT, A, B, Servo, governor, of_run

TARGET = 1e-5
"""rad: the largest error of y that counts as equal accuracy. RK4 may need less than its bound for it."""

TOLERANCES = tuple(10.0**-e for e in range(3, 10))
NAN = float("nan")
MOST_STEPS = 20_000
"""Accepted steps after which an attempt is given up: it has no larger step than RK4."""


@dataclass(frozen=True)
class Stiff:
    """A stiff motion: the mechanism, its start, its drive, its truth y(t), and how long it lasts, s."""

    name: str
    mechanism: Mechanism
    v0: Array
    torque: Torque | None
    truth: Callable[[Array], Array]
    duration: float


@dataclass(frozen=True)
class Stride:
    """What an implicit stepper needs for `TARGET`."""

    name: str
    stepper: str
    bound: float  # RK4's largest stable step at the start, s
    # rtol, error: loosest tolerance that meets the target, and the error of y there; NaN where none does
    rtol: float
    error: float
    # mean, largest: accepted steps, s
    mean: float
    largest: float
    rhs: int  # right-hand sides, those of the Jacobian among them
    rk4_rhs: float  # what RK4 needs at its bound

    @property
    def ratio(self) -> float:
        """Mean step over RK4's bound."""
        return self.mean / self.bound


def motions(quick: bool) -> list[Stiff]:
    """Springs, dampers, critically damped servos, and the flyball governor."""
    rows = []
    for e in (8,) if quick else (2, 4, 6, 8):
        k, c = 10.0**e * B, 10.0**e * np.sqrt(A * B)
        rows += [(f"servo k = 1e{e} B, critical", Servo(k, 2.0 * np.sqrt(k * A)))]
        rows += [(f"spring k = 1e{e} B, undamped", Servo(k, 0.0))]
        rows += [] if quick else [(f"damper c = 1e{e} √(AB)", Servo(0.0, c))]
    return [*(_servo(*row) for row in rows), _flyball()]


def _servo(name: str, servo: Servo) -> Stiff:
    return Stiff(name, driven(servo), np.zeros(3), drive(servo), lambda t: servo.exact(t)[:, :1], 0.5)


def _flyball() -> Stiff:
    mechanism, duration = governor(), 0.3
    truth = of_run(mechanism, duration, v0=SHAFT, step=1e-3, stepper="Radau", rtol=1e-11, atol=1e-12)
    return Stiff("flyball governor", mechanism, SHAFT, None, truth, duration)


def stride(motion: Stiff, stepper: str) -> Stride:
    """The loosest tolerance that meets the target, and its steps."""
    bound = linearise(motion.mechanism, motion.mechanism.home, motion.v0, motion.torque).largest_stable_step
    rk4 = 4.0 * motion.duration / bound
    for rtol in TOLERANCES:
        t, y, rhs = _integrate(motion, stepper, rtol)
        if t[-1] < motion.duration:
            break
        error = float(np.abs(y - motion.truth(t)).max())
        if error <= TARGET:
            steps = np.diff(t)
            return Stride(motion.name, stepper, bound, rtol, error, steps.mean(), steps.max(), rhs, rk4)
    return Stride(motion.name, stepper, bound, NAN, NAN, NAN, NAN, 0, rk4)


def _integrate(motion: Stiff, stepper: str, rtol: float) -> tuple[Array, Array, int]:
    """Times and y of the accepted steps, and right-hand sides."""
    from scipy import integrate

    mechanism, m = motion.mechanism, motion.mechanism.m
    begun = initial_value_problem(
        mechanism, v0=motion.v0, torque=motion.torque, choice=MapChoice(error_controlled=True)
    )
    f, x = begun.equations, begun.x
    options = {"rtol": rtol, "atol": 1e-2 * rtol, "jac": ReducedJacobian(f)}
    solver = getattr(integrate, stepper)(lambda t, x: f(t, x.copy()), 0.0, x, motion.duration, **options)
    t, y = [0.0], [x[:m]]
    while solver.status == "running" and len(t) <= MOST_STEPS:
        solver.step()
        t.append(solver.t)
        y.append(solver.y[:m].copy())
    return np.array(t), np.array(y), f.calls


def strides(quick: bool) -> list[Stride]:
    """All motions by Radau, BDF and LSODA."""
    steppers = ("Radau",) if quick else IMPLICIT
    return [stride(motion, stepper) for motion in motions(quick) for stepper in steppers]
