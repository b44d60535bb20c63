"""Extreme bodies: mass and length ratios, links without mass or inertia, units from µm to km."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...examples.linkages import four_bar, swinging_four_bar
from ...mechanism.mechanism import Mechanism
from ...mechanism.tree import Array
from .case import Case, Families
from .extreme_tools import (
    ANTIPARALLELOGRAM,
    CHANGE_POINT,
    CRANK_ROCKER,
    RHOMBUS,
    Lengths,
    Motion,
    Truth,
    columns,
    four_bar_case,
)

LINKAGES: tuple[tuple[str, Lengths, float, int], ...] = (
    ("change point", CHANGE_POINT, 2.5, 1),
    ("crank-rocker", CRANK_ROCKER, 0.5, 1),
    ("rhombus", RHOMBUS, 0.2, 1),
    ("antiparallelogram", ANTIPARALLELOGRAM, 1.0, -1),
)


def mass_ratios(quick: bool) -> list[Case]:
    """One link a billion times lighter or heavier than the others."""
    cases = []
    for name, lengths, y, assembly in LINKAGES[:1] if quick else LINKAGES[:3]:
        for link in (0, 2) if quick else (0, 1, 2):
            for exponent in (-9, 9) if quick else (-9, -6, -3, 3, 6, 9):
                masses = [1.0, 1.0, 1.0]
                masses[link] = 10.0**exponent
                motion = Motion(lengths, y, 0.0, assembly, (masses[0], masses[1], masses[2]))
                row = f"{name}, m{link + 1} = 1e{exponent}"
                settings = columns(1.0, (200,), ()) if quick else columns(1.0, (200, 2000))
                cases.append(four_bar_case("mass ratios", row, motion, 1.0, settings))
    return cases


def massless(quick: bool) -> list[Case]:
    """Links without mass: fine as long as something that moves has some."""
    cases = []
    sets = [(0.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]
    rows = [*LINKAGES, ("rhombus, rocker at rest", RHOMBUS, 0.5, -1)]
    for name, lengths, y, assembly in rows[-1:] if quick else rows:
        for masses in sets:
            motion = Motion(lengths, y, 1.0, assembly, masses)
            row = f"{name}, masses {', '.join(f'{m:g}' for m in masses)}"
            cases.append(four_bar_case("massless links", row, motion, 0.5, columns(0.5, (100,))))
    for joints in ((2, 3),) if quick else ((1,), (2, 3), (2, 3, 4), (1, 2, 3, 4)):
        for share in (0.0,) if quick else (0.0, 1e-9, 1e-15):
            row = f"mobility 2, links {', '.join(map(str, joints))} times {share:g}"
            cases.append(_lighter(row, joints, share))
    return cases


def _lighter(name: str, joints: tuple[int, ...], share: float) -> Case:
    """The swinging four-bar with some links lighter, judged against half the step."""

    def build() -> tuple[Mechanism, Array, Array]:
        plain = swinging_four_bar(4.0, 2.0, 3.0, 3.0, swing=-0.5, y=2.5)
        model = plain.model.copy()
        for joint in joints:
            body = model.inertias[joint]
            model.inertias[joint] = pin.Inertia(share * body.mass, body.lever, share * body.inertia)
        mechanism = Mechanism(model, plain.closures, plain.independent, plain.home, plain.name)
        return mechanism, mechanism.home, np.zeros(mechanism.nv)

    settings = columns(0.3, (300,), ())
    return Case("massless links", name, build, 0.3, settings, 1e-5, energy_allowed=1e-5)


def point_masses(quick: bool) -> list[Case]:
    """Bodies without rotational inertia: fine where a centre of mass moves."""
    cases = []
    for name, at in (("at the tips", 1.0), ("amid the links", 0.5), ("on the hinges", 0.0)):
        cases.append(_points(name, at))
    return cases[::2] if quick else cases


def _points(name: str, at: float) -> Case:
    """The rhombus of point masses at this share of the links, against half the step."""

    def build() -> tuple[Mechanism, Array, Array]:
        plain = four_bar(*RHOMBUS, y=0.2)
        model = plain.model.copy()
        for joint in (1, 2, 3):
            model.inertias[joint] = pin.Inertia(1.0, np.array([0.0, at, 0.0]), np.zeros((3, 3)))
        if at == 0.0:  # the coupler's hinge moves: leave it no mass either
            model.inertias[2] = pin.Inertia.Zero()
        mechanism = Mechanism(model, plain.closures, plain.independent, plain.home, plain.name)
        return mechanism, mechanism.home, np.zeros(3)

    settings = columns(1.0, (500,))
    return Case("point masses", name, build, 1.0, settings, 1e-6, energy_allowed=1e-6)


def length_ratios(quick: bool) -> list[Case]:
    """One or two links a million times shorter or longer; no gravity, the fastest joint at 1 rad/s."""
    cases = []
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
            cases.append(_long(f"{name} 1e{exponent}", lengths, y, assembly, quick))
    return cases


def _long(name: str, lengths: Lengths, y: float | None, assembly: int, quick: bool) -> Case:
    motion = Motion(lengths, 0.0, 1.0, assembly, gravity=(0.0, 0.0))
    low, high = motion.linkage.reach
    start = y if y is not None and low < y < high else low + 0.6 * (high - low)
    G = motion.linkage.evaluate(start)[1]
    motion = Motion(lengths, start, 1.0 / float(np.abs(G).max()), assembly, gravity=(0.0, 0.0))
    settings = columns(2.0, (200,), () if quick else ("DOP853",))
    return four_bar_case("length ratios", name, motion, 2.0, settings)


def units(quick: bool) -> list[Case]:
    """The same linkage in other units of length, mass and time: the same angles at the scaled times."""
    cases = []
    scales = [(1e-6, 1e-9, 1e-3), (1e-3, 1.0, 1.0), (1e3, 1e9, 60.0), (1e-6, 1e-18, 1e-3), (1e6, 1e6, 1e-6)]
    for name, lengths, y, assembly in LINKAGES[::2] if quick else LINKAGES:
        motion = Motion(lengths, y, 0.0, assembly)
        cases += [_scaled(name, motion, scale) for scale in (scales[:3:2] if quick else scales)]
    return cases


def _scaled(name: str, motion: Motion, scale: tuple[float, float, float]) -> Case:
    """Lengths, masses and times multiplied; gravity with them."""
    length, mass, time = scale
    l0, l1, l2, l3 = (length * x for x in motion.lengths)
    gravity = (0.0, motion.gravity[1] * length / time**2)
    small = Motion((l0, l1, l2, l3), motion.y, 0.0, motion.assembly, (mass, mass, mass), gravity)
    truth = Truth(motion, 1.0)  # in SI units
    settings = columns(time, (200,), ())
    return Case(
        "units",
        f"{name}: {length:g} m, {mass:g} kg, {time:g} s",
        small.build,
        time,
        settings,
        lambda setting: truth.allowed(columns(1.0, (200,), ())[0]),
        lambda t: truth.exact(t / time),
        closure_allowed=1e-12,
        mode_kept=motion.kept,
    )


FAMILIES: Families = {
    "mass ratios": mass_ratios,
    "massless links": massless,
    "point masses": point_masses,
    "length ratios": length_ratios,
    "units": units,
}
