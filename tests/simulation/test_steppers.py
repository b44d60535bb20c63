"""Steppers: the tableau of RK4, orders observed, and scipy's solvers as generators of states."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.maps.closed_form import parallelogram_pendulum, pendulum
from robust_gcp.simulation.runs.steppers import SCIPY_STEPPERS, adaptive, check_stepper, rk4_step

Array = NDArray[np.float64]
Rhs = Callable[[float, Array], Array]


def integrate(f: Rhs, x: Array, duration: float, steps: int) -> Array:
    h = duration / steps
    for i in range(steps):
        x = rk4_step(f, i * h, x, h, f(i * h, x))
    return x


# --------------------------------------------------------------------------- the tableau


def tableau() -> tuple[Array, Array, Array]:
    """A, b and c, read off: stage i answers with the unit vector e_i, so states are rows of A."""
    rows, times = [np.zeros(4)], [0.0]

    def f(t: float, x: Array) -> Array:
        rows.append(x)
        times.append(t)
        return np.eye(4)[len(rows) - 1]

    b = rk4_step(f, 0.0, np.zeros(4), 1.0, np.eye(4)[0])
    return np.array(rows), b, np.array(times)


def test_four_stages_explicit_and_consistent() -> None:
    """Kutta's classical method of 1901; rows of A sum to c."""
    A, b, c = tableau()
    np.testing.assert_array_equal(c, [0.0, 0.5, 0.5, 1.0])
    np.testing.assert_allclose(A.sum(axis=1), c, atol=1e-16)
    np.testing.assert_allclose(b, np.array([1, 2, 2, 1]) / 6, atol=1e-16)
    np.testing.assert_array_equal(np.triu(A), 0.0)


def test_all_conditions_of_order_four() -> None:
    """One for each rooted tree of up to four nodes (Butcher; Hairer, Nørsett, Wanner, Table II.2.1)."""
    A, b, c = tableau()
    conditions = {
        "b": (b.sum(), 1),
        "bc": (b @ c, 1 / 2),
        "bc²": (b @ c**2, 1 / 3),
        "bAc": (b @ A @ c, 1 / 6),
        "bc³": (b @ c**3, 1 / 4),
        "bcAc": ((b * c) @ A @ c, 1 / 8),
        "bAc²": (b @ A @ c**2, 1 / 12),
        "bAAc": (b @ A @ A @ c, 1 / 24),
    }
    for name, (left, right) in conditions.items():
        assert left == pytest.approx(right, abs=1e-15), name
    assert abs(b @ c**4 - 1 / 5) > 1e-3  # and not of order five


@pytest.mark.parametrize("z", (-2.0, -0.3, 0.1, 1.5))
def test_linear_equation_gives_the_stability_polynomial(z: float) -> None:
    """ẋ = λ x with h λ = z: R(z) = 1 + z + z²/2 + z³/6 + z⁴/24."""
    h, x = 0.01, np.array([3.0])
    step = rk4_step(lambda t, x: x * (z / h), 0.0, x, h, x * (z / h))
    assert step[0] == pytest.approx(3.0 * (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24), rel=1e-14)


def test_cubics_in_time_are_exact() -> None:
    """b and c are Simpson's rule."""
    exact = np.array([2.0**4 / 4 - 2.0**2])
    step = integrate(lambda t, x: np.array([t**3 - 2.0 * t]), np.zeros(1), 2.0, 1)
    np.testing.assert_allclose(step, exact, atol=1e-15)


def test_state_and_derivative_are_not_changed() -> None:
    x, k1 = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    rk4_step(lambda t, x: -x, 0.0, x, 0.1, k1)
    np.testing.assert_array_equal(x, [1.0, 2.0])
    np.testing.assert_array_equal(k1, [3.0, 4.0])


def test_order_on_a_smooth_equation() -> None:
    """ẋ = x cos t, x = exp(sin t): halving the step divides the error by 2⁴."""

    def f(t: float, x: Array) -> Array:
        return x * np.cos(t)

    errors = [abs(integrate(f, np.ones(1), 3.0, n)[0] - np.exp(np.sin(3.0))) for n in (100, 200, 400, 800)]
    # the ratio is 16 (1 + O(h)), h = 0.03 … 0.004; the last error is 5e-13
    np.testing.assert_allclose([a / b for a, b in pairwise(errors)], 16.0, rtol=0.05)


# --------------------------------------------------------------------------- through singularities


