"""Trajectories and their certificates: what is recorded is true, and the errors reported are the errors."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

import robust_gcp as rg
from robust_gcp.maps.closed_form import parallelogram_pendulum, pendulum

Array = NDArray[np.float64]
PI = np.pi
EVERYTHING = ("a", "energy", "multipliers")


@pytest.fixture(scope="module")
def fall() -> rg.Trajectory:
    """0.3 s of the crank-rocker, released at home, with everything recorded."""
    return rg.simulate(rg.load("crank_rocker"), duration=0.3, step=3e-3, record=EVERYTHING)


# --------------------------------------------------------------------------- certificates


@pytest.mark.slow
@pytest.mark.parametrize("method", ("bridge", "projection"))
@pytest.mark.parametrize("name", ("rhombus", "parallelogram"))
def test_certificates_of_five_seconds_through_singularities(
    free_fall: Callable[..., rg.Trajectory], name: str, method: str
) -> None:
    """Loops closed to rounding at every output, K v = 0, and energy at the level of RK4."""
    traj = free_fall(name, method)
    assert traj.t.shape == (5001,)
    assert traj.closure_error().max() < 1e-12
    assert traj.velocity_error().max() < 1e-11  # some ten times |v| = 6 m/s as bad as φ
    # the local error of RK4 in ẏ is (ω h)⁵/120, ω² = B/A < 12 /s²; 5000 steps of it, times A ẏ < 10
    assert np.abs(traj.energy_error()).max() < 5000 * (12**0.5 * 1e-3) ** 5 / 120 * 10
    if method == "bridge":
        assert all(c.certificate <= 1e-12 for c in traj.crossings)
        assert traj.stats.bridges_built <= 2  # q1 = 0 and q1 = −π: kept, not built anew


@pytest.mark.parametrize("method", ("bridge", "projection", "closed_form"))
def test_energy_drift_is_that_of_rk4(free_fall: Callable[..., rg.Trajectory], method: str) -> None:
    """Halving the step divides it by 2⁴ (the part that comes and goes) to 2⁵ (the drift)."""
    drifts = [np.abs(free_fall("rhombus", method, step, 1.6).energy_error()).max() for step in (16e-3, 8e-3)]
    assert 15.0 < drifts[0] / drifts[1] < 33.0


def test_closure_and_velocity_errors_are_what_they_say(fall: rg.Trajectory) -> None:
    mech = fall.mechanism
    q_off, v_off = np.array([0.0, 1e-3, 0.0]), np.array([0.0, 0.0, 1e-2])
    wrong = rg.Trajectory(mech, fall.t, fall.q + q_off, fall.v + v_off)
    phi = [np.abs(mech.phi(q)).max() for q in wrong.q]
    Kv = [np.abs(mech.K(q) @ v).max() for q, v in zip(wrong.q, wrong.v, strict=True)]
    np.testing.assert_array_equal(wrong.closure_error(), phi)
    np.testing.assert_array_equal(wrong.velocity_error(), Kv)
    assert wrong.closure_error().min() > 1e-4  # l2 times 1e-3, at some angle
    assert fall.closure_error().shape == fall.velocity_error().shape == fall.t.shape
    assert fall.closure_error().max() < 1e-13
    assert fall.velocity_error().max() < 1e-13


def test_energy_error_is_relative_to_the_start_and_sees_work(fall: rg.Trajectory) -> None:
    assert fall.energy is not None
    np.testing.assert_array_equal(fall.energy_error(), fall.energy - fall.energy[0])
    tree = fall.mechanism.tree
    expected = [sum(tree.energies(q, v)) for q, v in zip(fall.q, fall.v, strict=True)]
    np.testing.assert_allclose(fall.energy, expected, rtol=1e-14)
    bare = rg.Trajectory(fall.mechanism, fall.t, fall.q, fall.v)  # computed when it was not recorded
    np.testing.assert_allclose(bare.energy_error(), fall.energy_error(), atol=1e-12)


def test_work_is_the_integral_of_power() -> None:
    """τ = (2, 0, 0) N m: W = 2 (q1 − q1(0))."""
    traj = rg.simulate(rg.load("crank_rocker"), duration=0.3, step=5e-3, torque=[2.0, 0.0, 0.0])
    assert traj.work is not None
    np.testing.assert_allclose(traj.work, 2.0 * (traj.q[:, 0] - traj.q[0, 0]), atol=1e-10)
    assert np.abs(traj.energy_error()).max() < 1e-7


# --------------------------------------------------------------------------- what is recorded


def test_shapes_and_what_was_not_asked_for() -> None:
    mech = rg.load("rhombus")
    traj = rg.simulate(mech, duration=0.01, step=2e-3)
    assert traj.mechanism is mech
    assert traj.t.shape == (6,)
    assert traj.q.shape == (6, mech.nq)
    assert traj.v.shape == (6, mech.nv)
    assert traj.y.shape == (6, 1)
    assert traj.a is traj.energy is traj.multipliers is traj.work is None
    full = rg.simulate(mech, duration=0.01, step=2e-3, record=EVERYTHING)
    assert full.a is not None
    assert full.energy is not None
    assert full.multipliers is not None
    assert full.a.shape == (6, 3)
    assert full.energy.shape == (6,)
    assert full.multipliers.shape == (6, 2)
    np.testing.assert_array_equal(full.q, traj.q)  # recording changes nothing
    np.testing.assert_array_equal(traj.y[:, 0], traj.q[:, 0])
    assert rg.simulate(mech, duration=0.01, step=2e-3, record="a").a is not None


def test_times_end_at_the_duration() -> None:
    """A step that divides it, one that does not (the last is shorter), and one step only."""
    mech = rg.load("rhombus")
    np.testing.assert_allclose(rg.simulate(mech, duration=0.03, step=0.01).t, [0, 0.01, 0.02, 0.03])
    uneven = rg.simulate(mech, duration=0.025, step=0.01)
    np.testing.assert_allclose(uneven.t, [0, 0.01, 0.02, 0.025])
    assert uneven.t[-1] == 0.025
    even = rg.simulate(mech, duration=0.025, step=0.005)
    np.testing.assert_allclose(uneven.q[-1], even.q[-1], atol=1e-8)  # O(h⁵) each
    assert rg.simulate(mech, duration=0.01, step=0.01).t.tolist() == [0.0, 0.01]
    # 0.3/0.1 is 2.9999999999999996: three steps, not four
    assert len(rg.simulate(mech, duration=0.3, step=0.1).t) == 4


def test_velocities_and_accelerations_are_derivatives(fall: rg.Trajectory) -> None:
    """v = q̇ and a = v̇, by eighth-order central differences of the recorded motion."""
    h, n = 3e-3, len(fall.t)
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h

    def rate(values: Array) -> Array:
        return np.array([weights @ values[i - 4 : i + 5] for i in range(4, n - 4)])

    # RK4's local error per step over h: h⁴ · 1e2 = 1e-8
    np.testing.assert_allclose(rate(fall.q), fall.v[4:-4], atol=1e-7)
    np.testing.assert_allclose(rate(fall.v), fall.a[4:-4], atol=1e-6)


def test_multipliers_balance_at_every_time(fall: rg.Trajectory) -> None:
    mech = fall.mechanism
    assert fall.a is not None
    assert fall.multipliers is not None
    for q, v, a, multipliers in zip(fall.q, fall.v, fall.a, fall.multipliers, strict=True):
        np.testing.assert_allclose(mech.K(q).T @ multipliers, mech.tree.rnea(q, v, a), atol=1e-11)


def test_accelerations_through_a_singularity_are_exact(
    free_fall: Callable[..., rg.Trajectory],
) -> None:
    """ÿ = −(B/A) cos y on the rhombus' parallelogram mode: also where K cannot show it."""
    traj = free_fall("rhombus", "bridge", 16e-3, 1.6)
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    expected = np.outer(-B / A * np.cos(traj.y[:, 0]), [1.0, -1.0, 1.0])
    # ε/zone³, zone 0.05, times ẏ² < 24
    np.testing.assert_allclose(traj.a, expected, atol=1e-9)


