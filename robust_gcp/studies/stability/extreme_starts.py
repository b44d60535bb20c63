"""Beside the singular configuration: starts, lengths that just miss a change point, random linkages."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...errors import OptionError
from ...examples.linkages import four_bar
from ...maps.closed_form import FourBar
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .case import Case, Families
from .extreme_tools import (
    ANTIPARALLELOGRAM,
    CHANGE_POINT,
    RHOMBUS,
    Lengths,
    Motion,
    Truth,
    columns,
    four_bar_case,
)

BRIDGED = 0.9e-9
"""Gap in lengths, clearly below the library's tolerance of 1e-9, with which a linkage is taken to cross."""

APART = 1e4
"""Largest distance of the motions of two linkages over the difference of their lengths, rad/m."""


def starts(quick: bool) -> list[Case]:
    """At 1e-3 … 1e-15 rad from the singular configuration and at it, at rest and moving."""
    cases = []
    places: list[tuple[str, Lengths, float, int]] = [
        ("change point", CHANGE_POINT, math.pi, 1),
        ("rhombus at 0", RHOMBUS, 0.0, 1),
        ("rhombus at π", RHOMBUS, math.pi, 1),
        ("antiparallelogram", ANTIPARALLELOGRAM, 0.0, -1),
    ]
    for name, lengths, singular, assembly in places[:1] if quick else places:
        for distance in (1e-3, 1e-8, 0.0) if quick else (*(10.0**-k for k in range(1, 16)), 0.0):
            for speed in (0.0, 1.0, -1.0):
                motion = Motion(lengths, singular - distance, speed, assembly)
                how = f"{speed:+g} rad/s" if speed else "at rest"
                # a start at rest nearer than 1e-5 counts as singular: name the mode that is meant
                named = not speed and distance < 2e-5
                mode = motion.linkage.evaluate(singular)[1] if named else None
                row = f"{name}, {distance:g} rad beside, {how}"
                cases.append(four_bar_case("starts", row, motion, 0.5, columns(0.5, (100,)), mode=mode))
    for name, lengths, singular, assembly in places[:1] if quick else places:
        motion = Motion(lengths, singular, 0.0, assembly)
        row = f"{name}, at it, at rest, mode not named"
        cases.append(four_bar_case("starts", row, motion, 0.5, columns(0.5, (100,), ())))
    return cases


def near_misses(quick: bool) -> list[Case]:
    """Lengths off a change point by 1e-2 … 1e-15 m: followed, taken for one and said so, or a dead point."""
    cases = []
    shapes: list[tuple[str, Lengths, int, float, float, int]] = [
        ("change point, l0", CHANGE_POINT, 0, 2.5, 0.0, 1),
        ("rhombus, l1", RHOMBUS, 1, 0.2, 0.0, 1),
        ("antiparallelogram, l1", ANTIPARALLELOGRAM, 1, 0.3, -2.0, -1),
    ]
    for name, lengths, link, y, speed, assembly in shapes[:1] if quick else shapes:
        for exponent in (-2, -6, -12) if quick else range(-15, -1):
            for sign in (1.0, -1.0):
                gap = sign * 10.0**exponent
                cases += _near_miss(name, Motion(lengths, y, speed, assembly), link, gap, quick)
    return cases


def _near_miss(name: str, motion: Motion, link: int, gap: float, quick: bool) -> list[Case]:
    l = list(motion.lengths)
    l[link] += gap
    missed = replace(motion, lengths=(l[0], l[1], l[2], l[3]))
    row, settings = f"{name} {gap:+.0e} m", columns(0.6, (300,), ())
    if abs(gap) > BRIDGED * max(motion.lengths):
        plain = four_bar_case("near misses", row, missed, 0.6, settings)
        if quick:
            return [plain]
        # where y turns back there is no γ(y): judged by energy and against half the step
        other = Case(
            "near misses",
            f"{row}, repartition",
            missed.build,
            0.6,
            settings,
            1e-4,
            energy_allowed=1e-5,
            more={"on_toggle": "repartition"},
        )
        return [plain, other]
    truth = Truth(motion, 0.6)  # of the linkage with the change point
    turns = np.round((missed.build()[1] - motion.build()[1]) / (2.0 * np.pi))
    return [
        Case(
            "near misses",
            row,
            missed.build,
            0.6,
            settings,
            lambda setting: truth.allowed(setting) + APART * abs(gap),
            lambda t: truth.exact(t) + 2.0 * np.pi * turns,
            crossings=1,
            note="taken for a crossing",
        )
    ]


# --------------------------------------------------------------------------- random linkages


def random_linkages(quick: bool) -> list[Case]:
    """Four-bars of all Grashof classes and change points, masses over four decades, any start."""
    return draw_linkages(30 if quick else 1000, 7)


def draw_linkages(count: int, seed: int) -> list[Case]:
    """So many random linkages; every fourth is a change point, every eighth a kite or parallelogram."""
    rng = np.random.default_rng(seed)
    cases: list[Case] = []
    while len(cases) < count:
        found = _draw(rng, len(cases))
        if found is None:
            continue
        what, motion = found
        row = f"{len(cases)}: {what}"
        cases.append(four_bar_case("random linkages", row, motion, 1.0, columns(1.0, (250,), ())))
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
    masses = (10.0 ** rng.uniform(-2.0, 2.0, 3)).tolist()
    try:
        low, high = FourBar(*lengths, assembly).reach
        y = float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))
        FourBar(*lengths, assembly).evaluate(y)
    except OptionError:
        return None
    return grashof(lengths), Motion(lengths, y, speed, assembly, (masses[0], masses[1], masses[2]))


def grashof(lengths: Lengths) -> str:
    """Which links turn fully: Grashof's classes."""
    shortest, longest = min(lengths), max(lengths)
    rest = sum(lengths) - shortest - longest
    if abs(shortest + longest - rest) <= 1e-12 * sum(lengths):
        return "change point"
    if shortest + longest > rest:
        return "triple rocker"
    return ("double crank", "crank-rocker", "double rocker", "rocker-crank")[lengths.index(shortest)]


# --------------------------------------------------------------------------- other coordinates


def turned(quick: bool) -> list[Case]:
    """Random linkages whose crank turns back, with the coordinates changed there: against half the step."""
    rng, cases = np.random.default_rng(11), list[Case]()
    while len(cases) < (4 if quick else 60):
        found = _draw(rng, 7, 0.3)
        if found is None or found[0] not in ("triple rocker", "double rocker", "rocker-crank"):
            continue
        motion = replace(found[1], masses=(1.0, 1.0, 1.0))
        row = f"{len(cases)}: {found[0]}"
        cases.append(_turned(row, motion))
    return cases


def _turned(name: str, motion: Motion) -> Case:
    def build() -> tuple[Mechanism, Array, Array]:
        plain = four_bar(*motion.lengths, y=motion.y, assembly=motion.assembly)
        return plain, plain.home, motion.linkage.evaluate(motion.y)[1] * motion.speed

    return Case(
        "coordinates that turn back",
        name,
        build,
        1.0,
        columns(1.0, (2000,)),
        1e-4,
        energy_allowed=1e-4,
        more={"on_toggle": "repartition"},
    )


FAMILIES: Families = {
    "starts": starts,
    "near misses": near_misses,
    "random linkages": random_linkages,
    "coordinates that turn back": turned,
}
