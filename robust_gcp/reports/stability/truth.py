"""References of the stiff cases: scalar equations written out by hand, and runs on the closed form."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ... import Force, JointDamper, JointSpring, Mechanism, PointSpring, load, simulate
from ...examples.linkages import four_bar
from ...maps.pendulum import parallelogram_pendulum
from ...mechanism.tree.tree import Array
from ..stepping import stepped

A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
"""A ÿ = −B cos y: the rhombus of rods of 1 kg and 1 m on its parallelogram mode, kg m² and N m."""

TANGENT = np.array([1.0, -1.0, 1.0])
"""q = y (1, −1, 1) on that mode."""


@dataclass(frozen=True)
class Servo:
    """A ÿ = −B cos y − k (y − r(t)) − c (ẏ − ṙ(t)), r = r0 cos νt: a stiff drive follows a slow path."""

    # k, c: N m/rad, N m s/rad
    k: float
    c: float

    r0, nu = 0.5, 4.0
    """rad, rad/s"""

    @cached_property
    def y0(self) -> float:
        """Start at rest, rad: where a stiff spring carries the load and the acceleration, else r0."""
        y = self.r0
        if self.k > 10.0 * B:
            for _ in range(50):  # contracts by B/k
                y = self.r0 - (B * math.cos(y) - A * self.r0 * self.nu**2) / self.k
        return y

    def rate(self, t: float, x: Array) -> Array:
        """ẋ of x = (y, ẏ)."""
        y, speed = float(x[0]), float(x[1])
        moment = -B * math.cos(y) + self.drive(t) - self.k * (y - self.r0) - self.c * speed
        return np.array([speed, moment / A])

    def drive(self, t: float) -> float:
        """What moves the spring's rest from r0 to r(t) and the damper with it, N m."""
        return self.r0 * (self.k * (math.cos(self.nu * t) - 1.0) - self.c * self.nu * math.sin(self.nu * t))

    def torque(self, t: float, q: Array, v: Array) -> Array:
        """The same on all joints, (nv,)."""
        return np.array([self.drive(t), 0.0, 0.0])

    def mechanism(self) -> Mechanism:
        """The rhombus, at home on its parallelogram mode, with the drive's spring and damper on q1."""
        forces: list[Force] = [JointSpring("q1", self.k, self.r0), JointDamper("q1", self.c)]
        return with_forces(four_bar(1.0, 1.0, 1.0, 1.0, y=self.y0), forces)

    def exact(self, t: Array) -> Array:
        """q (n, 3) at times t from 0 on: the scalar equation at rtol = 1e-12.

        By DOP853, or by LSODA where the damper leaves an explicit method too many steps.
        """
        from scipy.integrate import ode

        stiff = self.c > 1e5 * A
        kind = {"name": "lsoda"} if stiff else {"name": "dop853"}
        solver = ode(self.rate).set_integrator(**kind, rtol=1e-12, atol=1e-13, nsteps=10**8)
        solver.set_initial_value([self.y0, 0.0], float(t[0]))
        y = [self.y0, *(float(solver.integrate(float(time))[0]) for time in t[1:])]
        return np.array(y)[:, None] * TANGENT

    def floor(self, step: float, duration: float) -> float:
        """Largest error of RK4 with this step on the scalar equation, rad; infinite where it grows."""
        return floor(self.rate, self.y0, step, round(duration / step), self.exact)


def floor(
    rate: Callable[[float, Array], Array], y0: float, step: float, count: int, exact: Callable[[Array], Array]
) -> float:
    """Largest error of RK4 on a scalar equation from rest at y0, rad; infinite where it grows."""
    times = step * np.arange(count + 1)
    states, _, stopped = stepped(rate, np.array([y0, 0.0]), times, "rk4", step)
    if stopped or np.abs(states[:, 0]).max() >= 1e3:
        return float("inf")
    return float(np.abs(states[:, 0] - exact(times)[:, 0]).max())


def of_run(mechanism: Mechanism, duration: float, **arguments: Any) -> Callable[[Array], Array]:
    """q(t) of a run, between its outputs by cubic Hermite interpolation; made when first asked for."""

    @cache
    def run() -> CubicHermiteSpline:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = simulate(mechanism, duration=duration, **arguments)
        return CubicHermiteSpline(run.t, run.q, run.v)

    return lambda t: np.asarray(run()(t))


def with_forces(mechanism: Mechanism, forces: Sequence[Force]) -> Mechanism:
    """The same mechanism with these forces alone."""
    given = mechanism.own_model, list(mechanism.closures), mechanism.independent
    return Mechanism.from_pinocchio(*given, home=mechanism.home, name=mechanism.name, forces=forces)


SHAFT = np.array([2.0 * np.pi, 0.0, 0.0, 0.0])
"""How the flyball governor starts in IFToMM's A05, rad/s."""


def governor(factor: float = 1.0) -> Mechanism:
    """The flyball governor A05, its spring-dampers `factor` times as stiff."""
    original = load("flyball")
    springs = (f for f in original.forces if isinstance(f, PointSpring))
    stiffer = [replace(f, stiffness=factor * f.stiffness, damping=factor * f.damping) for f in springs]
    return with_forces(original, stiffer)
