"""The motions of the study: mechanism, start, duration, exact motion and ladder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import pinocchio as pin

from ... import Mechanism, RevoluteClosure, load
from ...examples.families import Lengths, four_bars, scissor_lift
from ...examples.linkages import four_bar, n_four_bar
from ...maps.closed_form import FourBar
from ...maps.pendulum import parallelogram_pendulum
from ...mechanism.tree.tree import Array
from ..contender import Scene
from . import benchmarks, reduced, robots
from .reduced import GRAVITY, Curves, OneDof, Planar, Read, SeveralDof, Weights, joints_reader
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


# --------------------------------------------------------------------------- what users have

CHANGE_POINT = (4.0, 2.0, 3.0, 3.0)
STAGES, LIFTED, FALLING = 3, 1.0, -4.0
"""Of the scissor lift: stages, and the bars' angle, rad, and speed, rad/s, at the start."""


def scissor() -> Motion:
    """A lift of three stages turns over: flat, and upright, all its loops are singular at once."""
    mechanism = scissor_lift(STAGES, LIFTED)
    zigzag = np.array([-2.0, 2.0] * STAGES)[: STAGES - 1]
    turns = np.concatenate([[1.0], zigzag, [0.0, -1.0], -zigzag])
    heights = np.arange(STAGES) + 0.5

    def shape(y: float) -> tuple[Array, Array, Array]:
        q = mechanism.home + turns * (y - LIFTED)
        G, bend = turns.copy(), np.zeros_like(turns)
        q[STAGES], G[STAGES], bend[STAGES] = np.cos(y), -np.sin(y), -np.cos(y)
        return q, G, bend

    def weigh(q: Array, G: Array, Gp: Array) -> Weights:
        """2 bars a stage of 1 kg and 1 m with centres at (½ cos y, (i − ½) sin y), and a foot of 0.1 kg."""
        c, s = np.cos(q[0]), np.sin(q[0])
        rise = 2.0 * float(heights @ heights)
        inertia = 2.0 * STAGES * (0.25 * s * s + 1.0 / 12.0) + rise * c * c + 0.1 * s * s
        slope = (0.5 * STAGES + 0.1 - rise) * s * c
        weight = 2.0 * GRAVITY * float(heights.sum())
        return Weights(inertia, slope, weight * s, weight * c)

    v0 = mechanism.lift(mechanism.home, [FALLING])
    scene = Scene("scissor_lift", mechanism, mechanism.home, v0, times_of(3.0))
    geometry = "bars as rods, Lagrange by hand"
    return of_energy("scissor lift, 3 stages", scene, OneDof(shape, weigh), geometry)


SKEW = pin.rpy.rpyToMatrix(0.0, 0.5, 0.7)
"""Takes the linkages' plane out of the vertical."""


def skew() -> Motion:
    """The antiparallelogram in a skew plane, its cut revolute joint closed in space, with redundant rows."""
    lengths, (y, ydot) = (2.0, 1.0, 2.0, 1.0), (0.1, -2.0)
    flat = four_bar(*lengths, y=y, assembly=-1)
    model = flat.model.copy()
    for i, parent in enumerate(model.parents):
        if i and parent == 0:
            model.jointPlacements[i] = pin.SE3(SKEW, np.zeros(3)) * model.jointPlacements[i]
    hinge = RevoluteClosure("q2_tip", "q3_tip", axis=(1.0, 0.0, 0.0))
    mechanism = Mechanism(model, [hinge], ["q1"], home=flat.home)
    _, right, up = GRAVITY * SKEW[2]
    v0 = mechanism.lift(mechanism.home, [ydot])
    scene = Scene("skew_antiparallelogram", mechanism, mechanism.home, v0, times_of(5.0))
    title = "antiparallelogram in a skew plane (spatial, redundant)"
    return of_energy(title, scene, reduced.four_bar(lengths, -1, complex(right, up)))


# --------------------------------------------------------------------------- several coordinates


def chain() -> Motion:
    """Three change-point four-bars, each on the coupler of the one before: their crossings overlap."""
    lengths, parents = [CHANGE_POINT] * 3, [-1, 0, 1]
    y, ydot = np.array([2.5, 2.55, 2.6]), np.array([1.5, 1.4, 1.3])
    mechanism = four_bars(lengths, y.tolist(), parents)
    system, curves = loops(mechanism, lengths, parents)
    title = "chain of 3 change-point four-bars (m = 3)"
    return _several("four_bar_chain", title, mechanism, system, (y, ydot), joints_reader(curves))


BASE = pin.Inertia(3.0, np.zeros(3), np.diag([0.6, 0.4, 0.5]))


def floating() -> Motion:
    """A change-point four-bar on a free body, thrown: base and links turn and cross in the plane."""
    mechanism = four_bars([CHANGE_POINT], [2.5], floating=BASE)
    system, curves = loops(mechanism, [CHANGE_POINT], [-1], BASE)
    y, ydot = np.array([0.0, 0.0, 0.0, 2.5]), np.array([0.4, 3.0, -0.5, 2.0])
    title = "change-point four-bar on a floating base (m = 7)"
    return _several("floating_change_point", title, mechanism, system, (y, ydot), floating_reader(curves))


