"""Constraint forces of many states in the kernel: they balance, and are those of the reference."""

from __future__ import annotations

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.dynamics.equations import constraint_forces
from robust_gcp.kernel.dynamics.measures import reactions

from ..compiled import needs_kernel, some
from .test_random_floating import made

pytestmark = needs_kernel

SCENES = ("andrews", "bricard", "delta", "rhombus", "slider_crank", "stewart", "walker")


def states(mechanism: rg.Mechanism, seed: int) -> tuple[np.ndarray, ...]:
    """q and v along a motion, any torques, and the accelerations under these."""
    rng = np.random.default_rng(seed)
    run = rg.simulate(mechanism, duration=2e-3, step=2e-4)
    a, tau = [], []
    for q, v in zip(run.q, run.v, strict=True):
        M, tau_now = mechanism.tree.crba(q).copy(), rng.normal(size=mechanism.nv)
        G, g = mechanism.G(q), mechanism.g(q, v)
        force = tau_now - mechanism.tree.rnea(q, v, g)
        a.append(G @ np.linalg.solve(G.T @ M @ G, G.T @ force) + g)
        tau.append(tau_now)
    return run.q, run.v, np.array(a), np.array(tau)


@pytest.mark.parametrize("name", SCENES)
def test_those_of_shipped_scenes_balance(name: str) -> None:
    mechanism = rg.load(name)
    require_those(mechanism, *states(mechanism, 1))


@pytest.mark.parametrize("seed", some(range(40), 5))
def test_those_of_random_mechanisms_balance(seed: int) -> None:
    mechanism, _ = made(seed)
    require_those(mechanism, *states(mechanism, seed))


def require_those(
    mechanism: rg.Mechanism, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray
) -> None:
    found = reactions(mechanism, q, v, a, tau)
    assert found is not None
    for i in range(len(q)):
        wanted = constraint_forces(mechanism, q[i], v[i], a[i], tau[i])
        needed = mechanism.tree.rnea(q[i], v[i], a[i]) - tau[i]
        size = 1.0 + np.abs(needed).max()
        np.testing.assert_allclose(mechanism.K(q[i]).T @ found[i], needed, rtol=0.0, atol=1e-10 * size)
        np.testing.assert_allclose(found[i], wanted, rtol=0.0, atol=1e-9 * (1.0 + np.abs(wanted).max()))


def test_what_no_constraint_force_balances_is_no_number() -> None:
    """At the flat rhombus K loses a row, and a torque along what it leaves free has no λ."""
    mechanism, q, v = rg.load("rhombus"), np.zeros((1, 3)), np.zeros((1, 3))
    for along, free in ((0, False), (1, True)):
        tau = np.linalg.svd(mechanism.K(q[0]))[2][None, 2 * along]
        bias = mechanism.tree.rnea(q[0], v[0], v[0])
        found = reactions(mechanism, q, v, v, bias + tau)
        assert found is not None
        assert np.isnan(found).all() == free
