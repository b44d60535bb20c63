"""The bridge: full order through singular configurations, with a certificate."""

import re
import warnings
from contextlib import nullcontext

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.closed_form import parallelogram_pendulum, pendulum
from robust_gcp.maps.cluster.options import BridgeOptions

EXACT = {"method": "closed_form", "stepper": "DOP853", "rtol": 1e-13, "atol": 1e-13}


def errors(mechanism, duration, steps, output, **start):
    """Largest |q − exact| of the bridge and of the same stepper on the closed form, per step."""
    exact = rg.simulate(mechanism, duration=duration, step=output, **start, **EXACT)
    ours, floor, runs = [], [], []
    for h in steps:
        every = round(output / h)
        for method, found in (("bridge", ours), ("closed_form", floor)):
            run = rg.simulate(mechanism, duration=duration, step=h, method=method, **start)
            found.append(np.abs(run.q[::every] - exact.q).max())
            if method == "bridge":
                runs.append(run)
    return np.array(ours), np.array(floor), runs


@pytest.fixture(scope="module")
def change_point():
    steps = (1e-2, 5e-3, 2e-3)
    return steps, *errors(rg.load("change_point"), 5.0, steps, 5e-2)


def test_change_point_linkage_reaches_the_floor_and_order_four(change_point):
    steps, ours, floor, runs = change_point
    assert np.all(ours <= 1.5 * floor)
    order = np.log(ours[:-1] / ours[1:]) / np.log(np.array(steps[:-1]) / np.array(steps[1:]))
    # the coarsest pair is not asymptotic: the closed form itself shows 4.97 and 4.92 there
    assert np.all(order > 3.8)
    for run in runs:
        assert len(run.crossings) == 3
        assert run.closure_error().max() < 1e-12


def test_crossings_are_logged_with_time_place_and_certificate(change_point):
    _, _, _, runs = change_point
    times = np.array([[c.time for c in run.crossings] for run in runs])
    # times converge with the trajectory: the finest two runs agree to its error over the speed
    assert np.abs(times[1] - times[2]).max() < 1e-5
    for crossing in runs[-1].crossings:
        # l0 + l1 = l2 + l3 folds flat where cos y = −1
        assert np.cos(crossing.y[0]) == pytest.approx(-1.0, abs=1e-14)
        assert crossing.kind == "transversal"
        assert crossing.certificate < 1e-12
        assert crossing.transversality > 0.1


@pytest.mark.parametrize(
    ("lengths", "factor", "y", "speed"), [((1, 2, 1, 2), 3.0, 1.0, 0.0), ((2, 1, 2, 1), -3.0, 0.1, -2.0)]
)
def test_antiparallelogram_ten_seconds(lengths, factor, y, speed):
    linkage = linkages.four_bar(*lengths, y=y, assembly=-1)
    v0 = linkage.lift(linkage.home, [speed])
    ours, floor, runs = errors(linkage, 10.0, (1e-2, 4e-3), 4e-2, v0=v0)
    assert np.all(ours <= 1.5 * floor)
    assert all(len(run.crossings) >= 4 for run in runs)
    q = runs[-1].q
    # tan(q3/2) = factor tan(q1/2), written without poles: sin and cos of half angles
    identity = np.sin(q[:, 2] / 2) * np.cos(q[:, 0] / 2) - factor * np.sin(q[:, 0] / 2) * np.cos(q[:, 2] / 2)
    assert np.abs(identity).max() < 1e-12


@pytest.mark.parametrize(("lengths", "factor"), [((1, 2, 1, 2), 3.0), ((2, 1, 2, 1), -3.0)])
def test_antiparallelogram_started_at_the_flat_configuration(lengths, factor):
    linkage = linkages.four_bar(*lengths, y=0.0, assembly=-1)
    flat = linkage.home
    here = rg.analyse(linkage, flat)
    assert here.kind == "singular"
    # d/dy of tan(q3/2) = factor tan(q1/2) at 0 is factor
    mode = next(t for t in here.modes if np.isclose(t[2], factor * t[0]))
    v0 = mode / mode[0] * 2.0
    ours, floor, _ = errors(linkage, 2.0, (1e-2, 4e-3), 4e-2, v0=v0)
    assert np.all(ours <= 1.5 * floor)
    named, _, _ = errors(linkage, 2.0, (1e-2,), 4e-2, v0=v0, mode=mode)
    assert named[0] == pytest.approx(ours[0])


