"""Beside an isolated cone of the configuration space: followed to the accuracy promised, or refused."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages

APEX = np.array([0.0, 0.0, 0.0, np.pi])


def five_bar(home: np.ndarray) -> rg.Mechanism:
    """Cranks of 1, couplers of 1.4, pivots 2.8 apart: in line at the apex, 1 + 1.4 = 2.8 + 1 − 1.4."""
    model = pin.Model()
    left = linkages.add_link(model, 0, 0.0, "q1", 1.0)
    linkages.add_link(model, left, 1.0, "q2", 1.4)
    right = linkages.add_link(model, 0, 2.8, "q3", 1.0)
    linkages.add_link(model, right, 1.0, "q4", 1.4)
    return rg.Mechanism(model, [rg.PointClosure("q2_tip", "q4_tip")], ["q1", "q3"], home=home)


def beside(distance: float) -> tuple[rg.Mechanism, np.ndarray]:
    """The linkage on the cone at this distance from its apex, and the velocity 2 around the apex."""
    mechanism = five_bar(APEX)
    U, _, Vt = np.linalg.svd(mechanism.K(APEX))
    u, N = U[:, 1], Vt[1:].T

    def bend(a: np.ndarray, b: np.ndarray) -> float:
        return float(u @ (mechanism.k(APEX, a - b) - mechanism.k(APEX, a + b))) / 4.0

    values, vectors = np.linalg.eigh(np.array([[bend(a, b) for a in N.T] for b in N.T]))
    assert (np.sign(values) == [-1.0, 1.0, 1.0]).all()  # a cone, no crossing and no isolated point
    axes = N @ vectors / np.sqrt(np.abs(values))
    ruling = axes @ [1.0, np.cos(1.0), np.sin(1.0)]
    around = axes @ [0.0, -np.sin(1.0), np.cos(1.0)]
    q = APEX + distance * ruling / np.linalg.norm(ruling)
    for _ in range(20):
        q = q - np.linalg.lstsq(mechanism.K(q), mechanism.phi(q), rcond=None)[0]
    free = np.linalg.svd(mechanism.K(q))[2][2:].T
    v = free @ (free.T @ around)
    return five_bar(q), 2.0 * v / np.linalg.norm(v)


@pytest.mark.parametrize("distance", [1e-2, 1e-3])
def test_the_way_past_a_cone_is_the_way_back(distance: float) -> None:
    """Without friction a motion goes back as it came: through the pass, to 2e-9, energy to 1e-7 of 4 J."""
    mechanism, v = beside(distance)
    back = rg.simulate(mechanism, v0=-v, duration=0.005, step=1e-3)
    run = rg.simulate(mechanism, back.q[-1], -back.v[-1], duration=0.01, step=1e-3)
    assert np.abs(run.q[5] - mechanism.home).max() < 2e-9
    assert np.abs(run.energy_error()).max() < 1e-7
    assert run.closure_error().max() < 1e-12
    assert run.stats.refined_steps > 0
    assert not run.crossings


def test_a_pass_that_rounding_spoils_is_refused_by_that_name() -> None:
    mechanism, v = beside(1e-4)
    with pytest.raises(rg.NotCertifiedError, match="isolated cone"):
        rg.simulate(mechanism, v0=v, duration=0.005, step=1e-3)


def test_a_start_at_the_apex_is_refused() -> None:
    mechanism, v = beside(1e-6)
    with pytest.raises(rg.NotCertifiedError, match="signature 1, 2"):
        rg.simulate(mechanism, v0=v, duration=0.005, step=1e-3)