# --------------------------------------------------------------------------- crossings


@pytest.mark.parametrize("method", ("bridge", "projection"))
@pytest.mark.parametrize("name", ("rhombus", "parallelogram"))
def test_crossings_at_their_exact_times(
    free_fall: Callable[..., rg.Trajectory], name: str, method: str
) -> None:
    """q1 = 0 on the way down, q1 = −π and its turning back: zeros of the exact elliptic solution."""
    l = {"rhombus": 1.0, "parallelogram": 2.0}[name]
    A, B = parallelogram_pendulum(l, l, 1.0, 1.0, 1.0)
    traj = free_fall(name, method, 8e-3, 1.6)
    t = np.linspace(0.0, 1.6, 401)
    y = pendulum(t, 0.2, 0.0, A, B)[0]
    exact = []
    for angle in (0.0, -PI):
        for i in np.flatnonzero((y[:-1] - angle) * (y[1:] - angle) < 0.0):
            when = brentq(lambda s, a=angle: float(pendulum(s, 0.2, 0.0, A, B)[0]) - a, t[i], t[i + 1])
            exact.append((when, angle))
    exact.sort()
    assert [round(c.y[0], 6) + 0.0 for c in traj.crossings] == [round(a, 6) for _, a in exact]
    # the error of y, 4e-8 rad at 8 ms, over a speed of 2 rad/s
    np.testing.assert_allclose([c.time for c in traj.crossings], [w for w, _ in exact], atol=5e-8)
    for crossing in traj.crossings:
        np.testing.assert_allclose(crossing.q, crossing.y * [1.0, -1.0, 1.0], atol=1e-6)
        assert crossing.kind == {"bridge": "transversal", "projection": "projected"}[method]
        assert crossing.certificate < 1e-12
        assert np.isnan(crossing.transversality) if method == "projection" else crossing.transversality > 0.1


