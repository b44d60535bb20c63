"""Classical GCP, Eq. (4): its identities where K_d is regular, and how it fails where it is not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.maps.classical import ClassicalMap, NewtonStart
from robust_gcp.maps.closed_form import FourBar, parallelogram_pendulum, pendulum
from robust_gcp.maps.regular_path import RegularPath

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]
PI = np.pi
ALONG = np.array([1.0, -1.0, 1.0])
LOOPS = ("crank_rocker", "change_point", "kite", "tripod", "spherical loop", "seven hinges", "humanoid")


def classical(mech: rg.Mechanism, q: Array, v: Array, newton_start: NewtonStart = "tangent") -> ClassicalMap:
    path = RegularPath(mech, mech.select_rows(mech.K(q)))
    start = path.settle(q.copy(), q[mech.iq_independent], v[mech.iv_independent])
    assert start is not None
    return ClassicalMap(path, start, newton_start)


# --------------------------------------------------------------------------- identities


@pytest.mark.parametrize("name", LOOPS)
def test_identities_at_random_configurations(
    mechanisms: dict[str, rg.Mechanism], closed_states: States, name: str
) -> None:
    """φ(γ(y)) = 0, K G = 0, K g = k, the independent rows of G are the identity and those of g zero."""
    mech = mechanisms[name]
    rng = np.random.default_rng(0)
    for q, v in closed_states(mech, 4):
        explicit = classical(mech, q, v)
        y = q[mech.iq_independent] + rng.uniform(-0.01, 0.01, mech.m)
        ydot = rng.uniform(-1, 1, mech.m)
        point = explicit.point_at(y, ydot)
        G, g = point.G, point.g
        K, k = mech.K(point.q), mech.k(point.q, G @ ydot)
        np.testing.assert_array_equal(point.q[mech.iq_independent], y)
        assert np.abs(mech.phi(point.q)).max() < 1e-13
        # solves are backward stable: residuals are roundings of |K| |G|, whatever the conditioning
        assert np.abs(K @ G).max() <= 1e-13 * np.abs(K).max() * np.abs(G).max()
        assert np.abs(K @ g - k).max() <= 1e-12 * max(1.0, np.abs(K).max() * np.abs(g).max())
        np.testing.assert_array_equal(G[mech.iv_independent], np.eye(mech.m))
        np.testing.assert_array_equal(g[mech.iv_independent], 0.0)
        multipliers = rng.uniform(-1, 1, mech.nc)
        constraint_force = K.T @ multipliers
        assert np.abs(G.T @ constraint_force).max() <= 1e-12 * np.abs(K).max() * np.abs(G).max()


@pytest.mark.parametrize("name", LOOPS)
def test_G_and_g_are_the_derivatives_of_the_motion(
    mechanisms: dict[str, rg.Mechanism],
    closed_states: States,
    derivative: Callable[..., Array],
    name: str,
) -> None:
    """Along y + s ẏ: q̇ = G ẏ as a tangent, and v̇ = g because ÿ = 0."""
    mech = mechanisms[name]
    q, v = closed_states(mech, 1)[0]
    explicit = classical(mech, q, v)
    start, ydot = explicit.anchor, v[mech.iv_independent]

    def at(s: float) -> tuple[Array, Array]:
        explicit.anchor = start
        point = explicit.point_at(start.y + s * ydot, ydot)
        return mech.tree.difference(start.q, point.q), point.G @ ydot

    here = explicit.point_at(start.y, ydot)
    h = 2e-3  # γ turns over some tenths here: (h/0.1)⁸ is below rounding, ε/h = 1e-13 of it is left
    scale = max(1.0, np.abs(here.g).max())
    np.testing.assert_allclose(derivative(lambda s: at(s)[0], h), here.G @ ydot, atol=1e-9 * scale)
    np.testing.assert_allclose(derivative(lambda s: at(s)[1], h), here.g, atol=1e-8 * scale)


@pytest.mark.parametrize("lengths", ((4.0, 1.0, 3.5, 3.0), (4.0, 2.0, 3.0, 3.0)))
def test_agrees_with_the_closed_form(lengths: tuple[float, float, float, float]) -> None:
    """γ, G and γ'' of the four-bar in closed form, along half a turn; both Newton starts."""
    name = {1.0: "crank_rocker", 2.0: "change_point"}[lengths[1]]
    bar, mech = FourBar(*lengths), rg.load(name)
    for newton_start in ("tangent", "previous"):
        q, G, second = bar.evaluate(0.5)
        explicit = classical(mech, q, 2.0 * G, newton_start)  # type: ignore[arg-type]
        for y in np.arange(0.5, 2.5, 0.02):
            q, G, second = bar.evaluate(y, near=explicit.anchor.q)
            point = explicit.point_at(np.array([y]), np.array([2.0]))
            np.testing.assert_allclose(point.q, q, atol=1e-12)
            np.testing.assert_allclose(point.G[:, 0], G, atol=1e-12)
            np.testing.assert_allclose(point.g, 4.0 * second, atol=1e-11)


def test_evaluations_may_come_in_any_order() -> None:
    """As the stages of RK4 and the rejected steps of adaptive solvers do."""
    bar, mech = FourBar(4.0, 1.0, 3.5, 3.0), rg.load("crank_rocker")
    explicit = classical(mech, *bar.evaluate(1.0)[:2])
    for y in (1.05, 0.95, 1.0, 1.1, 1.0):
        point = explicit.point_at(np.array([y]), np.ones(1))
        np.testing.assert_allclose(point.q, bar.evaluate(y)[0], atol=1e-13)


# --------------------------------------------------------------------------- failures, as published


def test_started_from_the_previous_value_it_locks_in_the_folded_mode(
    free_fall: Callable[..., rg.Trajectory],
) -> None:
    """The paper's Fig. 4: at q1 = −π, which free fall meets at 0.9503 s, q2 and q3 freeze at π and
    −π, the folded mode (c), and link 1 swings with link 2 alone; the first crossing is passed."""
    traj = free_fall("rhombus", "classical", 1e-3, 1.5)
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    y, _, _ = pendulum(traj.t, 0.2, 0.0, A, B)
    before, after = y > -PI + 0.01, traj.q[:, 0] < -PI - 0.01
    right = traj.t < 0.9503
    assert np.any(y[right] < 0.0)
    np.testing.assert_allclose(traj.q[right & before], np.outer(y, ALONG)[right & before], atol=1e-9)
    assert np.sum(after) > 100
    np.testing.assert_allclose(traj.q[after, 1], PI, atol=1e-12)
    np.testing.assert_allclose(traj.q[after, 2], -PI, atol=1e-12)
    assert np.abs(traj.v[after, 1:]).max() < 1e-9
    assert np.abs(traj.v[after, 0]).max() > 1.0
    # closed loops all the way, and yet another motion: φ = 0 cannot tell
    assert traj.closure_error().max() < 1e-12
    assert np.abs(traj.q - np.outer(y, ALONG)).max() > 0.1
    assert traj.crossings == []
    tangent = rg.analyse(traj.mechanism, traj.q[-1]).modes[0]
    np.testing.assert_allclose(tangent, [1.0, 0.0, 0.0], atol=1e-9)


def test_started_from_the_previous_value_the_parallelogram_changes_its_mode(
    free_fall: Callable[..., rg.Trajectory],
) -> None:
    """l0 = l2 ≠ l1 = l3: behind q1 = −π (at 1.344 s) lies the antiparallelogram, not a folded mode."""
    traj = free_fall("parallelogram", "classical", 1e-3, 1.5)
    A, B = parallelogram_pendulum(2.0, 2.0, 1.0, 1.0, 1.0)
    y, _, _ = pendulum(traj.t, 0.2, 0.0, A, B)
    np.testing.assert_allclose(traj.q[traj.t < 1.34], np.outer(y, ALONG)[traj.t < 1.34], atol=1e-8)
    end = traj.q[-1]
    assert end[0] < -PI
    other = FourBar(1.0, 2.0, 1.0, 2.0, -1).evaluate(end[0], near=end)[0]
    np.testing.assert_allclose(end, other, atol=1e-9)
    assert np.abs(end - end[0] * ALONG).max() > 0.01


def test_started_from_the_tangent_it_keeps_the_mode() -> None:
    """docs/method.md: branch loss is cured by the prediction. On this mode G is constant and g = 0,
    so that no digits are lost either; it warns all the same."""
    with pytest.warns(rg.SingularityWarning, match=r"singular configuration.*method=\"bridge\""):
        traj = rg.simulate(rg.load("rhombus"), [0.2, -0.2, 0.2], duration=1.5, step=2e-3, method="classical")
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    y, _, _ = pendulum(traj.t, 0.2, 0.0, A, B)
    assert y.min() < -PI
    # RK4's own error at h = 2 ms: 1.5e-10
    np.testing.assert_allclose(traj.q, np.outer(y, ALONG), atol=1e-9)


@pytest.mark.parametrize("distance", (1e-3, 1e-4, 1e-5))
def test_digits_are_lost_beside_a_crossing(distance: float) -> None:
    """docs/method.md: errors ε/δ in q, ε/δ² in G and ε/δ³ in g at the distance δ from a crossing of
    curved modes; the linkage 4, 2, 3, 3 at y = π, against its closed form, which loses none."""
    bar, mech = FourBar(4.0, 2.0, 3.0, 3.0), rg.load("change_point")
    y = PI - distance
    q, G, second = bar.evaluate(y)
    path = RegularPath(mech, mech.select_rows(mech.K(mech.home)))
    point = path.settle(q.copy(), np.array([y]), np.ones(1))
    assert point is not None
    eps = np.finfo(float).eps
    for value, exact, power in ((point.q, q, 1), (point.G[:, 0], G, 2), (point.g, second, 3)):
        assert np.abs(value - exact).max() <= 100.0 * eps / distance**power
    assert point.conditioning < 2.0 * distance


def test_the_warning_comes_once() -> None:
    """Two crossings, one warning: at q1 = 0 after 0.19 s and at q1 = −π after 0.95 s."""
    with pytest.warns(rg.SingularityWarning) as caught:
        rg.simulate(rg.load("rhombus"), duration=1.2, step=4e-3, method="classical")
    assert sum(w.category is rg.SingularityWarning for w in caught) == 1


def test_beyond_its_reach_it_stops() -> None:
    """The rocker 4, 1, 3.5, 3 turns back: as y it cannot go on, and classical GCP cannot say why."""
    bar, mech = FourBar(4.0, 1.0, 3.5, 3.0), rg.load("crank_rocker").with_independent(["q3"])
    q, G, _ = bar.evaluate(1.0)
    explicit = classical(mech, q, G)
    with pytest.raises(rg.BranchError, match=r"no solution at y = \[0\.\].*bridge"):
        explicit.point_at(np.zeros(1), np.ones(1))


def test_a_tree_needs_no_newton() -> None:
    mech = rg.Mechanism.from_pinocchio(rg.load("rhombus").model)
    for method in ("classical", "projection", "bridge"):
        traj = rg.simulate(mech, duration=0.02, step=0.01, method=method)
        assert traj.stats.newton_iterations == 0
        assert traj.crossings == []
