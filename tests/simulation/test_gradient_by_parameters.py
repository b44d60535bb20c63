"""Gradients by masses, centres, inertias, rotors and gravity: against differences of runs, on every path."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.regressor import OF_A_BODY
from robust_gcp.simulation.derivatives import reverse_sweep

from ..dynamics.test_derivatives import floating
from .test_gradient import COST, slope

Array = NDArray[np.float64]


def changed(mech: rg.Mechanism, name: str, by: float) -> rg.Mechanism:
    """The same mechanism with one of its numbers changed, by Pinocchio."""
    model = mech.model.copy()
    joint, _, what = name.partition(".")
    axes = {"x": 0, "y": 1, "z": 2}
    if joint == "gravity":
        pull = np.array(model.gravity.linear)
        pull[axes[what]] += by
        model.gravity.linear = pull
    else:
        i = mech.joint(joint).index
        body = model.inertias[i].copy()
        if what == "armature":
            rotors = np.array(model.armature)
            rotors[mech.joint(joint).idx_v] += by
            model.armature = rotors
        elif what == "mass":
            body.mass += by
        elif what.startswith("com"):
            body.lever = np.array(body.lever) + by * np.eye(3)[axes[what[-1]]]
        else:
            pi = body.toDynamicParameters()
            pi[OF_A_BODY.index(what)] += by
            body = pin.Inertia.FromDynamicParameters(pi)
        model.inertias[i] = body
    return rg.Mechanism.from_pinocchio(model, mech.closures, mech.independent, mech.home, forces=mech.forces)


def thick(mech: rg.Mechanism) -> rg.Mechanism:
    """With rotors and some inertia about each body's centre: small changes make none that no body has."""
    model = mech.model.copy()
    model.armature = np.full(mech.nv, 0.05)
    for joint in mech.joints:
        model.inertias[joint.index] += pin.Inertia(0.1, np.array([0.03, 0.05, 0.02]), 0.05 * np.eye(3))
    return rg.Mechanism.from_pinocchio(model, mech.closures, mech.independent, mech.home, forces=mech.forces)


def feedback(t: float, q: Array, v: Array) -> Array:
    tau = -0.3 * np.asarray(v)
    tau[..., 0] += np.sin(np.asarray(q)[..., -1] + t)
    return tau


def value(run: rg.Trajectory, held: bool, cost: rg.Cost = COST) -> float:
    """The cost of a run under `feedback`, by the trapezoidal rule as `rg.Cost` says."""
    assert cost.terminal is not None and cost.running is not None
    total = float(cost.terminal(run.q[-1], run.v[-1]))
    for i in range(len(run.t) - 1):
        for k in (i, i + 1):
            at = i if held else k
            tau = feedback(run.t[at], run.q[at], run.v[at])
            total += 0.5 * (run.t[i + 1] - run.t[i]) * cost.running(run.t[k], run.q[k], run.v[k], tau)
    return total


def scenes() -> dict[str, tuple[rg.Mechanism, Array, float, tuple[str, ...]]]:
    """Mechanism, first speeds, step, and names of parameters."""
    crank, delta, rhombus = (thick(rg.load(name)) for name in ("crank_rocker", "delta", "rhombus"))
    free = floating(pin.JointModelFreeFlyer())
    arm = delta.joints[1].name
    first = free.joints[0].name
    return {
        "crank-rocker": (crank, np.array([2.0]), 5e-3, ("q1.m", "q2.my", "q2.com.z", "q3.mass", "gravity.z")),
        "delta": (
            delta,
            np.array([0.4, -0.5, 0.3]),
            5e-3,
            (
                *(f"{arm}.{short}" for short in OF_A_BODY),
                f"{arm}.com.x",
                f"{arm}.armature",
                "platform.Ixz",
                "gravity.y",
            ),
        ),
        "floating": (
            free,
            np.full(7, 0.4),
            5e-3,
            (f"{first}.mx", f"{first}.Ixy", f"{first}.com.y", f"{first}.mass", "gravity.x"),
        ),
        "through flat": (rhombus, np.array([-3.0]), 4e-3, ("q1.mz", "q2.mass", "q3.com.y", "gravity.z")),
    }


