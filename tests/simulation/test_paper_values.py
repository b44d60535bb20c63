"""The published numbers of the paper's four-bar examples (docs/method.md), to all printed digits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.maps.closed_form import pendulum
from robust_gcp.maps.regular_path import RegularPath

Array = NDArray[np.float64]
PI = np.pi
ALONG = np.array([1.0, -1.0, 1.0])
"""G of the parallelogram mode, q = (y, −y, y)."""


@pytest.fixture(scope="module")
def rhombus() -> rg.Mechanism:
    return rg.load("rhombus")


def projector(basis: Array) -> Array:
    Q, _ = np.linalg.qr(np.asarray(basis, dtype=float).T)
    return Q @ Q.T


def eq7(kernel: Array, G_prev: Array) -> tuple[Array, Array]:
    """α and G of Eq. (7): G = N α with α = Nᵀ G_prev, then independent rows made the identity."""
    N = np.asarray(kernel, dtype=float).T
    alpha = N.T @ G_prev
    G = N @ alpha
    return alpha, G / G[0]


def test_regular_configuration(rhombus: rg.Mechanism) -> None:
    """q = (0.2, −0.2, 0.2)."""
    q = [0.2, -0.2, 0.2]
    np.testing.assert_array_equal(np.round(rhombus.K(q), 4), [[-0.1987, 0.0, 0.1987], [1.9801, 1.0, -0.9801]])
    here = rg.analyse(rhombus, q)
    assert here.rank == 2
    path = RegularPath(rhombus, rhombus.select_rows(rhombus.K(q)))
    point = path.settle(np.array(q), np.array([0.2]), np.array([3.0]))
    assert point is not None
    np.testing.assert_allclose(point.G[:, 0], ALONG, atol=1e-14)
    np.testing.assert_allclose(point.g, 0.0, atol=1e-13)  # for any speed: links keep their direction


def test_first_singularity(rhombus: rg.Mechanism) -> None:
    """q* = (0, 0, 0): modes a and b meet."""
    here = rg.analyse(rhombus, [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(np.round(rhombus.K(here.q), 4), [[0, 0, 0], [2, 1, -1]])
    assert here.rank == 1
    published = np.array([[-1, 1, -1] / np.sqrt(3), [0, 1, 1] / np.sqrt(2)])
    np.testing.assert_allclose(projector(here.kernel.T), projector(published), atol=1e-14)
    alpha, G = eq7(published, ALONG)
    np.testing.assert_allclose(G, ALONG, atol=1e-15)
    # the paper prints α = (−1/√3, 0); G = N α = (1, −1, 1) needs −√3, as Eq. (7) gives it
    np.testing.assert_allclose(alpha, [-np.sqrt(3), 0.0], atol=1e-15)
    slip = published.T @ [-1 / np.sqrt(3), 0.0]
    np.testing.assert_allclose(slip, ALONG / 3.0, atol=1e-15)


def test_second_singularity(rhombus: rg.Mechanism) -> None:
    """q* = (π, −π, π): modes a and c meet; α = (0, √3)."""
    here = rg.analyse(rhombus, [PI, -PI, PI])
    np.testing.assert_array_equal(np.round(rhombus.K(here.q), 4) + 0.0, [[0, 0, 0], [0, 1, 1]])
    assert here.rank == 1
    # α = (0, √3) says that the second vector of the paper's basis is (1, −1, 1)/√3; the first one is
    # then what is left of ker K = {v2 + v3 = 0}
    basis = np.array([[2, 1, -1] / np.sqrt(6), ALONG / np.sqrt(3)])
    np.testing.assert_allclose(projector(here.kernel.T), projector(basis), atol=1e-14)
    alpha, G = eq7(basis, ALONG)
    np.testing.assert_allclose(alpha, [0.0, np.sqrt(3)], atol=1e-15)
    np.testing.assert_allclose(G, ALONG, atol=1e-15)


def test_bias_has_the_sign_of_minus_Kdot_v(rhombus: rg.Mechanism) -> None:
    """The paper's other slip: K a = k needs k = −K̇ q̇, not K̇ q̇. On mode c with q̇ = (1, 0, 0), of
    which links 1 and 2 turn as one, a = 0 is the motion, so k = 0; on q2 alone the tip of link 2
    accelerates towards its hinge, and K a = k must undo that."""
    np.testing.assert_allclose(rhombus.k([2.0, PI, PI], [1.0, 0.0, 0.0]), 0.0, atol=1e-15)
    q, v = np.array([0.0, 0.5 * PI, 0.0]), np.array([0.0, 2.0, 0.0])
    # tip at (1, 1), hinge at (1, 0): centripetal acceleration (0, −4) = K̇ q̇
    np.testing.assert_allclose(rhombus.k(q, v), [0.0, 4.0], atol=1e-15)


@pytest.mark.parametrize("t", (-2.0, 0.5, 3.0))
def test_three_operation_modes(rhombus: rg.Mechanism, t: float) -> None:
    """(a) parallelogram; (b) q1 = 0, links 2 and 3 folded; (c) q3 = π, links 1 and 2 folded."""
    modes = {
        "a": ([t, -t, t], [1.0, -1.0, 1.0]),
        "b": ([0.0, t, t], [0.0, 1.0, 1.0]),
        "c": ([t, PI, PI], [1.0, 0.0, 0.0]),
    }
    for q, tangent in modes.values():
        assert np.abs(rhombus.phi(q)).max() < 1e-15
        here = rg.analyse(rhombus, q)
        assert here.kind == "regular"
        np.testing.assert_allclose(here.modes[0], tangent, atol=1e-12)


def test_modes_that_meet(rhombus: rg.Mechanism) -> None:
    """a and b at (0, 0, 0), a and c at (π, −π, π)."""
    for q, others in (([0.0, 0.0, 0.0], [0.0, 1.0, 1.0]), ([PI, -PI, PI], [1.0, 0.0, 0.0])):
        modes = rg.analyse(rhombus, q).modes
        assert len(modes) == 2
        for expected in (ALONG, others):
            assert min(np.abs(mode - expected).max() for mode in modes) < 1e-12


# --------------------------------------------------------------------------- free fall, 5 s


def pendulum_of(name: str) -> tuple[float, float]:
    """(m1 l1²/3 + m2 l1² + m3 l3²/3) and (m1 l1/2 + m2 l1 + m3 l3/2) 9.81; 1 kg each."""
    l1 = l3 = {"rhombus": 1.0, "parallelogram": 2.0}[name]
    return l1**2 / 3 + l1**2 + l3**2 / 3, (l1 / 2 + l1 + l3 / 2) * 9.81


@pytest.mark.slow
@pytest.mark.parametrize("method", ("bridge", "projection"))
@pytest.mark.parametrize("name", ("rhombus", "parallelogram"))
def test_five_seconds_agree_with_the_exact_solution(
    free_fall: Callable[..., rg.Trajectory], name: str, method: str
) -> None:
    """RK4, h = 0.001 s, from y = 0.2 at rest: within 1e-10 rad of the elliptic solution throughout."""
    traj = free_fall(name, method)
    y, rate, _ = pendulum(traj.t, 0.2, 0.0, *pendulum_of(name))
    assert traj.t[-1] == 5.0
    assert np.abs(traj.q - np.outer(y, ALONG)).max() < 1e-10
    assert np.abs(traj.v - np.outer(rate, ALONG)).max() < 1e-9
    assert traj.closure_error().max() < 1e-12
    # it swings between 0.2 and −π − 0.2, so each turn passes q1 = 0 and q1 = −π twice
    passes = sum(int(np.sum(np.diff(np.sign(y - a)) != 0)) for a in (0.0, -PI))
    assert len(traj.crossings) == passes >= 6


def test_the_exact_solution_is_a_free_fall() -> None:
    """Independent of Jacobi's functions: energy ½ A ẏ² + B sin y and the turning point −π − 0.2."""
    for name in ("rhombus", "parallelogram"):
        A, B = pendulum_of(name)
        t = np.linspace(0.0, 5.0, 20001)
        y, rate, acceleration = pendulum(t, 0.2, 0.0, A, B)
        np.testing.assert_allclose(0.5 * A * rate**2 + B * np.sin(y), B * np.sin(0.2), atol=1e-12 * B)
        np.testing.assert_allclose(A * acceleration, -B * np.cos(y), atol=1e-12 * B)
        assert y.max() == pytest.approx(0.2, abs=1e-12)
        assert y.min() == pytest.approx(-PI - 0.2, abs=1e-6)  # sampled every 0.25 ms