def test_start_at_rest_on_a_named_mode():
    rhombus = rg.load("rhombus")
    here = rg.analyse(rhombus, np.zeros(3))
    parallelogram = next(t for t in here.modes if np.allclose(t, [1, -1, 1]))
    run = rg.simulate(rhombus, np.zeros(3), mode=parallelogram, duration=2.0, step=2e-3)
    y, *_ = pendulum(run.t, 0.0, 0.0, *parallelogram_pendulum(1, 1, 1, 1, 1))
    assert np.abs(run.q - np.stack([y, -y, y], axis=1)).max() < 1e-9


@pytest.mark.parametrize("distance", [1e-3, 1e-5, 1e-7, 1e-9, 1e-12, 1e-15])
def test_starts_beside_the_singularity_follow_the_same_motion(distance):
    rhombus = rg.load("rhombus")
    q0 = distance * np.array([1.0, -1.0, 1.0])
    run = rg.simulate(rhombus, q0, v0=[-1.0, 1.0, -1.0], duration=1.0, step=2e-3)
    y, *_ = pendulum(run.t, distance, -1.0, *parallelogram_pendulum(1, 1, 1, 1, 1))
    assert np.abs(run.q - np.stack([y, -y, y], axis=1)).max() < 1e-9


def test_motion_that_turns_round_inside_the_zone():
    # thrown upwards from just below the flat configuration, y comes back before or just after it
    rhombus = rg.load("rhombus")
    A, B = parallelogram_pendulum(1, 1, 1, 1, 1)
    for apex in (-1e-3, 1e-3):
        drop = 0.03
        y0 = apex - drop
        speed = np.sqrt(2 * B / A * (np.sin(apex) - np.sin(y0)))
        run = rg.simulate(
            rhombus,
            [y0, -y0, y0],
            v0=speed * np.array([1.0, -1.0, 1.0]),
            duration=0.3,
            step=2e-3,
        )
        y, *_ = pendulum(run.t, y0, speed, A, B)
        assert np.abs(run.q[:, 0] - y).max() < 1e-10
        assert len(run.crossings) == (2 if apex > 0 else 0)


@pytest.mark.parametrize("stepper", ["DOP853", "RK45", "Radau", "LSODA"])
def test_adaptive_solvers_pass_the_same_bridge(stepper):
    linkage = rg.load("change_point")
    options = {"duration": 2.5, "step": 5e-2, "stepper": stepper, "rtol": 1e-9, "atol": 1e-11}
    ours = rg.simulate(linkage, **options)
    floor = rg.simulate(linkage, **options, method="closed_form")
    exact = rg.simulate(linkage, duration=2.5, step=5e-2, **EXACT)
    error = np.abs(ours.q - exact.q).max()
    assert error <= 1.5 * np.abs(floor.q - exact.q).max() + 1e-9
    assert len(ours.crossings) == 2


@pytest.mark.parametrize("rtol", (1e-3, 1e-4))
def test_a_coarse_solver_whose_steps_are_refused_comes_back_to_the_mode(rtol):
    """Trial steps of 7 rad are refused; the next trial starts a whole turn behind the last evaluation."""
    change_point = rg.load("change_point")
    run, exact = (
        rg.simulate(change_point, duration=5.0, step=0.0125, stepper="DOP853", method=method, rtol=r, atol=a)
        for method, r, a in (("bridge", rtol, 1e-2 * rtol), ("closed_form", 1e-12, 1e-12))
    )
    assert np.abs(run.q - exact.q).max() < 20 * rtol


@pytest.mark.parametrize("n", [1, 2, 5])
def test_rows_of_four_bars_all_singular_at_once(n):
    row = linkages.n_four_bar(n)
    v0 = row.lift(row.home, [-1.0])
    run = rg.simulate(row, v0=v0, duration=1.5, step=2e-3)
    # A02: θ̈ = (g/L) ((3N + 1)/2)/((4N + 1)/3) sin θ about the upright; y = π/2 − θ
    y, *_ = pendulum(run.t, np.pi / 2, -1.0, (4 * n + 1) / 3, (3 * n + 1) / 2 * 9.81)
    assert np.abs(run.q[:, 0] - y).max() < 1e-8
    cranks = [row.joint_names.index(f"crank{i}") for i in range(n + 1)]
    assert np.abs(run.q[:, cranks] - y[:, None]).max() < 1e-8
    assert len(run.crossings) == 2


