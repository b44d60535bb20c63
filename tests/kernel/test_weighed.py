"""Sums of λᵀ ∂(M a + C)/∂π in the kernel: beside Pinocchio's regressor, whatever the joints' axes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.dynamics.regressor import torque_regressor
from robust_gcp.kernel.dynamics.measures import weighed

pytestmark = pytest.mark.skipif(not rg.backends()["native"].available, reason="no compiled kernel")


def skew() -> rg.Mechanism:
    """A chain of joints whose axes are along none of their frames'."""
    model, rng, parent = pin.Model(), np.random.default_rng(4), 0
    along = [pin.exp3(rng.normal(size=3))[0] for _ in range(3)]
    kinds = [pin.JointModelFreeFlyer(), pin.JointModelSpherical()]
    kinds += [pin.JointModelRevoluteUnaligned(along[0]), pin.JointModelPrismaticUnaligned(along[1])]
    kinds += [pin.JointModelRevoluteUnaligned(along[2])]
    for i, kind in enumerate(kinds):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        parent = model.addJoint(parent, kind, place, f"j{i}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    home = pin.neutral(model)
    return rg.Mechanism.from_pinocchio(model, [], [f"j{i}" for i in range(5)], home)


@pytest.mark.parametrize("name", ["skew", "crank_rocker", "delta", "bricard", "stewart"])
def test_beside_the_regressor(name: str) -> None:
    """All ten parameters of each body and gravity, summed over five states."""
    mech, rng = skew() if name == "skew" else rg.load(name), np.random.default_rng(1)
    q = np.array([pin.integrate(mech.near, mech.home, rng.normal(size=mech.nv)) for _ in range(5)])
    v, a, weights = rng.normal(size=(3, 5, mech.nv))
    found = weighed(mech, q, v, a, weights)
    assert found is not None
    by_inertia, by_gravity = found
    regressor = torque_regressor(mech)
    wanted = sum(w @ regressor.matrix_at(*state) for w, *state in zip(weights, q, v, a, strict=True))
    np.testing.assert_allclose(
        by_inertia.ravel(), wanted[: by_inertia.size], atol=1e-12 * np.abs(wanted).max()
    )
    model = mech.near.copy()
    for k, axis in enumerate(np.eye(3)):
        model.gravity.linear = axis
        data = model.createData()
        weight = sum(
            w @ pin.computeGeneralizedGravity(model, data, x) for w, x in zip(weights, q, strict=True)
        )
        assert by_gravity[k] == pytest.approx(weight, abs=1e-12 * np.abs(wanted).max())
