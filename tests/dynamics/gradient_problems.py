"""Writes the problems of `robust_gcp.reports.gradients`: `python -m tests.dynamics.gradient_problems`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.families import four_bars, scissor_lift
from robust_gcp.examples.linkages import four_bar
from robust_gcp.mechanism.closures import closure_frames
from robust_gcp.reports import gradients

from ..exact import Exact, Matrix, Vector
from .test_derivatives_singular import PLACES, modes, placed

Array = NDArray[np.float64]

DIGITS = 30

APART = Decimal("1e-18")
"""Step of differences by y of what errs by 1e-40: errors of 1e-36 and 1e-22."""

NEAR = (0.3, 1e-1, 1e-2, 1e-3, 1e-4)
"""Along a mode from where modes cross, rad."""


def linkage(mech: rg.Mechanism) -> dict[str, Any]:
    """A planar mechanism with point closures, as plain numbers."""
    model = mech.model
    frames = closure_frames(model, mech.loops)
    half = len(frames) // 2

    def plane(at: Array) -> list[float]:
        return [float(at[1]), float(at[2])]

    return {
        "joints": [
            {
                "name": str(model.names[j]),
                "parent": int(model.parents[j]) - 1,
                "kind": model.joints[j].shortname().removeprefix("JointModel"),
                "place": plane(model.jointPlacements[j].translation),
                "mass": float(model.inertias[j].mass),
                "centre": plane(model.inertias[j].lever),
                "inertia": float(model.inertias[j].inertia[0, 0]),
            }
            for j in range(1, model.njoints)
        ],
        "gravity": float(model.gravity.linear[2]),
        "closures": [
            [[joint - 1, plane(place.translation)] for joint, place in pair]
            for pair in zip(frames[:half], frames[half:], strict=True)
        ],
        "independent": list(mech.independent),
    }


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
    exact = Exact(mech)
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


def singular() -> Iterator[dict[str, Any]]:
    for name in PLACES:
        _, q = placed(name)
        for number, (mech, tangent) in enumerate(modes(name)):
            m = mech.m
            G = tangent @ np.linalg.inv(tangent[mech.iv_independent])
            u, across = np.array([1.25, -0.75])[:m], np.array([1.0, 0.7])[:m]
            udot, *parts = Exact(mech).at_singularity(q, tangent, u, across)
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
    found = [*regular(), *singular()]
    Path(gradients.PROBLEMS).write_text(json.dumps(found, indent=None, separators=(",", ":")) + "\n")
    print(len(found), "problems,", {k: sum(p["kind"] == k for p in found) for k in ("regular", "near", "at")})


if __name__ == "__main__":
    pin.seed(0)
    main()
