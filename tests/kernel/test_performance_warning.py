"""Where Python does what one expects the compiled kernel to do, one warning says so, why, and what helps."""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.reports.derivative_paths import dead_point, five_bar_in_line
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


def test_states_that_the_kernel_leaves_are_told_once_for_each_thing_that_is_asked() -> None:
    mech, q, _ = five_bar_in_line()
    q = mech.assemble(0.01 * q, hold=["q1", "q3"])  # where derivatives hang on rounding
    v = mech.lift(q, [1.0, -0.5])
    for call, what in ((rg.derivatives, "derivatives"), (rg.forward_dynamics, "accelerations")):
        with pytest.warns(rg.PerformanceWarning, match=f"{what} of planar_linkage everywhere") as told:
            for _ in range(2):
                with suppress(rg.SimulationError):
                    call(mech, q, v)
        assert len(told) == 1
        assert told[0].filename == __file__


def test_single_states_at_singular_places_and_beside_dead_points_are_compiled() -> None:
    bars, flat = rg.load("rhombus"), np.zeros(3)
    with warnings.catch_warnings():
        warnings.simplefilter("error", rg.PerformanceWarning)
        for mode in rg.analyse(bars, flat).modes:
            mech = bars.with_independent(["q1" if mode[0] else "q2"])
            for speed in (2.0, 0.0):
                v = speed * np.asarray(mode)
                found = rg.derivatives(mech, flat, v, mode=mode)
                exact = reference.derivatives(mech, flat, v, mode=mode)
                for name in ("udot", "da_dy", "da_dv", "da_dtau", "G", "dv_dy"):
                    size = np.abs(exact.da_dy).max() + np.abs(exact.da_dtau).max()
                    np.testing.assert_allclose(getattr(found, name), getattr(exact, name), atol=1e-10 * size)
                after = rg.step(mech, flat, v, h=1e-3, jacobians=True, mode=mode)
                run = rg.simulate(mech, flat, v, duration=1e-3, step=1e-3, mode=mode)
                np.testing.assert_allclose(after.q, run.q[-1], atol=1e-12)
                np.testing.assert_allclose(after.v, run.v[-1], atol=1e-10)
                rg.linearise(mech, flat, v, mode=mode)
        poor, q, v = dead_point()
        for _ in range(2):
            with_derivatives = rg.step(poor, q, v, h=1e-2, jacobians=True)
            alone = rg.step(poor, q, v, h=1e-2)
            np.testing.assert_allclose(with_derivatives.q, alone.q, atol=1e-12)
            np.testing.assert_allclose(with_derivatives.v, alone.v, atol=1e-12)
            assert np.abs(alone.q - q).max() > 1e-3


def test_a_mode_that_is_none_is_refused_after_its_place_is_known() -> None:
    mech, flat = rg.load("rhombus"), np.zeros(3)
    mode = np.asarray(rg.analyse(mech, flat).modes[0])
    rg.derivatives(mech, flat, mode=mode)
    for wrong, q in (
        (np.array([1.0, 1.0, 0.0]), flat),
        (np.array([1.0, 0.0, 1.0]), mech.assemble([0.2] * 3)),
    ):
        for call in (rg.derivatives, rg.forward_dynamics, rg.step):
            with pytest.raises(rg.OptionError, match="mode"):
                call(mech, q, mode=wrong)