def floating_reader(curves: Curves) -> Read:
    """q and v of a linkage on a free body: its place, its turn about x as a quaternion, its own velocity."""

    def read(x: Array) -> tuple[Array, Array]:
        y, ydot = np.split(x, 2)
        q, G, _ = curves(y)
        rate = G @ ydot
        along = np.exp(-1j * y[2]) * (rate[0] + 1j * rate[1])
        place = [0.0, y[0], y[1], np.sin(0.5 * y[2]), 0.0, 0.0, np.cos(0.5 * y[2])]
        moving = [0.0, along.real, along.imag, rate[2], 0.0, 0.0]
        return np.concatenate([place, q[3:]]), np.concatenate([moving, rate[3:]])

    return read


def _several(
    name: str, title: str, mechanism: Mechanism, system: SeveralDof, start: tuple[Array, Array], read: Read
) -> Motion:
    """2 s by Lagrange's equation, against Hamilton's."""
    first, second = system.lagrange(*start, read), system.hamilton(*start, read)
    scene = Scene(name, mechanism, *read(first.x0), times_of(2.0))
    what = "γ in closed form, Lagrange's equation by hand", "Hamilton's equations"
    return of_two(title, scene, first, second, what, first, steps=SLOW_STEPS, cap=SLOW_CAP)


def loops(
    mechanism: Mechanism, lengths: Sequence[Lengths], parents: Sequence[int], base: pin.Inertia | None = None
) -> tuple[SeveralDof, Curves]:
    """Planar bodies and γ of `four_bars`, on the ground or on a free body whose place and turn come first."""
    free = 0 if base is None else 3
    before = mechanism.nv - 3 * len(lengths) - free  # velocities of a free body that leave the plane
    n, k = mechanism.nv - before, 1 + 3 * len(lengths)
    S, A, carriers = np.zeros((k, n)), np.zeros((k, k), dtype=complex), {-1: (0, np.zeros(k, complex))}
    if free:
        S[0, 2] = 1.0
    at = np.array(
        [
            [mechanism.joint(f"{part}{i}").idx_v - before for part in ("crank", "coupler", "rocker")]
            for i in range(len(lengths))
        ]
    )
    for i, (l0, l1, l2, l3) in enumerate(lengths):
        body, origin = carriers[parents[i]]
        crank, coupler, rocker = range(1 + 3 * i, 4 + 3 * i)
        S[crank], S[rocker] = S[body] + np.eye(n)[at[i, 0]], S[body] + np.eye(n)[at[i, 2]]
        S[coupler] = S[crank] + np.eye(n)[at[i, 1]]
        unit = np.eye(k)
        middle = origin + l1 * unit[crank] + 0.5 * l2 * unit[coupler]
        A[crank], A[coupler] = origin + 0.5 * l1 * unit[crank], middle
        A[rocker] = origin + l0 * unit[body] + 0.5 * l3 * unit[rocker]
        carriers[i] = coupler, middle
    bars = np.array(lengths)[:, 1:].ravel()
    mass = np.concatenate([[0.0 if base is None else base.mass], np.ones(len(bars))])
    moment = np.concatenate([[0.0 if base is None else base.inertia[0, 0]], bars**2 / 12.0])
    shapes = [FourBar(*sizes) for sizes in lengths]

    def curves(y: Array) -> tuple[Array, Array, Array]:
        q, G, D = np.zeros(n), np.zeros((n, len(y))), np.zeros((n, len(y)))
        q[:free], G[:free, :free] = y[:free], np.eye(free)
        for i, shape in enumerate(shapes):
            q[at[i]], G[at[i], free + i], D[at[i], free + i] = shape.evaluate(float(y[free + i]))
        return q, G, D

    return SeveralDof(Planar(S, A, np.arange(k), mass, moment), curves, bool(free)), curves


# --------------------------------------------------------------------------- all

MOTIONS: dict[str, Callable[[], Motion]] = {
    **{name: partial(_parallelogram, name) for name in PARALLELOGRAMS},
    **{name: partial(_four_bar, name) for name in FOUR_BARS},
    "n_four_bar_1": partial(n_bars, 1, 5.0),
    "n_four_bar_5": partial(n_bars, 5, 5.0),
    "n_four_bar_40": partial(n_bars, 40, 5.0, SLOW_STEPS, SLOW_CAP),
    "andrews": andrews,
    "bricard": bricard,
    "flyball": flyball,
    "scissor_lift": scissor,
    "skew_antiparallelogram": skew,
    "four_bar_chain": chain,
    "floating_change_point": floating,
    "delta": robots.delta,
    "walker": robots.walker,
}
"""Scenes by name, made when called."""
