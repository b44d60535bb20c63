"""What a right-hand side costs, part by part, and a step of the kernel, against the number of loops."""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from .. import BridgeOptions, Mechanism, OptionError, backends, load, simulate
from ..arguments import DEFAULT, Arguments, existing_file, file, known_folder, pathname, whole, word
from ..dynamics.problem import initial_value_problem
from ..examples.linkages import n_four_bar
from ..kernel.library import library
from ..maps.choice import MapChoice
from ..maps.cluster.regular_ground import same_branch
from ..printing import along, table, write_json
from . import derivative_cost, derivative_paths, robot_speed, throughput
from .robot_speed import batches
from .throughput import gain
from .timing import exponent, least, seconds

SIZES = (1, 5, 10, 20, 40)
SHARES = ("map", "M_and_C", "rest", "zone_test")
ANGLE = 1.2
"""rad: cranks well away from flat, so that only the regular path is timed."""

ROUNDS = 50
"""Of each measurement in the kernel; the smallest counts, that is the one least disturbed."""


def seconds_per_call(call: Callable[[], object], budget: float = 0.1) -> float:
    """Smallest mean time of a call over five rounds, s: the least disturbed by other processes."""
    once = max(seconds(call, time.perf_counter), 1e-7)
    count = max(3, int(budget / 5.0 / once))

    def several() -> None:
        for _ in range(count):
            call()

    return least(several, 5, time.perf_counter) / count


def naive(n: int) -> Callable[[], object]:
    """The same right-hand side as one writes it first: one Jacobian a frame and dense solves.

    The yardstick of this machine: both times are quoted, and their ratio travels.
    """
    import pinocchio as pin

    mechanism = n_four_bar(n, ANGLE)
    model, q, data = mechanism.own_model, mechanism.home, mechanism.own_model.createData()
    frames = [[model.getFrameId(name) for name in (c.frame1, c.frame2)] for c in mechanism.loops]
    v = mechanism.lift(q, [1.0])
    dependent, independent = mechanism.iv_dependent, mechanism.iv_independent
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def evaluate() -> object:
        pin.forwardKinematics(model, data, q, v, 0.0 * v)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        rows, bias = [], []
        for ends in frames:
            J1, J2 = (pin.getFrameJacobian(model, data, frame, axes) for frame in ends)
            a1, a2 = (pin.getFrameClassicalAcceleration(model, data, frame, axes).linear for frame in ends)
            rows.append((J1 - J2)[1:3])
            bias.append((a2 - a1)[1:3])
        K, k = np.vstack(rows), np.concatenate(bias)
        G, g = np.zeros((model.nv, 1)), np.zeros(model.nv)
        G[independent] = 1.0
        G[dependent] = np.linalg.solve(K[:, dependent], -K[:, independent])
        g[dependent] = np.linalg.solve(K[:, dependent], k)
        M = pin.crba(model, data, q)
        C = pin.nle(model, data, q, v)
        return np.linalg.solve(G.T @ M @ G, G.T @ (-C - M @ g))

    return evaluate