@pytest.mark.parametrize("method", ("bridge", "projection", "closed_form"))
@pytest.mark.parametrize("name", ("rhombus", "parallelogram"))
def test_order_four_through_crossings_against_the_exact_pendulum(
    free_fall: Callable[..., rg.Trajectory], name: str, method: str
) -> None:
    """1.6 s of free fall from 0.2 rad, through q1 = 0 and q1 = −π, against elliptic functions.

    The error is 6e-7 at h = 16 ms, far above rounding; 2⁴ = 16 is approached as 16 (1 − 2 h/s)."""
    l = {"rhombus": 1.0, "parallelogram": 2.0}[name]
    A, B = parallelogram_pendulum(l, l, 1.0, 1.0, 1.0)
    errors = []
    for step in (16e-3, 8e-3):
        traj = free_fall(name, method, step, 1.6)
        y, rate, _ = pendulum(traj.t, 0.2, 0.0, A, B)
        assert y.min() < -np.pi < 0.0 < y.max()
        tangent = np.array([1.0, -1.0, 1.0])
        off = np.abs(traj.q - np.outer(y, tangent)), np.abs(traj.v - np.outer(rate, tangent))
        errors.append(max(off[0].max(), off[1].max()))
    assert errors[1] < 1e-7
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)


# --------------------------------------------------------------------------- scipy's solvers


def oscillator(t: float, x: Array) -> Array:
    return np.array([x[1], -x[0]])


@pytest.mark.parametrize("name", SCIPY_STEPPERS)
def test_states_come_at_the_times_asked_for(name: str) -> None:
    """One period of an oscillator at odd times; the error follows the tolerance."""
    times = np.array([0.0, 1e-3, 0.5, 0.5001, 3.0, 2.0 * np.pi])
    exact = np.array([np.cos(times), -np.sin(times)]).T[1:]
    errors = []
    for tolerance in (1e-4, 1e-8):
        states = list(adaptive(name, oscillator, np.array([1.0, 0.0]), times, tolerance, tolerance))
        assert len(states) == len(times) - 1
        errors.append(np.abs(np.array(states) - exact).max())
    # rule of thumb: global error within some hundred tolerances for a few oscillations
    assert errors[0] < 1e-2
    assert errors[1] < 2e-6
    assert errors[1] < 0.1 * errors[0]


def test_states_are_made_as_they_are_asked_for() -> None:
    """A generator: the run can stop, and what was simulated until then is kept."""
    calls = []

    def f(t: float, x: Array) -> Array:
        calls.append(t)
        return oscillator(t, x)

    states: Iterator[Array] = adaptive(
        "RK45", f, np.array([1.0, 0.0]), np.linspace(0.0, 100.0, 101), 1e-6, 1e-6
    )
    next(states)
    assert max(calls) < 10.0


def test_states_can_be_kept() -> None:
    """Each state is its own array."""
    times = np.linspace(0.0, 1.0, 5)
    states = list(adaptive("DOP853", oscillator, np.array([1.0, 0.0]), times, 1e-8, 1e-8))
    np.testing.assert_allclose([s[0] for s in states], np.cos(times[1:]), atol=1e-6)


@pytest.mark.parametrize("name", ("RK45", "DOP853", "Radau", "BDF"))
def test_refused_trials_make_the_step_shrink(name: str) -> None:
    """x = −ln(1 + t) in an equation that refuses x < −ln 2.001: trials beyond t = 1 are taken back,
    and t = 1 is reached within the tolerance."""
    refusals = []

    def f(t: float, x: Array) -> Array:
        if x[0] < -np.log(2.001):
            refusals.append(t)
            raise rg.BranchError("beyond")
        return -np.exp(x)

    (end,) = adaptive(name, f, np.zeros(1), np.array([0.0, 1.0]), 1e-3, 1e-3)
    assert refusals
    assert end[0] == pytest.approx(-np.log(2.0), abs=2e-3)


@pytest.mark.parametrize("name", ("Radau", "BDF", "LSODA"))
def test_a_toggle_stops_every_stepper_with_its_reason(name: str) -> None:
    """The crank-rocker's rocker turns back after 0.28 s: a typed error, and what came before."""
    mech = rg.load("crank_rocker").with_independent(["q3"])
    with pytest.raises(rg.ToggleError, match=r"turn back.*q1, or q2") as caught:
        rg.simulate(mech, duration=0.4, step=0.01, stepper=name, on_toggle="error")
    kept = caught.value.trajectory
    assert kept is not None
    assert 0.2 < kept.t[-1] < 0.29
    assert kept.closure_error().max() < 1e-12


def test_where_no_step_is_small_enough_the_refusal_is_raised() -> None:
    """Nothing can pass x = ½: the error that says why comes out, not a solver's message."""

    def f(t: float, x: Array) -> Array:
        if x[0] > 0.5:
            raise rg.ToggleError("turns back at one half")
        return np.ones(1)

    with pytest.raises(rg.ToggleError, match="turns back at one half"):
        list(adaptive("RK45", f, np.zeros(1), np.array([0.0, 1.0]), 1e-6, 1e-6))


