"""What a right-hand side costs, part by part, against the number of loops."""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable

import numpy as np

from ..arguments import DEFAULT, Arguments, file, pathname, whole
from ..dynamics.problem import set_out
from ..examples.linkages import n_four_bar
from ..maps.choice import MapChoice
from ..maps.cluster.options import BridgeOptions
from ..maps.march import same_branch
from ..mechanism.folders.loader import load
from ..native import backends
from ..printing import along, table, write_json
from ..simulation.simulate import simulate
from .benchmark_native import native_seconds, thread_gain

SIZES = (1, 5, 10, 20, 40)
SHARES = ("map", "M_and_C", "rest", "zone_test")
ANGLE = 1.2
"""rad: cranks well away from flat, so that only the regular path is timed."""


def seconds_per_call(call: Callable[[], object], budget: float = 0.1) -> float:
    """Smallest mean time of a call over five rounds, s: the least disturbed by other processes."""
    begun = time.perf_counter()
    call()
    once = max(time.perf_counter() - begun, 1e-7)
    count = max(3, int(budget / 5.0 / once))
    rounds = []
    for _ in range(5):
        begun = time.perf_counter()
        for _ in range(count):
            call()
        rounds.append((time.perf_counter() - begun) / count)
    return min(rounds)


def naive_seconds(n: int, budget: float = 0.1) -> float:
    """The same right-hand side as one writes it first: one Jacobian a frame and dense solves, s.

    The yardstick of this machine: both times are quoted, and their ratio travels.
    """
    import pinocchio as pin

    mechanism = n_four_bar(n, ANGLE)
    model, q = mechanism.model, mechanism.home
    data = model.createData()
    frames = [(model.getFrameId(c.frame1), model.getFrameId(c.frame2)) for c in mechanism.loops]
    v = mechanism.lift(q, [1.0])
    dependent, independent = mechanism.iv_dependent, mechanism.iv_independent
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def evaluate() -> object:
        pin.forwardKinematics(model, data, q, v, 0.0 * v)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        K, k = [], []
        for first, second in frames:
            J1 = pin.getFrameJacobian(model, data, first, axes)
            J2 = pin.getFrameJacobian(model, data, second, axes)
            K.append((J1 - J2)[1:3])
            a1 = pin.getFrameClassicalAcceleration(model, data, first, axes).linear
            a2 = pin.getFrameClassicalAcceleration(model, data, second, axes).linear
            k.append((a2 - a1)[1:3])
        stacked, bias = np.vstack(K), np.concatenate(k)
        G = np.zeros((model.nv, 1))
        G[independent] = 1.0
        G[dependent] = np.linalg.solve(stacked[:, dependent], -stacked[:, independent])
        g = np.zeros(model.nv)
        g[dependent] = np.linalg.solve(stacked[:, dependent], bias)
        M = pin.crba(model, data, q)
        C = pin.nle(model, data, q, v)
        return np.linalg.solve(G.T @ M @ G, G.T @ (-C - M @ g))

    return seconds_per_call(evaluate, budget)


