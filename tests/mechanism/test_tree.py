"""The spanning tree: what Pinocchio computes, seen through views that stay valid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.mechanism.tree.tree import Tree, require_depth_first

Array = NDArray[np.float64]
SPATIAL = ("tripod", "spherical loop", "seven hinges", "humanoid")


def random_configuration(tree: Tree, rng: np.random.Generator) -> Array:
    return tree.integrate(pin.neutral(tree.model), rng.uniform(-2.0, 2.0, tree.nv))


@pytest.mark.parametrize("name", SPATIAL)
def test_views_follow_every_call(spatial: dict[str, rg.Mechanism], name: str) -> None:
    """Against a fresh `pin.Data` each time: nothing of the last call is left in a view."""
    rng = np.random.default_rng(0)
    model = spatial[name].model
    joint, placement = model.njoints - 1, pin.SE3(pin.exp3(np.ones(3)), np.array([0.1, 0.2, 0.3]))
    tree = Tree(model, [(joint, placement), (0, placement)])
    R, p, J, v, a = tree.R, tree.p, tree.J, tree.v, tree.a
    for _ in range(3):
        q = random_configuration(tree, rng)
        speed, rate = rng.uniform(-1, 1, tree.nv), rng.uniform(-1, 1, tree.nv)
        tree.jacobians(q)
        tau = tree.rnea(q, speed, rate)
        data = model.createData()
        np.testing.assert_array_equal(pin.computeJointJacobians(model, data, q).T, J)
        np.testing.assert_array_equal(pin.rnea(model, data, q, speed, rate), tau)
        for i in range(model.njoints):
            np.testing.assert_array_equal(data.oMi[i].rotation, R[i])
            np.testing.assert_array_equal(data.oMi[i].translation, p[i])
            np.testing.assert_array_equal(data.v[i].vector, v[i])
            np.testing.assert_array_equal(data.a_gf[i].vector, a[i])
        followed = data.oMi[joint] * placement
        np.testing.assert_allclose(tree.frame_p[0], followed.translation, atol=1e-15)
        np.testing.assert_allclose(tree.frame_R[0], followed.rotation, atol=1e-15)
        np.testing.assert_array_equal(tree.frame_p[1], placement.translation)


@pytest.mark.parametrize("name", SPATIAL)
def test_forces_inertia_and_energies_agree(
    spatial: dict[str, rg.Mechanism], derivative: Callable[..., Array], name: str
) -> None:
    """τ = M a + C, T = ½ vᵀ M v, and τ(q, 0, 0) = ∂U/∂q."""
    tree = spatial[name].tree
    rng = np.random.default_rng(1)
    q = random_configuration(tree, rng)
    v, a = rng.uniform(-1, 1, tree.nv), rng.uniform(-1, 1, tree.nv)
    M = tree.crba(q).copy()
    np.testing.assert_allclose(M, M.T, atol=1e-14 * np.abs(M).max())
    assert np.linalg.eigvalsh(M)[0] > 0.0
    total, bias = tree.rnea(q, v, a).copy(), tree.rnea(q, v, tree.zero).copy()
    np.testing.assert_allclose(M @ a, total - bias, atol=1e-13 * np.abs(total).max())
    kinetic, _ = tree.energies(q, v)
    assert kinetic == pytest.approx(0.5 * v @ M @ v, rel=1e-13)
    weight = tree.rnea(q, tree.zero, tree.zero).copy()
    power = derivative(lambda s: np.array(tree.energies(tree.integrate(q, s * v), v)[1]))
    # U of some 1e3 J differenced over 1e-2: ε U/h = 2e-11
    assert weight @ v == pytest.approx(float(power), abs=1e-10)


@pytest.mark.parametrize("name", ("rhombus", *SPATIAL))
def test_integrate_and_difference_are_inverse(
    mechanisms: dict[str, rg.Mechanism], derivative: Callable[..., Array], name: str
) -> None:
    tree = mechanisms[name].tree
    rng = np.random.default_rng(2)
    q, dv, e = random_configuration(tree, rng), rng.uniform(-1, 1, tree.nv), rng.uniform(-1, 1, tree.nv)
    moved = tree.integrate(q, dv)
    np.testing.assert_allclose(tree.difference(q, moved), dv, atol=1e-14)
    # ∂(q1 ⊖ q0)/∂q1 along e
    rate = derivative(lambda s: tree.difference(q, tree.integrate(moved, s * e)))
    np.testing.assert_allclose(tree.difference_rate(q, moved) @ e, rate, atol=1e-11)
    # ∂(q ⊕ dv)/∂dv along e, as a velocity at q ⊕ dv
    rate = derivative(lambda s: tree.difference(moved, tree.integrate(q, dv + s * e)))
    np.testing.assert_allclose(tree.integrate_rate(q, dv) @ e, rate, atol=1e-11)


def test_user_model_is_never_written_to(spatial: dict[str, rg.Mechanism]) -> None:
    model = spatial["humanoid"].model
    before = model.copy()
    tree = Tree(model, [(1, pin.SE3.Identity())])
    tree.jacobians(pin.neutral(model))
    assert model == before
    assert model.nframes == before.nframes


def test_a_tree_of_one_joint() -> None:
    """A pendulum: Pinocchio gives (6,), not (6, 1), for its joint Jacobian. A swing of a slender
    rod: ÿ = −(3/2) (g/l) cos y from the horizontal, y = q1."""
    model = pin.Model()
    linkages.add_link(model, 0, 0.0, "q1", 2.0)
    mech = rg.Mechanism.from_pinocchio(model)
    assert (mech.nv, mech.m, mech.nc) == (1, 1, 0)
    assert mech.tree.J.shape == (1, 6)
    traj = rg.simulate(mech, [0.4], duration=0.01, step=0.01, record=("a",))
    assert traj.a is not None
    assert traj.a[0, 0] == pytest.approx(-1.5 * 9.81 / 2.0 * np.cos(0.4), rel=1e-13)


def siblings_first() -> pin.Model:
    """Joint c hangs on a, but b, a's sibling, was added between them."""
    model = pin.Model()
    body = pin.Inertia(1.0, np.array([0.3, 0.2, 0.1]), np.eye(3))
    at = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
    for name, parent in (("a", 0), ("b", 0), ("c", 1)):
        joint = model.addJoint(parent, pin.JointModelRZ(), at, name)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return model


