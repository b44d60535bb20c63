"""A motion by names: joints, columns, frames, cut joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.simulation.trajectories.reactions import row_names

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def fall() -> rg.Trajectory:
    return rg.simulate(
        rg.load("crank_rocker"),
        duration=0.3,
        step=3e-3,
        record=("a", "energy", "multipliers"),
        torque=[0.1, 0, 0],
    )


@pytest.fixture(scope="module")
def tumble(spatial: dict[str, rg.Mechanism]) -> rg.Trajectory:
    mech = spatial["spherical loop"]
    v = mech.lift(mech.home, [2.0])
    return rg.simulate(mech, v0=v, duration=0.1, step=1e-3, record=("a", "multipliers"))


def rate(values: Array, h: float) -> Array:
    """Eighth-order central differences, at all rows but the first and last four."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    return np.array([np.tensordot(weights, values[i - 4 : i + 5], 1) for i in range(4, len(values) - 4)])


def test_joints_by_name(fall: rg.Trajectory, tumble: rg.Trajectory) -> None:
    np.testing.assert_array_equal(fall["q2"], fall.q[:, 1])
    np.testing.assert_array_equal(fall["v.q2"], fall.v[:, 1])
    np.testing.assert_array_equal(fall["a.q3"], fall.a[:, 2])
    ball = tumble.mechanism.joint("ball")
    np.testing.assert_array_equal(tumble["ball"], tumble.q[:, ball.idx_q : ball.idx_q + 4])
    np.testing.assert_array_equal(tumble["v.ball"], tumble.v[:, ball.idx_v : ball.idx_v + 3])
    assert tumble["ball"].shape == (101, 4)
    np.testing.assert_array_equal(tumble["ball.qw"], tumble["ball"][:, 3])


def test_columns_by_name(fall: rg.Trajectory, tumble: rg.Trajectory) -> None:
    for run in (fall, tumble):
        columns = run.columns()
        m = run.mechanism
        assert len(columns) == 1 + m.nq + 2 * m.nv + m.nc + 2 * (run is fall)
        for name, values in columns.items():
            np.testing.assert_array_equal(run[name], values)
            assert values.shape == run.t.shape
    np.testing.assert_array_equal(fall["work"], fall.work)
    np.testing.assert_array_equal(fall["lambda.coupler_tip-rocker_tip.z"], fall.multipliers[:, 1])


@pytest.mark.parametrize(
    ("name", "told"),
    (
        ("qq1", "did you mean 'q"),
        ("v.q9", "its joints are q1, q2, q3"),
        (3, "its columns t, q.q1"),
        ("tau.q1", "q1"),
    ),
)
def test_unknown_names_are_told_the_known_ones(fall: rg.Trajectory, name: str, told: str) -> None:
    with pytest.raises(rg.OptionError, match=told):
        fall[name]


def test_accelerations_not_recorded_are_said_to_be() -> None:
    run = rg.simulate(rg.load("rhombus"), duration=0.01)
    with pytest.raises(rg.OptionError, match="accelerations were not recorded"):
        run["a.q1"]


@pytest.mark.parametrize("name", ("fall", "tumble"))
def test_frames_move_as_their_positions_say(name: str, request: pytest.FixtureRequest) -> None:
    """Velocity and acceleration are the derivatives of the position; ω that of the orientation."""
    run = request.getfixturevalue(name)
    h = float(run.t[1])
    for label in {"fall": ("coupler_tip", "q3"), "tumble": ("pin1", "ball")}[name]:
        frame = run.frame(label)
        inner = slice(4, -4)
        np.testing.assert_allclose(rate(frame.position, h), frame.velocity[inner], atol=1e-7)
        np.testing.assert_allclose(rate(frame.velocity, h), frame.acceleration[inner], atol=1e-5)
        np.testing.assert_allclose(
            rate(frame.angular_velocity, h), frame.angular_acceleration[inner], atol=1e-5
        )
        turning = rate(frame.rotation, h) @ frame.rotation[inner].transpose(0, 2, 1)
        np.testing.assert_allclose(turning, [pin.skew(w) for w in frame.angular_velocity[inner]], atol=1e-6)


def test_the_two_frames_of_a_cut_joint_stay_together(fall: rg.Trajectory) -> None:
    first, second = fall.frame("coupler_tip"), fall.frame("rocker_tip")
    np.testing.assert_allclose(first.position, second.position, atol=1e-12)
    np.testing.assert_allclose(first.velocity, second.velocity, atol=1e-11)
    np.testing.assert_allclose(first.acceleration, second.acceleration, atol=1e-9)
    matrices = first.placement
    assert matrices.shape == (101, 4, 4)
    np.testing.assert_array_equal(matrices[7] @ [0.0, 0.0, 0.0, 1.0], [*first.position[7], 1.0])


