"""Motions of the study: scenes with ladders of steps, and their exact motions.

These are computed twice by independent means; the difference is their own accuracy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import fixed_quad
from scipy.optimize import newton

from ...maps.pendulum import pendulum
from ...mechanism.tree.tree import Array
from ...simulation.runs.steppers import adaptive
from ..contender import Scene
from . import reduced
from .reduced import OneDof, Reduced

OUTPUTS = 400
STEPS = (1, 2, 3, 4, 6, 8, 16, 32, 64, 128)
"""Steps in each output interval, coarse to fine."""

SLOW_STEPS, SLOW_CAP = (1, 2, 3, 4, 5, 6, 8, 16, 32), 1.2
"""Of scenes whose evaluations cost ten times those of a four-bar; the cap in s."""

TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13)

TIGHT, TIGHTEST = 3e-14, 1e-15
"""Relative and absolute tolerance of the references' integration."""

QUADRATURE = 8
"""Gauss–Legendre nodes in each output interval."""


@dataclass(frozen=True)
class Reference:
    """The motion at the output times."""

    # q (401, nq), v (401, nv)
    q: Array
    v: Array
    # largest difference of two independent computations, rad (slides: m over the mechanism's length)
    accuracy: float
    source: str  # one sentence: how both were made


@dataclass(frozen=True)
class Motion:
    """A scene with its exact motion."""

    scene: Scene
    title: str  # for figures and tables
    floor: Reduced | None  # the exact reduced equations, which floors are integrated from
    solve: Callable[[], Reference]
    steps: tuple[int, ...] = STEPS  # steps in each output interval
    cap: float = 0.5  # longest run that is timed, s

    @cached_property
    def reference(self) -> Reference:
        """The exact motion, solved once."""
        return self.solve()


def times_of(duration: float) -> Array:
    """The output times."""
    return np.linspace(0.0, duration, OUTPUTS + 1)


def integrate(
    system: Reduced, times: Array, stepper: str = "DOP853", rtol: float = TIGHT, atol: float = TIGHTEST
) -> tuple[Array, Array, Array]:
    """States, q and v at the times."""
    states = [system.x0, *adaptive(stepper, system.rate, system.x0, times, rtol, atol)]
    poses = [system.read(x) for x in states]
    return np.array(states), np.array([q for q, _ in poses]), np.array([v for _, v in poses])


def of_pendulum(title: str, scene: Scene, A: float, B: float, turns: Array, **more: Any) -> Motion:
    """A ÿ = −B cos y, the joints turning alike: in Jacobi elliptic functions, against DOP853."""
    start = _start(scene)
    floor = reduced.cranks(A, B, turns).start(*start)

    def solve() -> Reference:
        y, ydot, _ = pendulum(scene.times, *start, A, B)
        q, v = np.outer(y, turns), np.outer(ydot, turns)
        _, other, _ = integrate(floor, scene.times)
        source = "pendulum in Jacobi elliptic functions; against DOP853 at rtol = 3e-14 on its equation"
        return Reference(q, v, float(np.abs(q - other).max()), source)

    return Motion(scene, title, floor, solve, **more)


def of_energy(
    title: str,
    scene: Scene,
    system: OneDof,
    geometry: str = "γ in closed form, Lagrange by hand",
    **more: Any,
) -> Motion:
    """DOP853 on the hand-written equation, against the times of arrival by quadrature of the energy."""
    floor = system.start(*_start(scene))

    def solve() -> Reference:
        states, q, v = integrate(floor, scene.times)
        late = arrival_times(system, states) - scene.times
        source = (
            f"{geometry}, DOP853 at rtol = 3e-14; against t = ∫ √(m/2(E − V)) dy by Gauss–Legendre quadrature"
        )
        return Reference(q, v, float(np.abs(late[:, None] * v).max()), source)

    return Motion(scene, title, floor, solve, **more)


def of_two(
    title: str, scene: Scene, first: Reduced, second: Reduced, what: tuple[str, str], floor: Reduced | None,
    scale: ArrayLike = 1.0, stepper: str = "DOP853", rtol: float = TIGHT, **more: Any,
) -> Motion:  # fmt: skip
    """DOP853 on one set of equations, against this stepper on another; differences in units of `scale`.

    `what` names both sets.
    """

    def solve() -> Reference:
        _, q, v = integrate(first, scene.times)
        _, other, _ = integrate(second, scene.times, stepper, rtol, rtol * 1e-2)
        source = f"{what[0]}, DOP853 at rtol = {TIGHT:g}; against {stepper} at {rtol:g} on {what[1]}"
        return Reference(q, v, float((np.abs(q - other) / scale).max()), source)

    return Motion(scene, title, floor, solve, **more)


def _start(scene: Scene) -> tuple[float, float]:
    """y and ẏ of a scene whose first joint is its coordinate."""
    return float(scene.q0[0]), float(scene.v0[0])


def arrival_times(system: OneDof, states: Array) -> Array:
    """When a motion of energy E passes the given positions, by quadrature alone, (N + 1,), s.

    t = ∫ dy/|ẏ| with ½ m ẏ² = E − V. Where the motion turns back at y_T the integrand is singular;
    y = y_T + d s² removes that.

    Parameters
    ----------
    states : ndarray (N + 1, 2)
        y and ẏ, of which only the order of passing is used, and the energy of the first.
    """
    y, ydot = states.T
    w = system.weights(float(y[0]))
    energy = 0.5 * w.inertia * ydot[0] ** 2 + w.potential

    def speed(at: float) -> float:
        here = system.weights(at)
        return float(np.sqrt(2.0 * max(energy - here.potential, 0.0) / here.inertia))

    turns = [0] if ydot[0] == 0.0 else []  # outputs just before the motion turns back
    turns += [i for i in range(len(y) - 1) if ydot[i] * ydot[i + 1] < 0.0]
    places = [float(y[0]) if ydot[i] == 0.0 else _turning(system, energy, states[i]) for i in turns]

    def integral(f: Callable[[float], float], a: float, b: float) -> float:
        return float(fixed_quad(np.vectorize(f), a, b, n=QUADRATURE)[0])

    def from_turn(place: float, a: float, b: float) -> float:
        side = 1.0 if 0.5 * (a + b) > place else -1.0
        ends = (np.sqrt(max(side * (x - place), 0.0)) for x in (a, b))
        return abs(integral(lambda s: 2.0 * s / speed(place + side * s * s), *ends))

    def span(i: int, a: float, b: float) -> float:
        if not turns:
            return abs(integral(lambda x: 1.0 / speed(x), a, b))
        k = int(np.argmin([abs(i - turn) for turn in turns]))
        place = places[k]
        if i == turns[k] and ydot[i] != 0.0:
            return from_turn(place, place, a) + from_turn(place, place, b)
        return from_turn(place, a, b)

    spans = [span(i, *map(float, ends)) for i, ends in enumerate(pairwise(y))]
    return np.concatenate([[0.0], np.cumsum(spans)])


def _turning(system: OneDof, energy: float, state: Array) -> float:
    """Where the potential energy is all of it, by Newton's method from the parabola of the last output."""
    y, ydot = map(float, state)
    near = y + 0.5 * ydot**2 / -float(system.rate(0.0, state)[1])

    def left(place: float) -> float:
        return system.weights(place).potential - energy

    def slope(place: float) -> float:
        return system.weights(place).moment

    return float(newton(left, near, slope, tol=1e-15, maxiter=30, disp=False))
