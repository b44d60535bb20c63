"""φ, K and k: their meaning, against finite differences, and against the paper's (5) and (6)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import add_link
from robust_gcp.mechanism.constraint.closures import Closure, closure_frames
from robust_gcp.mechanism.constraint.constraint import ImplicitConstraint
from robust_gcp.mechanism.tree.tree import Tree

Array = NDArray[np.float64]
LENGTHS = {  # of the shipped models, as their URDF files say: l0, l1, l2, l3 in m
    "rhombus": (1.0, 1.0, 1.0, 1.0),
    "parallelogram": (1.0, 2.0, 1.0, 2.0),
    "crank_rocker": (4.0, 1.0, 3.5, 3.0),
    "change_point": (4.0, 2.0, 3.0, 3.0),
    "kite": (2.0, 2.0, 1.0, 1.0),
}
KINDS: dict[str, Closure] = {
    "3d": rg.PointClosure("first", "second"),
    "6d": rg.FrameClosure("first", "second"),
    "revolute": rg.RevoluteClosure("first", "second"),
    "revolute, oblique axis": rg.RevoluteClosure("first", "second", axis=(1.0, -2.0, 0.5)),
    "prismatic": rg.PrismaticClosure("first", "second"),
    "prismatic, oblique axis": rg.PrismaticClosure("first", "second", axis=(1.0, -2.0, 0.5)),
}


class Constraint:
    """φ, K and k of closures on any tree, all rows, whether or not a mechanism comes of it."""

    def __init__(self, model: pin.Model, closures: list[Closure]) -> None:
        self.tree = Tree(model, closure_frames(model, closures))
        self.rows = ImplicitConstraint(self.tree, closures)

    def phi(self, q: Array) -> Array:
        self.tree.jacobians(q)
        return self.rows.residual()

    def K(self, q: Array) -> Array:
        self.phi(q)
        return self.rows.jacobian()

    def k(self, q: Array, v: Array) -> Array:
        self.phi(q)
        self.tree.rnea(q, v, self.tree.zero)
        return self.rows.bias()


def random_tree(rng: np.random.Generator) -> pin.Model:
    """Joints of every kind that a tree may hold, bodies and branches at random, depth first."""
    kinds = [
        pin.JointModelFreeFlyer(),
        pin.JointModelSpherical(),
        pin.JointModelRX(),
        pin.JointModelRUBZ(),  # (cos, sin)
        pin.JointModelPY(),
        pin.JointModelRevoluteUnaligned(np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)),
        pin.JointModelPlanar(),
        pin.JointModelSphericalZYX(),
        pin.JointModelTranslation(),
    ]
    model = pin.Model()
    for name, i in enumerate(rng.permutation(len(kinds))):
        # any joint between the last one and the root keeps the order depth first
        line = list(model.supports[model.njoints - 1])
        parent = int(rng.choice(line))
        placement = pin.SE3(pin.exp3(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
        joint = model.addJoint(parent, kinds[i], placement, f"joint{name}")
        body = pin.Inertia(1.0, rng.uniform(-0.3, 0.3, 3), 0.1 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return model


def with_frames(model: pin.Model, joints: tuple[int, int], rng: np.random.Generator) -> pin.Model:
    for name, joint in zip(("first", "second"), joints, strict=True):
        placement = pin.SE3(pin.exp3(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
        model.addFrame(pin.Frame(name, int(joint), placement, pin.FrameType.OP_FRAME))
    return model


def random_constraint(kind: str, seed: int) -> tuple[Constraint, Array, Array]:
    """A closure between two random joints of a random tree, at a random configuration: loops open."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng)
    ends = rng.choice(model.njoints, size=2, replace=False)  # 0, the ground, among them
    constraint = Constraint(with_frames(model, (ends[0], ends[1]), rng), [KINDS[kind]])
    q = constraint.tree.integrate(pin.neutral(model), rng.uniform(-2, 2, model.nv))
    return constraint, q, rng.uniform(-1, 1, model.nv)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_against_finite_differences(kind: str, seed: int, derivative: Callable[..., Array]) -> None:
    """K dv = dφ(q ⊕ s dv)/ds for every unit dv, off the closed manifold."""
    constraint, q, _ = random_constraint(kind, seed)
    tree = constraint.tree
    assert np.abs(constraint.phi(q)).max() > 0.1  # open
    columns = [derivative(lambda s, e=e: constraint.phi(tree.integrate(q, s * e))) for e in np.eye(tree.nv)]
    # φ is some metres: rounding 1e-15 · 5 / h, h = 1e-2
    np.testing.assert_allclose(constraint.K(q), np.array(columns).T, atol=2e-12)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", KINDS)
