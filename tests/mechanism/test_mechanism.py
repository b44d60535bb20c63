"""A mechanism: sizes, units, assembling, lifting velocities, changing coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages

Array = NDArray[np.float64]
PI = np.pi
SPATIAL = ("tripod", "spherical loop", "seven hinges", "humanoid")


def test_sizes_and_names() -> None:
    mech = linkages.swinging_four_bar(4.0, 1.0, 3.5, 3.0, swing=0.3, y=1.0)
    assert (mech.nq, mech.nv, mech.nc, mech.m) == (4, 4, 2, 2)
    assert mech.joint_names == ("q0", "q1", "q2", "q3")
    assert mech.independent == ("q0", "q1")
    assert mech.dependent == ("q2", "q3")
    assert mech.closures == (rg.PointClosure("q2_tip", "q3_tip"),)
    assert mech.velocity_slice("q2") == slice(2, 3)
    assert all(word in repr(mech) for word in ("swinging_four_bar", "2 rows", "y = q0, q1"))


@pytest.mark.parametrize(
    ("name", "size"),
    [("tripod", (6, 9)), ("spherical loop", (1, 5)), ("seven hinges", (1, 6)), ("humanoid", (23, 9))],
)
def test_mobility_and_rows_in_space(
    spatial: dict[str, rg.Mechanism], name: str, size: tuple[int, int]
) -> None:
    """m = nv − nc, see the fixtures; nq exceeds nv by one for each quaternion."""
    mech = spatial[name]
    quaternions = 0 if name == "seven hinges" else 1
    assert (mech.m, mech.nc) == size
    assert mech.m + mech.nc == mech.nv == mech.nq - quaternions


def test_without_loops_every_joint_is_independent() -> None:
    model = pin.buildSampleModelManipulator()
    mech = rg.Mechanism.from_pinocchio(model)
    assert mech.independent == tuple(model.names)[1:]
    assert (mech.m, mech.nc) == (model.nv, 0)
    q = np.linspace(-1, 1, model.nq)
    assert mech.phi(q).shape == (0,)
    assert mech.K(q).shape == (0, model.nv)
    assert mech.k(q, q).shape == (0,)
    np.testing.assert_array_equal(mech.assemble(q), q)
    np.testing.assert_array_equal(mech.lift(q, 2.0 * q), 2.0 * q)


def test_users_model_is_never_written_to() -> None:
    """The whole way: building, assembling, analysing, simulating."""
    model = linkages.four_bar(1.0, 1.0, 1.0, 1.0).model.copy()
    before, frames = model.copy(), [f.name for f in model.frames]
    mech = rg.Mechanism.from_pinocchio(model, [rg.PointClosure("q2_tip", "q3_tip")], ["q1"])
    q = mech.assemble([0.2, -0.1, 0.1])
    rg.analyse(mech, q)
    rg.simulate(mech, q, duration=0.01, torque=[0.1, 0.0, 0.0], record=("a", "energy", "multipliers"))
    assert model == before
    assert [f.name for f in model.frames] == frames
    assert mech.model is not model


def test_units_of_length_do_not_matter() -> None:
    """In millimetres the dimensionless K is the same, and so is what counts as closed."""
    metres = linkages.four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    millimetres = linkages.four_bar(4000.0, 1000.0, 3500.0, 3000.0, y=1.0)
    q = np.array([0.3, 0.8, -0.4])
    np.testing.assert_allclose(millimetres.K(q), 1000.0 * metres.K(q), rtol=1e-12)
    np.testing.assert_allclose(millimetres.scaled(millimetres.K(q)), metres.scaled(metres.K(q)), rtol=1e-12)
    assert millimetres.length == 1000.0 * metres.length == 4000.0  # the ground link is longest
    assert millimetres.closure_residual(q) == pytest.approx(metres.closure_residual(q), rel=1e-12)
    assert metres.closure_residual(q) == pytest.approx(np.abs(metres.phi(q)).max() / 4.0)


# --------------------------------------------------------------------------- assembling


@pytest.mark.parametrize("name", ("crank_rocker", "change_point", *SPATIAL))
def test_assemble_closes_the_loops_and_holds_the_independent_joints(
    mechanisms: dict[str, rg.Mechanism], name: str
) -> None:
    mech = mechanisms[name]
    rng = np.random.default_rng(0)
    guess = mech.tree.integrate(mech.home, rng.uniform(-0.05, 0.05, mech.nv))
    assert mech.closure_residual(guess) > 1e-3
    q = mech.assemble(guess)
    assert np.abs(mech.phi(q)).max() <= 1e-12
    np.testing.assert_array_equal(q[mech.iq_independent], guess[mech.iq_independent])
    assert np.abs(mech.tree.difference(guess, q)).max() < 1.0  # the assembly near the guess


def test_assemble_can_hold_other_joints() -> None:
    mech = rg.load("crank_rocker")
    guess = mech.home + np.array([0.05, -0.1, 0.02])
    q = mech.assemble(guess, hold=["q3"])
    assert q[2] == guess[2]
    assert np.abs(mech.phi(q)).max() <= 1e-12
    free = mech.assemble(guess, hold=[])
    assert np.abs(mech.phi(free)).max() <= 1e-12
    assert np.linalg.norm(free - guess) <= np.linalg.norm(q - guess)  # more freedom, a nearer solution


@pytest.mark.parametrize("q", ([0.0, 0.0, 0.0], [PI, -PI, PI], [0.0, PI, PI]))
def test_assemble_at_a_singular_configuration(q: list[float]) -> None:
    """Typed to seven digits. φ = O(δ²) along a flat pose's second mode, so q may differ by √ε."""
    mech = rg.load("rhombus")
    found = mech.assemble(np.round(q, 7))
    assert np.abs(mech.phi(found)).max() <= 1e-12
    np.testing.assert_allclose(found, q, atol=1e-5)