def measure(n: int, budget: float = 0.1) -> dict[str, float]:
    """Microseconds per right-hand side, per RK4 step, and per part, for n loops."""
    mechanism = n_four_bar(n, ANGLE)
    motion = set_out(mechanism)
    start, equations = motion.start, motion.equations
    path, tree = start.path, mechanism.tree
    q, G = start.point.q, start.point.G[:, 0]
    x = np.array([ANGLE, 1.0])
    sweep = itertools.cycle(ANGLE + 1e-4 * np.sin(np.arange(64)))

    def right_hand_side() -> object:
        x[0] = next(sweep)
        return equations(0.0, x.copy())

    explicit = MapChoice().over(start)
    unit = np.ones(1)

    def solve_map() -> object:
        return explicit.at(np.array([next(sweep)]), unit)

    def constraint() -> object:
        tree.jacobians(q)
        path.implicit.residual()
        return path.implicit.jacobian()

    def bias() -> object:
        tree.rnea(q, G, tree.zero)
        return path.implicit.bias()

    def inertia() -> object:
        M = tree.crba(q)
        return tree.rnea(q, G, G), G @ (M @ G)

    K = constraint()
    assert isinstance(K, np.ndarray)
    K_i = K[:, path.independent[0]]
    factor = path.factor

    def solve() -> object:
        factor.factor(K)
        return factor.solve(K_i)

    here, there = start.point, path.step(start.point, start.point.y + 1e-3, start.point.ydot)
    assert there is not None
    zone = BridgeOptions().zone

    def zone_test() -> object:
        return there.conditioning < zone or not same_branch(here, there)

    def steps(count: int) -> float:
        return seconds_per_call(
            lambda: simulate(mechanism, duration=count * 1e-4, step=1e-4, backend="python"), budget
        )

    few, many = 20, 120
    rhs, whole = seconds_per_call(right_hand_side, budget), seconds_per_call(solve_map, budget)
    masses = seconds_per_call(inertia, budget)
    times = {
        "rhs": rhs,
        "rk4_step": (steps(many) - steps(few)) / (many - few),
        "map": whole,
        "M_and_C": masses,
        "rest": max(rhs - whole - masses, 0.0),
        "zone_test": seconds_per_call(zone_test, budget),
        "numpy_phi_K": seconds_per_call(constraint, budget),
        "numpy_solve": seconds_per_call(solve, budget),
        "numpy_bias": seconds_per_call(bias, budget),
        "naive_rhs": naive_seconds(n, budget),
    }
    native = native_seconds(mechanism)
    per_rhs = {"native_newton": native.pop("native_newton")} if native else {}
    return {"loops": n} | {name: 1e6 * value for name, value in (times | native).items()} | per_rhs


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = f"numbers of loops; {DEFAULT}"
    add_to.add("--sizes", whole(1, 1000), type=int, nargs="+", default=list(SIZES), metavar="N", help=text)
    text = "write the figures to this JSON file"
    add_to.add("--out", file((".json",), "a record of figures"), type=pathname, metavar="FILE", help=text)
    add_to.add("--quick", action="store_true", help="short rounds, for a smoke test")


def run(args: argparse.Namespace) -> int:
    """Print the tables."""
    rows = [measure(n, 0.01 if args.quick else 0.2) for n in along(args.sizes, "benchmark")]
    names = list(rows[0])
    print("microseconds, smallest of 5 rounds. map: predict, Newton, G, g and the zone test; rest: reduced")
    print("equation and objects; numpy_*: parts of the reference path that the map replaces where it can")
    cells = [[f"{row[name]:.4g}" for name in names] for row in rows]
    print(table([f" {name}" for name in names], cells, None))
    shares = [[f"{row['loops']:.0f}", *(f"{row[part] / row['rhs']:.1%}" for part in SHARES)] for row in rows]
    print(table([" loops", *(f" {part}" for part in SHARES)], shares, None))
    if len(rows) > 1:
        sizes = np.log([row["loops"] for row in rows[-3:]])
        slope = float(np.polyfit(sizes, np.log([row["rhs"] for row in rows[-3:]]), 1)[0])
        print(f"cost grows as N^{slope:.2f} over the largest sizes")
    _print_native(rows)
    if args.out:
        write_json(args.out, rows)
    return 0


def _print_native(rows: list[dict[str, float]]) -> None:
    """The compiled kernel's share of the table, or why there is none."""
    state = backends()["native"]
    if not state.available:
        print(f"no compiled kernel: {state.reason}")
        return
    print("native_step: an RK4 step in the compiled kernel; pinocchio_rhs: computeJointJacobians, rnea twice")
    print("and crba from C++; native_newton: Newton iterations per right-hand side")
    if len(rows) > 1:
        sizes = np.log([row["loops"] for row in rows])
        slope = float(np.polyfit(sizes, np.log([row["native_step"] for row in rows]), 1)[0])
        print(f"a step in the kernel costs N^{slope:.2f}")
    crank_rocker = native_seconds(load("crank_rocker"), h=1e-3)
    print(f"crank-rocker: {1e6 * crank_rocker['native_step']:.3g} µs a step of 1e-3 s")
    print(f"two threads do {thread_gain(load('crank_rocker')):.2f} times the work of one")