def test_an_equation_that_refuses_its_start_says_so() -> None:
    def f(t: float, x: Array) -> Array:
        raise rg.BranchError("never")

    with pytest.raises(rg.BranchError, match="never"):
        list(adaptive("RK45", f, np.zeros(1), np.array([0.0, 1.0]), 1e-6, 1e-6))


def test_a_refused_trial_is_not_continued_from() -> None:
    """f is asked for finite states only, and the refusal that stops the run is about one."""
    seen: list[float] = []

    def f(t: float, x: Array) -> Array:
        seen.append(float(x[0]))
        if x[0] > 0.5:
            raise rg.ToggleError("turns back at one half")
        return np.ones(1)

    for name in ("RK45", "DOP853"):
        with pytest.raises(rg.ToggleError, match="turns back at one half"):
            list(adaptive(name, f, np.zeros(1), np.array([0.0, 1.0]), 1e-6, 1e-6))
    assert np.all(np.isfinite(seen))


def test_creeping_is_not_progress() -> None:
    """ẋ = −1e9 (x − cos t) by an explicit method: its step is 3e-9 s, so the run would take for ever."""
    with pytest.raises(rg.SimulationError, match=r"RK45 made no headway.*too stiff"):
        list(
            adaptive(
                "RK45",
                lambda t, x: -1e9 * (x - np.cos(t)),
                np.ones(1),
                np.array([0.0, 1.0]),
                1e-6,
                1e-6,
                effort=500,
            )
        )


def test_stiff_methods_take_it_at_once() -> None:
    """The same equation: x = cos t to 1e-9."""
    for name in ("Radau", "BDF"):
        (end,) = adaptive(
            name, lambda t, x: -1e9 * (x - np.cos(t)), np.ones(1), np.array([0.0, 1.0]), 1e-8, 1e-8
        )
        assert end[0] == pytest.approx(np.cos(1.0), abs=1e-6)


@pytest.mark.parametrize("name", ("Radau", "BDF", "LSODA"))
def test_a_given_jacobian_is_used_and_the_last_one_kept_where_it_refuses(name: str) -> None:
    """ẋ = −1e4 (x − cos t) makes even LSODA implicit; the Jacobian refuses all but its first call."""
    calls = []

    def jacobian(t: float, x: Array) -> Array:
        calls.append(t)
        if len(calls) > 1:
            raise rg.BranchError("no neighbour")
        return np.array([[-1e4]])

    f = lambda t, x: -1e4 * (x - np.cos(t))  # noqa: E731
    (end,) = adaptive(name, f, np.ones(1), np.array([0.0, 2.0]), 1e-6, 1e-8, jacobian=jacobian)
    assert calls
    assert end[0] == pytest.approx(np.cos(2.0) + 1e-4 * np.sin(2.0), abs=1e-5)


def test_names_are_checked() -> None:
    for name in ("rk4", *SCIPY_STEPPERS):
        assert check_stepper(name) == name
    with pytest.raises(rg.OptionError, match=r"'rk5' is unknown.*'rk4'.*Radau"):
        check_stepper("rk5")


@pytest.mark.parametrize("name", SCIPY_STEPPERS)
def test_simulation_with_an_adaptive_stepper(name: str) -> None:
    """0.5 s of the rhombus through q1 = 0 (at 0.19 s), against the exact pendulum."""
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    traj = rg.simulate(rg.load("rhombus"), duration=0.5, step=0.05, stepper=name, rtol=1e-7, atol=1e-9)
    y, _, _ = pendulum(traj.t, 0.2, 0.0, A, B)
    assert y[-1] < -0.5
    assert np.abs(traj.q - np.outer(y, [1.0, -1.0, 1.0])).max() < 1e-5
    assert traj.closure_error().max() < 1e-12
    assert len(traj.crossings) == 1


def test_lsoda_within_lsoda_is_refused_by_name():
    mech = rg.load("rhombus")

    def torque(t, q, v):
        return 0.0 * rg.simulate(mech, duration=1e-3, stepper="LSODA").v[-1]

    with pytest.raises(rg.OptionError, match="one state for both"):
        rg.simulate(mech, duration=0.01, stepper="LSODA", torque=torque)
    within = rg.simulate(mech, duration=2e-3, stepper="Radau", torque=torque)
    np.testing.assert_allclose(within.q, rg.simulate(mech, duration=2e-3, stepper="Radau").q, atol=1e-12)
    assert len(rg.simulate(mech, duration=0.01, stepper="LSODA").t) > 1  # as before
