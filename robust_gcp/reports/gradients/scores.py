"""The problems, and how right derivatives of them are: `python -m robust_gcp reports gradients`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

from ... import Mechanism, RobustGcpError, derivatives
from ...arguments import Arguments, file, word
from ...mechanism.tree.tree import Array
from ...printing import table, write_json
from ..linkages import mechanism_of
from ..peers.parts import rigid_constraints

PROBLEMS = Path(__file__).with_name("problems.json")


@dataclass(frozen=True)
class Problem:
    """A linkage at a state, and the derivatives there.

    Torques act on all joints.

    Attributes
    ----------
    name, kind : str
        "regular", "near" (0.1 to 1e-4 rad from a singular configuration) or "at" one.
    linkage : dict
        See `reports.linkages`.
    q, u, tau : ndarray (nv,), (m,), (nv,)
        q to the last digit of a double; its independent entries are meant exactly.
    mode : ndarray (nv, m) or None
        At a singular configuration the mode that is meant, v in its span.
    udot, da_dy, da_dv, da_dtau : ndarray (m,), (m, m), (m, m), (m, nv)
        Of the independent accelerations: Gᵀ M G u̇ = Gᵀ (τ − C − M g).
    """

    name: str
    kind: str
    linkage: dict[str, Any]
    q: Array
    u: Array
    tau: Array
    mode: Array | None
    udot: Array
    da_dy: Array
    da_dv: Array
    da_dtau: Array

    def mechanism(self) -> Mechanism:
        """The linkage, with its loops closed."""
        return mechanism_of(self.linkage, self.q)

    @cached_property
    def state(self) -> tuple[Mechanism, Array, Array]:
        """The mechanism, q closed to its own rounding where that can be done, and v."""
        mech, q, mode = self.mechanism(), self.q, self.mode
        if mode is not None:
            return mech, q, mode @ np.linalg.solve(mode[mech.iv_independent], self.u)
        q = mech.assemble(q, hold=mech.independent)
        return mech, q, mech.lift(q, self.u)


def problems() -> list[Problem]:
    """All of them."""
    arrays = ("q", "u", "tau", "udot", "da_dy", "da_dv", "da_dtau")
    found = []
    for given in json.loads(PROBLEMS.read_text()):
        numbers = {key: np.array(given[key], dtype=float) for key in arrays}
        mode = None if given["mode"] is None else np.array(given["mode"], dtype=float)
        found.append(Problem(given["name"], given["kind"], given["linkage"], mode=mode, **numbers))
    return found


# --------------------------------------------------------------------------- scores

RIGHT = 1e-9
"""Relative error of the largest entry up to which a matrix is right, and beyond 1e-3 wrong."""

WRONG = 1e-3

Answer = tuple[Array, Array, Array, Array]
"""u̇ and its derivatives by y, u and τ."""


def of_robust_gcp(problem: Problem) -> Answer:
    """`rg.derivatives`."""
    found = derivatives(*problem.state, problem.tau, mode=problem.mode)
    return found.udot, found.da_dy, found.da_dv, found.da_dtau


def of_pinocchio(problem: Problem) -> Answer:
    """`computeConstraintDynamicsDerivatives` of rigid constraints, taken to y, u and τ.

    G and ∂v/∂y, which Pinocchio has not, are those of K and of its differences along G.
    """
    mech, q = problem.mechanism(), problem.q
    model, own = mech.own_model, mech.iv_independent
    data, (constraints, datas) = model.createData(), rigid_constraints(mech)
    settings = pin.ProximalSettings(1e-14, 1e-14, 1e-8, 200)
    pin.initConstraintDynamics(model, data, constraints, datas)
    G = _map(mech, q)
    v = G @ problem.u
    a = np.array(pin.constraintDynamics(model, data, q, v, problem.tau, constraints, datas, settings))
    by_q, by_v, by_tau, *_ = pin.computeConstraintDynamicsDerivatives(
        model, data, constraints, datas, settings
    )
    h = 1e-5
    turned = [(_map(mech, q + h * g) - _map(mech, q - h * g)) @ problem.u / (2.0 * h) for g in G.T]
    by_y = np.asarray(by_q) @ G + np.asarray(by_v) @ np.array(turned).T
    return a[own], by_y[own], (np.asarray(by_v) @ G)[own], np.asarray(by_tau)[own]


def of_mujoco(problem: Problem) -> Answer:
    """Differences of `mj_forward`, which is what MuJoCo's own `mjd_transitionFD` takes, along y, u and τ.

    Its closures are as hard as they can be; G, which it has not, is that of K.
    """
    import mujoco  # an extra

    from ..peers.mujoco import compiled

    mech, q, u = problem.mechanism(), problem.q, problem.u
    model = compiled(mech, "Euler", True)
    data = mujoco.MjData(model)

    def accelerations(q: Array, u: Array, tau: Array) -> Array:
        data.qpos[:], data.qvel[:] = q, _map(mech, q) @ u
        data.qfrc_applied[:] = tau
        mujoco.mj_forward(model, data)
        return np.array(data.qacc[mech.iv_independent])

    def slopes(moved: Callable[[Array], Array], size: int, h: float) -> Array:
        return np.array([(moved(h * e) - moved(-h * e)) / (2.0 * h) for e in np.eye(size)]).T

    G = _map(mech, q)
    return (
        accelerations(q, u, problem.tau),
        slopes(lambda dy: accelerations(q + G @ dy, u, problem.tau), len(u), 1e-5),
        slopes(lambda du: accelerations(q, u + du, problem.tau), len(u), 0.1),
        slopes(lambda dtau: accelerations(q, u, problem.tau + dtau), len(q), 0.1),
    )


def engines() -> dict[str, Callable[[Problem], Answer]]:
    """Those that are installed, by their names; Exudyn has no derivatives of accelerations."""
    found: dict[str, Callable[[Problem], Answer]] = {"robust_gcp": of_robust_gcp, "pinocchio": of_pinocchio}
    return {**found, "mujoco": of_mujoco} if find_spec("mujoco") is not None else found


@dataclass(frozen=True)
class Score:
    """How an engine did at problems of a kind: how many are right, inaccurate, wrong and refused."""

    engine: str
    kind: str
    count: int
    right: int
    inaccurate: int
    wrong: int
    refused: int
    median: float
    worst: float


def error(problem: Problem, answer: Answer) -> float:
    """The largest error, relative to the largest entry of its matrix or of u̇'s scale."""
    exact = problem.udot, problem.da_dy, problem.da_dv, problem.da_dtau
    size = max(float(np.abs(part).max()) for part in exact[:3])
    errors = [float(np.abs(a - b).max()) for a, b in zip(answer, exact, strict=True)]
    relative = [*(e / size for e in errors[:3]), errors[3] / float(np.abs(problem.da_dtau).max())]
    return max(relative) if np.all(np.isfinite(relative)) else np.inf