def measure(n: int, budget: float = 0.1) -> dict[str, float]:
    """Microseconds per right-hand side, per RK4 step, and per part, for n loops."""
    mechanism = n_four_bar(n, ANGLE)
    motion = initial_value_problem(mechanism)
    start, equations = motion.start, motion.equations
    path, tree = start.path, mechanism.tree
    q, G = start.point.q, start.point.G[:, 0]
    sweep = itertools.cycle(ANGLE + 1e-4 * np.sin(np.arange(64)))
    explicit, unit = MapChoice().over(start), np.ones(1)
    here, there = start.point, path.step(start.point, start.point.y + 1e-3, start.point.ydot)
    assert there is not None
    zone = BridgeOptions().zone

    def constraint() -> np.ndarray:
        tree.jacobians(q)
        path.implicit.residual()
        return path.implicit.jacobian()

    def inertia() -> object:
        M = tree.crba(q)
        return tree.rnea(q, G, G), G @ (M @ G)

    K = constraint()
    K_i = K[:, path.independent[0]]

    def solve() -> object:
        path.factor.factor(K)
        return path.factor.solve(K_i)

    parts: dict[str, Callable[[], object]] = {
        "rhs": lambda: equations(0.0, np.array([next(sweep), 1.0])),
        "map": lambda: explicit.point_at(np.array([next(sweep)]), unit),
        "M_and_C": inertia,
        "zone_test": lambda: there.conditioning < zone or not same_branch(here, there),
        "numpy_phi_K": constraint,
        "numpy_solve": solve,
        "numpy_bias": lambda: (tree.rnea(q, G, tree.zero), path.implicit.bias()),
        "naive_rhs": naive(n),
    }
    times = {name: seconds_per_call(call, budget) for name, call in parts.items()}

    def steps(count: int) -> float:
        run = partial(simulate, mechanism, duration=count * 1e-4, step=1e-4, backend="python")
        return seconds_per_call(run, budget)

    few, many = 20, 120
    times["rk4_step"] = (steps(many) - steps(few)) / (many - few)
    times["rest"] = max(times["rhs"] - times["map"] - times["M_and_C"], 0.0)
    native = native_seconds(mechanism)
    per_rhs = {"native_newton": native.pop("native_newton")} if native else {}
    names = ("rhs", "rk4_step", "map", "M_and_C", "rest", *list(times)[3:8], *native)
    return {"loops": n} | {name: 1e6 * (times | native)[name] for name in names} | per_rhs


