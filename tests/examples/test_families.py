"""Six-bars, lamps, parallel legs and spatial loops: closed at home, with the mobility they are known for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples import six_bars, spatial


@pytest.mark.parametrize(
    ("make", "m", "clusters"),
    [
        (six_bars.watt, 1, 1),
        (six_bars.stephenson, 1, 1),
        (six_bars.joined_by_dyad, 2, 1),
        (six_bars.lamp, 2, 2),
        (lambda: six_bars.lamp((0.3, 0.2, 0.1)), 3, 3),
        (lambda: six_bars.lamp((0.3, 0.2), parallel=True), 2, 2),
        (six_bars.parallel_legs, 1, 1),
        (spatial.bennett, 1, 1),
        (spatial.spherical_four_bar, 1, 1),
        (spatial.sarrus, 1, 1),
        (spatial.rod_between_cranks, 1, 1),
    ],
)
def test_families_close_and_move(make: Callable[[], rg.Mechanism], m: int, clusters: int) -> None:
    mechanism = make()
    assert mechanism.closure_residual(mechanism.home) < 1e-14
    assert (mechanism.m, len(mechanism.clusters)) == (m, clusters)
    assert rg.analyse(mechanism, mechanism.home).local_dof == m
    v0 = mechanism.lift(mechanism.home, np.ones(m))
    run = rg.simulate(mechanism, v0=v0, duration=0.02, step=2e-3)
    assert run.closure_error().max() < 1e-13


def test_bennett_turns_fully() -> None:
    """tan(θ1/2) tan(θ2/2) = sin((β + α)/2) / sin((β − α)/2), for a whole turn of the crank."""
    alpha, beta = 0.5, 1.1
    linkage = spatial.bennett(1.0, (alpha, beta))
    run = rg.simulate(linkage, v0=linkage.lift(linkage.home, [12.0]), duration=0.7, step=1e-3)
    assert abs(run.q[-1, 0]) > 2.0 * np.pi
    ratio = np.sin(0.5 * (beta + alpha)) / np.sin(0.5 * (beta - alpha))
    second = 2.0 * np.arctan(ratio / np.tan(0.5))
    product = np.tan(0.5 * (1.0 + run.q[:, 0])) * np.tan(0.5 * (second + run.q[:, 1]))
    np.testing.assert_allclose(1.0 / product, 1.0 / ratio, atol=1e-9)


def test_sarrus_lifts_its_platform_straight() -> None:
    linkage = spatial.sarrus(0.8)
    run = rg.simulate(linkage, v0=linkage.lift(linkage.home, [2.0]), duration=0.3, step=1e-3)
    # both rods of a pair turn alike, the platform (after three hinges) does not turn at all
    np.testing.assert_allclose(run.q[:, 1], -2.0 * run.q[:, 0], atol=1e-10)
    np.testing.assert_allclose(run.q[:, :3].sum(axis=1), 0.0, atol=1e-10)
    (crossing,) = run.crossings
    height = 0.8 / 2.0  # of a knee over the foot: sin of the rod's angle
    assert abs(crossing.q[0]) == pytest.approx(np.arcsin(height), abs=1e-10)


def test_a_spherical_linkage_meets_its_change_point_where_the_axes_lie_in_a_plane() -> None:
    linkage = spatial.spherical_four_bar(angle=2.6)
    run = rg.simulate(linkage, v0=linkage.lift(linkage.home, [3.0]), duration=0.5, step=1e-3)
    (crossing,) = run.crossings
    assert crossing.q[0] == pytest.approx(np.pi - 2.6, abs=1e-10)
    assert crossing.kind == "transversal"


def test_a_lamp_by_its_points_is_a_row_of_parallelograms() -> None:
    lamp = six_bars.lamp((0.3, 0.25))
    run = rg.simulate(lamp, v0=lamp.lift(lamp.home, [-2.0, -2.2]), duration=0.2, step=1e-3)
    names = run.mechanism.joint_names
    arm, turn = (run.q[:, names.index(name)] for name in ("p1@P1", "s1@S1"))
    np.testing.assert_allclose(arm + turn, 0.0, atol=1e-12)  # the plate keeps level
    assert [crossing.cluster for crossing in run.crossings] == [0, 1]
