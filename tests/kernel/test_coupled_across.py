"""Joints that are coupled across a ball or a floating base, which is in a chart of its own then."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.dynamics import discrete
from robust_gcp.kernel.derivatives.derivations import derivation

from ..compiled import needs_kernel
from .test_derivation import same

pytestmark = needs_kernel

BETWEEN = {
    "ball": pin.JointModelSpherical,
    "free": pin.JointModelFreeFlyer,
    "planar": pin.JointModelPlanar,
}


def coupled(between: str, grounded: bool) -> rg.Mechanism:
    """A hinge, a joint on a group and another hinge in a row, or that joint and a hinge beside it first."""
    rng, model = np.random.default_rng(2), pin.Model()
    kinds = [pin.JointModelRX(), BETWEEN[between](), pin.JointModelRY()]
    parents = [0, 0, 2] if grounded else [0, 1, 2]
    for i, (kind, parent) in enumerate(zip(kinds, parents, strict=True)):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        joint = model.addJoint(parent, kind, place, f"j{i}")
        inertia = pin.Inertia(1.0 + i, 0.3 * rng.normal(size=3), np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    home = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    first, last = home[0], home[-1]
    closure = rg.CouplingClosure("j0", "j2", 0.9, float(first - 0.9 * last))
    return rg.Mechanism.from_pinocchio(model, [closure], "auto", home=home)


@pytest.mark.parametrize("grounded", (False, True))
@pytest.mark.parametrize("between", BETWEEN)
def test_energy_is_kept_and_the_coupling_closed(between: str, grounded: bool) -> None:
    mech = coupled(between, grounded)
    start = mech.lift(mech.home, np.random.default_rng(3).normal(size=mech.m))
    runs = [
        rg.simulate(mech, None, start, duration=0.05, step=1e-3, record=("energy",), backend=backend)
        for backend in ("auto", "python")
    ]
    assert runs[0].energy is not None and runs[0].stats.native_steps == 50
    assert np.ptp(runs[0].energy) < 1e-6
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0.0, atol=1e-12)
    u = rg.forward_dynamics(mech, mech.home, start)
    again = rg.Mechanism.from_pinocchio(mech.model, mech.closures, list(mech.independent), home=mech.home)
    np.testing.assert_allclose(rg.forward_dynamics(again, mech.home, start), u, rtol=1e-12)


@pytest.mark.parametrize("grounded", (False, True))
@pytest.mark.parametrize("between", BETWEEN)
def test_derivatives_are_those_of_the_reference(between: str, grounded: bool) -> None:
    mech = coupled(between, grounded)
    rng = np.random.default_rng(4)
    v, tau = mech.lift(mech.home, rng.normal(size=mech.m)), rng.normal(size=mech.nv)
    kernel = derivation(mech, mech.home)
    assert kernel is not None and kernel.slopes(mech.home[None], v[None], tau[None]).good.all()
    same(rg.derivatives(mech, mech.home, v, tau), reference.derivatives(mech, mech.home, v, tau))
    for one, other in zip(
        rg.step_jacobians(mech, mech.home, v, tau, 0.01),
        discrete.step_jacobians(mech, mech.home, v, tau, 0.01),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12 * np.abs(other).max())
