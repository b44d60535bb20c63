"""Published motions: Andrews' mechanism (A03), Bricard's (A04) and the flyball governor (A05).

A03 to A05 are problems of the IFToMM multibody benchmark; Andrews' end values are from the Test Set for
IVP Solvers (Bari), good to about 7.3 digits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

import robust_gcp as rg

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]
PI = np.pi

# --------------------------------------------------------------------------- A03, Andrews

ANGLES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
"""In the order of the test set: β, Θ, γ, Φ, δ, Ω, ε."""


def test_andrews_starts_with_the_published_accelerations() -> None:
    mech = rg.load("andrews")
    order = [mech.joint_names.index(name) for name in ANGLES]
    start = [
        -0.0617138900142764496,
        0.0,
        0.455279819163070380,
        0.222668390165885885,
        0.487364979543842550,
        -0.222668390165885885,
        1.23054744454982119,
    ]
    np.testing.assert_allclose(mech.home[order], start, atol=1e-15)
    a, _ = rg.implicit_dynamics(mech, mech.home, np.zeros(7))
    exact = [14222.4439199541138706, -10666.8329399655854, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(a[order], exact, atol=1e-11 * 14222.0)


def test_andrews_reaches_the_published_end() -> None:
    """Two and a half turns of the crank in 0.03 s, from DOP853; the energy balances to 1e-10 J."""
    mech = rg.load("andrews")
    order = [mech.joint_names.index(name) for name in ANGLES]
    traj = rg.simulate(mech, duration=0.03, step=1e-3, stepper="DOP853", rtol=1e-12, atol=1e-14)
    q = [
        15.81077119629904,
        -15.75637105984298,
        0.04082224013073101,
        -0.5347301163226948,
        0.5244099658805303,
        0.5347301163226948,
        1.048080741042263,
    ]
    v = [
        1139.920302151208,
        -1424.379294994111,
        11.03291221937134,
        19.29337464421385,
        0.5735699284790808,
        -19.29337464421385,
        0.3231791658026955,
    ]
    np.testing.assert_allclose(traj.q[-1][order], q, rtol=1e-7)
    np.testing.assert_allclose(traj.v[-1][order], v, rtol=1e-7)
    assert np.abs(traj.energy_error()).max() < 1e-10
    assert traj.closure_error().max() < 1e-14
    assert traj.work is not None
    assert traj.work[-1] == pytest.approx(0.033 * (traj.y[-1, 0] - traj.y[0, 0]), rel=1e-9)


@pytest.mark.slow
def test_andrews_converges_to_itself() -> None:
    """RK4 at 5e-6 s against DOP853 at 1e-12: 1e-10 rad, beyond what the published values can tell."""
    mech = rg.load("andrews")
    fixed = rg.simulate(mech, duration=0.03, step=5e-6)
    adaptive = rg.simulate(mech, duration=0.03, step=1e-3, stepper="DOP853", rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(fixed.q[-1], adaptive.q[-1], atol=1e-10)
    assert np.abs(fixed.energy_error()).max() < 1e-10


# --------------------------------------------------------------------------- A04, Bricard


def return_time(traj: rg.Trajectory, after: float) -> float:
    """When the first joint comes to rest again, from the Hermite interpolant of its velocity."""
    assert traj.a is not None
    t, v, a = traj.t, traj.v[:, 0], traj.a[:, 0]
    speed = CubicHermiteSpline(t, v, a)
    i = int(np.flatnonzero((t[:-1] > after) & (v[:-1] * v[1:] < 0.0))[0])
    return float(brentq(speed, t[i], t[i + 1], xtol=1e-14))


PERIODS = {"bricard": 4.98630861, "bricard_square": 4.99171151}


@pytest.mark.parametrize("name", PERIODS)
def test_bricard_turns_back_after_half_its_period(name: str) -> None:
    """From rest and back to rest is half a period: the motion runs back the way it came."""
    traj = rg.simulate(rg.load(name), duration=2.6, step=5e-3, record=("a",))
    assert 2.0 * return_time(traj, 1.0) == pytest.approx(PERIODS[name], abs=1e-6)
    assert not traj.crossings


@pytest.mark.slow
@pytest.mark.parametrize("name", PERIODS)
def test_bricard_over_ten_seconds(name: str) -> None:
    """Two returns, one redundant row all the way, no false alarm."""
    traj = rg.simulate(rg.load(name), duration=10.0, step=2e-3, record=("a",))
    assert return_time(traj, 4.0) == pytest.approx(PERIODS[name], abs=1e-6)
    assert return_time(traj, 9.0) == pytest.approx(2.0 * PERIODS[name], abs=1e-6)
    assert not traj.crossings
    assert traj.closure_error().max() < 1e-12
    assert np.abs(traj.energy_error()).max() < 1e-9


def test_bricards_closure_has_one_row_too_many(closed_states: States) -> None:
    """Rank 4 of 5 in every configuration, and least-norm forces all the same."""
    mech = rg.load("bricard")
    for q, _ in closed_states(mech, 3):
        s = np.linalg.svd(mech.K(q), compute_uv=False)
        assert s[3] > 0.1
        assert s[4] < 1e-12
        assert rg.analyse(mech, q).kind == "redundant"


# --------------------------------------------------------------------------- A05, flyball governor


def governor() -> tuple[rg.Mechanism, Array]:
    mech = rg.load("flyball")
    return mech, np.array([2.0 * PI if name == "shaft" else 0.0 for name in mech.joint_names])


def test_flyball_eigenvalues_at_the_start() -> None:
    """−8117, −20.05, ±7.35i 1/s (A05), and two of the mode that the symmetric start leaves alone."""
    mech, v0 = governor()
    assert mech.closures == ()

    def f(x: Array) -> Array:
        return np.concatenate([x[4:], rg.implicit_dynamics(mech, x[:4], x[4:])[0]])

    x, h = np.concatenate([mech.home, v0]), 1e-6
    jacobian = np.array([(f(x + h * e) - f(x - h * e)) / (2.0 * h) for e in np.eye(8)]).T
    values = np.linalg.eigvals(jacobian)
    for published in (-8117.0, -20.05, 7.35j, -7.35j):
        assert np.abs(values - published).min() < 6e-4 * abs(published)


def test_flyball_stiff_and_fixed_steps_agree() -> None:
    """RK4 below its stability limit 2.8/8117 s against BDF; the rods keep their symmetry."""
    mech, v0 = governor()
    fixed = rg.simulate(mech, v0=v0, duration=0.05, step=1e-4)
    stiff = rg.simulate(mech, v0=v0, duration=0.05, step=0.01, stepper="BDF", rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(fixed.q[-1], stiff.q[-1], atol=1e-7)
    one, two = (mech.joint_names.index(name) for name in ("alpha1", "alpha2"))
    np.testing.assert_allclose(fixed.q[:, one], fixed.q[:, two], atol=1e-12)
    assert fixed.work is not None
    assert fixed.work[-1] < 0.0
