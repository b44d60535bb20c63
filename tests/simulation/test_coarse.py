"""Steps too long to see the motion are told of."""

import warnings

import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.simulation.coarse import CoarseStepWarning


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


def test_nothing_is_said_without_loops():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", CoarseStepWarning)
        arm = rg.Mechanism.from_pinocchio(four_bar(1.0, 1.0, 1.0, 1.0).model)
        rg.simulate(arm, [0.0, 0.0, 0.0], [9.0, 0.0, 0.0], duration=0.4, step=0.2)
