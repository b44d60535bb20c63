"""Inverse dynamics: the drives that forward dynamics turns back into the same acceleration."""

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages

MECHANISMS = {
    "crank_rocker": lambda: rg.load("crank_rocker"),
    "n_four_bar": lambda: linkages.n_four_bar(3, angle=1.1),
    "swinging": lambda: linkages.swinging_four_bar(4, 2, 3, 3, swing=0.3, y=1.0),
}


@pytest.mark.parametrize("name", MECHANISMS)
def test_forward_dynamics_returns_the_acceleration(name):
    mechanism = MECHANISMS[name]()
    rng = np.random.default_rng(3)
    q = mechanism.home
    v = mechanism.lift(q, rng.normal(size=mechanism.m))
    ydd = rng.normal(size=mechanism.m)
    drive = np.zeros(mechanism.nv)
    drive[mechanism.iv_independent] = rg.inverse_dynamics(mechanism, q, v, ydd)
    run = rg.simulate(mechanism, q, v, duration=1e-3, step=1e-3, torque=drive, record=("a",))
    assert run.a[0, mechanism.iv_independent] == pytest.approx(ydd, abs=1e-10)


def test_holding_torque_of_the_rhombus_at_its_singularity():
    # at rest, the parallelogram mode needs B cos y (METHOD §1: B = (1/2 + 1 + 1/2) 9.81), also at y = 0
    rhombus = rg.load("rhombus")
    mode = [1.0, -1.0, 1.0]
    for y in (0.3, 1e-7, 0.0):
        q = np.array([y, -y, y])
        held = rg.inverse_dynamics(rhombus, q, np.zeros(3), [0.0], mode=mode)
        assert held[0] == pytest.approx(2.0 * 9.81 * np.cos(y), abs=1e-9)


def test_drives_of_mobility_two_are_continuous_through_the_singularity():
    # the change-point linkage folds flat at q1 = π whatever the swing of its ground link
    scene = linkages.swinging_four_bar(4, 2, 3, 3, swing=0.3, y=np.pi)
    ydot, ydd = np.array([0.7, -1.1]), np.array([0.4, 0.9])
    beside = []
    for offset in (-0.02, 0.02):
        near = linkages.swinging_four_bar(4, 2, 3, 3, swing=0.3, y=np.pi + offset)
        v = near.lift(near.home, ydot)
        beside.append((rg.inverse_dynamics(near, near.home, v, ydd), v))
    v0 = 0.5 * (beside[0][1] + beside[1][1])
    modes = rg.analyse(scene, scene.home).modes
    mode = min(modes, key=lambda t: np.linalg.norm(v0 - t @ np.linalg.lstsq(t, v0, rcond=None)[0]))
    v0 = mode @ np.linalg.solve(mode[scene.iv_independent], ydot)
    drives = rg.inverse_dynamics(scene, scene.home, v0, ydd, mode=mode)
    # the mean of both sides differs by the second order of 0.02 rad
    assert drives == pytest.approx(0.5 * (beside[0][0] + beside[1][0]), rel=2e-3)
