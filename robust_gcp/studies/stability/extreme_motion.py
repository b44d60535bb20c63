"""Extreme motions: speeds, gravity, steps, energies that just reach the singular configuration, long runs."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.optimize import brentq

from ...maps.closed_form import parallelogram_pendulum, pendulum
from ...mechanism.tree import Array
from ...simulation.steppers import rk4_step
from .case import Case, Families, Setting
from .extreme_bodies import LINKAGES
from .extreme_tools import ANTIPARALLELOGRAM, CHANGE_POINT, RHOMBUS, Lengths, Motion, columns, four_bar_case

TANGENT = np.array([1.0, -1.0, 1.0])
"""q = y (1, −1, 1) on the rhombus' parallelogram mode."""


def speeds(quick: bool) -> list[Case]:
    """Up to 1e5 rad/s, with steps that follow the speed and with one that does not."""
    cases = []
    for name, lengths, y, assembly in LINKAGES[:1] if quick else LINKAGES:
        for speed in (1e5,) if quick else (1.0, 1e2, 1e3, 1e4, 1e5):
            motion = Motion(lengths, y, speed, assembly)
            row = f"{name}, {speed:g} rad/s"
            cases.append(four_bar_case("speeds", row, motion, 5.0 / speed, columns(5.0 / speed, (500,))))
            if speed >= 1e3:
                coarse = (Setting(step=1e-2, name="RK4, 500 steps"),)
                cases.append(four_bar_case("speeds", f"{row}, h = 0.01 s", motion, 0.05, coarse))
    return cases


def gravities(quick: bool) -> list[Case]:
    """None, and a hundred thousand times the Earth's."""
    cases = []
    for name, lengths, y, assembly in LINKAGES[::2] if quick else LINKAGES:
        for g in (0.0, 1e6) if quick else (0.0, 1e-6, 1e3, 1e6):
            time = math.sqrt(9.81 / g) if g else 1.0
            motion = Motion(lengths, y, 0.0 if g else 2.0, assembly, gravity=(0.0, -g))
            row = f"{name}, {g:g} m/s²"
            cases.append(four_bar_case("gravity", row, motion, time, columns(time, (200,))))
    return cases


def steps(quick: bool) -> list[Case]:
    """From a nanosecond to a second."""
    cases = []
    sizes = (1e-9, 1e-3, 0.1, 0.5, 1.0)
    more = (1e-9, 1e-7, 1e-5, 1e-3, 1e-2, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0)
    for name, lengths, y, assembly in LINKAGES[:1] if quick else LINKAGES:
        for h in sizes if quick else more:
            duration = h * max(5, min(50, round(2.0 / h)))
            motion = Motion(lengths, y, 0.0, assembly)
            settings = (Setting(step=h, name="RK4"),)
            cases.append(four_bar_case("steps", f"{name}, h = {h:g} s", motion, duration, settings))
    return cases


# --------------------------------------------------------------------------- energies


def energies(quick: bool) -> list[Case]:
    """Thrown at a singular configuration, the top of the motion, with just enough energy or just not."""
    cases = []
    tops: list[tuple[str, Lengths, int, float, float]] = [
        ("change point", CHANGE_POINT, 1, math.pi, 2.5),
        ("rhombus", RHOMBUS, 1, -math.pi, -2.1),
        ("antiparallelogram", ANTIPARALLELOGRAM, -1, 0.0, 0.6),
    ]
    exponents = (-2, -8, -14) if quick else (-2, -4, -6, -8, -10, -12, -14)
    for name, lengths, assembly, top, y in tops[:1] if quick else tops:
        for exponent in exponents:
            for sign in (1.0, -1.0):
                share = sign * 10.0**exponent
                motion = _thrown(lengths, assembly, top, y, share)
                row = f"{name}, E = E* (1 {'+' if sign > 0 else '−'} 1e{exponent})"
                settings = columns(4.0, (400,), () if quick else ("DOP853",))
                cases.append(four_bar_case("energies", row, motion, 4.0, settings))
    return cases


def _thrown(lengths: Lengths, assembly: int, top: float, y: float, share: float) -> Motion:
    """From y towards `top`, where gravity is turned so that the potential has its maximum."""

    def potential(angle: float, at: float) -> float:
        linkage = Motion(lengths, at, 0.0, assembly, gravity=_down(angle))
        mechanism, q, v = linkage.build()
        return mechanism.energy(q, v)

    def slope(angle: float) -> float:
        return potential(angle, top + 1e-3) - potential(angle, top - 1e-3)

    # the slope is a sine of the angle: two zeros half a turn apart, one of them a maximum
    zero = float(brentq(slope, 0.0, math.pi, xtol=1e-15))
    angle = max((zero, zero + math.pi), key=lambda a: 2.0 * potential(a, top) - potential(a, top - 1e-2))
    if potential(angle, top) < potential(angle, top - 1e-2):
        angle += math.pi
    rest = Motion(lengths, y, 0.0, assembly, gravity=_down(angle))
    mechanism, q, _ = rest.build()
    G = rest.linkage.evaluate(y)[1]
    needed = (potential(angle, top) - potential(angle, y)) * (1.0 + share)
    speed = math.copysign(math.sqrt(needed / mechanism.tree.kinetic(q, G)), top - y)
    return Motion(lengths, y, speed, assembly, gravity=_down(angle))


def _down(angle: float) -> tuple[float, float]:
    return -9.81 * math.sin(angle), -9.81 * math.cos(angle)


# --------------------------------------------------------------------------- long runs


def long_runs(quick: bool) -> list[Case]:
    """A million steps of the rhombus against the exact pendulum, through thousands of crossings."""
    count = 20_000 if quick else 1_000_000
    step = 2e-3
    return [_long_run(f"rhombus, {count} steps", count, step, 0.2)]


def _long_run(name: str, count: int, step: float, y: float) -> Case:
    a, b = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    duration = count * step
    motion = Motion(RHOMBUS, y)

    def exact(t: Array) -> Array:
        return pendulum(t, y, 0.0, a, b)[0][:, None] * TANGENT

    @cache
    def floor() -> float:
        """The largest error of the same stepper on the pendulum's equation."""

        def rate(t: float, x: Array) -> Array:
            return np.array([x[1], -b / a * math.cos(x[0])])

        x, seen = np.array([y, 0.0]), np.empty(count + 1)
        for i in range(count + 1):
            seen[i] = x[0]
            x = rk4_step(rate, 0.0, x, step, rate(0.0, x))
        return float(np.abs(seen - exact(step * np.arange(count + 1))[:, 0]).max())

    # rounding: y walks at random by ε a step, and its phase by that times the number of steps
    least = 1e-11 + float(np.finfo(float).eps) * count**1.5
    return Case(
        "long runs",
        name,
        motion.build,
        duration,
        (Setting(step=step, name="RK4"),),
        lambda setting: 1.1 * floor() + least,
        exact,
        energy_allowed=1e-7 * max(1.0, count / 1e5),
        mode_kept=motion.kept,
    )


FAMILIES: Families = {
    "speeds": speeds,
    "gravity": gravities,
    "steps": steps,
    "energies": energies,
    "long runs": long_runs,
}
