"""What the extreme cases share: a four-bar, its motion in closed form, and the error that is allowed."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from ... import Mechanism, RobustGcpError, Stats, Trajectory, simulate
from ...dynamics.problem import initial_value_problem
from ...examples.families import Lengths
from ...examples.linkages import four_bar
from ...maps.choice import MapChoice
from ...maps.closed_form import FourBar
from ...mechanism.tree.tree import Array
from ..stepping import same_steps
from .case import Case, Setting, Start, row

CHANGE_POINT = (4.0, 2.0, 3.0, 3.0)
CRANK_ROCKER = (4.0, 1.0, 3.0, 3.5)
RHOMBUS = (1.0, 1.0, 1.0, 1.0)
ANTIPARALLELOGRAM = (1.0, 2.0, 1.0, 2.0)

NUDGE = 1e-13
"""Relative change of the start by which the motion's own sensitivity to rounding is measured."""

SENSITIVE = 10.0
"""Times the effect of the nudge that rounding may have."""

ROUNDINGS = 3600.0
"""Times ε and the ratio of lengths: φ is rounded at the longest link, a short one turns by as much more.
Newton stops at 9 ε; at the edge of a zone, with a conditioning of 0.05, G errs by 180 ε, γ'' by 3600 ε. At a
speed of 1 rad/s that is an error of ÿ over the zone, and of q after no more than 1 s in it and 1 s after it.
Measured at a ratio of 1e4: ÿ errs by 4e-9 to 3e-8 in a zone, or 1600 to 13,000 ε 1e4, as its nodes fall."""

LOOSE = 10.0
"""Times the tolerances of steps with error control, which the run chooses by itself."""

LEAST = 1e-11
"""rad: an error below is rounding."""

EXACT: dict[str, Any] = {"stepper": "DOP853", "rtol": 1e-13, "atol": 1e-13}


@dataclass(frozen=True)
class Motion:
    """A four-bar and how it starts."""

    lengths: Lengths  # l0, l1, l2, l3, m
    y: float  # rad
    speed: float = 0.0  # rad/s
    assembly: int = 1
    masses: tuple[float, float, float] = (1.0, 1.0, 1.0)  # kg
    gravity: tuple[float, float] = (0.0, -9.81)  # along y and z, m/s²

    @property
    def linkage(self) -> FourBar:
        """The closed form."""
        return FourBar(*self.lengths, self.assembly)

    def build(self, nudge: float = 0.0) -> Start:
        """The mechanism, q0 and v0, moved by a relative nudge."""
        y = self.y + nudge * max(1.0, abs(self.y))

        def pull(model: pin.Model) -> None:
            model.gravity.linear = np.array([0.0, *self.gravity])

        mechanism = changed(four_bar(*self.lengths, y=y, assembly=self.assembly, masses=self.masses), pull)
        speed = self.speed * (1.0 + nudge)
        v0 = self.linkage.evaluate(y)[1] * speed if speed else np.zeros(3)
        return mechanism, mechanism.home, v0

    def kept(self, q: Array) -> bool:
        """Whether q (n, 3) lies on the mode of the start, to 1e-6 rad and what rounding of y makes of it."""
        linkage, roundings = self.linkage, 1e3 * rounding(self.lengths)
        for pose in q:
            try:
                on_mode, G, _ = linkage.evaluate(float(pose[0]), near=pose)
            except RobustGcpError:  # at a dead point both assemblies meet
                continue
            if np.abs(on_mode - pose).max() > 1e-6 + roundings * np.abs(G).max():
                return False
        return True


def changed(plain: Mechanism, change: Callable[[pin.Model], None]) -> Mechanism:
    """The mechanism with its model changed."""
    model = plain.model.copy()
    change(model)
    return Mechanism(model, plain.closures, plain.independent, plain.home, plain.name)