def native_seconds(mechanism: Mechanism, h: float = 1e-4) -> dict[str, float]:
    """Seconds per RK4 step in the kernel, and Newton iterations; empty without it."""
    if library() is None:
        return {}
    run = batches(mechanism, max(20, 1000 // mechanism.nv), h)  # some ms
    rounds = [run() for _ in range(ROUNDS)]
    return {"native_step": min(rounds)[0], "native_newton": rounds[0][1]}


def thread_gain(mechanism: Mechanism, steps: int = 20_000) -> float:
    """How many times the work of one thread two threads do in the same time, best of rounds."""
    if library() is None:
        return float("nan")
    return gain([batches(mechanism, steps, 1e-5) for _ in range(2)], ROUNDS // 3)


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"numbers of loops; {DEFAULT}"
    add_to.add("--sizes", whole(1, 1000), type=int, nargs="+", default=list(SIZES), metavar="N", help=text)
    text = "write the figures to this JSON file"
    add_to.add("--out", file((".json",), "a record of figures"), type=pathname, metavar="FILE", help=text)
    add_to.add("--quick", action="store_true", help="short rounds, for a smoke test")
    add_to.heading("robots in place of rows of loops")
    text = "time the robots in this folder and those below it against Pinocchio's aba and constraintDynamics"
    add_to.add("--robots", known_folder, type=pathname, metavar="DIR", help=text)
    add_to.add("--shipped", action="store_true", help="the same for shipped robots")
    text = "steps per second of so many starts at once, beside mujoco.rollout"
    add_to.add("--starts", whole(2, 100_000), type=int, metavar="N", help=text)
    text = "what derivatives cost: of some models, of the robots where they are given"
    add_to.add("--derivatives", action="store_true", help=text)
    text = "every way to calls beside the plain one, why it takes longer, and the largest errors"
    add_to.add("--paths", action="store_true", help=text)
    text = "with --derivatives or --paths: renew the tables in this document"
    add_to.add("--refresh", existing_file, type=pathname, metavar="FILE", help=text)
    text = "what robots stand on: fixed or free; as their files say when left out"
    add_to.add("--base", word(("fixed", "free")), metavar="BASE", help=text)


def run(args: argparse.Namespace) -> int:
    """Print the tables."""
    if args.refresh is not None and not (args.derivatives or args.paths):
        raise OptionError("--refresh: renews the tables of --derivatives or --paths; give one of them too")
    if args.starts is not None:
        return _starts(args)
    if args.paths:
        return derivative_paths.tell(2 if args.quick else ROUNDS, not args.quick, args.out, args.refresh)
    if args.derivatives:
        derivative_cost.tell(args.robots, args.base, 3 if args.quick else 4 * ROUNDS, args.out, args.refresh)
        return 0
    if args.robots is not None or args.shipped:
        return _robots(args)
    rows = [measure(n, 0.01 if args.quick else 0.2) for n in along(args.sizes, "benchmark")]
    names = list(rows[0])
    print("microseconds, smallest of 5 rounds. map: predict, Newton, G, g and the zone test; rest: reduced")
    print("equation and objects; numpy_*: parts of the reference path that the map replaces where it can")
    cells = [[f"{row[name]:.4g}" for name in names] for row in rows]
    print(table([f" {name}" for name in names], cells, None))
    shares = [[f"{row['loops']:.0f}", *(f"{row[part] / row['rhs']:.1%}" for part in SHARES)] for row in rows]
    print(table([" loops", *(f" {part}" for part in SHARES)], shares, None))
    if len(rows) > 1:
        print(f"cost grows as N^{_exponent(rows[-3:], 'rhs'):.2f} over the largest sizes")
    state = backends()["native"]
    if state.available:
        print("native_step: an RK4 step in the compiled kernel; native_newton: Newton iterations per")
        print("right-hand side")
        if len(rows) > 1:
            print(f"a step in the kernel costs N^{_exponent(rows, 'native_step'):.2f}")
        crank_rocker = load("crank_rocker")
        step = native_seconds(crank_rocker, 1e-3)["native_step"]
        print(f"crank-rocker: {1e6 * step:.3g} µs a step of 1e-3 s")
        print(f"two threads do {thread_gain(crank_rocker):.2f} times the work of one")
    else:
        print(f"no compiled kernel: {state.reason}")
    if args.out:
        write_json(args.out, rows)
    return 0


MANY = ("crank_rocker", "rhombus", "five_bar", "slider_crank", "walker", "stewart")
"""Shipped models that `--starts` steps."""


def _starts(args: argparse.Namespace) -> int:
    """The table of many starts."""
    steps, h, rounds = (50, 1e-3, 1) if args.quick else (500, 1e-3, 3)
    counts = sorted({1, os.cpu_count() or 1})
    rows = [
        throughput.measured(name, load(name), args.starts, steps, h, threads, rounds)
        for name, threads in along(list(itertools.product(MANY, counts)), "benchmark")
    ]
    print(
        f"steps per second of RK4, {args.starts} starts of {steps} steps of {h:g} s, best of {rounds} rounds;"
    )
    print("MuJoCo: RK4 with connect as hard as it goes")
    print(table(throughput.HEADER, rows, None))
    return 0


def _robots(args: argparse.Namespace) -> int:
    """The table of robots."""
    found: list[tuple[str | Path, str]] = [(name, name) for name in robot_speed.SHIPPED if args.shipped]
    if args.robots is not None:
        paths = robot_speed.robots_in(args.robots)
        found += [(path, str(path.relative_to(args.robots))) for path in paths]
    rounds = 3 if args.quick else ROUNDS
    rows = [robot_speed.measured(*one, args.base, rounds) for one in along(found, "benchmark")]
    print(
        f"µs, smallest of {rounds} rounds. step: RK4 step of {robot_speed.STEP:g} s in the kernel; aba (open"
    )
    print(
        "tree), constraintDynamics (cheapest right setting): a quarter of an RK4 step in a C++ loop; ratio:"
    )
    print("a step of ours over one evaluation of constraintDynamics, of aba where nothing is closed")
    print(table(robot_speed.HEADER, [row.cells for row in rows], None))
    if args.out:
        write_json(args.out, [asdict(row) | {"ratio": row.ratio} for row in rows])
    return 0


def _exponent(rows: Sequence[dict[str, float]], name: str) -> float:
    """p of cost ~ N^p."""
    return exponent([row["loops"] for row in rows], [row[name] for row in rows])
