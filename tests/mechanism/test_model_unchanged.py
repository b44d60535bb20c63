"""The model of a mechanism is there to be read: a change is refused by all that is computed after it."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg


def weightless(model: pin.Model) -> None:
    model.gravity.linear = np.zeros(3)


def heavier(model: pin.Model) -> None:
    model.inertias[1] = pin.Inertia(100.0, np.zeros(3), np.eye(3))


def geared(model: pin.Model) -> None:
    model.armature = np.full(3, 5.0)


def longer(model: pin.Model) -> None:
    model.jointPlacements[2] = pin.SE3(np.eye(3), np.array([0.0, 1.1, 0.0]))


def narrower(model: pin.Model) -> None:
    model.upperPositionLimit = np.full(3, 0.1)


CHANGES = {
    "gravity": weightless, "inertias": heavier, "armature": geared, "jointPlacements": longer,
    "upperPositionLimit": narrower,
}  # fmt: skip
COST = rg.Cost(terminal=lambda q, v: float(q[0]))
CALLS: dict[str, Callable[[rg.Mechanism], Any]] = {
    "simulate": lambda m: rg.simulate(m, duration=0.01),
    "in Python": lambda m: rg.simulate(m, duration=0.01, backend="python"),
    "simulate_many": lambda m: rg.simulate_many(m, [(None, None)], duration=0.01),
    "Simulation": rg.Simulation,
    "forward_dynamics": lambda m: rg.forward_dynamics(m, m.home),
    "inverse_dynamics": lambda m: rg.inverse_dynamics(m, m.home, np.zeros(3), np.zeros(1)),
    "derivatives": lambda m: rg.derivatives(m, m.home),
    "step_jacobians": lambda m: rg.step_jacobians(m, m.home, np.zeros(3), None, 1e-3),
    "analyse": lambda m: rg.analyse(m, m.home),
    "K": lambda m: m.K(m.home),
    "energy": lambda m: m.energy(m.home, np.zeros(3)),
    "assemble": lambda m: m.assemble(m.home),
    "with_independent": lambda m: m.with_independent(["q3"]),
    "pickle": pickle.dumps,
    "copy": copy.deepcopy,
}


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("part", CHANGES)
def test_a_changed_model_is_refused_by_name(part: str, before: bool) -> None:
    mech = rg.load("crank_rocker")
    if before:
        rg.simulate(mech, duration=0.01)
    CHANGES[part](mech.model)
    with pytest.raises(rg.ModelError, match=rf"was changed \({part}\)"):
        rg.simulate(mech, duration=0.01)


@pytest.mark.parametrize("call", CALLS)
def test_every_call_refuses_it(call: str) -> None:
    mech = rg.load("crank_rocker")
    CALLS[call](mech)
    weightless(mech.model)
    with pytest.raises(rg.ModelError, match=r"changed \(gravity\)"):
        CALLS[call](mech)


def test_what_goes_on_refuses_it_too() -> None:
    mech = rg.load("crank_rocker")
    sim, run = rg.Simulation(mech), rg.simulate(mech, duration=0.01)
    weightless(mech.model)
    for call in (sim.step, sim.reset, lambda: rg.gradient(run, COST)):
        with pytest.raises(rg.ModelError, match=r"changed \(gravity\)"):
            call()


def test_the_remedy_makes_another_mechanism() -> None:
    mech = rg.load("crank_rocker")
    model = mech.model.copy()
    weightless(model)
    other = rg.Mechanism.from_pinocchio(model, mech.closures, mech.independent, mech.home, forces=mech.forces)
    run = rg.simulate(other, duration=0.1)
    np.testing.assert_allclose(run.q, run.q[0] + np.zeros_like(run.q), atol=1e-14)
    assert np.abs(rg.simulate(mech, duration=0.1).q[-1] - mech.home).max() > 1e-3


def test_reading_is_free_and_what_was_given_stays_the_callers() -> None:
    given = rg.load("crank_rocker").model.copy()
    mech = rg.Mechanism(
        given, [rg.PointClosure("coupler_tip", "rocker_tip")], ["q1"], rg.load("crank_rocker").home
    )
    weightless(given)
    assert mech.model is mech.model and mech.model.gravity.linear[2] != 0.0
    rg.simulate(mech, duration=0.01)


def test_limits_that_are_no_numbers_are_no_change() -> None:
    model = rg.load("crank_rocker").model.copy()
    model.upperPositionLimit = np.array([np.nan, np.inf, 1.0])
    base = rg.load("crank_rocker")
    mech = rg.Mechanism.from_pinocchio(model, base.closures, base.independent, base.home)
    assert np.isnan(mech.model.upperPositionLimit[0])
    rg.simulate(mech, duration=0.01)
    weightless(mech.model)
    with pytest.raises(rg.ModelError, match="gravity"):
        rg.simulate(mech, duration=0.01)
