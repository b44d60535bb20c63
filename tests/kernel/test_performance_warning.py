"""Where Python does what one expects the compiled kernel to do, one warning says so, why, and what helps."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from tests.compiled import needs_kernel

Array = NDArray[np.float64]
pytestmark = needs_kernel


@dataclass(frozen=True)
class Cubic(rg.Force):
    joint: str
    k: float

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        joint, tau = mechanism.joint(self.joint), np.zeros(mechanism.nv)
        tau[joint.idx_v] = -self.k * q[joint.idx_q] ** 3
        return tau

    def energy(self, mechanism: rg.Mechanism, q: Array) -> float:
        return float(0.25 * self.k * q[mechanism.joint(self.joint).idx_q] ** 4)


def with_screw() -> rg.Mechanism:
    model = pin.Model()
    axis = np.array([1.0, 0.0, 0.0])
    joint = model.addJoint(0, pin.JointModelHelicalUnaligned(axis, 0.1), pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model, [], ["screw"])


def test_derivatives_with_a_force_of_ones_own_tell_that_a_torque_function_is_compiled() -> None:
    base = rg.load("crank_rocker")
    closures, names = base.closures, base.independent
    mech = rg.Mechanism(base.model, closures, names, home=base.home, forces=[Cubic("q1", 2.0)])
    with pytest.warns(rg.PerformanceWarning, match="crank_rocker.*own.*torque functions") as told:
        found = rg.derivatives(mech, base.home)
    assert len(told) == 1
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.PerformanceWarning)
        same = rg.derivatives(base, base.home, tau=lambda t, q, v: Cubic("q1", 2.0).tau(base, q, v))
        run = rg.simulate(mech, duration=2e-3, step=1e-3)  # its steps are compiled
    np.testing.assert_allclose(found.da_dy, same.da_dy, rtol=1e-7)
    with pytest.warns(rg.PerformanceWarning, match="20 to 200 times") as told:
        rg.gradient(run, rg.Cost(terminal=lambda q, v: q[0]))
    assert len(told) == 1


def test_a_joint_that_the_kernel_does_not_know_is_told_but_to_who_asks_for_python() -> None:
    mech = with_screw()
    with pytest.warns(rg.PerformanceWarning, match=r"'screw' is of type.*simple joints.*backend=\"python\""):
        rg.simulate(mech, duration=2e-3, step=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.PerformanceWarning)
        rg.simulate(mech, duration=2e-3, step=1e-3, backend="python")
