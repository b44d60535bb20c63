"""Small machines for tests of stops, friction and locks, and what is asked of all of them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

Array = NDArray[np.float64]

BACKENDS = ["python", "native"]


def require_backend(name: str) -> str:
    if name == "native" and not rg.backends()["native"].available:
        pytest.skip(f"no compiled kernel: {rg.backends()['native'].reason}")
    return name


def sliders(*masses: float, along: object = None) -> rg.Mechanism:
    """Masses on rails of their own along the vertical, or where told."""
    model = pin.Model()
    for k, mass in enumerate(masses, 1):
        joint = model.addJoint(0, pin.JointModelPZ() if along is None else along, pin.SE3.Identity(), f"q{k}")
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model)


def flywheels(*inertias: float) -> rg.Mechanism:
    """Wheels on axes of their own, without gravity."""
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    for k, inertia in enumerate(inertias, 1):
        joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), f"q{k}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), inertia * np.eye(3)), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model)


def pendulum() -> rg.Mechanism:
    """A point of 1 kg on 1 m, hinged about x; q1 = 0 along y, level."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "q1")
    model.appendBodyToJoint(
        joint, pin.Inertia(1.0, np.array([0.0, 1.0, 0.0]), np.zeros((3, 3))), pin.SE3.Identity()
    )
    return rg.Mechanism.from_pinocchio(model)


def change_point() -> tuple[rg.Mechanism, Array, Array]:
    """The shipped change-point linkage, its home, and a velocity there that takes it through a crossing."""
    mech = rg.load("change_point")
    return mech, mech.home, mech.lift(mech.home, [0.0])


def orders(values: list[Array]) -> Array:
    """Orders by three runs, each with half the step of the one before."""
    coarse, fine = np.abs(values[1] - values[0]), np.abs(values[2] - values[1])
    return np.log2(coarse / fine)


def times_of(run: rg.Trajectory, *kinds: str) -> Array:
    return np.array([x.time for x in run.happenings if x.kind in kinds])


def require_sound(run: rg.Trajectory, energy: float) -> None:
    """Increasing times, finite columns, closed loops, energy to `energy` J."""
    assert np.all(np.diff(run.t) > 0.0)
    assert all(np.isfinite(column).all() for column in run.columns().values())
    assert run.closure_error().max(initial=0.0) < 1e-11
    assert np.abs(run.energy_error()).max() < energy
    assert np.all(np.diff([x.time for x in run.happenings]) >= 0.0)
    assert np.diff(run.dissipated).min(initial=0.0) > -1e-9
