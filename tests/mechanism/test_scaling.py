"""Lengths and masses in other units: the same motion, to the last digit for powers of two."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import rod

Array = NDArray[np.float64]


def resized(mechanism: rg.Mechanism, length: float, mass: float) -> rg.Mechanism:
    """All lengths and masses so many times as large, and gravity and forces so that the time stays."""
    model = mechanism.model.copy()
    for j in range(model.njoints):
        model.jointPlacements[j] = _moved(model.jointPlacements[j], length)
        body = model.inertias[j]
        model.inertias[j] = pin.Inertia(
            mass * body.mass, length * body.lever, mass * length**2 * body.inertia
        )
    for frame in model.frames:
        frame.placement = _moved(frame.placement, length)
    unit = units(mechanism, length)
    model.armature = mass * length**2 / unit**2 * model.armature
    model.gravity.linear = length * model.gravity.linear
    forces = [_force(mechanism, force, length, mass) for force in mechanism.forces]
    return rg.Mechanism(
        model, mechanism.closures, mechanism.independent, placed(mechanism, mechanism.home, length),
        mechanism.name, forces,
    )  # fmt: skip


def units(mechanism: rg.Mechanism, length: float) -> Array:
    """By what velocities grow, (nv,)."""
    return np.where(mechanism.tree.rotates, 1.0, length)


def placed(mechanism: rg.Mechanism, q: Array, length: float) -> Array:
    """The same configuration, (nq,)."""
    scaled = np.array(q, dtype=float)
    for joint in list(mechanism.model.joints)[1:]:
        slides = ~mechanism.tree.rotates[joint.idx_v : joint.idx_v + joint.nv]
        # the positions of all joints with slides come first in q and in v
        scaled[joint.idx_q : joint.idx_q + joint.nv][slides] *= length
    return scaled


def _moved(placement: pin.SE3, length: float) -> pin.SE3:
    return pin.SE3(placement.rotation, length * placement.translation)


def _force(mechanism: rg.Mechanism, force: object, length: float, mass: float) -> object:
    if isinstance(force, rg.PointSpring):
        return dataclasses.replace(
            force,
            stiffness=mass * force.stiffness,
            rest_length=length * force.rest_length,
            damping=mass * force.damping,
        )
    unit = units(mechanism, length)[mechanism.velocity_slice(force.joint)][0]  # type: ignore[attr-defined]
    moment = mass * length**2 / unit
    if isinstance(force, rg.JointSpring):
        return dataclasses.replace(force, stiffness=moment / unit * force.stiffness, rest=unit * force.rest)
    if isinstance(force, rg.JointDamper):
        return dataclasses.replace(force, damping=moment / unit * force.damping)
    assert isinstance(force, rg.JointTorque)
    return dataclasses.replace(force, torque=moment * force.torque)


def inverted_slider_crank() -> rg.Mechanism:
    """A crank's tip in a block that slides along a rocker about a pivot two cranks away."""
    model = pin.Model()
    crank = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "crank")
    pivot = pin.SE3(np.eye(3), np.array([0.0, 2.0, 0.0]))
    rocker = model.addJoint(0, pin.JointModelRX(), pivot, "rocker")
    block = model.addJoint(rocker, pin.JointModelPY(), pin.SE3.Identity(), "block")
    for joint, body in (
        (crank, rod(1.0)),
        (rocker, rod(1.0)),
        (block, pin.Inertia(0.5, np.zeros(3), 0.01 * np.eye(3))),
    ):
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    for name, joint, y in (("tip", crank, 1.0), ("pin", block, 0.0)):
        place = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    tip = np.array([np.cos(0.7) - 2.0, np.sin(0.7)])
    home = [0.7, np.arctan2(tip[1], tip[0]), np.hypot(*tip)]
    closure = rg.PointClosure("tip", "pin")
    return rg.Mechanism(model, [closure], ["crank"], home, "inverted slider-crank")


@pytest.fixture(scope="module")
def all_kinds(mechanisms: dict[str, rg.Mechanism]) -> dict[str, rg.Mechanism]:
    return mechanisms | {"inverted slider-crank": inverted_slider_crank()}


EXACT = [(2.0**20, 1.0), (2.0**-20, 1.0), (1.0, 4.0**10), (2.0**-7, 4.0**-10)]
"""Twelve decades of length and of mass by powers of two: no product rounds otherwise."""

MOVING = (
    "andrews", "bricard", "crank_rocker", "five_bar", "rhombus", "slider_crank", "stewart",
    "strandbeest", "spherical loop", "seven hinges", "humanoid", "inverted slider-crank",
)  # fmt: skip


def motion(mechanism: rg.Mechanism, backend: str) -> rg.Trajectory:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return rg.simulate(mechanism, duration=0.1, step=2e-3, backend=backend)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", MOVING)
@pytest.mark.parametrize("backend", ["python", "native"])
def test_motions_scale_exactly(all_kinds: dict[str, rg.Mechanism], name: str, backend: str) -> None:
    """An absolute number in any decision or formula on the way would change a digit."""
    if backend == "native" and not rg.backends()["native"].available:
        pytest.skip("the compiled kernel is not built")
    mechanism = all_kinds[name]
    expected = motion(mechanism, backend)
    for length, mass in EXACT if backend == "native" else EXACT[1::2]:
        run = motion(resized(mechanism, length, mass), backend)
        np.testing.assert_array_equal(run.q, [placed(mechanism, q, length) for q in expected.q])
        np.testing.assert_array_equal(run.v, expected.v * units(mechanism, length))
        assert run.stats.newton_iterations == expected.stats.newton_iterations


@pytest.mark.parametrize("length", [10.0**k for k in range(-6, 7)])
def test_an_inverted_slider_crank_of_any_size(length: float) -> None:
    """Twelve decades, one by one: the same angles to rounding, by fixed steps all the way."""
    mechanism = inverted_slider_crank()
    expected = motion(mechanism, "auto")
    run = motion(resized(mechanism, length, 1.0), "auto")
    np.testing.assert_allclose(run.q / [1.0, 1.0, length], expected.q, rtol=1e-12)
    assert run.stats.refined_steps == 0


@pytest.mark.parametrize("length", [1e-6, 1e-3, 10.0, 1e6])
@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("name", ["rhombus", "bricard", "stewart", "inverted slider-crank", "seven hinges"])
def test_implicit_dynamics_at_any_size(
    all_kinds: dict[str, rg.Mechanism], name: str, length: float, mass: float
) -> None:
    """The same accelerations, and multipliers that are forces: mass · length, times length for moments."""
    mechanism = all_kinds[name]
    q = mechanism.home
    if name == "rhombus":
        q = mechanism.assemble([0.4, -0.4, 0.4])
    v = mechanism.lift(q, np.linspace(0.5, 1.0, mechanism.m))
    a, multipliers = rg.implicit_dynamics(mechanism, q, v)
    unit = units(mechanism, length)
    big = resized(mechanism, length, mass)
    a2, multipliers2 = rg.implicit_dynamics(big, placed(mechanism, q, length), v * unit)
    np.testing.assert_allclose(a2 / unit, a, rtol=1e-9, atol=1e-9 * np.abs(a).max())
    force = mass * length * np.where(mechanism.implicit.is_length, 1.0, length)
    scale = np.abs(multipliers).max()
    np.testing.assert_allclose(multipliers2 / force, multipliers, rtol=1e-9, atol=1e-9 * scale)