def scored(
    engine: str, given: list[Problem], answer: Callable[[Problem], Answer] | None = None
) -> list[Score]:
    """Scores of an engine, or of an answer under its name, a row for each kind of problem."""
    asked = engines()[engine] if answer is None else answer
    errors: dict[str, list[float | None]] = {"regular": [], "near": [], "at": []}
    for problem in given:
        try:
            errors[problem.kind].append(error(problem, asked(problem)))
        except (RobustGcpError, ValueError, RuntimeError, np.linalg.LinAlgError):
            errors[problem.kind].append(None)
    found = []
    for kind, every in errors.items():
        told = [e for e in every if e is not None]
        right, wrong = sum(e <= RIGHT for e in told), sum(e > WRONG for e in told)
        middle, worst = (median(told), max(told)) if told else (float("nan"), float("nan"))
        rest = len(told) - right - wrong
        counts = len(every), right, rest, wrong, len(every) - len(told)
        found.append(Score(engine, kind, *counts, middle, worst))
    return found


def arguments(add_to: Arguments) -> None:
    """Name the arguments."""
    text = "robust_gcp, pinocchio or mujoco, several times for several; all that are installed unless given"
    add_to.add("--engine", word(engines()), action="append", metavar="NAME", help=text)
    add_to.path("--out", file((".json",), "a record of scores"), "FILE", "write the scores to this JSON file")


def run(args: argparse.Namespace) -> int:
    """Print the scores; exit code 1 where one of ours is wrong."""
    given, found = problems(), []
    for engine in args.engine or engines():
        found += scored(engine, given)
    print(f"{len(given)} problems; right: to {RIGHT:g} of the largest entry, wrong: beyond {WRONG:g}")
    header = ("engine", "kind", "problems", "right", "inaccurate", "wrong", "refused", "median", "worst")
    cells = [
        [s.engine, s.kind, *map(str, (s.count, s.right, s.inaccurate, s.wrong, s.refused)),
         f"{s.median:.1e}", f"{s.worst:.1e}"]
        for s in found
    ]  # fmt: skip
    print(table(header, cells, None))
    if args.out:
        write_json(args.out, [asdict(score) for score in found])
    return 1 if any(s.wrong for s in found if s.engine == "robust_gcp") else 0


def _map(mech: Mechanism, q: Array) -> Array:
    """G of K G = 0 at q."""
    K, own, rest = mech.K(q), mech.iv_independent, mech.iv_dependent
    G = np.zeros((mech.nv, mech.m))
    G[own] = np.eye(mech.m)
    G[rest] = -np.linalg.solve(K[:, rest], K[:, own])
    return G
