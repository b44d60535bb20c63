"""Extreme bodies: mass and length ratios, links without mass or inertia, units from µm to km."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ...examples.families import Lengths
from ...examples.linkages import four_bar, swinging_four_bar
from ...simulation.runs.stats import Stats
from .case import Case, Families, Start, at_rest, family, row
from .extreme_tools import (
    ANTIPARALLELOGRAM,
    CHANGE_POINT,
    CRANK_ROCKER,
    RHOMBUS,
    Motion,
    Truth,
    changed,
    columns,
    four_bar_row,
)

FAMILIES: Families = {}

LINKAGES: tuple[tuple[str, Motion], ...] = (
    ("change point", Motion(CHANGE_POINT, 2.5)),
    ("crank-rocker", Motion(CRANK_ROCKER, 0.5)),
    ("rhombus", Motion(RHOMBUS, 0.2)),
    ("antiparallelogram", Motion(ANTIPARALLELOGRAM, 1.0, assembly=-1)),
)


@family("mass ratios", FAMILIES)
def mass_ratios(quick: bool) -> Iterator[Case]:
    """One link a billion times lighter or heavier than the others."""
    settings = columns(1.0, (200,), ()) if quick else columns(1.0, (200, 2000))
    for name, motion in LINKAGES[:1] if quick else LINKAGES[:3]:
        for link in (0, 2) if quick else (0, 1, 2):
            for exponent in (-9, 9) if quick else (-9, -6, -3, 3, 6, 9):
                m1, m2, m3 = (10.0**exponent if i == link else 1.0 for i in range(3))
                case = f"{name}, m{link + 1} = 1e{exponent}"
                yield four_bar_row(case, replace(motion, masses=(m1, m2, m3)), 1.0, settings)


@family("massless links", FAMILIES)
def massless(quick: bool) -> Iterator[Case]:
    """Links without mass: fine as long as something that moves has some."""
    sets = [(0.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]
    rows = [*LINKAGES, ("rhombus, rocker at rest", Motion(RHOMBUS, 0.5, assembly=-1))]
    for name, motion in rows[-1:] if quick else rows:
        for masses in sets:
            case = f"{name}, masses {', '.join(f'{m:g}' for m in masses)}"
            yield four_bar_row(case, replace(motion, speed=1.0, masses=masses), 0.5, columns(0.5, (100,)))
    for joints in ((2, 3),) if quick else ((1,), (2, 3), (2, 3, 4), (1, 2, 3, 4)):
        for share in (0.0,) if quick else (0.0, 1e-9, 1e-15):
            yield _lighter(f"mobility 2, links {', '.join(map(str, joints))} times {share:g}", joints, share)


def _lighter(name: str, joints: tuple[int, ...], share: float) -> Case:
    """The swinging four-bar with some links lighter, judged against half the step."""

    def lighten(model: pin.Model) -> None:
        for joint in joints:
            body = model.inertias[joint]
            model.inertias[joint] = pin.Inertia(share * body.mass, body.lever, share * body.inertia)

    def build() -> Start:
        return at_rest(changed(swinging_four_bar(4.0, 2.0, 3.0, 3.0, swing=-0.5, y=2.5), lighten))

    return row(name, build, 0.3, columns(0.3, (300,), ()), 1e-5, energy_allowed=1e-5)


@family("point masses", FAMILIES)
def point_masses(quick: bool) -> Iterator[Case]:
    """Bodies without rotational inertia: fine where a centre of mass moves."""
    places = (("at the tips", 1.0), ("amid the links", 0.5), ("on the hinges", 0.0))
    for name, at in places[::2] if quick else places:
        yield _points(name, at)


def _points(name: str, at: float) -> Case:
    """The rhombus of point masses at this share of the links, against half the step."""

    def gather(model: pin.Model) -> None:
        for joint in (1, 2, 3):
            model.inertias[joint] = pin.Inertia(1.0, np.array([0.0, at, 0.0]), np.zeros((3, 3)))
        if at == 0.0:  # the coupler's revolute joint moves: leave it no mass either
            model.inertias[2] = pin.Inertia.Zero()

    def build() -> Start:
        return at_rest(changed(four_bar(*RHOMBUS, y=0.2), gather))

    return row(name, build, 1.0, columns(1.0, (500,)), 1e-6, energy_allowed=1e-6)


@family("length ratios", FAMILIES)
def length_ratios(quick: bool) -> Iterator[Case]:
    """One or two links a million times shorter or longer; no gravity, the fastest joint at 1 rad/s."""
    for exponent in (-6, 6) if quick else (-6, -4, -2, 2, 4, 6):
        r = 10.0**exponent
        shapes: list[tuple[str, Lengths, float | None, int]] = [
            ("parallelogram, links 1 and 3 times", (1.0, r, 1.0, r), 0.5, 1),
            ("antiparallelogram, links 1 and 3 times", (1.0, r, 1.0, r), 0.5, -1),
            ("kite, links 1 and 2 times", (1.0, r, r, 1.0), 0.5, 1),
            ("kite, links 2 and 3 times", (1.0, 1.0, r, r), None, 1),
            ("change point, links 0 and 2 times", (0.7 + r, 0.7, r, 1.4), 2.5, 1),
        ]
        if exponent < 0:
            shapes += [
                ("crank times", (1.0, r, 1.0, 1.2), 0.5, 1),
                ("coupler times", (1.0, 1.0 + 0.3 * r, r, 1.0), None, 1),
                ("rocker times", (1.0, 1.0 + 0.2 * r, 1.0, r), None, 1),
                ("ground link times", (r, 1.0, 1.2, 1.1), 0.5, 1),
            ]
        for name, lengths, y, assembly in shapes:
            motion = Motion(lengths, 0.0, 1.0, assembly, gravity=(0.0, 0.0))
            low, high = motion.linkage.reach
            start = y if y is not None and low < y < high else low + 0.6 * (high - low)
            G = motion.linkage.evaluate(start)[1]
            motion = replace(motion, y=start, speed=1.0 / float(np.abs(G).max()))
            settings = columns(2.0, (200,), () if quick else ("DOP853",))
            yield four_bar_row(f"{name} 1e{exponent}", motion, 2.0, settings)


@family("units", FAMILIES)
def units(quick: bool) -> Iterator[Case]:
    """The same linkage in other units of length, mass and time: the same angles at the scaled times."""
    scales = [(1e-6, 1e-9, 1e-3), (1e-3, 1.0, 1.0), (1e3, 1e9, 60.0), (1e-6, 1e-18, 1e-3), (1e6, 1e6, 1e-6)]
    for name, motion in LINKAGES[::2] if quick else LINKAGES:
        for scale in scales[:3:2] if quick else scales:
            yield _scaled(name, motion, scale)


def _slower(stats: Stats, time: float) -> Stats:
    """The same with `time` seconds as one."""
    return replace(stats, refined=[(begun / time, end / time) for begun, end in stats.refined])


def _scaled(name: str, motion: Motion, scale: tuple[float, float, float]) -> Case:
    """Lengths, masses and times multiplied; gravity with them."""
    length, mass, time = scale
    l0, l1, l2, l3 = (length * x for x in motion.lengths)
    gravity = (0.0, motion.gravity[1] * length / time**2)
    small = replace(motion, lengths=(l0, l1, l2, l3), masses=(mass, mass, mass), gravity=gravity)
    truth = Truth(motion, 1.0)  # in SI units
    return row(
        f"{name}: {length:g} m, {mass:g} kg, {time:g} s",
        small.build,
        time,
        columns(time, (200,), ()),
        lambda setting, stats: truth.allowed(columns(1.0, (200,), ())[0], _slower(stats, time)),
        lambda t: truth.exact(t / time),
        closure_allowed=1e-12,
        mode_kept=motion.kept,
    )