def test_bias_against_finite_differences(kind: str, seed: int, derivative: Callable[..., Array]) -> None:
    """k = −d/ds K(q ⊕ s v) v: along an exponential the velocity v is constant, so only K changes."""
    constraint, q, v = random_constraint(kind, seed)
    rate = derivative(lambda s: constraint.K(constraint.tree.integrate(q, s * v)) @ v)
    scale = max(1.0, np.abs(rate).max())
    np.testing.assert_allclose(constraint.k(q, v), -rate, atol=1e-11 * scale)


@pytest.mark.parametrize("name", ("tripod", "spherical loop", "seven hinges", "humanoid"))
def test_mechanisms_in_space(
    spatial: dict[str, rg.Mechanism],
    closed_states: Callable[..., list[tuple[Array, Array]]],
    derivative: Callable[..., Array],
    name: str,
) -> None:
    """K and k through the public interface, closed and open, several closures at once."""
    mech = spatial[name]
    rng = np.random.default_rng(5)
    q_closed, v_closed = closed_states(mech, 1)[0]
    q_open = mech.tree.integrate(mech.home, rng.uniform(-2, 2, mech.nv))
    assert np.abs(mech.phi(q_closed)).max() < 1e-12
    assert np.abs(mech.phi(q_open)).max() > 0.1
    for q, v in ((q_closed, v_closed), (q_open, rng.uniform(-1, 1, mech.nv))):
        w = rng.uniform(-1, 1, mech.nv)
        along = derivative(lambda s, q=q, w=w: mech.phi(mech.tree.integrate(q, s * w)))
        np.testing.assert_allclose(mech.K(q) @ w, along, atol=1e-11)
        rate = derivative(lambda s, q=q, v=v: mech.K(mech.tree.integrate(q, s * v)) @ v)
        np.testing.assert_allclose(mech.k(q, v), -rate, atol=1e-11 * max(1.0, np.abs(rate).max()))


@pytest.mark.parametrize("name", LENGTHS)
def test_four_bars_against_the_paper(name: str) -> None:
    """φ, K (5) and k (6) of docs/method.md, differentiated by hand, at open configurations."""
    mech, (l0, l1, l2, l3) = rg.load(name), LENGTHS[name]
    rng = np.random.default_rng(6)
    for _ in range(20):
        q, v = rng.uniform(-7, 7, 3), rng.uniform(-2, 2, 3)
        (q1, q12, q3), (v1, v12, v3) = (q[0], q[0] + q[1], q[2]), (v[0], v[0] + v[1], v[2])
        s1, s12, s3 = np.sin((q1, q12, q3))
        c1, c12, c3 = np.cos((q1, q12, q3))
        phi = [l1 * c1 + l2 * c12 - l0 - l3 * c3, l1 * s1 + l2 * s12 - l3 * s3]
        K = [
            [-l1 * s1 - l2 * s12, -l2 * s12, l3 * s3],
            [l1 * c1 + l2 * c12, l2 * c12, -l3 * c3],
        ]
        k = [
            l1 * c1 * v1**2 + l2 * c12 * v12**2 - l3 * c3 * v3**2,
            l1 * s1 * v1**2 + l2 * s12 * v12**2 - l3 * s3 * v3**2,
        ]
        np.testing.assert_allclose(mech.phi(q), phi, atol=1e-14 * (l0 + l1 + l2 + l3))
        np.testing.assert_allclose(mech.K(q), K, atol=1e-14 * (l0 + l1 + l2 + l3))
        np.testing.assert_allclose(mech.k(q, v), k, atol=1e-13 * (l0 + l1 + l2 + l3))


def test_bias_does_not_know_gravity() -> None:
    """RNEA's accelerations contain −gravity; it must cancel, also between a body and the ground."""
    model = with_frames(random_tree(np.random.default_rng(7)), (3, 0), np.random.default_rng(8))
    rng = np.random.default_rng(9)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1, 1, model.nv))
    v = rng.uniform(-1, 1, model.nv)
    heavy = model.copy()
    heavy.gravity.linear = np.array([30.0, -50.0, 70.0])
    for kind in KINDS.values():
        expected = Constraint(model, [kind]).k(q, v)
        np.testing.assert_allclose(Constraint(heavy, [kind]).k(q, v), expected, atol=1e-12)


# --------------------------------------------------------------------------- meaning of the rows


