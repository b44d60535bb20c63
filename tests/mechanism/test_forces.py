"""Springs, dampers and drives: against potentials, closed forms and the energy balance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.mechanism.forces.forces import Force

Array = NDArray[np.float64]
PI = np.pi

SPRINGS: dict[str, tuple[Force, ...]] = {
    "tripod": (
        rg.PointSpring("leg0_tip1", "universe", 40.0, 0.3),
        rg.PointSpring("leg1_tip2", "leg2_tip1", 70.0, 0.1),
        rg.PointSpring("universe", "leg2_tip2", 20.0),
        rg.JointSpring("leg0z", 30.0, 0.2),
        rg.JointSpring("leg0z", 11.0, -0.4),
        rg.JointSpring("leg1x", 3.0),
    ),
    "humanoid": (
        rg.PointSpring("hand1", "foot1", 50.0, 0.5),
        rg.PointSpring("foot2", "hand2", 15.0, 0.2),
        rg.JointSpring("larm2_joint", 4.0, 0.1),
    ),
}


def with_forces(mech: rg.Mechanism, *forces: Force) -> rg.Mechanism:
    return rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home, mech.name, forces
    )


def slide(*forces: Force, mass: float = 2.0, gravity: float = 0.0) -> rg.Mechanism:
    """A mass on a slide along z, joint "z", frame "mass"."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    joint = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("mass", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    shifted = pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.0]))
    model.addFrame(pin.Frame("post", 0, shifted, pin.FrameType.OP_FRAME))
    return rg.Mechanism.from_pinocchio(model, forces=forces)


# --------------------------------------------------------------------------- τ, energy, power


@pytest.mark.parametrize("name", SPRINGS)
def test_springs_follow_their_potential(
    spatial: dict[str, rg.Mechanism], derivative: Callable[..., Array], name: str
) -> None:
    """τ = −∂U/∂q in every direction of the tangent space, free-flyers and spherical joints included."""
    mech = with_forces(spatial[name], *SPRINGS[name])
    applied, tree = mech.applied, mech.tree
    assert applied is not None
    assert not applied.works
    rng = np.random.default_rng(0)
    q = tree.integrate(mech.home, rng.uniform(-0.4, 0.4, mech.nv))
    tau = applied.tau(q, rng.uniform(-1, 1, mech.nv))
    assert np.abs(tau).max() > 1.0
    along = rng.uniform(-1, 1, mech.nv)
    slope = derivative(lambda s: np.array(applied.energy(tree.integrate(q, s * along))), 1e-3)
    assert tau @ along == pytest.approx(-float(slope), abs=1e-9 * np.abs(tau).max())


def test_dampers_take_what_their_speed_says(
    spatial: dict[str, rg.Mechanism], derivative: Callable[..., Array]
) -> None:
    """Power −c v² at a joint, −c (dl/dt)² between points, + τ v at a drive: all of τ·v here."""
    bare, c = spatial["tripod"], 7.0
    ends = ("leg1_tip2", "leg2_tip1")
    mech = with_forces(
        bare,
        rg.PointSpring(*ends, stiffness=0.0, damping=c),
        rg.JointDamper("leg0z", 3.0),
        rg.JointDamper("platform", 0.5),
        rg.JointTorque("leg1z", 11.0),
    )
    applied, model = mech.applied, mech.model
    assert applied is not None
    assert applied.works

    def distance(q: Array) -> Array:
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        one, two = (data.oMf[model.getFrameId(name)].translation for name in ends)
        return np.array(np.linalg.norm(one - two))

    rng = np.random.default_rng(1)
    q, v = mech.home, rng.uniform(-1, 1, mech.nv)
    tau, power = applied.torque_at(q, v)
    rate = float(derivative(lambda s: distance(mech.tree.integrate(q, s * v)), 1e-3))
    z, drive = (v[mech.velocity_slice(name)] for name in ("leg0z", "leg1z"))
    body = v[mech.velocity_slice("platform")]
    expected = -c * rate**2 - 3.0 * float(z @ z) - 0.5 * float(body @ body) + 11.0 * float(drive[0])
    assert power == pytest.approx(expected, rel=1e-9)
    assert tau @ v == pytest.approx(power, rel=1e-12)
    assert applied.energy(q) == 0.0


def test_a_spring_within_one_body_does_nothing() -> None:
    mech = rg.load("crank_rocker")
    inside = with_forces(mech, rg.PointSpring("coupler", "coupler_tip", 1e3, 0.1, 10.0))
    assert inside.applied is not None
    np.testing.assert_allclose(inside.applied.tau(mech.home, np.ones(3)), 0.0, atol=1e-12)


def test_nothing_is_set_up_where_nothing_acts() -> None:
    mech = rg.load("crank_rocker")
    assert mech.forces == ()
    assert mech.applied is None
    assert rg.simulate(mech, duration=0.01, step=0.01).work is None


