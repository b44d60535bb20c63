"""Writes the problems of `robust_gcp.reports.gradients`: `python -m tests.dynamics.gradient_problems`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.families import four_bars, scissor_lift
from robust_gcp.examples.linkages import four_bar
from robust_gcp.mechanism.constraint.closures import closure_frames
from robust_gcp.reports.gradients.scores import PROBLEMS

from ..exact import Exact, Matrix, Vector
from ..exact_in_space import ExactInSpace
from .test_derivatives_singular import PLACES, modes_at, placed

Array = NDArray[np.float64]

DIGITS = 30

APART = Decimal("1e-18")
"""Step of differences by y of what errs by 1e-40: errors of 1e-36 and 1e-22."""

CROSSINGS, REGULAR = (
    (0, 2, 4, 7, 10),
    ((4, 1), (4, 2), (4, 3), (4, 5), (5, 1), (5, 3), (5, 4), (6, 2), (6, 7)),
)
"""Seeds of linkages in space of which two modes cross, and numbers of joints and seeds of others."""

NEAR = (0.3, 1e-1, 1e-2, 1e-3, 1e-4)
"""Along a mode from where modes cross, rad."""


def linkage(mech: rg.Mechanism) -> dict[str, Any]:
    """A mechanism with point closures, as plain numbers."""
    model = mech.model
    frames = closure_frames(model, mech.loops)
    half, space = len(frames) // 2, in_space(mech)

    def point(at: Array) -> list[float]:
        return [float(x) for x in at[0 if space else 1 :]]

    return {
        "joints": [
            {
                "name": str(model.names[j]),
                "parent": int(model.parents[j]) - 1,
                "kind": model.joints[j].shortname().removeprefix("JointModel"),
                "place": point(model.jointPlacements[j].translation),
                **({"turn": model.jointPlacements[j].rotation.tolist()} if space else {}),
                "mass": float(model.inertias[j].mass),
                "centre": point(model.inertias[j].lever),
                "inertia": model.inertias[j].inertia.tolist()
                if space
                else float(model.inertias[j].inertia[0, 0]),
            }
            for j in range(1, model.njoints)
        ],
        "gravity": model.gravity.linear.tolist() if space else float(model.gravity.linear[2]),
        "closures": [
            [[joint - 1, point(place.translation)] for joint, place in pair]
            for pair in zip(frames[:half], frames[half:], strict=True)
        ],
        "independent": list(mech.independent),
    }


def in_space(mech: rg.Mechanism) -> bool:
    """Whether it is one of those made here in space."""
    return str(mech.model.name).startswith("space")


def exactly(mech: rg.Mechanism) -> Exact:
    return ExactInSpace(mech) if in_space(mech) else Exact(mech)


def differentiated(exact: Exact, q: Vector, u: Vector, tau: Vector) -> tuple[list[str], ...]:
    """u̇ and its derivatives at a regular q, to `DIGITS`."""
    m = exact.m

    def value(y: Vector, speed: Vector) -> tuple[Vector, Matrix]:
        udot, lifted = exact.forward(exact.closed(q, y), speed)
        pushed = [sum(a * b for a, b in zip(row, tau, strict=True)) for row in lifted]
        return [a + b for a, b in zip(udot, pushed, strict=True)], lifted

    y = [q[k] for k in exact.i]
    udot, lifted = value(y, u)
    by_y, by_u = [], []
    for j in range(m):
        pairs = []
        for step, of_y in ((APART, True), (Decimal(1), False)):
            ends = []
            for sign in (1, -1):
                moved, speed = list(y), list(u)
                (moved if of_y else speed)[j] += sign * step
                ends.append(value(moved, speed)[0])
            pairs.append([(a - b) / (2 * step) for a, b in zip(*ends, strict=True)])
        by_y.append(pairs[0])
        by_u.append(pairs[1])
    columns = ([udot], list(zip(*by_y, strict=True)), list(zip(*by_u, strict=True)), lifted)
    return tuple([[f"{x:.{DIGITS - 1}e}" for x in row] for row in part] for part in columns)


def problem(name: str, kind: str, mech: rg.Mechanism, q: Array, u: Array, tau: Array) -> dict[str, Any]:
    exact = exactly(mech)
    given = [Decimal(float(x)) for x in q]
    closed = exact.closed(given, [given[k] for k in exact.i])
    parts = differentiated(exact, closed, *([Decimal(float(x)) for x in part] for part in (u, tau)))
    state = {"q": [float(x) for x in closed], "u": u.tolist(), "tau": tau.tolist(), "mode": None}
    return {"name": name, "kind": kind, "linkage": linkage(mech), **state, **_told(*parts)}


def _told(udot: Any, da_dy: Any, da_dv: Any, da_dtau: Any) -> dict[str, Any]:
    return {"udot": udot[0], "da_dy": da_dy, "da_dv": da_dv, "da_dtau": da_dtau}


def regular() -> Iterator[dict[str, Any]]:
    rng = np.random.default_rng(0)
    made = {name: rg.load(name) for name in ("crank_rocker", "five_bar", "parallelogram")}
    made["scissor lift"] = scissor_lift(2)
    while len(made) < 24:
        lengths = rng.uniform(0.5, 3.0, 4)
        try:
            made[f"random four-bar {len(made)}"] = four_bar(*lengths, y=float(rng.uniform(0.3, 2.8)))
        except rg.RobustGcpError:
            continue
    made["two loops"] = four_bars([(1.0, 2.2, 2.0, 1.5), (1.0, 2.0, 1.7, 1.4)], [0.6, 0.5], (-1, 0))
    for name, mech in made.items():
        q = mech.assemble(mech.home)
        u, tau = rng.normal(size=mech.m), rng.normal(size=mech.nv)
        yield problem(name, "regular", mech, q, u, tau)


def spatial(seed: int, joints: int, crossing: bool, slides: bool = False) -> rg.Mechanism:
    """Two branches that meet in a point, the joints' axes along x, y or z at q = 0, with all numbers dyadic.

    At a crossing no joint moves the point along z there: axes along x lie at its y, those along y at its x.
    """
    rng = np.random.default_rng(seed)

    def dyadic(low: float, high: float, count: int = 3) -> Array:
        return np.round(64.0 * rng.uniform(low, high, count)) / 64.0

    model = pin.Model()
    model.name, model.gravity.linear = f"space {seed}", dyadic(-9.0, 9.0)
    meeting = dyadic(-0.5, 0.5)
    parent, placed, at, ends = 0, np.eye(3), -meeting, []
    for k in range(joints):
        if k == joints // 2:  # the other branch
            ends.append((parent, placed.T @ -at))
            parent, placed, at = 0, np.eye(3), -meeting
        axis = int(rng.integers(3))
        origin = dyadic(-1.0, 1.0)  # seen from the point where the branches meet
        if crossing and axis < 2:
            origin[1 - axis] = 0.0
        turn = np.roll(np.eye(3), axis, axis=0)  # takes x to the axis
        frame = pin.SE3(placed.T @ turn, placed.T @ (origin - at))
        kind = "PX" if slides and k == 1 and axis != 2 else "RX"
        parent = model.addJoint(parent, getattr(pin, f"JointModel{kind}")(), frame, f"q{k + 1}")
        placed, at = turn, origin
        half = dyadic(-0.5, 0.5, 9).reshape(3, 3)
        body = pin.Inertia(
            float(dyadic(0.25, 2.0, 1)[0]), dyadic(-0.5, 0.5), np.eye(3) / 64.0 + half @ half.T / 8.0
        )
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    ends.append((parent, placed.T @ -at))
    for k, (joint, place) in enumerate(ends):
        model.addFrame(pin.Frame(f"end {k}", joint, pin.SE3(np.eye(3), place), pin.FrameType.OP_FRAME))
    closure = rg.PointClosure("end 0", "end 1")
    names = [str(name) for name in model.names][1 : joints - 2]
    return rg.Mechanism.from_pinocchio(model, [closure], names, np.zeros(joints))


def regular_in_space() -> Iterator[dict[str, Any]]:
    rng = np.random.default_rng(1)
    for joints, seed in REGULAR:
        mech = spatial(seed, joints, False, slides=seed % 3 == 0)
        moved = mech.home.copy()
        moved[mech.iv_independent] += rng.uniform(0.05, 0.15, mech.m)
        q = mech.assemble(moved, hold=mech.independent)
        u, tau = rng.normal(size=mech.m), rng.normal(size=mech.nv)
        yield problem(f"in space, {joints} joints, {seed}", "regular", mech, q, u, tau)


def places() -> Iterator[tuple[str, rg.Mechanism, list[Decimal]]]:
    """Singular configurations in the plane, then in space."""
    for name in PLACES:
        yield name, *placed(name)
    for seed in CROSSINGS:
        mech = spatial(seed, 4, True, slides=seed % 3 == 0)
        yield f"in space, {seed}", mech, [Decimal(0)] * mech.nq


def singular() -> Iterator[dict[str, Any]]:
    for name, placed_at, q in places():
        for number, (mech, tangent) in enumerate(modes_at(placed_at, q)):
            m = mech.m
            G = tangent @ np.linalg.inv(tangent[mech.iv_independent])
            u, across = np.array([1.25, -0.75])[:m], np.array([1.0, 0.7])[:m]
            udot, *parts = exactly(mech).at_singularity(q, tangent, u, across)
            rows = [[udot], *parts]
            told = _told(*([[f"{x:.17e}" for x in row] for row in part] for part in rows))
            where = {"q": [float(x) for x in q], "u": u.tolist(), "tau": [0.0] * mech.nv}
            label = f"{name}, mode {number + 1}"
            at = {"name": label, "kind": "at", "linkage": linkage(mech), **where, "mode": tangent.tolist()}
            yield {**at, **told}
            for distance in NEAR:
                near = np.array([float(x) for x in q]) + distance * G @ across
                kind = "near" if distance < 0.3 else "regular"
                yield problem(f"{label}, {distance:g} rad away", kind, mech, near, u, np.zeros(mech.nv))


def main() -> None:
    """Write them."""
    found = [*regular(), *singular(), *regular_in_space()]
    PROBLEMS.write_text(json.dumps(found, indent=None, separators=(",", ":")) + "\n")
    print(len(found), "problems,", {k: sum(p["kind"] == k for p in found) for k in ("regular", "near", "at")})


if __name__ == "__main__":
    pin.seed(0)
    main()
