"""Loop clusters: what belongs together does not depend on how the mechanism is described."""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.closed_form import FourBar

Array = np.ndarray


def four_bar_on(model: pin.Model, base: int, name: str, at: pin.SE3) -> rg.PointClosure:
    """A change-point four-bar (4, 2, 3, 3) on the body of joint `base`, its ground link along y of `at`."""
    inertia = linkages.rod
    crank = model.addJoint(base, pin.JointModelRX(), at, f"{name}_crank")
    model.appendBodyToJoint(crank, inertia(2.0), pin.SE3.Identity())
    coupler = linkages.add_link(model, crank, 2.0, f"{name}_coupler", 3.0)
    pivot = at * pin.SE3(np.eye(3), np.array([0.0, 4.0, 0.0]))
    rocker = model.addJoint(base, pin.JointModelRX(), pivot, f"{name}_rocker")
    model.appendBodyToJoint(rocker, inertia(3.0), pin.SE3.Identity())
    for joint, end in ((rocker, f"{name}_rocker_tip"),):
        tip = pin.SE3(np.eye(3), np.array([0.0, 3.0, 0.0]))
        model.addFrame(pin.Frame(end, joint, tip, pin.FrameType.OP_FRAME))
    assert coupler
    return rg.PointClosure(f"{name}_coupler_tip", f"{name}_rocker_tip")


def carried(count: int = 2) -> rg.Mechanism:
    """Four-bars on a free body that a chain of a hinge and a slide carries."""
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, linkages.rod(1.0), pin.SE3.Identity())
    body = model.addJoint(arm, pin.JointModelPY(), pin.SE3.Random(), "slide")
    model.appendBodyToJoint(body, linkages.rod(1.0), pin.SE3.Identity())
    closures = [four_bar_on(model, body, f"leg{i}", pin.SE3.Random()) for i in range(count)]
    free = ["arm", "slide", *(f"leg{i}_crank" for i in range(count))]
    start = FourBar(4.0, 2.0, 3.0, 3.0, 1).evaluate(2.0)[0]
    return rg.Mechanism.from_pinocchio(model, closures, free, home=[0.3, 0.2, *(list(start) * count)])


def test_uncoupled_loops_are_clusters_of_their_own_and_other_joints_are_free():
    pin.seed(3)
    mechanism = carried(2)
    assert [cluster.joints for cluster in mechanism.clusters] == [
        ("leg0_crank", "leg0_coupler", "leg0_rocker"),
        ("leg1_crank", "leg1_coupler", "leg1_rocker"),
    ]
    assert [cluster.m for cluster in mechanism.clusters] == [1, 1]
    assert [cluster.independent for cluster in mechanism.clusters] == [("leg0_crank",), ("leg1_crank",)]
    assert [cluster.inputs.tolist() for cluster in mechanism.clusters] == [[2], [3]]
    in_loops = np.concatenate([cluster.iv for cluster in mechanism.clusters])
    assert sorted(set(range(mechanism.nv)) - set(in_loops.tolist())) == [0, 1]


def test_sizes_add_up_on_every_model(mechanisms: dict[str, rg.Mechanism]):
    for mechanism in mechanisms.values():
        parts = mechanism.clusters
        everything = np.concatenate([c.iv for c in parts]) if parts else np.zeros(0)
        assert len(set(everything.tolist())) == len(everything)
        assert sum(len(c.closures) for c in parts) == len(mechanism.closures)
        free = mechanism.nv - len(everything)
        assert sum(c.m for c in parts) + free == mechanism.m
        for part in parts:
            np.testing.assert_array_equal(part.iv[part.chosen], mechanism.iv_independent[part.inputs])


def test_columns_of_carrying_joints_vanish_off_the_constraint():
    """In the ancestor's frame φ depends on the cluster's joints alone, whatever carries it."""
    pin.seed(3)
    mechanism = carried(1)
    cluster = mechanism.clusters[0]
    rng = np.random.default_rng(0)
    q = mechanism.home + rng.uniform(-0.3, 0.3, mechanism.nq)  # loops open
    world = mechanism.K(q)
    assert np.abs(world[:, :2]).max() > 0.1  # in world axes the carrying joints seem to matter
    here = cluster.loops.phi(q[cluster.iq])
    moved = q.copy()
    moved[:2] += 1.0
    assert np.array_equal(cluster.loops.phi(moved[cluster.iq]), here)
    singular_values = np.linalg.svd(cluster.loops.K(q[cluster.iq]), compute_uv=False)
    assert np.sum(singular_values > 1e-12) == 2  # a planar loop, in whatever axes
    # the same gap, seen from another body: equal lengths
    assert np.linalg.norm(here) == pytest.approx(np.linalg.norm(mechanism.phi(q)), rel=1e-12)