def test_loops_that_cannot_close_are_reported_with_their_gap() -> None:
    """Crank-rocker 4, 1, 3.5, 3 with q3 held at −π/2: the rocker's tip is at (4, −3), 5 m away, and
    crank and coupler reach 4.5 m, so 0.5 m are left."""
    mech = rg.load("crank_rocker")
    with pytest.raises(
        rg.ClosureError, match=r"coupler_tip – rocker_tip is open by .*another guess"
    ) as caught:
        mech.assemble([-0.6, 0.0, -PI / 2], hold=["q3"])
    assert caught.value.loop == "coupler_tip – rocker_tip"
    # the gap's vector points along (4, −3)/5: its entries are 0.4 and −0.3 m, the larger is reported
    assert caught.value.residual == pytest.approx(0.4, abs=1e-6)


def ring(kind: Callable[..., object]) -> rg.Mechanism:
    """A parallelogram of four hinges in one chain, cut at the ground behind the fourth."""
    model = pin.Model()
    joint = 0
    for i in range(3):
        joint = linkages.add_link(model, joint, float(i > 0), f"q{i + 1}", 1.0)
    joint = linkages.add_link(model, joint, 1.0, "q4", 0.1)
    here = pin.SE3.Identity()
    model.addFrame(pin.Frame("end", joint, here, pin.FrameType.OP_FRAME))
    base = pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0]))
    model.addFrame(pin.Frame("base", 0, base, pin.FrameType.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, [kind("end", "base")], ["q1"])  # type: ignore[list-item]


def test_half_turned_frames_are_not_closed() -> None:
    """sin π = 0 closes the rotation rows too; the mechanism would be assembled upside down."""
    mech = ring(rg.FrameClosure)
    closed = mech.assemble([1.0, -1.0, -PI + 1.0, PI - 1.0])
    np.testing.assert_allclose(closed, [1.0, -1.0, -PI + 1.0, PI - 1.0], atol=1e-12)
    false = closed + np.array([0.0, 0.0, 0.0, PI])
    assert mech.closure_residual(false) < 1e-12
    turned = (mech.assemble(false) - closed) / (2.0 * PI)  # it turns the fourth joint, back or on
    np.testing.assert_allclose(turned, np.round(turned), atol=1e-11)
    with pytest.raises(rg.ClosureError, match="half a turn"):
        rg.simulate(mech, false, duration=0.01)


def test_half_turned_hinge_axes_are_not_closed() -> None:
    """A hinge about x may turn by any angle, but its axes must point the same way."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(joint, linkages.rod(1.0), pin.SE3.Identity())
    model.addFrame(pin.Frame("end", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("base", 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "other")
    model.appendBodyToJoint(joint, linkages.rod(1.0), pin.SE3.Identity())
    frame = pin.Frame("turning", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    model.addFrame(frame)
    closure = rg.FrameClosure("end", "turning")
    mech = rg.Mechanism.from_pinocchio(model, [closure], ["other"])
    about_x = pin.Quaternion(pin.exp3(np.array([2.5, 0.0, 0.0]))).coeffs()
    np.testing.assert_allclose(mech.assemble([*about_x, 2.5])[:4], about_x, atol=1e-12)
    flipped = pin.Quaternion(pin.exp3(np.array([0.0, PI, 0.0]))).coeffs()
    aligned = mech.assemble([*flipped, 0.0])
    np.testing.assert_allclose(np.abs(aligned[:4]), [0.0, 0.0, 0.0, 1.0], atol=1e-12)
    with pytest.raises(rg.ClosureError, match="half a turn"):
        rg.simulate(mech, [*flipped, 0.0], duration=0.01)


# --------------------------------------------------------------------------- velocities


@pytest.mark.parametrize("name", ("crank_rocker", "kite", *SPATIAL))
def test_lift_satisfies_the_constraint_and_keeps_the_given_rates(
    mechanisms: dict[str, rg.Mechanism], closed_states: Callable[..., list[tuple[Array, Array]]], name: str
) -> None:
    mech = mechanisms[name]
    rng = np.random.default_rng(1)
    for q, _ in closed_states(mech, 3):
        ydot = rng.uniform(-1, 1, mech.m)
        v = mech.lift(q, ydot)
        np.testing.assert_array_equal(v[mech.iv_independent], ydot)
        assert np.abs(mech.K(q) @ v).max() <= 1e-13 * np.abs(mech.K(q)).max() * max(1.0, np.abs(v).max())


@pytest.mark.parametrize("name", ("crank_rocker", "kite", *SPATIAL))
def test_the_explicit_constraint_satisfies_its_identities(
    mechanisms: dict[str, rg.Mechanism], closed_states: Callable[..., list[tuple[Array, Array]]], name: str
) -> None:
    """K G = 0 and K g = k; the independent rows of G are the identity, those of g zero."""
    mech = mechanisms[name]
    for q, v in closed_states(mech, 3):
        G, g, K, k = mech.G(q), mech.g(q, v), mech.K(q), mech.k(q, v)
        np.testing.assert_array_equal(G[mech.iv_independent], np.eye(mech.m))
        np.testing.assert_array_equal(g[mech.iv_independent], 0.0)
        size = np.abs(K).max()
        assert np.abs(K @ G).max() <= 1e-13 * size * np.abs(G).max()
        assert np.abs(K @ g - k).max() <= 1e-12 * max(1.0, size * np.abs(g).max())


def test_the_explicit_constraint_at_a_singular_configuration_points_to_the_modes() -> None:
    rhombus, q = rg.load("rhombus"), np.zeros(3)
    for call in (lambda: rhombus.lift(q, [1.0]), lambda: rhombus.G(q), lambda: rhombus.g(q, q)):
        with pytest.raises(rg.StateError, match=r"K_d is singular.*mode of analyse"):
            call()


# --------------------------------------------------------------------------- coordinates


def test_other_coordinates_leave_the_mechanism_as_it_is() -> None:
    mech = rg.load("crank_rocker")
    other = mech.with_independent(["q3"])
    assert (mech.independent, other.independent) == (("q1",), ("q3",))
    np.testing.assert_array_equal(other.home, mech.home)
    q, v = np.array([0.3, 0.8, -0.4]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(other.phi(q), mech.phi(q))
    np.testing.assert_array_equal(other.K(q), mech.K(q))
    np.testing.assert_array_equal(other.k(q, v), mech.k(q, v))
    assert other.name == mech.name == "crank_rocker"


def test_choices_leave_out_what_rests() -> None:
    """Mode b of the rhombus turns links 2 and 3 about the tip of a resting link 1."""
    choices = rg.load("rhombus").coordinate_choices([0.0, 1.0, 1.0])
    assert {names for _, names in choices} == {("q2",), ("q3",)}
    # dimensionless velocities: the columns are weighed by their size, q2 and q3 nearly alike
    assert all(0.5 < quality < 0.9 for quality, _ in choices)


def test_choices_offer_joints_of_one_number_only(spatial: dict[str, rg.Mechanism]) -> None:
    """The ball joint moves too, but three velocities cannot be one coordinate."""
    mech = spatial["spherical loop"]
    choices = mech.coordinate_choices(mech.home)
    assert {names for _, names in choices} <= {("crank",), ("elbow",), ("wrist",)}
    assert len(choices) >= 2


def test_automatic_choice_is_the_best_conditioned_one() -> None:
    """At home as given, or assembled first where its loops are open."""
    mech = rg.load("crank_rocker")
    unnamed = rg.Mechanism.from_pinocchio(mech.model, mech.closures, home=mech.home)
    auto = rg.Mechanism.from_pinocchio(mech.model, mech.closures, "auto", home=mech.home)
    assert unnamed.independent == auto.independent
    assert auto.independent == mech.coordinate_choices(mech.home)[0][1]
    opened = mech.home + np.array([0.0, 0.1, 0.0])
    auto = rg.Mechanism.from_pinocchio(mech.model, mech.closures, "auto", home=opened)
    assert auto.closure_residual(auto.home) < 1e-12
    assert auto.independent == mech.coordinate_choices(auto.home)[0][1]


@pytest.mark.parametrize("name", ("crank_rocker", "tripod", "seven hinges"))
def test_constraint_models_of_pinocchio_close_loops_too(
    mechanisms: dict[str, rg.Mechanism], name: str
) -> None:
    """Rigid and anchor models, points and frames: φ, K and k of the closures between named frames."""
    mech = mechanisms[name]
    model, rng = mech.model, np.random.default_rng(2)
    rigid, anchors = [], []
    for closure in mech.closures:
        ends = [model.frames[model.getFrameId(f)] for f in (closure.frame1, closure.frame2)]
        places = [p for end in ends for p in (end.parentJoint, end.placement)]
        point = isinstance(closure, rg.PointClosure)
        contact = pin.ContactType.CONTACT_3D if point else pin.ContactType.CONTACT_6D
        anchor = pin.PointAnchorConstraintModel if point else pin.FrameAnchorConstraintModel
        rigid.append(pin.RigidConstraintModel(contact, model, *places, pin.ReferenceFrame.LOCAL))
        anchors.append(anchor(model, *places))
    before = model.copy()
    q = mech.tree.integrate(mech.home, rng.uniform(-1, 1, mech.nv))
    v = rng.uniform(-1, 1, mech.nv)
    for constraints in (rigid, anchors):
        other = rg.Mechanism.from_pinocchio(model, constraints, mech.independent)
        np.testing.assert_allclose(other.phi(q), mech.phi(q), atol=1e-14)
        np.testing.assert_allclose(other.K(q), mech.K(q), atol=1e-14)
        np.testing.assert_allclose(other.k(q, v), mech.k(q, v), atol=1e-12)
    assert model == before


def test_velocities_are_refused_that_the_loops_do_not_let() -> None:
    """Two hinges in a row whose tip is pinned: K (2 × 2) is regular, nothing moves, and K G = 0 for no G."""
    model = pin.Model()
    first = linkages.add_link(model, 0, 0.0, "q1", 1.0)
    linkages.add_link(model, first, 1.0, "q2", 1.0)
    model.addFrame(pin.Frame("pin", 0, pin.SE3(np.eye(3), np.array([0.0, 1.0, 1.0])), pin.FrameType.OP_FRAME))
    mechanism = rg.Mechanism(model, [rg.PointClosure("q2_tip", "pin")], ["q1"], home=[0.0, 0.5 * np.pi])
    with pytest.raises(rg.StateError, match="q1"):
        mechanism.lift(mechanism.home, [1.0])
