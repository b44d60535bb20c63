"""Robust GCP as published, Eq. (7): the projection keeps the mode at a singularity, to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.closed_form import FourBar
from robust_gcp.maps.projection import PROJECTION_THRESHOLD, ProjectionMap
from robust_gcp.maps.regular_path import RegularPath

Array = NDArray[np.float64]
PI = np.pi
ALONG = np.array([1.0, -1.0, 1.0])


def projection(
    mech: rg.Mechanism, q: Array, v: Array, threshold: float = PROJECTION_THRESHOLD
) -> ProjectionMap:
    path = RegularPath(mech, mech.select_rows(mech.K(q)))
    start = path.settle(np.array(q), np.array(q)[mech.iq_independent], v[mech.iv_independent])
    assert start is not None
    return ProjectionMap(path, start, threshold)


@pytest.mark.parametrize("name", ("rhombus", "parallelogram"))
@pytest.mark.parametrize("singular", (0.0, PI, -PI))
@pytest.mark.parametrize("ydot", (3.0, 0.0, -1.0))
def test_exactly_at_the_singularity(name: str, singular: float, ydot: float) -> None:
    """G = (1, −1, 1) from the kernel of K and the last G; a rest there makes no difference, as the
    direction lives in G, not in the velocity. g is left open by the paper and 0 here."""
    mech = rg.load(name)
    y0 = singular + 0.01
    explicit = projection(mech, y0 * ALONG, ydot * ALONG)
    point = explicit.point_at(np.array([singular]), np.array([ydot]))
    np.testing.assert_allclose(point.q, singular * ALONG, atol=1e-14)
    np.testing.assert_allclose(point.G[:, 0], ALONG, atol=1e-13)
    np.testing.assert_array_equal(point.g, 0.0)
    assert np.abs(mech.K(point.q) @ point.G).max() < 1e-13
    beyond = explicit.point_at(np.array([singular - 0.01]), np.array([ydot]))
    np.testing.assert_allclose(beyond.q, (singular - 0.01) * ALONG, atol=1e-13)


def test_alpha_is_the_projection_of_the_last_G() -> None:
    """Eq. (7) written out at (0, 0, 0) with the last G a little off: G = N Nᵀ G⁻, row 1 made 1."""
    mech = rg.load("rhombus")
    explicit = projection(mech, 0.01 * ALONG, ALONG)
    start = explicit.anchor
    start.G = np.array([[1.0], [-0.9], [1.2]])
    N = np.array([[-1, 1, -1] / np.sqrt(3), [0, 1, 1] / np.sqrt(2)]).T  # docs/method.md
    # in dimensionless velocities, in which the library takes ranks and projections
    Q, _ = np.linalg.qr(N / mech.column_scale[:, None])
    scaled = start.G / mech.column_scale[:, None]
    expected = mech.column_scale[:, None] * (Q @ (Q.T @ scaled))
    point = explicit.point_at(np.zeros(1), np.ones(1))
    # the wrong G predicts q wrong by 0.01 · 0.2, which turns ker K by the square of it
    np.testing.assert_allclose(point.G, expected / expected[0], atol=(0.01 * 0.2) ** 2)
    assert abs(mech.K(point.q)[1] @ point.G[:, 0]) < (0.01 * 0.2) ** 2


def test_away_from_singularities_it_is_classical_gcp() -> None:
    """The crank-rocker has none: not one SVD, and the motion of method "classical" to the last bit."""
    mech = rg.load("crank_rocker")
    one, other = (
        rg.simulate(mech, duration=0.1, step=0.01, method=m, backend="python")
        for m in ("projection", "classical")
    )
    np.testing.assert_array_equal(one.q, other.q)
    assert one.stats.svds == 0


def test_starting_at_rest_beside_the_singularity() -> None:
    """Released 1e-3 rad from q1 = 0 it falls through, where Eq. (7) divides by the speed as printed."""
    mech = rg.load("rhombus")
    traj = rg.simulate(mech, 1e-3 * ALONG, duration=0.1, step=0.01, method="projection")
    assert traj.q[-1, 0] < -0.05
    np.testing.assert_allclose(traj.q, np.outer(traj.q[:, 0], ALONG), atol=1e-12)
    assert [c.kind for c in traj.crossings] == ["projected"]
    np.testing.assert_allclose(traj.crossings[0].q, 0.0, atol=1e-9)


@pytest.mark.parametrize("assembly", (1, -1))
def test_on_curved_modes_it_errs_with_the_distance(assembly: int) -> None:
    """docs/method.md: a first-order patch. The last G is kept and g is 0 where γ'' is not.

    A flat pose is its own mirror image, so γ is odd about it: at the distance s, G = G* + c s² and
    γ'' = 2 c s. From the last point at 20 s, G errs by c (20² − 1) s² less what the projection
    takes off, and g by 2 c s ẏ²."""
    bar = FourBar(4.0, 2.0, 3.0, 3.0, assembly)
    mech = linkages.four_bar(4.0, 2.0, 3.0, 3.0, y=2.5, assembly=assembly)
    errors = []
    for threshold in (1e-2, 1e-3):
        path = RegularPath(mech, mech.select_rows(mech.K(mech.home)))
        s = threshold  # conditioning vanishes like the distance; find where it is just below
        while path.worst_conditioning(bar.evaluate(PI - s)[0]) > 0.9 * threshold:
            s *= 0.9
        q, G, _ = bar.evaluate(PI - 20.0 * s)
        explicit = projection(mech, q, G, threshold)
        point = explicit.point_at(np.array([PI - s]), np.ones(1))
        assert explicit.counters.svds == 1  # it was projected
        exact = bar.evaluate(PI - s, near=point.q)
        np.testing.assert_array_equal(point.g, 0.0)
        errors.append((np.abs(point.G[:, 0] - exact[1]).max() / s**2, np.abs(exact[2]).max() / s))
    (G_error, g_error), nearer = errors
    assert G_error == pytest.approx(nearer[0], rel=0.2)
    assert g_error == pytest.approx(nearer[1], rel=0.01)
    assert 0.05 < G_error / ((20**2 - 1) * 0.5 * g_error) < 1.0


@pytest.mark.parametrize("rates", ((1.0, 0.0), (0.5, -2.0), (0.0, 0.0)))
def test_any_mobility(rates: tuple[float, float]) -> None:
    """A rhombus on a swinging base, m = 2: at its crossing both columns of G are kept, (1, 0, 0, 0)
    and (0, 1, −1, 1), and the independent rows are the identity."""
    mech = linkages.swinging_four_bar(1.0, 1.0, 1.0, 1.0, swing=0.3, y=0.01)
    ydot = np.array(rates)
    q = np.array([0.3, 0.01, -0.01, 0.01])
    exact = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 1.0]]).T
    explicit = projection(mech, q, exact @ ydot)
    point = explicit.point_at(np.array([0.3, 0.0]), ydot)
    np.testing.assert_allclose(point.G, exact, atol=1e-12)
    np.testing.assert_allclose(point.q, [0.3, 0.0, 0.0, 0.0], atol=1e-13)
    assert np.abs(mech.K(point.q) @ point.G).max() < 1e-12


def test_a_threshold_of_the_callers_choice() -> None:
    """0.05 projects farther from the crossing; on straight modes that does no harm."""
    mech, q0 = rg.load("rhombus"), [0.2, -0.2, 0.2]
    runs = [
        rg.simulate(mech, q0, duration=0.4, step=4e-3, method="projection", threshold=t) for t in (1e-3, 0.05)
    ]
    assert runs[1].stats.svds > runs[0].stats.svds
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-12)


def test_redundant_rows_are_no_singularity(spatial: dict[str, rg.Mechanism]) -> None:
    """m and rank K belong together: mechanisms in space, regular all along, are never projected."""
    for name in ("tripod", "spherical loop", "seven hinges"):
        traj = rg.simulate(spatial[name], duration=0.01, step=5e-3, method="projection")
        assert traj.stats.svds == 0
        assert traj.closure_error().max() < 1e-12


def test_projection_and_bridge_agree_where_both_are_exact(
    free_fall: Callable[..., rg.Trajectory],
) -> None:
    one, other = (free_fall("rhombus", m, 16e-3, 1.6) for m in ("projection", "bridge"))
    # g of the bridge beside the crossing: ε/zone³ ẏ², zone 0.05, over half a second
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)
    assert one.stats.bridges_built == 0


def test_a_motion_that_the_patch_throws_off_stops_with_what_was_simulated() -> None:
    """Beside its toggle the two-coordinate linkage's G grows without bound."""
    with pytest.raises(rg.SimulationError) as stop:
        rg.simulate(rg.load("five_bar"), method="projection", duration=3.0)
    assert stop.value.trajectory is not None
    assert np.all(np.isfinite(stop.value.trajectory.q))