def test_depth_first_order_is_required_because_crba_needs_it() -> None:
    """The columns of M are RNEA's answers to unit accelerations; crba gives others here."""
    model = siblings_first()
    data = model.createData()
    q, zero = np.array([0.3, 0.5, 0.7]), np.zeros(3)
    bias = pin.rnea(model, data, q, zero, zero).copy()
    M = np.array([pin.rnea(model, data, q, zero, e) - bias for e in np.eye(3)])
    assert np.abs(pin.crba(model, model.createData(), q) - M).max() > 0.1
    with pytest.raises(rg.ModelError, match=r"'c' is out of depth-first order.*'b'.*whole subtree"):
        require_depth_first(model)
    with pytest.raises(rg.ModelError, match="'c' is out of depth-first order"):
        rg.Mechanism.from_pinocchio(model)


def test_depth_first_models_pass(mechanisms: dict[str, rg.Mechanism]) -> None:
    for mechanism in mechanisms.values():
        require_depth_first(mechanism.model)
    require_depth_first(pin.Model())
    require_depth_first(pin.buildSampleModelManipulator())


def test_gravity_that_turns_is_refused() -> None:
    """It has no potential, and where the ground's origin is would matter."""
    model = rg.load("rhombus").model.copy()
    model.gravity.angular = np.array([0.1, 0.0, 0.0])
    with pytest.raises(rg.ModelError, match="gravity"):
        rg.Mechanism.from_pinocchio(model)