# --------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize("kind", ("joint", "points"))
def test_natural_frequency(kind: str) -> None:
    """z = z₀ + A cos(√(k/m) t) about the static equilibrium z₀ = −m g/k."""
    k, mass, gravity, A = 50.0, 2.0, 9.81, 0.1
    # between points: from the ground at the origin, always stretched downwards
    spring = rg.JointSpring("z", k) if kind == "joint" else rg.PointSpring("universe", "mass", k)
    mech = slide(spring, mass=mass, gravity=gravity)
    rest = -mass * gravity / k
    traj = rg.simulate(mech, q0=[rest + A], duration=3.0, step=2e-3)
    omega = np.sqrt(k / mass)
    # RK4 on an oscillator: phase error (ω h)⁴/120 ω t = 8e-10 · 15
    np.testing.assert_allclose(traj.q[:, 0], rest + A * np.cos(omega * traj.t), atol=1e-8 * A * 3)
    assert traj.work is None
    assert np.abs(traj.energy_error()).max() < 1e-9


def test_static_equilibrium() -> None:
    """A weight at rest on its spring stays: a = 0; a constant drive holds a linkage up likewise."""
    k, mass, gravity, rest_length = 80.0, 2.0, 9.81, 0.25
    mech = slide(rg.PointSpring("mass", "universe", k, rest_length), mass=mass, gravity=gravity)
    hanging = -(rest_length + mass * gravity / k)
    a, _ = rg.implicit_dynamics(mech, [hanging], [0.0])
    assert a[0] == pytest.approx(0.0, abs=1e-13)
    # the rhombus on its parallelogram mode is a pendulum: its gravity torque is 2 · 9.81 cos y
    y = 0.7
    held = with_forces(rg.load("rhombus"), rg.JointTorque("q1", 2.0 * 9.81 * np.cos(y)))
    traj = rg.simulate(held, q0=[y, -y, y], duration=1e-3, step=1e-3, record=("a",))
    assert traj.a is not None
    np.testing.assert_allclose(traj.a[0], 0.0, atol=1e-12)


def test_damped_oscillation_in_closed_form() -> None:
    """z = e^(−δt) (cos ωt + δ/ω sin ωt), δ = c/2m, ω² = k/m − δ²; the damper's work is the loss."""
    k, c, mass = 50.0, 4.0, 2.0
    mech = slide(rg.JointSpring("z", k), rg.JointDamper("z", c), mass=mass)
    traj = rg.simulate(mech, q0=[1.0], duration=2.0, step=1e-3)
    delta = c / (2.0 * mass)
    omega = np.sqrt(k / mass - delta**2)
    t = traj.t
    exact = np.exp(-delta * t) * (np.cos(omega * t) + delta / omega * np.sin(omega * t))
    np.testing.assert_allclose(traj.q[:, 0], exact, atol=1e-10)
    assert traj.work is not None
    loss = 0.5 * mass * traj.v[:, 0] ** 2 + 0.5 * k * traj.q[:, 0] ** 2 - 0.5 * k
    np.testing.assert_allclose(traj.work, loss, atol=1e-9)
    assert traj.work[-1] < -0.9 * 0.5 * k


# --------------------------------------------------------------------------- in closed loops

ACTING = (
    rg.JointSpring("q2", 3.0, 0.4),
    rg.JointDamper("q3", 0.8),
    rg.PointSpring("coupler_tip", "universe", 5.0, 1.0, 0.6),
    rg.JointTorque("q1", 2.0),
)


@pytest.mark.parametrize("name", ("crank_rocker", "rhombus"))
def test_energy_balance_through_everything(name: str) -> None:
    """Springs in the energy, dampers and drives in the work, a torque from outside added to them.

    The rhombus passes singular configurations on the way.
    """
    mech = with_forces(rg.load(name), *ACTING)
    errors = []
    for step in (4e-3, 2e-3):
        traj = rg.simulate(
            mech, duration=2.0, step=step, torque=lambda t, q, v: [np.sin(3 * t), 0.0, -0.3 * v[2]]
        )
        assert traj.work is not None
        assert np.ptp(traj.work) > 0.5
        errors.append(np.abs(traj.energy_error()).max())
    assert bool(traj.crossings) == (name == "rhombus")
    assert errors[0] < 3e-6
    assert errors[0] / errors[1] > 10.0  # order four: 16


def test_explicit_implicit_and_multipliers_agree() -> None:
    mech = with_forces(rg.load("crank_rocker"), *ACTING)
    v0 = mech.lift(mech.home, [1.5])
    traj = rg.simulate(mech, v0=v0, duration=1e-6, step=1e-6, record=("a", "multipliers"))
    assert traj.a is not None
    assert traj.multipliers is not None
    a, multipliers = rg.implicit_dynamics(mech, traj.q[0], traj.v[0])
    np.testing.assert_allclose(traj.a[0], a, atol=1e-11)
    np.testing.assert_allclose(traj.multipliers[0], multipliers, atol=1e-10)
    bare = rg.implicit_dynamics(rg.load("crank_rocker"), traj.q[0], traj.v[0])[0]
    assert np.abs(a - bare).max() > 0.1