def two_frames(relative: pin.SE3) -> tuple[pin.Model, Array]:
    """A free body whose frame `first` stands at `relative`, seen from `second` on the ground."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    ground = pin.SE3(pin.exp3(np.array([0.4, -0.3, 0.2])), np.array([1.0, 2.0, 3.0]))
    model.addFrame(pin.Frame("first", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("second", 0, ground, pin.FrameType.OP_FRAME))
    return model, np.asarray(pin.SE3ToXYZQUAT(ground * relative))


def test_rows_of_each_kind() -> None:
    model, q = two_frames(pin.SE3.Identity())
    for kind, count, lengths in (("3d", 3, 3), ("6d", 6, 3), ("revolute", 5, 3)):
        constraint = Constraint(model, [KINDS[kind]])
        assert constraint.phi(q).shape == (count,)
        assert constraint.rows.is_length.tolist() == [True] * lengths + [False] * (count - lengths)
        assert constraint.rows.labels == ["first – second"] * count
        assert np.linalg.matrix_rank(constraint.K(q)) == count
        np.testing.assert_allclose(constraint.phi(q), 0.0, atol=1e-15)


def test_point_rows_are_the_distance_in_world_axes() -> None:
    """φ = p₁ − p₂: frame 1 minus frame 2; of a slide, what of it is across the axis, in frame 2."""
    offset = np.array([0.1, -0.2, 0.3])
    model, q = two_frames(pin.SE3(pin.exp3(np.array([0.5, 0.6, 0.7])), offset))
    ground = model.frames[model.getFrameId("second")].placement.rotation
    for kind in KINDS.values():
        phi = Constraint(model, [kind]).phi(q)
        if isinstance(kind, rg.PrismaticClosure):
            axis = np.array(kind.axis) / np.linalg.norm(kind.axis)
            lost = np.linalg.norm(offset - axis * (axis @ offset))
            assert np.linalg.norm(phi[:2]) == pytest.approx(lost, abs=1e-15)
        else:
            np.testing.assert_allclose(phi[:3], ground @ offset, atol=1e-15)


@pytest.mark.parametrize("angle", (1e-9, 0.3, -2.0, 3.0))
def test_frame_rows_are_sine_times_axis(angle: float) -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    model, q = two_frames(pin.SE3(pin.exp3(angle * axis), np.zeros(3)))
    phi = Constraint(model, [KINDS["6d"]]).phi(q)
    np.testing.assert_allclose(phi[3:], np.sin(angle) * axis, atol=1e-15)


def test_hinge_rows_leave_the_hinge_free_and_see_every_tilt() -> None:
    axis = np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25)
    closure = KINDS["revolute, oblique axis"]
    for angle in (0.7, -2.9):
        model, q = two_frames(pin.SE3(pin.exp3(angle * axis), np.zeros(3)))
        constraint = Constraint(model, [closure])
        np.testing.assert_allclose(constraint.phi(q)[3:], 0.0, atol=1e-15)
        turning = np.concatenate([np.zeros(3), axis])  # the free-flyer's velocity, in its own axes
        np.testing.assert_allclose(constraint.K(q) @ turning, 0.0, atol=1e-15)
    for tilt in np.cross(axis, np.eye(3)):
        model, q = two_frames(pin.SE3(pin.exp3(0.4 * tilt / np.linalg.norm(tilt)), np.zeros(3)))
        # u on two directions normal to the axis in the other frame: length sin(tilt)
        norm = np.linalg.norm(Constraint(model, [closure]).phi(q)[3:])
        assert norm == pytest.approx(np.sin(0.4), abs=1e-15)


def test_exchanging_the_frames_turns_the_sign() -> None:
    """Of position and frame rows; the hinge's rotation rows change their meaning with the frames."""
    rng = np.random.default_rng(10)
    model = with_frames(random_tree(rng), (4, 7), rng)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1, 1, model.nv))
    v = rng.uniform(-1, 1, model.nv)
    for cls in (rg.PointClosure, rg.FrameClosure):
        one, other = Constraint(model, [cls("first", "second")]), Constraint(model, [cls("second", "first")])
        np.testing.assert_allclose(one.phi(q), -other.phi(q), atol=1e-14)
        np.testing.assert_allclose(one.K(q), -other.K(q), atol=1e-14)
        np.testing.assert_allclose(one.k(q, v), -other.k(q, v), atol=1e-12)