@pytest.mark.parametrize(
    ("name", "hold"),
    [(name, hold) for name in ("crank-rocker", "floating", "through flat") for hold in (False, True)]
    + [("delta", True)],
)
def test_against_differences_of_runs(name: str, hold: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """And what the reference finds without the kernel."""
    mech, u, h, names = scenes()[name]
    home = np.array([0.1, -0.1, 0.1]) if name == "through flat" else mech.home
    home = mech.assemble(home)

    def run(of: rg.Mechanism) -> rg.Trajectory:
        return rg.simulate(of, home, of.lift(home, u), duration=15 * h, step=h, torque=feedback, hold=hold)

    base = run(mech)
    assert len(base.crossings) == (name == "through flat")
    found = rg.gradient(base, COST, parameters=names)
    assert found.value == pytest.approx(value(base, hold), rel=1e-12)
    size = max(map(abs, found.parameters.values()))
    for parameter, got in found.parameters.items():

        def moved(s: float, parameter: str = parameter) -> float:
            return value(run(changed(mech, parameter, s)), hold)

        step = 1e-3 if parameter.split(".")[-1] in OF_A_BODY[4:] else 5e-3
        exact = slope(moved, step)
        assert got == pytest.approx(exact, abs=3e-9 * size), parameter
    monkeypatch.setattr(reverse_sweep, "kernel_of", lambda *_: None)
    slow: Any = rg.gradient(base, COST, parameters=names)
    np.testing.assert_allclose(
        list(found.parameters.values()), list(slow.parameters.values()), rtol=0, atol=1e-9 * size
    )
    np.testing.assert_allclose(found.dtau, slow.dtau, rtol=0, atol=1e-9 * np.abs(slow.dtau).max())
    np.testing.assert_allclose(found.dy, slow.dy, rtol=0, atol=1e-9 * np.abs(slow.dy).max())


def sprung(name: str = "", by: float = 0.0) -> rg.Mechanism:
    """The crank-rocker with a spring and a damper between its tip and the ground."""
    base, numbers = rg.load("crank_rocker"), {"stiffness": 30.0, "rest_length": 0.4, "damping": 2.0}
    if name:
        numbers[name] += by
    springs = [rg.PointSpring("coupler_tip", "universe", **numbers)]
    return rg.Mechanism.from_pinocchio(base.model, base.closures, ["q1"], base.home, forces=springs)


def test_springs_between_points() -> None:
    mech = sprung()
    names = [f"coupler_tip-universe.{what}" for what in ("stiffness", "rest_length", "damping")]

    def run(of: rg.Mechanism) -> rg.Trajectory:
        return rg.simulate(of, of.home, of.lift(of.home, [2.0]), duration=0.1, step=5e-3, torque=feedback)

    found = rg.gradient(run(mech), COST, parameters=names).parameters
    for name in names:
        what = name.rpartition(".")[2]
        exact = slope(lambda s, what=what: value(run(sprung(what, s)), False), 2e-2)
        assert found[name] == pytest.approx(exact, rel=1e-8), name
    by = rg.by_parameters(mech, mech.home, mech.lift(mech.home, [2.0]), parameters=names)
    for k, name in enumerate(names):
        what = name.rpartition(".")[2]
        ahead, behind = (sprung(what, s) for s in (0.1, -0.1))
        ends = [rg.forward_dynamics(m, m.home, m.lift(m.home, [2.0])) for m in (ahead, behind)]
        assert by[0, k] == pytest.approx((ends[0] - ends[1])[0] / 0.2, rel=1e-9)


def test_of_many_runs() -> None:
    """One gradient a run, each as by itself; a torque of its own for each start."""
    mech = rg.load("crank_rocker")
    starts = [(None, mech.lift(mech.home, [w])) for w in (1.0, 2.0, 3.0)] + [(np.full(3, 0.1), None)]
    torques: list[Any] = [{"q1": 1.0}, feedback, None, None]
    runs = rg.simulate_many(mech, starts, duration=0.05, step=5e-3, torques=torques)
    assert list(runs.errors) == [3]
    found = rg.gradient(runs, COST, parameters=["q2.mass"])
    assert found[3] is None
    for run, start, torque, one in zip(runs, starts[:3], torques, found, strict=False):
        assert run is not None and one is not None
        alone = rg.simulate(mech, *start, duration=0.05, step=5e-3, torque=torque)
        np.testing.assert_array_equal(run.q, alone.q)
        assert one.parameters == rg.gradient(alone, COST, parameters=["q2.mass"]).parameters
    with pytest.raises(rg.OptionError, match="2 are given for 4 starts"):
        rg.simulate_many(mech, starts, duration=0.05, torques=torques[:2])
    with pytest.raises(rg.OptionError, match="not both"):
        rg.simulate_many(mech, starts, duration=0.05, torque=torques[0], torques=torques)
