"""The motion between the outputs: the order of the interpolant, on vector spaces and on groups."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.simulation.trajectories.interpolant import sampled_accelerations

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def swing() -> rg.Trajectory:
    """A crank-rocker's fall, exact to 1e-12, at 641 times."""
    return rg.simulate(
        rg.load("crank_rocker"),
        duration=0.64,
        step=1e-3,
        stepper="DOP853",
        rtol=1e-13,
        atol=1e-13,
        record="a",
    )


@pytest.fixture(scope="module")
def tumble(spatial: dict[str, rg.Mechanism]) -> rg.Trajectory:
    """The loop with a ball joint in it, likewise; its q holds a quaternion."""
    mech = spatial["spherical loop"]
    v = mech.lift(mech.home, [2.0])
    return rg.simulate(
        mech, v0=v, duration=0.32, step=1e-3, stepper="DOP853", rtol=1e-13, atol=1e-13, record="a"
    )


def every(run: rg.Trajectory, k: int, recorded: bool = True) -> rg.Trajectory:
    """The run with only each k-th output."""
    assert run.a is not None
    return rg.Trajectory(run.mechanism, run.t[::k], run.q[::k], run.v[::k], run.a[::k] if recorded else None)


def errors(run: rg.Trajectory, k: int, recorded: bool) -> Array:
    """Largest errors of q, v and a at the outputs between each k-th, away from the ends."""
    tree = run.mechanism.tree
    inner = slice(2 * k, -2 * k)
    found = every(run, k, recorded).at(run.t[inner])
    off = [tree.difference(a, b) for a, b in zip(run.q[inner], found.q, strict=True)]
    return np.array([np.abs(x).max() for x in (off, found.v - run.v[inner], found.a - run.a[inner])])


@pytest.mark.parametrize("recorded", (True, False))
@pytest.mark.parametrize(("name", "k"), (("swing", 16), ("tumble", 32)))
def test_the_order_between_outputs(name: str, k: int, recorded: bool, request: pytest.FixtureRequest) -> None:
    """Six in q, five in v, four in a, as the data of a quintic give; halving the step shows it."""
    run = request.getfixturevalue(name)
    coarse, fine = errors(run, k, recorded), errors(run, k // 2, recorded)
    orders = np.log2(coarse / fine)
    assert np.all(orders > [5.3, 4.3, 3.3]), (orders, coarse, fine)
    # no better than a quintic can: the measured order is not that of rounding
    assert np.all(orders < [7.5, 6.5, 5.5]), (orders, coarse, fine)


@pytest.mark.parametrize("name", ("swing", "tumble"))
def test_outputs_are_met(name: str, request: pytest.FixtureRequest) -> None:
    run = request.getfixturevalue(name)
    found = run.at(run.t)
    np.testing.assert_allclose(found.q, run.q, atol=1e-14)
    np.testing.assert_allclose(found.v, run.v, atol=1e-11)
    np.testing.assert_allclose(found.a, run.a, atol=1e-8)  # ε/h² · |s|, and differences on the group
    if not run.mechanism.tree.vector_space:
        assert all(pin.isNormalized(run.mechanism.model, q, 1e-14) for q in found.q)


def test_one_time_and_several() -> None:
    run = rg.simulate(rg.load("rhombus"), duration=0.1, step=0.01)
    one, many = run.at(0.033), run.at([0.033, 0.05])
    assert one.q.shape == (3,) and one.v.shape == (3,) and one.a.shape == (3,) and one.t.shape == ()
    assert many.q.shape == (2, 3) and many.y.shape == (2, 1)
    np.testing.assert_array_equal(one.q, many.q[0])
    assert one["q1"] == one.q[0] and many["v.q2"][1] == many.v[1, 1]
    np.testing.assert_array_equal(one.frame("q2").position, many.frame("q2").position[0])


@pytest.mark.parametrize("name", ("swing", "tumble"))
def test_no_times(name: str, request: pytest.FixtureRequest) -> None:
    run = request.getfixturevalue(name)
    none = run.at([])
    assert [part.shape for part in (none.q, none.v, none.a)] == [
        (0, n) for n in (run.mechanism.nq, run.mechanism.nv, run.mechanism.nv)
    ]


def test_a_pendulum_between_its_outputs() -> None:
    """A rod turning freely about its end: q(t) = ω t exactly, at any time."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    run = rg.simulate(rg.Mechanism.from_pinocchio(model), v0=[3.0], duration=1.0, step=0.25)
    t = np.linspace(0.0, 1.0, 37)
    np.testing.assert_allclose(run.at(t)["hinge"], 3.0 * t, atol=1e-14)


def test_a_torque_that_jumps_costs_no_order() -> None:
    """τ = ±1 held over each step: between the outputs q̈ is constant, so quadratics are exact."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    mech = rg.Mechanism.from_pinocchio(model)
    t, h = 0.1 * np.arange(9), 0.1
    a = np.array([1.0, -1.0, -1.0, 1.0, 0.5, -1.0, 1.0, 1.0, -1.0])[:, None]
    v = np.vstack([[[0.0]], np.cumsum(h * a[:-1], axis=0)])
    q = np.vstack([[[0.0]], np.cumsum(h * v[:-1] + 0.5 * h * h * a[:-1], axis=0)])
    run = rg.Trajectory(mech, t, q, v, a)
    middle = run.at(t[:-1] + 0.5 * h)
    np.testing.assert_allclose(middle.q, q[:-1] + 0.5 * h * v[:-1] + 0.125 * h * h * a[:-1], atol=1e-15)
    np.testing.assert_allclose(middle.v, v[:-1] + 0.5 * h * a[:-1], atol=1e-14)


def test_accelerations_from_positions_and_velocities(swing: rg.Trajectory, tumble: rg.Trajectory) -> None:
    """Fourth order: a polynomial of degree five through three times, q and v at each; also at the ends."""
    for run in (swing, tumble):
        tree = run.mechanism.tree
        off = [
            np.abs(sampled_accelerations(tree, run.t[::k], run.q[::k], run.v[::k]) - run.a[::k]).max()
            for k in (16, 8)
        ]
        assert 3.3 < np.log2(off[0] / off[1]) < 5.5, off
    uneven = np.r_[0:641:8, 3]
    uneven.sort()
    tree = swing.mechanism.tree
    found = sampled_accelerations(tree, swing.t[uneven], swing.q[uneven], swing.v[uneven])
    np.testing.assert_allclose(found, swing.a[uneven], atol=1e-3)


@pytest.mark.parametrize("t", (-0.1, 1.1, np.nan, [0.5, 2.0], "soon", [[0.1]]))
def test_times_outside_are_refused(t: object, swing: rg.Trajectory) -> None:
    with pytest.raises(rg.OptionError, match=r"within the motion, from 0 to 0\.64 s"):
        swing.at(t)


def test_a_run_of_one_time(swing: rg.Trajectory) -> None:
    one = rg.Trajectory(swing.mechanism, swing.t[:1], swing.q[:1], swing.v[:1])
    assert np.all(np.isnan(one.accelerations()))
    np.testing.assert_array_equal(one.at(0.0).q, swing.q[0])
    two = rg.Trajectory(swing.mechanism, swing.t[:2], swing.q[:2], swing.v[:2])
    np.testing.assert_allclose(two.accelerations(), swing.a[:2], atol=1e-2)
