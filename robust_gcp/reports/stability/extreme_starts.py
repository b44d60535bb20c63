"""Beside the singular configuration: starts, lengths that just miss a change point, random linkages."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ... import OptionError
from ...examples.families import Lengths
from ...examples.linkages import four_bar
from ...maps.closed_form import FourBar
from .case import Case, Families, Start, family, row
from .extreme_tools import (
    ANTIPARALLELOGRAM,
    CHANGE_POINT,
    RHOMBUS,
    Motion,
    Truth,
    columns,
    four_bar_row,
)

FAMILIES: Families = {}

BRIDGED = 0.9e-9
"""Gap in lengths, clearly below the library's tolerance of 1e-9, with which a linkage is taken to cross."""

APART = 1e4
"""Largest distance of the motions of two linkages over the difference of their lengths, rad/m."""

ROUNDED = 4e-16
"""Times length / gap: where modes pass each other at δ = √(gap / length), G is known to 2 ε / δ²."""

TURNING = {"on_toggle": "repartition"}


@family("starts", FAMILIES)
def starts(quick: bool) -> Iterator[Case]:
    """At 1e-3 … 1e-15 rad from the singular configuration and at it, at rest and moving."""
    places: list[tuple[str, Motion]] = [
        ("change point", Motion(CHANGE_POINT, math.pi)),
        ("rhombus at 0", Motion(RHOMBUS, 0.0)),
        ("rhombus at π", Motion(RHOMBUS, math.pi)),
        ("antiparallelogram", Motion(ANTIPARALLELOGRAM, 0.0, assembly=-1)),
    ]
    for name, at in places[:1] if quick else places:
        for distance in (1e-3, 1e-8, 0.0) if quick else (*(10.0**-k for k in range(1, 16)), 0.0):
            for speed in (0.0, 1.0, -1.0):
                how = f"{speed:+g} rad/s" if speed else "at rest"
                # a start at rest nearer than 1e-5 counts as singular: name the mode that is meant
                mode = at.linkage.evaluate(at.y)[1] if not speed and distance < 2e-5 else None
                motion = replace(at, y=at.y - distance, speed=speed)
                case = f"{name}, {distance:g} rad beside, {how}"
                yield four_bar_row(case, motion, 0.5, columns(0.5, (100,)), mode)
    for name, at in places[:1] if quick else places:
        yield four_bar_row(f"{name}, at it, at rest, mode not named", at, 0.5, columns(0.5, (100,), ()))


@family("near misses", FAMILIES)
def near_misses(quick: bool) -> Iterator[Case]:
    """Lengths off a change point by 1e-2 … 1e-15 m: followed, taken for one and said so, or a dead point."""
    shapes: list[tuple[str, int, Motion]] = [
        ("change point, l0", 0, Motion(CHANGE_POINT, 2.5)),
        ("rhombus, l1", 1, Motion(RHOMBUS, 0.2)),
        ("antiparallelogram, l1", 1, Motion(ANTIPARALLELOGRAM, 0.3, -2.0, -1)),
    ]
    for name, link, motion in shapes[:1] if quick else shapes:
        for exponent in (-2, -6, -12) if quick else range(-15, -1):
            for sign in (1.0, -1.0):
                yield from _near_miss(name, motion, link, sign * 10.0**exponent, quick)


def _near_miss(name: str, motion: Motion, link: int, gap: float, quick: bool) -> Iterator[Case]:
    l0, l1, l2, l3 = (l + gap if i == link else l for i, l in enumerate(motion.lengths))
    missed = replace(motion, lengths=(l0, l1, l2, l3))
    case, settings = f"{name} {gap:+.0e} m", columns(0.6, (300,), ())
    if abs(gap) > BRIDGED * max(motion.lengths):
        rounded = ROUNDED * max(motion.lengths) / abs(gap)
        yield four_bar_row(case, missed, 0.6, settings, rounded=rounded)
        if not quick:  # where y turns back there is no γ(y): judged by energy and against half the step
            judged: dict[str, Any] = {"energy_allowed": 1e-5, "more": TURNING}
            yield row(f"{case}, repartition", missed.build, 0.6, settings, 1e-4, **judged)
        return
    truth = Truth(motion, 0.6)  # of the linkage with the change point
    turns = np.round((missed.build()[1] - motion.build()[1]) / (2.0 * np.pi))
    yield row(
        case,
        missed.build,
        0.6,
        settings,
        lambda setting, stats: truth.allowed(setting, stats) + APART * abs(gap),
        lambda t: truth.exact(t) + 2.0 * np.pi * turns,
        crossings=1,
    )


@family("random linkages", FAMILIES)
def random_linkages(quick: bool) -> list[Case]:
    """Four-bars of all Grashof classes and change points, masses over four decades, any start."""
    return draw_linkages(30 if quick else 1000, 7)


def draw_linkages(count: int, seed: int) -> list[Case]:
    """So many random linkages; every fourth is a change point, every eighth a kite or parallelogram."""
    rng = np.random.default_rng(seed)
    cases: list[Case] = []
    while len(cases) < count:
        found = _draw(rng, len(cases))
        if found is not None:
            what, motion = found
            cases.append(four_bar_row(f"{len(cases)}: {what}", motion, 1.0, columns(1.0, (250,), ())))
    return cases


def _draw(rng: np.random.Generator, i: int, spread: float = 0.7) -> tuple[str, Motion] | None:
    l0, l1, l2, l3 = (10.0 ** rng.uniform(-spread, spread, 4)).tolist()
    kind = i % 8
    if kind in (0, 4):
        l0 = l2 + l3 - l1
    elif kind in (1, 5):
        l0 = l1 + abs(l2 - l3)
    elif kind == 2:
        l2, l3 = l0, l1
    elif kind == 3:
        l2, l3 = l1, l0
    lengths: Lengths = (l0, l1, l2, l3)
    assembly = int(rng.choice([-1, 1]))
    speed = float(rng.uniform(-5.0, 5.0))
    m1, m2, m3 = (10.0 ** rng.uniform(-2.0, 2.0, 3)).tolist()
    try:
        low, high = FourBar(*lengths, assembly).reach
        y = float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))
        FourBar(*lengths, assembly).evaluate(y)
    except OptionError:
        return None
    return grashof(lengths), Motion(lengths, y, speed, assembly, (m1, m2, m3))


def grashof(lengths: Lengths) -> str:
    """Which links turn fully: Grashof's classes."""
    shortest, longest = min(lengths), max(lengths)
    rest = sum(lengths) - shortest - longest
    if abs(shortest + longest - rest) <= 1e-12 * sum(lengths):
        return "change point"
    if shortest + longest > rest:
        return "triple rocker"
    return ("double crank", "crank-rocker", "double rocker", "rocker-crank")[lengths.index(shortest)]


@family("coordinates that turn back", FAMILIES)
def turned(quick: bool) -> Iterator[Case]:
    """Random linkages whose crank turns back, with the coordinates changed there: against half the step."""
    rng, count = np.random.default_rng(11), 0
    while count < (4 if quick else 60):
        found = _draw(rng, 7, 0.3)
        if found is not None and found[0] in ("triple rocker", "double rocker", "rocker-crank"):
            yield _turned(f"{count}: {found[0]}", found[1])
            count += 1


def _turned(name: str, motion: Motion) -> Case:
    def build() -> Start:
        plain = four_bar(*motion.lengths, y=motion.y, assembly=motion.assembly)
        return plain, plain.home, motion.linkage.evaluate(motion.y)[1] * motion.speed

    return row(name, build, 1.0, columns(1.0, (2000,)), 1e-4, energy_allowed=1e-4, more=TURNING)
