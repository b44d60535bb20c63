"""RK4's largest stable step, and how much larger steps of Radau, BDF and LSODA are at equal accuracy.

RK4's is predicted from the linearised equations, and found by bisection on real runs.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import root

from ... import JointDamper, JointSpring, Mechanism, SimulationError, linearise, simulate
from ...dynamics.equations import Torque
from ...dynamics.linearise import ReducedJacobian
from ...dynamics.problem import initial_value_problem
from ...examples.linkages import four_bar
from ...maps.choice import MapChoice
from ...mechanism.tree.tree import Array
from ...simulation.runs.steppers import IMPLICIT
from .case import Start, at_rest
from .truth import SHAFT, A, B, Servo, governor, of_run, with_forces

STEPS = 60
"""Of a run of the bisection: few, so that the eigenvalues hardly change on the way."""

APART = 1e-6
"""Distance of the bisection's two runs, rad/s or m/s: small enough to stay linear."""

KICK = 1e-3
"""rad, or of the natural speed: the fast motion that a run starts with."""


TARGET = 1e-5
"""rad: the largest error of y that counts as equal accuracy. RK4 may need less than its bound for it."""

TOLERANCES = tuple(10.0**-e for e in range(3, 10))
NAN = float("nan")
MOST_STEPS = 20_000
"""Accepted steps after which an attempt is given up: it has no larger step than RK4."""

Build = Callable[[], Start]
"""Of a mechanism whose fastest motion is known, and a start that excites it a little."""


def systems(quick: bool) -> dict[str, Build]:
    """Springs, dampers and both on a rhombus, a spring on a dependent joint, and the flyball governor."""
    exponents = (8,) if quick else (2, 4, 6, 8)
    ratios = () if quick else (0.2, 0.7)
    factors = (1.0,) if quick else (1e-2, 1.0, 1e2)
    return {
        **{f"spring 1e{e}": partial(_rhombus, 10.0**e, 0.0) for e in exponents},
        **{f"damper 1e{e}": partial(_rhombus, 0.0, 10.0**e) for e in exponents},
        **{f"spring 1e6, damping ratio {r:g}": partial(_rhombus, 1e6, 2e3 * r) for r in ratios},
        "change point, spring 1e6 on q3": _change_point,
        "flyball at its start": _flyball_start,
        **{f"flyball × {f:g}, steady": partial(_steady_flyball, f) for f in factors},
    }


def _rhombus(k: float, c: float) -> Start:
    """At 0.5 rad, `KICK` from where the spring k B carries the load; damper c √(AB)."""
    bare = four_bar(1.0, 1.0, 1.0, 1.0, y=0.5)
    load = B * np.cos(0.5) / (k * B) if k else 0.0
    spring = JointSpring("q1", k * B, 0.5 + load + KICK)
    mechanism = with_forces(bare, [spring, JointDamper("q1", c * np.sqrt(A * B))])
    speed = 0.0 if k else KICK * c * np.sqrt(B / A)  # runs out after KICK rad
    return mechanism, bare.home, mechanism.lift(bare.home, [speed])


def _change_point() -> Start:
    bare = four_bar(4.0, 2.0, 3.0, 3.0, y=2.0)
    return at_rest(with_forces(bare, [JointSpring("q3", 1e6 * 9.81, float(bare.home[2]) + KICK)]))


def _flyball_start() -> Start:
    """IFToMM's A05: 30°. It moves on, and its eigenvalues with it."""
    mechanism = governor()
    return mechanism, mechanism.home, SHAFT


def _steady_flyball(factor: float) -> Start:
    """Turning steadily: a state at rest relative to the shaft, the slider kicked off it."""
    mechanism = governor(factor)
    applied = mechanism.applied
    assert applied is not None

    def pull(angles: Array) -> Array:
        q = np.array([0.0, *angles])
        return mechanism.tree.rnea(q, SHAFT, mechanism.tree.zero)[1:] - applied.tau(q, SHAFT)[1:]

    q = np.array([0.0, *root(pull, mechanism.home[1:], tol=1e-12).x])
    return mechanism, q, SHAFT + np.array([0.0, 0.0, 0.0, KICK])


@dataclass(frozen=True)
class Bound:
    """Largest stable step of RK4 at a start."""

    name: str
    eigenvalue: complex  # the one that limits the step, 1/s
    # predicted, measured: from all eigenvalues, and by bisection, s
    predicted: float
    measured: float

    @property
    def ratio(self) -> float:
        """Measured over predicted."""
        return self.measured / self.predicted


def measure(name: str, build: Build) -> Bound:
    """Predict and bisect the largest stable step.

    Two runs start a little apart in the motion that limits the step, and the step is bisected on whether
    that part of their distance has grown after `STEPS` steps.
    """
    mechanism, q0, v0 = build()
    found = linearise(mechanism, q0, v0)
    predicted, m = found.largest_stable_step, mechanism.m
    values, vectors = np.linalg.eig(found.A)
    i = int(np.argmin(np.abs(values - found.limiting)))
    across = np.linalg.inv(vectors)[i]
    rate = vectors[m:, i].real
    apart = mechanism.lift(q0, APART * rate / np.abs(rate).max())
    before = abs(across[m:] @ apart[mechanism.iv_independent])

    def grows(step: float) -> bool:
        try:
            first, second = (_end(mechanism, q0, v, step) for v in (v0, v0 + apart))
        except SimulationError:
            return True
        return bool(abs(across @ (second - first)) > before)

    low, high = 0.5 * predicted, 2.0 * predicted
    while high > 1.0005 * low:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if grows(middle) else (middle, high)
    return Bound(name, found.limiting, predicted, float(np.sqrt(low * high)))


def _end(mechanism: Mechanism, q0: Array, v0: Array, step: float) -> Array:
    """(y, ẏ) after `STEPS` steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = simulate(mechanism, q0, v0, STEPS * step, step)
    return np.concatenate([run.y[-1], run.v[-1, mechanism.iv_independent]])


# --------------------------------------------------------------------------- implicit steppers


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
    return Stiff(name, servo.mechanism(), np.zeros(3), servo.torque, lambda t: servo.exact(t)[:, :1], 0.5)


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
    return np.array(t), np.array(y), begun.counters.rhs


def strides(quick: bool) -> list[Stride]:
    """All motions by Radau, BDF and LSODA."""
    steppers = ("Radau",) if quick else IMPLICIT
    return [stride(motion, stepper) for motion in motions(quick) for stepper in steppers]
