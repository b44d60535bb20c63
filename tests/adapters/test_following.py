"""Knots whose points jump: they stay on their mode, on series as by the map."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.adapters import knot as knots
from robust_gcp.adapters.knot import Knot
from robust_gcp.adapters.mode_points import Followed
from robust_gcp.dynamics.modes.taylor_series import circles_of
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.examples.linkages import four_bar
from robust_gcp.simulation.derivatives import at_states

Array = NDArray[np.float64]


def followed(mech: rg.Mechanism, q: Array) -> Followed:
    return Followed(mech, initial_value_problem(mech, q, mech.lift(q, np.ones(mech.m))).explicit)


def jumps(mech: rg.Mechanism, follows: Followed, low: float, high: float, count: int) -> list[Array]:
    """Where jumps that are not refused lead: points are closed, and so are their velocities."""
    rng, places = np.random.default_rng(0), []
    for _ in range(count):
        try:
            point = follows.point_at(rng.uniform(low, high, 1), rng.normal(size=1))
        except rg.SimulationError:
            continue
        assert mech.closure_residual(point.q) < 1e-9
        assert np.abs(mech.K(point.q) @ point.G).max() < 1e-8
        places.append(point.q)
    return places


def test_a_rhombus_stays_a_parallelogram_however_it_jumps() -> None:
    mech = rg.load("rhombus")
    one, other = (followed(mech, y * np.array([1.0, -1.0, 1.0])) for y in (0.8, -2.5))
    for follows in (one, other, one):
        places = jumps(mech, follows, -3.6, 1.0, 60)
        assert len(places) == 60
        for q in places:
            np.testing.assert_allclose(q, q[0] * np.array([1.0, -1.0, 1.0]), rtol=0.0, atol=1e-9)
    assert len(circles_of(mech)[0]) > 4
    assert len(circles_of(mech)[0]) < 30


@pytest.mark.parametrize("gap", [0.0, 0.02, 0.2])
def test_the_other_mode_and_modes_that_pass_each_other_are_told_apart(gap: float) -> None:
    mech = four_bar(4.0, 2.0, 3.0, 3.0 + gap, y=np.pi + 0.6)
    places = jumps(mech, followed(mech, mech.home), np.pi - 0.6, np.pi + 0.6, 60)
    assert len(places) > (0 if gap else 59)
    for q in places:
        plain = initial_value_problem(mech, mech.home, mech.lift(mech.home, [-1.0])).explicit
        for share in np.linspace(0.0, 1.0, 101)[1:]:
            point = plain.point_at(mech.home[:1] + share * (q[:1] - mech.home[:1]), np.zeros(1))
        np.testing.assert_allclose(q, point.q, rtol=0.0, atol=1e-7)


def test_a_knot_has_the_steps_and_derivatives_of_the_reference_beside_flat(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mech, start = rg.load("rhombus"), np.array([0.5, -0.5, 0.5])
    tau, places = (
        np.array([2.0, 0.0, 0.0]),
        [np.array([y, -1.5]) for y in (0.3, 0.06, -0.02, 0.001, -0.4, 0.0)],
    )

    def told() -> list[tuple[Array, Array, Array]]:
        knot = Knot(mech, start, None, mech.iq_independent)
        return [(knot.step(x, tau, 1e-2), *knot.jacobians(x, tau, 1e-2)) for x in places]

    by_kernel = told()
    for module in (knots, at_states):
        monkeypatch.setattr(module, "derivation", lambda *of: None)
    for (end, A, B), (other, C, D) in zip(by_kernel, told(), strict=True):
        np.testing.assert_allclose(end, other, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(A, C, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(B, D, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("scene", ["rhombus", "five_bar"])
@pytest.mark.parametrize("y", [np.nan, np.inf, 1e9])
def test_what_no_knot_can_reach_is_refused(scene: str, y: float) -> None:
    mech = rg.load(scene)
    q = np.array([0.5, -0.5, 0.5]) if scene == "rhombus" else mech.home
    knot = Knot(mech, q, None, mech.iq_independent)
    x = np.ones(2 * mech.m)
    x[0] = y
    with pytest.raises(rg.BranchError, match="too far"):
        knot.step(x, np.zeros(mech.nv), 1e-2)