@pytest.mark.parametrize("backend", ("python", "auto"))
def test_a_bridge_met_again_after_whole_turns_is_not_built_again(backend):
    """All cranks turn over; flat at 0 and at π, whatever the count of turns."""
    row = linkages.n_four_bar(2)
    v0 = row.lift(row.home, [-1.0])
    run = rg.simulate(row, v0=v0, duration=6.0, step=2e-3, backend=backend)
    exact = pendulum(run.t, np.pi / 2, -1.0, 3.0, 3.5 * 9.81)[0]
    places = np.array([crossing.y[0] for crossing in run.crossings])
    assert np.ptp(places) > 2.0 * np.pi
    assert np.abs(np.sin(places)).max() < 1e-9  # the determinant is interpolated through six values
    assert run.stats.bridges_built == 2
    assert np.abs(run.q[:, 0] - exact).max() < 1e-8
    assert run.closure_error().max() < 1e-13


def test_kite_passes_its_fold_and_keeps_its_mode():
    # q3 parametrises the kite mode without a toggle; the fold of links 2 and 3 is at q1 = 0
    kite = rg.load("kite").with_independent(["q3"])
    steps = (4e-3, 2e-3)
    runs = [rg.simulate(kite, duration=2.0, step=h) for h in steps]
    for run in runs:
        assert run.crossings
        # on the kite mode the tips of links 1 and 3's pivot stay mirror images: q12 = −(π − ...)
        assert run.closure_error().max() < 1e-12
    drift = [np.abs(run.energy_error()).max() for run in runs]
    assert drift[0] / drift[1] > 12.0  # order 4 halves to 1/16


def test_mobility_two_keeps_order_four():
    # the change-point linkage on a swinging ground link; reference: error-controlled, 1e-12
    scene = linkages.swinging_four_bar(4, 2, 3, 3, swing=-0.5, y=2.5)
    exact = rg.simulate(scene, duration=1.0, step=2e-2, stepper="DOP853", rtol=1e-12, atol=1e-13)
    assert len(exact.crossings) == 1
    steps = (1e-2, 5e-3)
    ours = []
    for h in steps:
        run = rg.simulate(scene, duration=1.0, step=h)
        assert run.closure_error().max() < 1e-12
        ours.append(np.abs(run.q[:: round(2e-2 / h)] - exact.q).max())
    assert 3.5 < np.log2(ours[0] / ours[1]) < 5.5


def test_results_do_not_depend_on_the_options_over_a_decade():
    linkage = rg.load("change_point")
    exact = rg.simulate(linkage, duration=1.0, step=5e-2, **EXACT)
    found = []
    for zone in (0.015, 0.05, 0.15):
        run = rg.simulate(linkage, duration=1.0, step=5e-3, options=BridgeOptions(zone=zone))
        found.append(np.abs(run.q[::10] - exact.q).max())
    assert np.ptp(found) < 0.02 * max(found)


def test_a_scene_far_from_singular_runs_no_svd_and_no_bridge():
    run = rg.simulate(rg.load("crank_rocker"), duration=0.5, step=2e-3)
    assert (run.stats.svds, run.stats.bridges_built, run.stats.zone_evaluations) == (0, 0, 0)
    assert run.stats.marching_steps == 0


# --------------------------------------------------------------------------- hard cases


@pytest.mark.parametrize("gap", [1e-2, 1e-3, pytest.param(1e-5, marks=pytest.mark.campaign), 1e-7])
def test_near_miss_follows_the_true_curve(gap):
    # l0 + l1 just below l2 + l3: the modes veer instead of crossing, q1 still turns over
    linkage = linkages.four_bar(4 - gap, 2, 3, 3, y=2.5)
    # G is right to ε / gap there, which is told where it shows in a motion followed to 1e-10
    told = (
        pytest.warns(rg.SingularityWarning, match="rounding leaves it right") if gap < 1e-6 else nullcontext()
    )
    with told:
        run = rg.simulate(linkage, duration=1.0, step=4e-3)
    exact = rg.simulate(linkage, duration=1.0, step=4e-2, **EXACT)
    # the veer is √gap wide; rounding ε/gap^1.5 of g and RK4's 1e-6 elsewhere
    assert np.abs(run.q[::10] - exact.q).max() < 1e-5
    assert run.crossings == []


