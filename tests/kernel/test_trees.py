"""Trees in the compiled kernel: the articulated-body elimination against Pinocchio's."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg

from ..compiled import needs_kernel

pytestmark = needs_kernel


def random_tree(joints: int) -> pin.Model:
    """Hinges and slides with rotors, each on the last body or one of those that carry it."""
    random, model, last = np.random.default_rng(joints), pin.Model(), 0
    for i in range(joints):
        place = pin.SE3(pin.exp3(random.normal(size=3)), 0.2 * random.normal(size=3))
        kind = pin.JointModelRevoluteUnaligned if random.random() < 0.8 else pin.JointModelPrismaticUnaligned
        axis = random.normal(size=3)
        parent = int(random.choice(list(model.supports[last])[-4:]))
        last = model.addJoint(parent, kind(axis / np.linalg.norm(axis)), place, f"j{i}")
        body = pin.Inertia(random.uniform(0.5, 2.0), 0.1 * random.normal(size=3), 0.05 * np.eye(3))
        model.appendBodyToJoint(last, body, pin.SE3.Identity())
    model.armature = random.uniform(0.0, 0.05, model.nv)
    return model


@pytest.mark.parametrize("joints", [1, 12, 90])
def test_trees_accelerate_as_by_the_articulated_body_algorithm(joints: int) -> None:
    model = random_tree(joints)
    random = np.random.default_rng(1)
    q, v = random.normal(size=model.nq), random.normal(size=model.nv)
    mechanism = rg.Mechanism.from_pinocchio(model, [])
    run = rg.simulate(mechanism, q, v, duration=2e-4, step=1e-4, record=("a",), backend="native")
    assert run.a is not None and run.stats.native_steps == 2
    data = model.createData()
    for here, moves, a in zip(run.q, run.v, run.a, strict=True):
        exact = pin.aba(model, data, here, moves, np.zeros(model.nv))
        assert np.abs(a - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("backend", ["python", "native"])
def test_a_joint_without_inertia_is_refused(backend: str) -> None:
    model = random_tree(3)
    model.inertias[3] = pin.Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    model.armature = np.zeros(model.nv)
    with pytest.raises(rg.RobustGcpError, match="inertia"):
        rg.simulate(rg.Mechanism.from_pinocchio(model, []), duration=1e-3, step=1e-3, backend=backend)
