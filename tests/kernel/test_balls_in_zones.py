"""Loops with balls, floating and planar joints through singular places: as in Python, and as in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.four_bar import FourBar

from ..compiled import needs_kernel

pytestmark = needs_kernel

CHANGE_POINT = (4.0, 2.0, 3.0, 3.0)
JOINTS = {
    "ball": pin.JointModelSpherical,
    "planar": pin.JointModelPlanar,
    "circle": pin.JointModelRUBZ,
    "free": pin.JointModelFreeFlyer,
}


def body(model: pin.Model, joint: int, length: float) -> None:
    rod = pin.Inertia(1.0, np.array([length / 2, 0.0, 0.0]), np.diag([0.0, 1.0, 1.0]) * length**2 / 12)
    model.appendBodyToJoint(joint, rod, pin.SE3.Identity())


def linkage(kinds: tuple[str, ...], y: float, turn: float = 0.0) -> tuple[rg.Mechanism, Any]:
    """Change-point four-bars side by side in planes, each with such a joint between crank and coupler."""
    l0, l1, l2, l3 = CHANGE_POINT
    model, closures, names = pin.Model(), [], []
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    parts: dict[str, Any] = {}
    for n, kind in enumerate(kinds):
        about = pin.SE3(pin.exp3(np.array([0.0, turn * n, 0.0])), np.array([0.0, 0.0, 5.0 * n]))
        crank = model.addJoint(0, pin.JointModelRZ(), about, f"crank{n}")
        body(model, crank, l1)
        out = pin.SE3(np.eye(3), np.array([l1, 0.0, 0.0]))
        coupler = model.addJoint(crank, JOINTS[kind](), out, f"coupler{n}")
        body(model, coupler, l2)
        rocker = model.addJoint(
            0, pin.JointModelRZ(), about * pin.SE3(np.eye(3), np.array([l0, 0, 0])), f"rocker{n}"
        )
        body(model, rocker, l3)
        for joint, length in ((coupler, l2), (rocker, l3)):
            tip = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
            model.addFrame(pin.Frame(f"{model.names[joint]}_tip", joint, tip, pin.FrameType.OP_FRAME))
        model.addFrame(pin.Frame(f"crank{n}_tip", crank, out, pin.FrameType.OP_FRAME))
        model.addFrame(pin.Frame(f"coupler{n}_root", coupler, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        closures.append(rg.RevoluteClosure(f"coupler{n}_tip", f"rocker{n}_tip"))
        if kind in ("planar", "free"):  # its slides are closed by a point more
            closures.append(rg.PointClosure(f"crank{n}_tip", f"coupler{n}_root"))
        names.append(f"crank{n}")
        parts[f"crank{n}"], coupled, parts[f"rocker{n}"] = FourBar(*CHANGE_POINT, 1).evaluate(y - 0.05 * n)[0]
        parts[f"coupler{n}"] = coupled
    home = pin.neutral(model)
    for name, angle in parts.items():
        joint = model.joints[model.getJointId(name)]
        v = np.zeros(model.nv)
        v[joint.idx_v + joint.nv - 1] = angle  # about z, the last velocity of each kind
        home = pin.integrate(model, home, v)
    return rg.Mechanism.from_pinocchio(model, closures, names, home=home), model


IN_CHARTS = {"ball": "coupler{}.rz", "circle": "coupler{}", "planar": "crank{}", "free": "crank{}"}
"""A velocity about z that is no rate of a number in q; the crank where that would turn back."""


@pytest.mark.filterwarnings("ignore:.*a singular place was passed in a loop with a velocity of")
@pytest.mark.parametrize("in_charts", [False, True])
@pytest.mark.parametrize("kinds", [("ball",), ("planar",), ("circle",), ("free",), ("ball", "planar")])
def test_the_motion_is_that_of_hinges(kinds: tuple[str, ...], in_charts: bool) -> None:
    """Through the crossing, with the crossing's time, and the same in both backends."""
    if in_charts and not {"ball", "circle"} & set(kinds):
        pytest.skip("coordinates that turn back at the start")
    mechanism, _ = linkage(kinds, 2.6)
    if in_charts:
        mechanism = mechanism.with_independent([IN_CHARTS[kind].format(n) for n, kind in enumerate(kinds)])
        assert mechanism.chart_joints
    v0 = linkage(kinds, 2.6)[0].lift(mechanism.home, [3.0] * len(kinds))
    runs = [rg.simulate(mechanism, v0=v0, duration=0.4, step=2e-3, backend=b) for b in ("python", "native")]
    for n in range(len(kinds)):
        plain = linkages.four_bar(*CHANGE_POINT, y=2.6 - 0.05 * n)
        w0 = plain.lift(plain.home, [3.0])
        wanted = rg.simulate(plain, v0=w0, duration=0.4, step=2e-3)
        for run in runs:
            np.testing.assert_allclose(run[f"crank{n}"], wanted.q[:, 0], rtol=0.0, atol=1e-9)
            found = [c.time for c in run.crossings if c.cluster == n]
            assert found == pytest.approx([c.time for c in wanted.crossings], abs=1e-9)
    python, native = runs
    assert native.stats.zone_evaluations > 10
    assert native.stats.native_steps > 190
    assert not native.stats.repartitions
    for here, there in zip(native.q, python.q, strict=True):
        assert np.abs(mechanism.tree.difference(there, here)).max() < 1e-10
    for here, there in zip(native.crossings, python.crossings, strict=True):
        assert np.abs(mechanism.tree.difference(there.q, here.q)).max() < 1e-8


@pytest.mark.parametrize("stepper", ["DOP853", "Radau"])
def test_solvers_cross_too(stepper: str) -> None:
    mechanism, _ = linkage(("ball",), 2.6)
    v0 = mechanism.lift(mechanism.home, [3.0])
    options: dict[str, Any] = {"duration": 0.4, "step": 0.05, "stepper": stepper, "rtol": 1e-9, "atol": 1e-11}
    python, native = (rg.simulate(mechanism, v0=v0, backend=b, **options) for b in ("python", "native"))
    assert len(native.crossings) == len(python.crossings) == 1
    np.testing.assert_allclose(native["crank0"], python["crank0"], rtol=0.0, atol=1e-7)


def test_what_was_saved_in_a_zone_goes_on_to_the_last_bit() -> None:
    mechanism, _ = linkage(("ball",), 2.6)
    v0 = mechanism.lift(mechanism.home, [3.0])
    run = rg.simulate(mechanism, v0=v0, duration=0.4, step=2e-3)
    sim = rg.Simulation(mechanism, v0=v0, step=2e-3)
    for first in range(0, 160, 20):
        saved = sim.save()
        for _ in range(2):
            sim.restore(saved)
            np.testing.assert_array_equal(sim.step(n=40).q, run.q[first + 40])
        sim.restore(saved).step(n=20)