@pytest.mark.parametrize("stepper", ["rk4", pytest.param("DOP853", marks=pytest.mark.campaign)])
def test_what_rounding_costs_beside_a_near_miss_is_told(stepper):
    """An error above 3e-9 of a motion followed to 1e-12 comes with a warning, which bounds it."""
    linkage = linkages.four_bar(1.0, 2.0 + 1e-8, 1.0, 2.0, y=0.3, assembly=-1)
    v0 = linkage.lift(linkage.home, [-2.0])
    more = {} if stepper == "rk4" else {"stepper": stepper, "rtol": 1e-12, "atol": 1e-13}
    exact = rg.simulate(linkage, v0=v0, duration=0.6, step=0.3, **EXACT)
    for steps in range(300, 360, 10):  # where the stages come to lie is chance
        with pytest.warns(rg.SingularityWarning, match="rounding leaves it right to") as told:
            run = rg.simulate(linkage, v0=v0, duration=0.6, step=0.6 / steps, **more)
        said = re.search(r"right to (\S+) there", str(told[0].message))
        assert said is not None
        assert np.abs(run.q[-1] - exact.q[-1]).max() < float(said[1]) < 1e-7


def test_gap_below_the_geometric_tolerance_is_bridged_and_reported():
    linkage = linkages.four_bar(4 - 1e-10, 2, 3, 3, y=2.5)
    with pytest.warns(rg.SingularityWarning, match="gap of"):
        run = rg.simulate(linkage, duration=1.0, step=4e-3)
    assert [c.kind for c in run.crossings] == ["near miss"]
    assert 1e-12 < run.crossings[0].certificate < 1e-9
    crossing = rg.simulate(rg.load("change_point"), duration=1.0, step=4e-3)
    assert np.abs(run.q - crossing.q).max() < 1e-8