def test_forces_stay_when_the_coordinates_change() -> None:
    mech = with_forces(rg.load("crank_rocker"), *ACTING)
    other = mech.with_independent(["q2"])
    assert other.forces == mech.forces
    one, two = (rg.simulate(m, duration=0.3, step=1e-3) for m in (mech, other))
    np.testing.assert_allclose(one.q, two.q, atol=1e-10)


def test_a_spring_along_a_rigid_coupler_moves_nothing() -> None:
    """Across the loop the distance is the coupler's length: only the multipliers feel the spring."""
    mech = linkages.four_bar(4.0, 1.0, 3.5, 3.0)
    sprung = with_forces(mech, rg.PointSpring("q1_tip", "q3_tip", 10.0))
    at_rest = mech.home, np.zeros(3)
    (a, bare), (b, loaded) = (rg.implicit_dynamics(m, *at_rest) for m in (mech, sprung))
    np.testing.assert_allclose(a, b, atol=1e-12)
    assert np.linalg.norm(loaded - bare) == pytest.approx(10.0 * 3.5, rel=1e-12)


# --------------------------------------------------------------------------- no length, no direction


def test_a_spring_without_length() -> None:
    """Rest length zero: no force where the points meet. Otherwise: an error that names the spring."""
    mech = slide(rg.PointSpring("universe", "mass", 5.0))
    assert mech.applied is not None
    np.testing.assert_array_equal(mech.applied.tau(np.zeros(1), np.ones(1)), [0.0])
    for stiff in (
        rg.PointSpring("universe", "mass", 5.0, 0.1),
        rg.PointSpring("universe", "mass", 5.0, 0.0, 1.0),
    ):
        mech = slide(rg.PointSpring("post", "mass", 5.0, 0.1), stiff)
        with pytest.raises(rg.SimulationError, match=r"universe – mass .* no direction; move one"):
            rg.simulate(mech, q0=[0.0], duration=0.01, step=0.01)


# --------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rg.JointSpring("q1", -1.0), r"stiffness is -1.0; give zero or a positive"),
        (lambda: rg.JointSpring("q1", 1.0, np.nan), r"rest is nan; give a finite number"),
        (lambda: rg.JointDamper("q1", -0.1), r"damping is -0.1; give zero or a positive"),
        (lambda: rg.JointTorque("q1", np.inf), r"torque is inf; give a finite number"),
        (lambda: rg.PointSpring("a", "b", 1.0, -0.1), r"a – b: rest_length is -0.1"),
        (lambda: rg.PointSpring("a", "b", 1.0, 0.1, -2), r"damping is -2"),
        (lambda: rg.PointSpring("a", "b", "stiff"), r"stiffness is 'stiff'; give a number"),  # type: ignore[arg-type]
        (lambda: rg.JointSpring("q1", True), r"stiffness is True; give a number"),
    ],
)
def test_numbers_that_make_no_sense(make: Callable[[], Force], message: str) -> None:
    with pytest.raises(rg.ModelError, match=message):
        make()


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (rg.JointSpring("q11", 1.0), r"JointSpring: .* no joint 'q11', only .*; did you mean 'q1'"),
        (rg.JointDamper("elbow", 1.0), r"JointDamper: .* no joint 'elbow', only q1, q2, q3"),
        (rg.JointTorque("q0", 1.0), r"JointTorque: .* no joint 'q0'"),
        (rg.PointSpring("coupler_tp", "universe", 1.0), r"no frame 'coupler_tp'; did you mean 'coupler_tip'"),
        ("spring", r"'spring' is not a JointSpring"),
    ],
)
def test_names_that_are_not_there(force: Force, message: str) -> None:
    with pytest.raises(rg.ModelError, match=message):
        with_forces(rg.load("crank_rocker"), force)


def test_a_joint_spring_needs_a_joint_of_one_number(spatial: dict[str, rg.Mechanism]) -> None:
    with pytest.raises(rg.ModelError, match=r"'platform' .* has 7 numbers in q and 6 velocities"):
        with_forces(spatial["tripod"], rg.JointSpring("platform", 1.0))


@pytest.mark.parametrize("name", ("five_bar", "delta"))
def test_springs_between_points_that_a_closure_holds_together_are_refused(name: str) -> None:
    """At a length of 1e-17 m their force has the direction of rounding, and derivatives are made of it."""
    mech = rg.load(name)
    closure = mech.closures[0]
    ends = closure.frame2, closure.frame1
    for rest, damping in ((0.3, 0.0), (0.0, 0.5)):
        with pytest.raises(rg.ModelError, match="no length and no direction"):
            rg.Mechanism.from_pinocchio(
                mech.model,
                mech.closures,
                list(mech.independent),
                home=mech.home,
                forces=[rg.PointSpring(*ends, 10.0, rest, damping)],
            )
    plain = rg.Mechanism.from_pinocchio(
        mech.model,
        mech.closures,
        list(mech.independent),
        home=mech.home,
        forces=[*mech.forces, rg.PointSpring(*ends, 10.0)],
    )
    np.testing.assert_allclose(
        rg.forward_dynamics(plain, mech.home), rg.forward_dynamics(mech, mech.home), rtol=0.0, atol=1e-9
    )