@dataclass
class Truth:
    """The motion in closed form: by a fine method, and by the stepper that is judged."""

    motion: Motion
    duration: float  # s
    mode: Array | None = None  # (3,): tangent of the mode that a start at rest takes
    _kept: dict[Any, Trajectory] = field(default_factory=dict)

    @cached_property
    def start(self) -> Start:
        """Mechanism, q0 and v0."""
        return self.motion.build()

    def exact(self, t: Array) -> Array:
        """q at times t, (n, 3); NaN after the time up to which it is known."""
        q = np.full((len(t), 3), np.nan)
        if len(t) == 1:
            q[0] = self.start[1]
            return q
        known = self._simulate(0.0, float(t[-1]), step=float(t[1] - t[0]), **EXACT)
        if known is not None:
            q[: len(known.q)] = known.q[: len(t)]
        return q

    def allowed(self, setting: Setting, stats: Stats) -> float:
        """What the run's steps come to on the closed form and a tenth, what rounding does to them; rounding.

        Where steps are chosen by error control they may be others: ten times as much for an adaptive
        stepper, ten times the tolerance where fixed steps went over to it. 0 where there are none.
        """
        found, moved = (self._steps(setting, stats, nudge) for nudge in (0.0, NUDGE))
        if found is None:
            return 0.0
        t, q = found
        floor = float(np.abs(q - self.exact(t)).max())
        if not np.isfinite(floor):
            return 0.0
        n = 0 if moved is None else min(len(q), len(moved[1]))
        sensitivity = 0.0 if moved is None else float(np.abs(q[:n] - moved[1][:n]).max(initial=0.0))
        share = 1.1 if setting.stepper == "rk4" else 10.0
        least = LEAST + ROUNDINGS * rounding(self.motion.lengths)
        return share * floor + SENSITIVE * sensitivity + least

    def _steps(self, setting: Setting, stats: Stats, nudge: float) -> tuple[Array, Array] | None:
        """Times and q of the same steps on the closed form, as far as they go."""
        if setting.stepper != "rk4":
            run = self._simulate(nudge, self.duration, **setting.options)
            return None if run is None else (run.t, run.q)
        q0, v0 = (self.motion.build(nudge) if nudge else self.start)[1:]
        choice = MapChoice("closed_form", error_controlled=True)
        times = setting.step * np.arange(round(self.duration / setting.step) + 1)
        found: list[Array] = []
        with contextlib.suppress(RobustGcpError):  # the motion is known as far as this
            problem = initial_value_problem(self.start[0], q0, v0, mode=self.mode, choice=choice)
            found.extend(same_steps(problem.equations, problem.x, times, stats, loose=LOOSE))
        return (times[: len(found)], np.array(found)) if len(found) > 1 else None

    def _simulate(self, nudge: float, duration: float, **options: Any) -> Trajectory | None:
        """A run on the closed form, or what there is of one that stopped; made once."""
        key = (nudge, duration, *options.values())
        if key not in self._kept:
            try:
                start = self.motion.build(nudge) if nudge else self.start
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    more = options | {"method": "closed_form", "mode": self.mode}
                    self._kept[key] = simulate(*start, duration, **more)
            except RobustGcpError as error:
                if error.trajectory is None:
                    return None
                self._kept[key] = error.trajectory
        return self._kept[key]


def rounding(lengths: Lengths) -> float:
    """ε times the ratio of the longest link to the shortest, rad."""
    return float(np.finfo(float).eps) * max(lengths) / min(lengths)


def four_bar_row(
    name: str,
    motion: Motion,
    duration: float,
    settings: tuple[Setting, ...],
    mode: Array | None = None,
    rounded: float = 0.0,
) -> Case:
    """A row whose cells are right where they err no more than their stepper does on the closed form.

    And no more than `rounded` besides, where a library cannot know K better.
    """
    truth = Truth(motion, duration, mode)
    more: dict[str, Any] = {"mode_kept": motion.kept, "more": {} if mode is None else {"mode": mode}}

    def allowed(setting: Setting, stats: Stats) -> float:
        return truth.allowed(setting, stats) + rounded

    return row(name, lambda: truth.start, duration, settings, allowed, truth.exact, **more)


def columns(
    duration: float, counts: tuple[int, ...], adaptive: tuple[str, ...] = ("DOP853",)
) -> tuple[Setting, ...]:
    """RK4 with so many steps each, and adaptive steppers with as many outputs as the first."""
    fixed = tuple(Setting(step=duration / n, name=f"RK4, {n} steps") for n in counts)
    return fixed + tuple(
        Setting(stepper=s, step=duration / counts[0], rtol=1e-9, atol=1e-11, name=s) for s in adaptive
    )