def test_gap_within_rounding_is_a_crossing():
    linkage = linkages.four_bar(4 - 1e-14, 2, 3, 3, y=2.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = rg.simulate(linkage, duration=1.0, step=4e-3)
    assert [c.kind for c in run.crossings] == ["transversal"]


def test_toggle_is_an_error_that_names_better_joints():
    rocker = rg.load("crank_rocker").with_independent(["q3"])
    with pytest.raises(rg.ToggleError, match="repartition") as caught:
        rg.simulate(rocker, duration=1.0, step=4e-3, on_toggle="error")
    assert ("q1",) in caught.value.choices
    stopped = caught.value.trajectory
    assert len(stopped.t) > 10
    # what is known is right until then
    assert np.abs(stopped.energy_error()).max() < 1e-8


def test_toggle_with_repartition_goes_on_with_full_order():
    rocker = rg.load("crank_rocker").with_independent(["q3"])
    crank = rg.load("crank_rocker")
    exact = rg.simulate(crank, duration=1.0, step=4e-2, **EXACT)
    for h in (4e-3, 2e-3):
        run = rg.simulate(rocker, duration=1.0, step=h, on_toggle="repartition")
        assert run.stats.repartitions
        floor = rg.simulate(crank, duration=1.0, step=h)
        every = round(4e-2 / h)
        error = np.abs(run.q[::every] - exact.q).max()
        assert error <= 1.5 * np.abs(floor.q[::every] - exact.q).max()


def test_repartition_in_mid_motion_keeps_order_four():
    # the kite's q1 turns back at −π/3, after the fold at 0 has been crossed on q1
    kite = rg.load("kite")
    drift = []
    for h in (4e-3, 2e-3):
        run = rg.simulate(kite, duration=1.5, step=h, on_toggle="repartition")
        assert run.stats.repartitions[0][1] in {("q2",), ("q3",)}
        drift.append(np.abs(run.energy_error()).max())
    assert drift[0] / drift[1] > 12.0


def test_coordinates_change_as_often_as_they_turn_back():
    # no link of a triple rocker turns fully: each of its joints turns back within the run
    mechanism = linkages.four_bar(1.0, 1.2, 1.4, 0.7, y=1.5)
    v0 = mechanism.lift(mechanism.home, [3.0])
    errors = []
    for step in (2e-3, 1e-3):
        run = rg.simulate(mechanism, v0=v0, duration=1.5, step=step, on_toggle="repartition")
        assert len(run.stats.repartitions) >= 2
        errors.append(np.abs(run.energy_error()).max())
    # RK4's own: links fly by within 20 ms; see test_coordinates for its error in coordinates that do not turn
    assert errors[1] < 5e-5
    assert errors[1] < errors[0] / 12.0


def test_toggle_beside_the_line_of_steepest_descent_is_told_from_a_near_miss():
    # The five-bar's upper links fold onto each other while the cranks go on. Straight ahead along the
    # gradient of det K_d the surface of toggles bends away, as a near miss would; the motion meets it.
    five_bar = rg.load("five_bar")
    with pytest.raises(rg.ToggleError) as caught:
        rg.simulate(five_bar, duration=1.0, on_toggle="error")
    q = caught.value.trajectory.q[-1]
    folded = (q[0] + q[1]) - (q[2] + q[3])  # K_d's columns are the two links' directions
    assert abs(np.sin(folded)) < 0.05
    K = five_bar.K(q)
    assert np.linalg.cond(K) < 10.0 < 100.0 < np.linalg.cond(K[:, five_bar.iv_dependent])
    assert set(caught.value.choices[0]) == {"q1", "q4"}

    run = rg.simulate(five_bar, duration=0.75, on_toggle="repartition")
    assert [set(names) for _, names in run.stats.repartitions] == [{"q1", "q4"}]
    other = rg.simulate(five_bar.with_independent(["q1", "q4"]), duration=0.75)
    assert other.stats.refined_steps == 0  # regular throughout in these
    # RK4's own error at this step, by halving it: 9e-10 in q
    assert np.abs(run.q - other.q).max() < 2e-9


@pytest.mark.parametrize("cranks", [(-4.3, 5.4), (-3.6, -2.9), (-0.2, 5.8)])
def test_five_bar_turns_over_through_its_toggles_with_order_four(cranks):
    five_bar = rg.load("five_bar")
    v0 = five_bar.lift(five_bar.home, cranks)
    drift = []
    for h in (1e-3, 5e-4):
        run = rg.simulate(five_bar, v0=v0, duration=1.0, step=h, on_toggle="repartition")
        assert len(run.stats.repartitions) >= 2
        drift.append(np.abs(run.energy_error()).max())
    assert drift[0] / drift[1] > 12.0


def test_start_at_a_toggle_names_better_joints():
    # links 2 and 3 stretched: l0 = l1 = 2 subtend 2 sin(π/6) · 2 = l2 + l3 at q1 = π/3
    kite = rg.load("kite")
    tilt = -np.pi / 3  # direction from the tip of link 1 to the pivot of link 3
    straight = [np.pi / 3, tilt - np.pi / 3, tilt + np.pi]
    with pytest.raises(rg.ToggleError) as caught:
        rg.simulate(kite, straight, on_toggle="error")
    assert caught.value.choices


def test_start_at_rest_where_modes_meet_asks_for_a_mode():
    with pytest.raises(rg.SingularStartError, match=r"mode=.*modes\[0\]"):
        rg.simulate(rg.load("rhombus"), np.zeros(3))


def test_mode_on_which_the_coordinate_rests_is_refused():
    rhombus = rg.load("rhombus")
    folded = next(t for t in rg.analyse(rhombus, np.zeros(3)).modes if t[0] == 0.0)
    with pytest.raises(rg.ToggleError, match="q2, q3"):
        rg.simulate(rhombus, np.zeros(3), mode=folded, on_toggle="error")
    other = rhombus.with_independent(["q2"])
    run = rg.simulate(other, np.zeros(3), mode=folded, duration=0.5, step=2e-3)
    # mode b: links 2 and 3 folded, q1 = 0: two rods about the tip of link 1, 2 (1/3) ÿ = −9.81 cos y
    y, *_ = pendulum(run.t, 0.0, 0.0, 2.0 / 3.0, 9.81)
    assert np.abs(run.q - np.stack([0 * y, y, y], axis=1)).max() < 1e-9


def test_initial_velocity_off_every_mode_is_refused():
    with pytest.raises(rg.SingularStartError, match="none of them"):
        rg.simulate(rg.load("rhombus"), np.zeros(3), v0=[1.0, 0.0, 2.0])


@pytest.mark.parametrize("stepper", ["DOP853", "Radau"])
def test_adaptive_solvers_change_coordinates_at_toggles(stepper):
    # the kite's q1 turns back at −π/3
    kite = rg.load("kite")
    run = rg.simulate(
        kite, duration=1.2, step=2e-2, stepper=stepper, rtol=1e-8, atol=1e-10, on_toggle="repartition"
    )
    assert run.stats.repartitions
    assert run.t[-1] == 1.2
    assert np.abs(run.energy_error()).max() < 1e-5
    assert run.closure_error().max() < 1e-12


def test_repartition_needs_the_bridge():
    with pytest.raises(rg.OptionError, match="repartition"):
        rg.simulate(rg.load("rhombus"), method="classical", on_toggle="repartition")
