"""Closure errors and energies that the kernel measures along a motion: those of Pinocchio."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.kernel.dynamics.measures import measured

from ..compiled import needs_kernel

pytestmark = needs_kernel

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))
FILES = [
    "agility_cassie/cassie.xml",
    "drake_strandbeest/StrandbeestConstraints.urdf",
    "gepetto/digit_like_2legs",
    "grbda/tello_humanoid.urdf",
    "reachy_mini/reachy_mini.xml",
    "robotiq_2f85/2f85.xml",
    "toddlerbot/toddlerbot.xml",
]
FORCES = [
    rg.JointSpring("q1", 7.0, 0.3),
    rg.JointDamper("q2", 2.0),
    rg.JointTorque("q1", 3.0),
    rg.PointSpring("coupler", "ground", 11.0, 0.2),
]
EPS = float(np.finfo(float).eps)


def require_measured(mechanism: rg.Mechanism, count: int = 20) -> None:
    """At random states with loops that are wide open, and at home."""
    rng = np.random.default_rng(mechanism.nv)
    shifts = rng.uniform(-1.0, 1.0, (count, mechanism.nv))
    q = np.array([mechanism.tree.integrate(mechanism.home, dv) for dv in [0.0 * shifts[0], *shifts]])
    v = rng.normal(size=(len(q), mechanism.nv))
    found = measured(mechanism, q, v)
    assert found is not None
    reach = sum(float(np.linalg.norm(place.translation)) for place in mechanism.model.jointPlacements)
    left_open = [np.abs(mechanism.phi(one)).max(initial=0.0) for one in q]
    np.testing.assert_allclose(found[0], left_open, rtol=0, atol=20 * mechanism.nv * EPS * max(1.0, reach))
    parts = np.array([mechanism.energies(*state) for state in zip(q, v, strict=True)])
    weight = mechanism.model.gravity.linear, sum(body.mass for body in mechanism.model.inertias)
    size = np.abs(parts).sum(axis=1) + np.linalg.norm(weight[0]) * weight[1] * reach
    assert np.all(np.abs(found[1] - parts.sum(axis=1)) <= 20 * mechanism.nv * EPS * size)


@pytest.mark.parametrize("name", rg.model_names())
def test_shipped_models(name: str) -> None:
    require_measured(rg.load(name))


def test_spatial_mechanisms(spatial: dict[str, rg.Mechanism]) -> None:
    for mechanism in spatial.values():
        require_measured(mechanism)


def test_springs_between_points_and_at_joints() -> None:
    plain = rg.load("rhombus")
    require_measured(rg.Mechanism(plain.model, plain.closures, plain.independent, plain.home, forces=FORCES))


@pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")
@pytest.mark.parametrize("name", FILES)
def test_published_robots(name: str) -> None:
    """Couplings, balls, floating bases, redundant rows, rotors."""
    if not (ROBOTS / name).exists():
        pytest.skip("no folder of robots: name one in ROBUST_GCP_ROBOTS")
    require_measured(rg.load(ROBOTS / name))


def test_what_is_not_finite_stays_so() -> None:
    """A number that is none in one state does not touch the next."""
    mechanism = rg.load("rhombus")
    q, v = np.repeat(mechanism.home[None], 3, axis=0), np.ones((3, mechanism.nv))
    whole = measured(mechanism, q, v)
    q[1, 0], v[1, 0] = np.nan, np.inf
    found = measured(mechanism, q, v)
    assert whole is not None and found is not None
    for one, other in zip(found, whole, strict=True):
        assert np.isnan(one[1])
        np.testing.assert_array_equal(one[[0, 2]], other[[0, 2]])


def test_without_a_kernel_nothing_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = rg.load("rhombus")
    monkeypatch.setenv("ROBUST_GCP_NATIVE", "0")
    assert measured(mechanism, mechanism.home[None], np.zeros((1, mechanism.nv))) is None