def test_unknown_frames(fall: rg.Trajectory) -> None:
    with pytest.raises(rg.ModelError, match=r"no frame 'coupler_top'.*coupler_tip"):
        fall.frame("coupler_top")


# --------------------------------------------------------------------------- constraint forces


def test_a_reaction_balances_a_hanging_rod() -> None:
    """A uniform rod at rest between a hinge and a cut joint carries half its weight there."""
    run = rg.simulate(rg.load("crank_rocker"), duration=0.3, step=3e-3, record=("a", "multipliers"))
    rocker = run.mechanism.model.getJointId("q3")
    for i in (0, 40, 100):
        found = run.reaction("rocker_tip")
        # the rocker is alone in its branch: its hinge takes no moment about its axis
        data = run.mechanism.model.createData()
        arm = run.frame("rocker_tip").position[i] - run.frame("q3").position[i]
        torque = np.cross(arm, -found.force[i])  # the second frame's body receives the opposite
        pin.rnea(run.mechanism.model, data, run.q[i], run.v[i], run.a[i])
        needed = data.oMi[rocker].rotation @ data.f[rocker].angular
        assert torque[0] == pytest.approx(needed[0], abs=1e-10)
        assert found.force[i, 0] == 0.0
        assert np.abs(found.moment).max() == 0.0


@pytest.mark.parametrize("name", ("spherical loop", "seven hinges"))
def test_reactions_do_the_work_of_the_multipliers(spatial: dict[str, rg.Mechanism], name: str) -> None:
    """Kᵀ λ = J₁ᵀ (f, m) − J₂ᵀ (f, m) at the two frames' bodies: the wrench is what λ says."""
    mech = spatial[name]
    v = mech.lift(mech.home, np.ones(mech.m))
    run = rg.simulate(mech, v0=v, duration=0.02, step=1e-2, record=("a", "multipliers"))
    (closure,) = mech.closures
    found = run.reaction(0)
    model, data = mech.model, mech.model.createData()
    for i in range(len(run.t)):
        total = np.zeros(mech.nv)
        for sign, name1 in ((1.0, closure.frame1), (-1.0, closure.frame2)):
            index = model.getFrameId(name1)
            J = pin.computeFrameJacobian(model, data, run.q[i], index, pin.LOCAL_WORLD_ALIGNED)
            total += sign * J.T @ np.concatenate([found.force[i], found.moment[i]])
        np.testing.assert_allclose(total, mech.K(run.q[i]).T @ run.multipliers[i], atol=1e-11)
    assert np.abs(found.moment).max() > 1e-3


def test_rows_have_readable_names(mechanisms: dict[str, rg.Mechanism]) -> None:
    assert row_names(mechanisms["rhombus"]) == ["coupler_tip-rocker_tip.y", "coupler_tip-rocker_tip.z"]
    assert row_names(mechanisms["seven hinges"]) == [
        f"cut1-cut2.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")
    ]
    assert row_names(mechanisms["spherical loop"]) == [
        f"pin1-pin2.{axis}" for axis in ("x", "y", "z", "r1", "r2")
    ]
    for mechanism in mechanisms.values():
        names = row_names(mechanism)
        assert len(set(names)) == len(names) == mechanism.nc


def test_a_closure_is_named_or_refused(fall: rg.Trajectory) -> None:
    by_name = fall.reaction("coupler_tip-rocker_tip").force
    for number in (0, np.int64(0)):
        np.testing.assert_array_equal(by_name, fall.reaction(number).force)
    with pytest.raises(
        rg.OptionError, match=r"closure 'q9' is none of .* 0: coupler_tip-rocker_tip, nor .* q1"
    ):
        fall.reaction("q9")
    with pytest.raises(rg.OptionError, match="closure 1 is none"):
        fall.reaction(1)
    with pytest.raises(rg.OptionError, match="not recorded"):
        rg.Trajectory(fall.mechanism, fall.t, fall.q, fall.v).reaction(0)


# --------------------------------------------------------------------------- a summary


def test_a_trajectory_prints_as_a_summary(fall: rg.Trajectory) -> None:
    assert repr(fall) == str(fall)
    assert repr(fall).splitlines() == [
        "Trajectory of 'crank_rocker': 101 times from 0 to 0.3 s",
        "  3 joints: q1, q2, q3; independent: q1",
        "  recorded: t, q, v, a, energy, multipliers, work",
    ]


def test_the_summary_stays_short() -> None:
    run = rg.simulate(rg.load("strandbeest"), duration=0.01)
    assert all(len(line) <= 120 for line in repr(run).splitlines())
    swing = rg.simulate(rg.load("rhombus"), duration=1.0)
    assert repr(swing).splitlines()[-1] == "  2 crossings: 0.1857 s, 0.9503 s"
    assert "no times" in repr(rg.Trajectory(run.mechanism, run.t[:0], run.q[:0], run.v[:0]))
