"""Crossings by the thousand: random change-point linkages against the closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from robust_gcp.errors import OptionError, RobustGcpError
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.mechanism.mechanism import Mechanism
from robust_gcp.mechanism.tree.tree import Array
from robust_gcp.simulation.simulate import simulate
from robust_gcp.simulation.trajectories.trajectory import Trajectory

from .random_cases import RandomCase, passed

MOST_STEPS = 100
"""Steps before the crossing, at the most: keeps a thousand cases to some minutes."""


@dataclass(frozen=True)
class Case(RandomCase):
    """One random crossing and how it went."""

    lengths: tuple[float, float, float, float]  # l0, l1, l2, l3, m; a change-point linkage
    assembly: int
    y: float  # start, rad
    speed: float  # rad/s
    step: float  # s
    landing: bool  # whether the start was chosen so that a step ends within 1e-12 rad of the crossing
    expected: int = 0  # how often the exact motion crosses
    crossings: int = 0  # crossings logged
    nearest: float = np.inf  # smallest distance of an accepted y from the crossing, rad
    floor: float = np.nan  # largest error of the same stepper on the closed form, rad
    error: float = np.nan  # largest error of the bridge, rad
    failure: str = ""  # the message of an error, else empty

    @property
    def good(self) -> bool:
        """No failure, the error within ten times the floor, and each crossing logged."""
        return not self.failure and self.ratio <= 10.0 and self.crossings == self.expected

    def simulate(self, duration: float, step: float, **options: Any) -> Trajectory:
        """A run of this duration, s."""
        mechanism, v0 = self.set_up()
        return simulate(mechanism, v0=v0, duration=duration, step=step, **options)

    def set_up(self) -> tuple[Mechanism, Array]:
        """The linkage and the velocity it starts with."""
        mechanism = four_bar(*self.lengths, y=self.y, assembly=self.assembly)
        return mechanism, FourBar(*self.lengths, self.assembly).evaluate(self.y)[1] * self.speed


def crossing(seed: int, index: int) -> Case:
    """A random case and how it went; drawn anew where the closed form cannot follow it by a dead point."""
    rng = np.random.default_rng([seed, index])
    while True:
        case = _run(draw(rng))
        if case is not None:
            return case


def draw(rng: np.random.Generator) -> Case:
    """A change-point linkage, started up to 0.6 rad beside its crossing and moving towards it.

    l0 + l1 = l2 + l3 meets its other mode at y = π, |l0 − l1| = |l2 − l3| at y = 0. Lengths that
    make one link coincide with another to a few per cent are drawn anew: two crossings would merge.
    """
    while True:
        l1, l2, l3 = rng.uniform(0.5, 3.0, 3)
        at_pi = bool(rng.random() < 0.5)
        if at_pi:
            l0, center = l2 + l3 - l1, np.pi
        else:
            l0, center = l1 + abs(l2 - l3) * (1.0 if rng.random() < 0.5 else -1.0), 0.0
        lengths = (float(l0), float(l1), float(l2), float(l3))
        pairs = [abs(a - b) for i, a in enumerate(lengths) for b in lengths[i + 1 :]]
        if l0 < 0.3 or min(pairs) < 0.1 or max(lengths) > 0.95 * (sum(lengths) - max(lengths)):
            continue
        step = float(10.0 ** rng.uniform(-4.0, np.log10(2e-2)))
        pace = float(rng.uniform(2.0, 6.0))
        offset = min(float(rng.uniform(0.15, 0.6)), MOST_STEPS * step * pace)
        offset *= 1.0 if rng.random() < 0.5 else -1.0
        try:
            for assembly in (1, -1):
                for share in (1.0, 1.5, -1.0, -1.5):
                    FourBar(*lengths, assembly).evaluate(center + share * offset)
        except OptionError:
            continue
        speed = -float(np.sign(offset)) * pace
        assembly = 1 if rng.random() < 0.5 else -1
        landing = bool(rng.random() < 0.2)
        case = Case(lengths, assembly, center + offset, speed, step, landing)
        return _landed(case, center) if landing else case


def _landed(case: Case, center: float) -> Case:
    """The case with its start moved so that the fourth step of the closed form ends on the crossing."""
    duration = 4.0 * case.step

    def miss(y: float) -> float:
        run = replace(case, y=y).simulate(duration, case.step, method="closed_form")
        return float(run.q[-1, 0]) - center

    near, far = (center - share * case.speed * duration for share in (1.3, 0.7))
    try:
        if miss(near) * miss(far) < 0.0:
            return replace(case, y=float(brentq(miss, near, far, xtol=1e-15, rtol=1e-14)))
    except RobustGcpError:
        pass
    return replace(case, landing=False)


def _run(case: Case) -> Case | None:
    center = np.pi if abs(case.y - np.pi) < abs(case.y) else 0.0
    reach = 2.0 * abs(case.y - center) / abs(case.speed)
    duration = case.step * max(8.0, np.ceil(reach / case.step))
    step = duration / round(duration / case.step)
    exactly = {"method": "closed_form", "stepper": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    try:
        exact, floor = (
            case.simulate(duration, step, **options) for options in (exactly, {"method": "closed_form"})
        )
    except RobustGcpError:
        return None
    try:
        ours = case.simulate(duration, step)
    except RobustGcpError as error:
        return replace(case, failure=f"{type(error).__name__}: {error}")
    times, logged = passed(exact.q[:, :1], np.array([center]), np.array([len(ours.crossings)]))
    return replace(
        case,
        expected=int(times[0]),
        crossings=int(logged[0]),
        nearest=float(np.abs(ours.q[:, 0] - center).min()),
        floor=float(np.abs(floor.q - exact.q).max()),
        error=float(np.abs(ours.q - exact.q).max()),
    )
