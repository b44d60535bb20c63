"""Extreme motions: speeds, gravity, steps, energies that just reach the singular configuration, long runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import brentq

from ...examples.families import Lengths
from ...maps.pendulum import pendulum
from ...mechanism.tree.tree import Array
from .case import Case, Families, Setting, family, row
from .extreme_bodies import LINKAGES
from .extreme_tools import ANTIPARALLELOGRAM, CHANGE_POINT, RHOMBUS, Motion, columns, four_bar_row
from .truth import TANGENT, A, B, Servo, floor

FAMILIES: Families = {}


@family("speeds", FAMILIES)
def speeds(quick: bool) -> Iterator[Case]:
    """Up to 1e5 rad/s, with steps that follow the speed and with one that does not."""
    for name, motion in LINKAGES[:1] if quick else LINKAGES:
        for speed in (1e5,) if quick else (1.0, 1e2, 1e3, 1e4, 1e5):
            fast, case = replace(motion, speed=speed), f"{name}, {speed:g} rad/s"
            yield four_bar_row(case, fast, 5.0 / speed, columns(5.0 / speed, (500,)))
            if speed >= 1e3:
                coarse = (Setting(step=1e-2, name="RK4, 500 steps"),)
                yield four_bar_row(f"{case}, h = 0.01 s", fast, 0.05, coarse)


@family("gravity", FAMILIES)
def gravities(quick: bool) -> Iterator[Case]:
    """None, and a hundred thousand times the Earth's."""
    for name, motion in LINKAGES[::2] if quick else LINKAGES:
        for g in (0.0, 1e6) if quick else (0.0, 1e-6, 1e3, 1e6):
            time = math.sqrt(9.81 / g) if g else 1.0
            pulled = replace(motion, speed=0.0 if g else 2.0, gravity=(0.0, -g))
            yield four_bar_row(f"{name}, {g:g} m/s²", pulled, time, columns(time, (200,)))


@family("steps", FAMILIES)
def steps(quick: bool) -> Iterator[Case]:
    """From a nanosecond to a second."""
    sizes = (1e-9, 1e-3, 0.1, 0.5, 1.0)
    more = (1e-9, 1e-7, 1e-5, 1e-3, 1e-2, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0)
    for name, motion in LINKAGES[:1] if quick else LINKAGES:
        for h in sizes if quick else more:
            duration = h * max(5, min(50, round(2.0 / h)))
            yield four_bar_row(f"{name}, h = {h:g} s", motion, duration, (Setting(step=h, name="RK4"),))


@family("energies", FAMILIES)
def energies(quick: bool) -> Iterator[Case]:
    """Thrown at a singular configuration, the top of the motion, with just enough energy or just not."""
    tops: list[tuple[str, Lengths, int, float, float]] = [
        ("change point", CHANGE_POINT, 1, math.pi, 2.5),
        ("rhombus", RHOMBUS, 1, -math.pi, -2.1),
        ("antiparallelogram", ANTIPARALLELOGRAM, -1, 0.0, 0.6),
    ]
    exponents = (-2, -8, -14) if quick else (-2, -4, -6, -8, -10, -12, -14)
    settings = columns(4.0, (400,), () if quick else ("DOP853",))
    for name, lengths, assembly, top, y in tops[:1] if quick else tops:
        for exponent in exponents:
            for sign in (1.0, -1.0):
                case = f"{name}, E = E* (1 {'+' if sign > 0 else '−'} 1e{exponent})"
                motion = _thrown(Motion(lengths, y, assembly=assembly), top, sign * 10.0**exponent)
                yield four_bar_row(case, motion, 4.0, settings)


def _thrown(motion: Motion, top: float, share: float) -> Motion:
    """Towards `top`, where gravity is turned so that the potential has its maximum."""

    def pulled(angle: float, at: float) -> Motion:
        gravity = (-9.81 * math.sin(angle), -9.81 * math.cos(angle))
        return replace(motion, y=at, gravity=gravity)

    def potential(angle: float, at: float) -> float:
        mechanism, q, v = pulled(angle, at).build()
        return mechanism.energy(q, v)

    def slope(angle: float) -> float:
        return potential(angle, top + 1e-3) - potential(angle, top - 1e-3)

    # the slope is a sine of the angle: two zeros half a turn apart, one of them a maximum
    zero = float(brentq(slope, 0.0, math.pi, xtol=1e-15))
    angle = max((zero, zero + math.pi), key=lambda a: 2.0 * potential(a, top) - potential(a, top - 1e-2))
    if potential(angle, top) < potential(angle, top - 1e-2):
        angle += math.pi
    y = motion.y
    mechanism, q, _ = pulled(angle, y).build()
    G = motion.linkage.evaluate(y)[1]
    needed = (potential(angle, top) - potential(angle, y)) * (1.0 + share)
    speed = math.copysign(math.sqrt(needed / mechanism.tree.kinetic(q, G)), top - y)
    return replace(pulled(angle, y), speed=speed)


@family("long runs", FAMILIES)
def long_runs(quick: bool) -> Iterator[Case]:
    """A million steps of the rhombus against the exact pendulum, through thousands of crossings."""
    count, step, y = 20_000 if quick else 1_000_000, 2e-3, 0.2
    motion = Motion(RHOMBUS, y)

    def exact(t: Array) -> Array:
        return pendulum(t, y, 0.0, A, B)[0][:, None] * TANGENT

    @cache
    def least_error() -> float:
        """That of the same stepper on the pendulum's equation."""
        return floor(Servo(0.0, 0.0).rate, y, step, count, exact)

    # rounding: y walks at random by ε a step, and its phase by that times the number of steps
    least = 1e-11 + float(np.finfo(float).eps) * count**1.5
    yield row(
        f"rhombus, {count} steps",
        motion.build,
        count * step,
        (Setting(step=step, name="RK4"),),
        lambda setting, stats: 1.1 * least_error() + least,
        exact,
        energy_allowed=1e-7 * max(1.0, count / 1e5),
        mode_kept=motion.kept,
    )
