"""Derivatives on and beside singular surfaces of clusters of two coordinates, by all that have them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.dynamics.modes.mode_rates import ModeRates, cluster_rates
from robust_gcp.dynamics.modes.taylor_series import circles_of
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.examples.six_bars import joined_by_dyad
from robust_gcp.simulation.derivatives import reverse_sweep

from ..compiled import needs_kernel

pytestmark = needs_kernel

WHAT = ("udot", "da_dy", "da_dv", "da_dtau", "G", "dv_dy")

FLAT = np.pi
"""Crank's angle at which one of the two four-bars lies flat, rad."""


def relative(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference over the largest entry."""
    return float(np.abs(one - other).max() / np.abs(other).max())


def modes_of(mech: rg.Mechanism) -> list[np.ndarray]:
    """Its tangents at home by the independent velocities, (nv, 2) each."""
    found = [np.array(mode).reshape(mech.nv, 2) for mode in rg.analyse(mech, mech.home).modes]
    return [T @ np.linalg.inv(T[mech.iv_independent]) for T in found]


def test_a_series_is_the_mode_wherever_it_serves() -> None:
    """Against the map where K is regular, in all of its rates; and it ends where it says.

    Rounding is ε/ρ² of third derivatives in the series, and ε/σ² of them in the map.
    """
    mech = joined_by_dyad((FLAT - 0.02, 2.5))
    known = circles_of(mech)
    start = initial_value_problem(mech, mech.home).start
    [(_, around)] = ModeRates(start, known).beside([mech.home])
    [rates] = cluster_rates(mech)
    rng, compared = np.random.default_rng(1), 0
    for _ in range(200):
        share, u = rng.uniform(-0.5, 0.5, 2), rng.normal(size=2)
        y = around.center + around.ways @ share
        assert around.covers(y)
        assert not around.covers(around.center + 2.1 * around.ways @ (share / np.abs(share).max() * 0.5))
        q = around.q + around.moved(y)
        assert mech.closure_residual(q) < 1e-12
        point = start.path.settle(q.copy(), y, u)
        if point is None or point.conditioning < 0.02:
            continue
        found, exact = around.rates_at(y, u), rates.rates_at(rates.rates.real(rates.closed(q)), u)
        for part in ("G", "g", "bend", "V_y", "A_y", "A_u"):
            one, other = getattr(found, part), getattr(exact, part)
            off = np.abs(one - other).max() / (1.0 + np.abs(other).max())
            assert off < (1e-10 if part == "A_y" else 1e-11), part
        compared += 1
    assert compared > 20


@pytest.mark.parametrize(
    "cranks",
    [
        *((FLAT - 0.02, 2.5), (FLAT - 1e-4, 2.5), (FLAT + 1e-5, 2.5), (FLAT, 2.5)),
        pytest.param((FLAT, FLAT), marks=pytest.mark.campaign),
    ],
)
def test_every_mode_beside_and_at_a_surface_is_the_references(cranks: tuple[float, float]) -> None:
    """Moving states tell their mode, also where series of others pass the same place."""
    mech, rng = joined_by_dyad(cranks), np.random.default_rng(0)
    told = modes_of(mech) or [mech.G(mech.home)]
    states = [(T @ rng.normal(size=2), rng.normal(size=mech.nv)) for T in told]
    for _ in range(2):  # once more, with the series of all modes known
        for v, tau in states:
            found = rg.derivatives(mech, mech.home, v, tau)
            with warnings.catch_warnings():
                warnings.simplefilter("error", rg.PerformanceWarning)
                again = rg.derivatives(mech, mech.home, v, tau)
                u = rg.forward_dynamics(mech, mech.home, v, tau)
            exact = reference.derivatives(joined_by_dyad(cranks), mech.home, v, tau)
            for part in WHAT:
                assert relative(getattr(found, part), getattr(exact, part)) < 2e-11, part
                assert relative(getattr(again, part), getattr(exact, part)) < 2e-11, part
            np.testing.assert_allclose(u, exact.udot, rtol=0, atol=1e-11 * np.abs(exact.udot).max())


def test_steps_across_a_surface_have_the_derivatives_of_their_differences() -> None:
    mech = joined_by_dyad((FLAT - 0.003, 2.5))
    u, h, apart = np.array([3.0, 0.5]), 2e-3, 1e-3
    y = mech.home[mech.iq_independent]
    tau = np.random.default_rng(2).normal(size=mech.nv)
    A, _ = rg.step_jacobians(mech, mech.home, mech.lift(mech.home, u), tau, step=h)
    q = mech.home

    [around] = circles_of(mech)[0]

    def end(change: np.ndarray) -> np.ndarray:
        at, fast = y + change[:2], u + change[2:]
        near, G = q.copy(), around.rates_at(at, fast).G
        near[mech.clusters[0].iq] = around.q + around.moved(at)
        after = rg.step(mech, near, G @ fast, tau, h)
        return np.concatenate([after.q[mech.iq_independent], after.v[mech.iv_independent]])

    for k in range(4):
        one = apart * np.eye(4)[k]
        ends = [end(s * one) for s in (-2.0, -1.0, 1.0, 2.0)]
        slope = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12.0 * apart)
        np.testing.assert_allclose(A[:, k], slope, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("cranks", "rates", "duration", "crossings"),
    [((2.8, 2.5), (3.0, 0.5), 0.2, 1), ((2.9, 2.95), (3.0, 3.0), 0.12, 2)],
)
def test_gradients_of_runs_across_surfaces_stay_in_the_kernel(
    cranks: tuple[float, float],
    rates: tuple[float, float],
    duration: float,
    crossings: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mech, w = joined_by_dyad(cranks), np.random.default_rng(0).normal(size=8)
    cost = rg.Cost(
        terminal=lambda q, v: float(w @ q + 0.3 * w @ v), terminal_slopes=lambda q, v: (w, 0.3 * w)
    )

    def run(u: np.ndarray) -> rg.Trajectory:
        return rg.simulate(mech, v0=mech.lift(mech.home, u), duration=duration, step=2e-3)

    through = run(np.array(rates))
    assert len(through.crossings) == crossings
    monkeypatch.setattr(
        reverse_sweep.ReverseSweep, "_by_reference", lambda *_: pytest.fail("left to the reference")
    )
    found, apart = rg.gradient(through, cost), 4e-3
    for k in range(2):
        ends = [run(rates + s * apart * np.eye(2)[k]) for s in (-2.0, -1.0, 1.0, 2.0)]
        values = [cost.terminal(end.q[-1], end.v[-1]) for end in ends]
        slope = (8.0 * (values[2] - values[1]) - (values[3] - values[0])) / (12.0 * apart)
        assert found.dv[k] == pytest.approx(slope, rel=0, abs=2e-8 * np.abs(found.dv).max())
