"""The motions of the study: mechanism, start, duration, exact motion and ladder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ... import Mechanism, load
from ...examples.linkages import four_bar, n_four_bar
from ...maps.pendulum import parallelogram_pendulum
from ..contender import Scene
from . import benchmarks, reduced, robots, users
from .reduced import GRAVITY
from .references import SLOW_CAP, SLOW_STEPS, STEPS, Motion, of_energy, of_pendulum, of_two, times_of


def _scene(name: str, mechanism: Mechanism, ydot: float, duration: float) -> Scene:
    v0 = mechanism.lift(mechanism.home, [ydot] * mechanism.m) if ydot else np.zeros(mechanism.nv)
    return Scene(name, mechanism, mechanism.home, v0, times_of(duration))


FOUR_BARS = {
    # γ curved, turning through six crossings on the crossed mode
    "antiparallelogram": ("antiparallelogram", (2.0, 1.0, 2.0, 1.0), -1, (0.1, -2.0), 5.0),
    # two curved modes cross at π
    "change_point": ("change point 4, 2, 3, 3", (4.0, 2.0, 3.0, 3.0), 1, (2.5, 0.0), 5.0),
    # driven from a short link, which turns fully: crossings at 0 and π
    "kite": ("kite 2, 1, 1, 2", (2.0, 1.0, 1.0, 2.0), 1, (1.0, -3.0), 3.0),
    # no singular configuration in the way: the control on which every tool is at home
    "crank_rocker": ("crank-rocker (regular)", (4.0, 1.0, 3.5, 3.0), 1, (1.0, 4.0), 5.0),
}
"""Title, lengths, assembly, start (y, ẏ), and duration."""

PARALLELOGRAMS = {"rhombus": 1.0, "parallelogram": 2.0}
"""The paper's examples, from rest at 0.2 rad: lengths of cranks in those of the coupler's."""


def _four_bar(name: str) -> Motion:
    """γ in closed form, DOP853, the energy's quadrature."""
    title, lengths, assembly, (y, ydot), duration = FOUR_BARS[name]
    scene = _scene(name, four_bar(*lengths, y=y, assembly=assembly), ydot, duration)
    return of_energy(title, scene, reduced.four_bar(lengths, assembly))


def _parallelogram(name: str) -> Motion:
    crank = PARALLELOGRAMS[name]
    A, B = parallelogram_pendulum(crank, crank, 1.0, 1.0, 1.0)
    return of_pendulum(name, _scene(name, load(name), 0.0, 5.0), A, B, np.array([1.0, -1.0, 1.0]))


def n_bars(n: int, duration: float, steps: tuple[int, ...] = STEPS, cap: float = 0.5) -> Motion:
    """IFToMM A02: cranks upright, the first pin at 1 m/s, `duration` s."""
    name = f"n_four_bar_{n}"
    scene = _scene(name, n_four_bar(n), -1.0, duration)
    turns = np.array([1.0, -1.0] * n + [1.0])
    A, B = (4 * n + 1) / 3.0, (3 * n + 1) / 2.0 * GRAVITY
    title = f"{n} four-bar{'s in a row' if n > 1 else ''} (A02)"
    return of_pendulum(title, scene, A, B, turns, steps=steps, cap=cap)


def andrews(duration: float = 0.03) -> Motion:
    """IFToMM A03: fast and regular."""
    mechanism = load("andrews")
    order = np.array([mechanism.joint_names.index(name) for name in benchmarks.ANDREWS_JOINTS])
    scene = _scene("andrews", mechanism, 0.0, duration)
    first, second = benchmarks.andrews_implicit(order), benchmarks.andrews_reduced(order)
    what = "test set's seven angles and index-1 equations by hand", "the equation of the crank alone"
    return of_two("Andrews (A03)", scene, first, second, what, second, cap=0.8)


def bricard() -> Motion:
    """IFToMM A04, slender rods: from rest, one closure row redundant throughout."""
    scene = _scene("bricard", load("bricard"), 0.0, 10.0)
    geometry = "threefold-symmetric γ in closed form, kinematics by hand"
    return of_energy("Bricard (A04)", scene, benchmarks.bricard(), geometry, steps=SLOW_STEPS, cap=SLOW_CAP)


def flyball(duration: float = 0.5, steps: tuple[int, ...] = (2, 3, 4, 5, 6, 8, 12, 16, 32, 64)) -> Motion:
    """IFToMM A05: a stiff tree (−8117/s), no loop; the shaft starts at 2π rad/s."""
    mechanism = load("flyball")
    names = ("shaft", "alpha1", "alpha2", "s")
    order = np.array([mechanism.joint_names.index(name) for name in names])
    v0 = np.zeros(4)
    v0[order[0]] = benchmarks.OMEGA
    scene = Scene("flyball", mechanism, mechanism.home, v0, times_of(duration))
    scale = np.ones(4)
    scale[order[3]] = mechanism.length
    first, second = benchmarks.flyball(order, conserving=True), benchmarks.flyball(order, conserving=False)
    what = "symmetric Lagrangian by hand with conserved angular momentum", "the equations with φ̈"
    title = "flyball governor (A05, stiff, no loop)"
    return of_two(title, scene, first, second, what, second, scale, "Radau", 1e-11, steps=steps)


MOTIONS: dict[str, Callable[[], Motion]] = {
    **{name: partial(_parallelogram, name) for name in PARALLELOGRAMS},
    **{name: partial(_four_bar, name) for name in FOUR_BARS},
    "n_four_bar_1": partial(n_bars, 1, 5.0),
    "n_four_bar_5": partial(n_bars, 5, 5.0),
    "n_four_bar_40": partial(n_bars, 40, 5.0, SLOW_STEPS, SLOW_CAP),
    "andrews": andrews,
    "bricard": bricard,
    "flyball": flyball,
    "scissor_lift": users.scissor,
    "skew_antiparallelogram": users.skew,
    "four_bar_chain": users.chain,
    "floating_change_point": users.floating,
    "delta": robots.delta,
    "walker": robots.walker,
}
"""Scenes by name, made when called."""
