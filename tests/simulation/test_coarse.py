"""Steps too long to see the motion are told of."""

import warnings

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.simulation.runs.too_long_steps import CoarseStepWarning


def thrown(step: float, speed: float = 10.0) -> rg.Trajectory:
    rhombus = four_bar(1.0, 1.0, 1.0, 1.0, y=0.2)
    return rg.simulate(rhombus, v0=rhombus.lift(rhombus.home, [speed]), duration=1.0, step=step)


def test_long_steps_are_told_of_with_a_better_one():
    with pytest.warns(CoarseStepWarning, match="crossings in such a step may be missing") as caught:
        thrown(0.2)
    better = float(str(caught[0].message).split("use a step of ")[1].split()[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        thrown(better)


def test_crossings_are_not_spoken_of_without_loops():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", "the step at", CoarseStepWarning)
        arm = rg.Mechanism.from_pinocchio(four_bar(1.0, 1.0, 1.0, 1.0).model)
        rg.simulate(arm, [0.0, 0.0, 0.0], [9.0, 0.0, 0.0], duration=0.4, step=0.2)


@pytest.mark.parametrize("outputs", [None, [0.3, 2.9, 3.0]])
def test_energy_out_of_nothing_is_told_of(outputs):
    """Steps below a radian that are wrong all the same, with a better step in the message."""
    mech = rg.load("slider_crank")
    with pytest.warns(CoarseStepWarning, match="energy is off by") as caught:
        wrong = rg.simulate(mech, duration=3.0, step=0.12, outputs=outputs)
    assert np.abs(wrong.v * 0.12).max() < 1.0
    step = float(str(caught[0].message).split("one of ")[1].split()[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        right = rg.simulate(mech, duration=3.0, step=step, outputs=outputs)
    exact = rg.simulate(mech, duration=3.0, step=step / 4.0)
    assert np.abs(right.q[-1] - exact.q[-1]).max() < 0.05 < np.abs(wrong.q[-1] - exact.q[-1]).max()


def test_torques_and_dampers_are_not_taken_for_errors():
    """Work done and lost accounts for the energy; a mechanism at rest has none to lose."""
    mech = rg.load("crank_rocker")
    damped = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home, forces=[rg.JointDamper("q1", 20.0)]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rg.simulate(damped, duration=3.0, step=5e-3, torque={"q1": lambda t, q, v: 5.0 * np.sin(t)})
        rg.simulate(rg.load("rhombus"), [np.pi / 2, -np.pi / 2, np.pi / 2], [0, 0, 0], 0.1, 1e-2)


@pytest.mark.parametrize("backend", ["auto", "python"])
def test_steps_one_by_one_are_looked_at_too(backend):
    rhombus = rg.load("rhombus")
    sim = rg.Simulation(rhombus, v0=rhombus.lift(rhombus.home, [10.0]), step=0.2, backend=backend)
    with pytest.warns(CoarseStepWarning, match="crossings in such a step may be missing"):
        sim.step(n=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.step(n=2)
    sim = rg.Simulation(rg.load("slider_crank"), step=0.12, backend=backend).step(n=25)
    with pytest.warns(CoarseStepWarning, match="energy is off by"):
        assert len(sim.trajectory.t) == 26
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(sim.trajectory.t) == 26