def test_selected_and_scaled_rows() -> None:
    constraint, q, v = random_constraint("revolute", 3)
    tree, closures = constraint.tree, [KINDS["revolute"]]
    rng = np.random.default_rng(11)
    rows = np.array([4, 0, 2])
    row_scale, column_scale = rng.uniform(0.5, 2.0, 3), rng.uniform(0.5, 2.0, tree.nv)
    part = ImplicitConstraint(tree, closures, rows, row_scale, column_scale)
    phi, K, k = constraint.phi(q), constraint.K(q), constraint.k(q, v)
    np.testing.assert_allclose(part.residual(), phi[rows] / row_scale, atol=1e-15)
    np.testing.assert_allclose(part.jacobian(), K[rows] / row_scale[:, None] * column_scale, atol=1e-14)
    np.testing.assert_allclose(part.bias(), k[rows] / row_scale, atol=1e-13)


# --------------------------------------------------------------------------- rows that never move


def planar_four_bar(plane: pin.SE3, apart: float = 0.0) -> pin.Model:
    """A rhombus in the y–z plane of `plane`; the rocker's tip is shifted out of it by `apart` m."""
    model = pin.Model()
    crank = add_link(model, 0, 0.0, "q1", 1.0)
    add_link(model, crank, 1.0, "q2", 1.0)
    rocker = add_link(model, 0, 1.0, "q3", 1.0)
    for joint in (crank, rocker):
        model.jointPlacements[joint] = plane * model.jointPlacements[joint]
    shifted = pin.SE3(np.eye(3), np.array([apart, 1.0, 0.0]))
    model.addFrame(pin.Frame("shifted_tip", rocker, shifted, pin.FrameType.OP_FRAME))
    return model


@pytest.mark.parametrize("kind", (rg.PointClosure, lambda a, b: rg.RevoluteClosure(a, b, (1.0, 0.0, 0.0))))
def test_rows_out_of_the_plane_are_dropped_once(kind: Callable[..., Closure]) -> None:
    """A planar loop in a coordinate plane: of 3 or 5 rows the two in the plane are left."""
    model = planar_four_bar(pin.SE3.Identity())
    closure = kind("q2_tip", "q3_tip")
    mech = rg.Mechanism.from_pinocchio(model, [closure], ["q1"])
    assert mech.implicit.rows.tolist() == [1, 2]
    assert mech.nc == 2
    q, v = np.array([0.4, 0.8, -0.3]), np.array([1.0, -2.0, 0.5])
    full = Constraint(model, [closure])
    np.testing.assert_array_equal(mech.phi(q), full.phi(q)[1:3])
    np.testing.assert_array_equal(mech.K(q), full.K(q)[1:3])
    np.testing.assert_array_equal(mech.k(q, v), full.k(q, v)[1:3])
    np.testing.assert_array_equal(np.delete(full.K(q), (1, 2), axis=0), 0.0)


def test_rows_of_a_tilted_plane_are_kept() -> None:
    """There each row moves; that they are redundant is for the analysis to say."""
    plane = pin.SE3(pin.exp3(np.array([0.3, 0.4, 0.5])), np.array([0.1, 0.2, 0.3]))
    closure = rg.PointClosure("q2_tip", "q3_tip")
    mech = rg.Mechanism.from_pinocchio(planar_four_bar(plane), [closure], ["q1"])
    assert mech.nc == 3
    assert np.linalg.matrix_rank(mech.K([0.4, 0.8, -0.3])) == 2


@pytest.mark.parametrize("kind", (rg.PointClosure, rg.FrameClosure))
def test_a_gap_that_no_joint_closes_is_refused(kind: Callable[..., Closure]) -> None:
    """The tips lie in parallel planes 0.01 m apart: φ has a constant row that is not zero."""
    model = planar_four_bar(pin.SE3.Identity(), apart=-0.01)
    with pytest.raises(rg.ModelError, match=r"q2_tip – shifted_tip.*0\.01 m apart.*shift or turn"):
        rg.Mechanism.from_pinocchio(model, [kind("q2_tip", "shifted_tip")], ["q1"])


def test_a_turn_that_no_joint_undoes_is_refused() -> None:
    """Hinge axes 0.1 rad off the plane's normal, in frames that only turn about it."""
    model = planar_four_bar(pin.SE3.Identity())
    rocker = model.getJointId("q3")
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.1, 0.0])), np.array([0.0, 1.0, 0.0]))
    model.addFrame(pin.Frame("turned_tip", rocker, turned, pin.FrameType.OP_FRAME))
    closure = rg.RevoluteClosure("q2_tip", "turned_tip", (1.0, 0.0, 0.0))
    with pytest.raises(rg.ModelError, match=r"q2_tip – turned_tip.*0\.0998 rad apart"):  # sin 0.1
        rg.Mechanism.from_pinocchio(model, [closure], ["q1"])
