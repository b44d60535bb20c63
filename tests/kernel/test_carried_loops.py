"""Loops that are carried by a body of another loop, in the compiled kernel."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference

from ..compiled import needs_kernel

pytestmark = needs_kernel

CLOSURES = {"point": rg.PointClosure, "frame": rg.FrameClosure, "hinge": rg.RevoluteClosure}
IN_SPACE = {"hinge": rg.RevoluteClosure, "slide": rg.PrismaticClosure}


def carried(floating: bool, second: str = "point") -> rg.Mechanism:
    """A four-bar askew, and another one whose frame is the first one's coupler: the loop ends on it."""
    model, last = pin.Model(), 0
    home = [0.6, -0.7, -1.2, 0.5, -0.8, -1.1]
    if floating:
        last = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        home = [0.1, 0.2, 0.3, *pin.Quaternion(pin.exp3(np.array([0.2, 0.5, -0.3]))).coeffs(), *home]
        model.appendBodyToJoint(last, pin.Inertia(3.0, np.full(3, 0.1), np.eye(3)), pin.SE3.Identity())
    parents, ends = [last], []
    for name, sizes, turn in (("a", (1.0, 1.2, 0.9), 0.4), ("b", (0.5, 0.6, 0.45), -0.7)):
        place = pin.SE3(pin.exp3(np.array([0.3, turn, 0.1])), np.array([0.1, 0.2, 0.3]))
        at = parents[-1]
        for i, size in enumerate(sizes):
            at = model.addJoint(at, pin.JointModelRZ(), place, f"{name}{i}")
            body = pin.Inertia(1.0, np.array([0.5 * size, 0.1, 0.0]), 0.1 * np.eye(3))
            model.appendBodyToJoint(at, body, pin.SE3.Identity())
            place = pin.SE3(np.eye(3), np.array([size, 0.0, 0.0]))
            if i == 1:
                coupler = at
        ends.append((name, at, parents[-1], place))
        parents.append(coupler)
    q, data = np.array(home), model.createData()
    pin.forwardKinematics(model, data, q)
    for name, tip, root, place in ends:
        there = data.oMi[tip] * place
        for side, joint in (("tip", tip), ("ground", root)):
            on = data.oMi[joint].actInv(there)
            model.addFrame(pin.Frame(f"{name}_{side}", joint, on, pin.FrameType.OP_FRAME))
    closures = [rg.PointClosure("a_tip", "a_ground"), CLOSURES[second]("b_tip", "b_ground")]
    made = rg.Mechanism.from_pinocchio(model, closures, "auto", home=q)
    assert len(made.clusters) == 2
    return made


@pytest.mark.parametrize("floating", (False, True))
@pytest.mark.parametrize("second", CLOSURES)
def test_as_in_python(floating: bool, second: str) -> None:
    """A loop that ends on the body that carries it sees that body stand still, however this one moves."""
    mech, rng = carried(floating, second), np.random.default_rng(1)
    q, tau = mech.home, rng.normal(size=mech.nv)
    v = mech.lift(q, rng.normal(size=mech.m))
    runs = [
        rg.simulate(mech, q, v, duration=0.02, step=1e-3, torque=tau, record=("a",), backend=backend)
        for backend in ("native", "python")
    ]
    assert runs[0].stats.native_steps == 20
    for part in ("q", "v", "a"):
        found, exact = (getattr(run, part) for run in runs)
        np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-11 * np.abs(exact).max())
    found, exact = (by(mech, q, v, tau) for by in (rg.derivatives, reference.derivatives))
    for part in ("udot", "da_dy", "da_dv", "da_dtau"):
        one, other = getattr(found, part), getattr(exact, part)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11 * np.abs(other).max())


def in_space(closure: str) -> rg.Mechanism:
    """A loop of seven freedoms in space that ends on the swinging body that carries it."""
    rng, model = np.random.default_rng(4), pin.Model()
    at = [
        model.addJoint(0, pin.JointModelRX(), pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)), "j0")
    ]
    for i in range(6):
        axis = pin.exp3(rng.normal(size=3))[0]
        place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.5 * rng.normal(size=3))
        at.append(model.addJoint(at[-1], pin.JointModelRevoluteUnaligned(*axis), place, f"j{i + 1}"))
    for joint in at:
        inertia = pin.Inertia(rng.uniform(0.5, 2.0), 0.2 * rng.normal(size=3), 0.1 * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    home, data = rng.normal(size=model.nq), model.createData()
    pin.forwardKinematics(model, data, home)
    there = data.oMi[at[-1]] * pin.SE3(pin.exp3(rng.normal(size=3)), 0.4 * rng.normal(size=3))
    for name, joint in (("tip", at[-1]), ("root", at[0])):
        model.addFrame(pin.Frame(name, joint, data.oMi[joint].actInv(there), pin.FrameType.OP_FRAME))
    made = rg.Mechanism.from_pinocchio(model, [IN_SPACE[closure]("tip", "root")], "auto", home=home)
    assert made.m == 2
    return made


@pytest.mark.parametrize("closure", IN_SPACE)
def test_derivatives_in_space(closure: str) -> None:
    """The carrier also bears the reactions of the loops that end on it."""
    mech, rng = in_space(closure), np.random.default_rng(1)
    q, tau = mech.home, rng.normal(size=mech.nv)
    v = mech.lift(q, rng.normal(size=mech.m))
    found, exact = (by(mech, q, v, tau) for by in (rg.derivatives, reference.derivatives))
    for part in ("udot", "da_dy", "da_dv", "da_dtau"):
        one, other = getattr(found, part), getattr(exact, part)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11 * np.abs(other).max())


def test_energy_is_kept() -> None:
    """With no oracle but physics, and nothing lost but RK4's error."""
    mech = carried(False)
    start = mech.lift(mech.home, np.array([1.0, -0.5]))
    run = rg.simulate(mech, None, start, duration=0.4, step=2e-4, record=("energy",), backend="native")
    assert run.energy is not None
    assert np.ptp(run.energy) < 1e-8