def test_on_the_constraint_the_cluster_and_the_mechanism_have_the_same_motions():
    pin.seed(3)
    mechanism = carried(2)
    G = mechanism.G(mechanism.home)
    for cluster in mechanism.clusters:
        K = cluster.loops.K(mechanism.home[cluster.iq])
        assert np.abs(K @ G[np.ix_(cluster.iv, cluster.inputs)]).max() < 1e-14


@pytest.mark.parametrize("cut", [0, 1, 2, 3])
def test_groups_do_not_depend_on_the_cut(cut: int):
    """A ring of four hinges, cut at any of them: one cluster of the other three."""
    model = pin.Model()
    lengths = np.roll([4.0, 2.0, 3.0, 3.0], -cut)
    joint = 0
    for i in range(3):
        before = lengths[i - 1] if i else 0.0
        joint = linkages.add_link(model, joint, before, f"q{i}", lengths[i])
    end = pin.Frame("end", joint, pin.SE3(np.eye(3), np.array([0, lengths[2], 0])), pin.FrameType.OP_FRAME)
    model.addFrame(end)
    base = pin.SE3(np.eye(3), np.array([0.0, lengths[3], 0.0]))
    model.addFrame(pin.Frame("base", 0, base, pin.FrameType.OP_FRAME))
    mechanism = rg.Mechanism.from_pinocchio(model, [rg.PointClosure("end", "base")], ["q0"])
    (cluster,) = mechanism.clusters
    assert cluster.joints == ("q0", "q1", "q2")
    assert cluster.loops.length == 4.0


@pytest.mark.parametrize("shift", [0.0, 1.0, 1e3])
def test_the_length_does_not_count_where_the_mechanism_stands(shift: float):
    model = pin.Model()
    closure = four_bar_on(model, 0, "leg", pin.SE3(np.eye(3), np.array([shift, 2 * shift, -shift])))
    mechanism = rg.Mechanism.from_pinocchio(model, [closure], ["leg_crank"])
    assert mechanism.length == pytest.approx(4.0, rel=1e-12)
    assert mechanism.clusters[0].loops.length == pytest.approx(4.0, rel=1e-12)


def test_rate_of_the_jacobian(mechanisms: dict[str, rg.Mechanism], derivative: Callable[..., Array]):
    """K̇ along v against differences of K along q ⊕ s v, and K̇ v = −k."""
    rng = np.random.default_rng(1)
    for mechanism in mechanisms.values():
        v = rng.uniform(-1.0, 1.0, mechanism.nv)
        q = mechanism.tree.integrate(mechanism.home, rng.uniform(-0.3, 0.3, mechanism.nv))
        rate = mechanism.K_rate(q, v)
        slope = derivative(lambda s: mechanism.K(mechanism.tree.integrate(q, s * v)))  # noqa: B023
        np.testing.assert_allclose(rate, slope, atol=1e-10 * max(1.0, np.abs(slope).max(initial=0.0)))
        np.testing.assert_allclose(
            rate @ v, -mechanism.k(q, v), atol=1e-12 * (1.0 + np.abs(rate).max(initial=0))
        )


def test_the_chosen_components_are_found_where_a_cluster_is_not_in_the_order_of_the_tree():
    model = pin.Model()
    parents = {"a": 0, "b": 1, "c": 2, "d": 1}
    for name, parent in parents.items():
        at = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
        joint = model.addJoint(parent, pin.JointModelRZ(), at, name)
        model.appendBodyToJoint(joint, linkages.rod(1.0), pin.SE3.Identity())
    ties = [rg.CouplingClosure("a", "d", 0.3), rg.CouplingClosure("c", "d", -2.0)]
    for independent in (["b", "a"], ["b", "c"], ["b", "d"]):
        mechanism = rg.Mechanism.from_pinocchio(model, ties, independent)
        (cluster,) = mechanism.clusters
        assert cluster.joints == ("a", "d", "c")  # b, which carries c, is in no loop
        assert cluster.iv[cluster.chosen] == mechanism.iv_independent[cluster.inputs]