def test_no_crossings_where_there_are_none(fall: rg.Trajectory) -> None:
    """And what is not needed is not computed: no SVD, no bridge, no small step."""
    assert fall.crossings == []
    stats = fall.stats
    assert stats.svds == stats.bridges_built == stats.zone_evaluations == stats.marching_steps == 0
    assert stats.refined_steps == 0
    assert stats.repartitions == []
    assert stats.rhs == 4 * (len(fall.t) - 1) + 1  # four stages a step, and the end
    assert stats.newton_iterations > 0
    assert stats.wall_seconds > 0.0


def test_progress_is_reported() -> None:
    seen: list[float] = []
    rg.simulate(rg.load("rhombus"), duration=0.01, step=2e-3, progress=seen.append)
    np.testing.assert_allclose(seen, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_a_run_that_stops_keeps_what_it_had() -> None:
    """A torque that becomes NaN after 0.1 s."""
    with pytest.raises(rg.NonFiniteError) as caught:
        rg.simulate(
            rg.load("rhombus"),
            duration=0.2,
            step=0.01,
            torque=lambda t, q, v: np.full(3, np.nan if t > 0.1 else 0.0),
            record=EVERYTHING,
        )
    kept = caught.value.trajectory
    assert kept is not None
    assert kept.a is not None
    assert len(kept.t) == len(kept.q) == len(kept.a) == 11
    assert kept.t[-1] == pytest.approx(0.1)
    assert kept.closure_error().max() < 1e-12
    assert np.all(np.isfinite(kept.q))


# --------------------------------------------------------------------------- files


def test_csv_holds_every_digit(fall: rg.Trajectory, tmp_path: Path) -> None:
    path = fall.to_csv(tmp_path / "motion.csv")
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == [
        "t",
        *(f"{letter}.{joint}" for letter in "qva" for joint in ("q1", "q2", "q3")),
        "energy",
        "lambda.coupler_tip-rocker_tip.y",
        "lambda.coupler_tip-rocker_tip.z",
    ]
    values = np.array(rows, dtype=float)
    np.testing.assert_array_equal(values[:, 0], fall.t)
    np.testing.assert_array_equal(values[:, 1:4], fall.q)
    np.testing.assert_array_equal(values[:, 4:7], fall.v)
    np.testing.assert_array_equal(values[:, 7:10], fall.a)
    np.testing.assert_array_equal(values[:, 10], fall.energy)
    np.testing.assert_array_equal(values[:, 11:], fall.multipliers)
    bare = rg.Trajectory(fall.mechanism, fall.t, fall.q, fall.v).to_csv(str(tmp_path / "bare.csv"))
    assert bare.read_text(encoding="utf-8").splitlines()[0] == "t,q.q1,q.q2,q.q3,v.q1,v.q2,v.q3"


def test_csv_of_joints_with_several_numbers(spatial: dict[str, rg.Mechanism], tmp_path: Path) -> None:
    """nq = 7, nv = 6: a joint's numbers are called by their components."""
    mech = spatial["spherical loop"]
    path = rg.simulate(mech, duration=1e-3, step=1e-3).to_csv(tmp_path / "motion.csv")
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    ball = [*(f"q.ball.q{a}" for a in "xyzw"), *(f"v.ball.r{a}" for a in "xyz")]
    assert header == [
        *("t", "q.crank", *ball[:4], "q.elbow", "q.wrist"),
        *("v.crank", *ball[4:], "v.elbow", "v.wrist"),
    ]
    assert len(rows) == 2


def test_interpolated_motion_is_the_motion(fall: rg.Trajectory) -> None:
    """q and v are consistent enough for Hermite interpolation, as replay and events use it."""
    coarse = CubicHermiteSpline(fall.t[::2], fall.q[::2], fall.v[::2])
    # (2h)⁴/384 · q⁗, some hundred: 1e-9 · 1e2
    np.testing.assert_allclose(coarse(fall.t[1::2]), fall.q[1::2], atol=1e-7)


def test_a_run_without_outputs_answers_with_nothing_and_is_not_drawn(tmp_path: Path) -> None:
    """Such as one that stops before its first output, or of a simulation that keeps none."""
    empty = rg.Simulation(rg.load("rhombus"), keep="none").step(n=3).trajectory
    assert empty.energy_error().shape == empty.closure_error().shape == (0,)
    for draw in (empty.plot, empty.strobe, lambda: empty.animate(tmp_path / "run.gif")):
        with pytest.raises(rg.StateError, match="empty"):
            draw()
    with pytest.raises(rg.StateError, match="empty"):
        rg.simulate(rg.load("rhombus"), duration=0.1, step=1e-2).plot("q", overlay=empty)
