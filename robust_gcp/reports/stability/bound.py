"""RK4's largest stable step: predicted from the linearised equations, and found by bisection on real runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import root

from ... import JointDamper, JointSpring, Mechanism, SimulationError, linearise, simulate
from ...examples.linkages import four_bar
from ...mechanism.tree.tree import Array
from .case import Start, at_rest
from .truth import SHAFT, A, B, governor, with_forces

STEPS = 60
"""Of a run of the bisection: few, so that the eigenvalues hardly change on the way."""

APART = 1e-6
"""Distance of the bisection's two runs, rad/s or m/s: small enough to stay linear."""

KICK = 1e-3
"""rad, or of the natural speed: the fast motion that a run starts with."""


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
        **{f"flyball × {f:g}, steady": partial(_flyball, f) for f in factors},
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


def _flyball(factor: float) -> Start:
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
