"""Equations of motion: explicit (3), implicit (2) and Pinocchio's own agree; forces balance; work counts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples import linkages
from robust_gcp.maps.closed_form import FourBar, parallelogram_pendulum, pendulum

Array = NDArray[np.float64]
States = Callable[[rg.Mechanism, int], list[tuple[Array, Array]]]
PI = np.pi
LOOPS = ("crank_rocker", "change_point", "kite", "tripod", "spherical loop", "seven hinges", "humanoid")


def explicit(
    mech: rg.Mechanism, q: Array, v: Array, tau: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """q, v, a and λ of the state with which a simulation by (3) begins."""
    traj = rg.simulate(mech, q, v, duration=1e-6, step=1e-6, torque=tau, record=("a", "multipliers"))
    assert traj.a is not None
    assert traj.multipliers is not None
    return traj.q[0], traj.v[0], traj.a[0], traj.multipliers[0]


@pytest.mark.parametrize("name", LOOPS)
def test_explicit_and_implicit_equations_agree(
    mechanisms: dict[str, rg.Mechanism], closed_states: States, name: str
) -> None:
    """(3) eliminates what (2) carries as multipliers: the same a, the same λ."""
    mech = mechanisms[name]
    rng = np.random.default_rng(0)
    for q, v in closed_states(mech, 4):
        tau = rng.uniform(-10, 10, mech.nv)
        q0, v0, a, multipliers = explicit(mech, q, v, tau)
        a2, multipliers2 = rg.implicit_dynamics(mech, q0, v0, tau)
        # conditioning of K_d below 200 (closed_states), of M some hundreds, twice ε
        np.testing.assert_allclose(a, a2, atol=1e-9 * max(1.0, np.abs(a).max()))
        scale = max(1.0, np.abs(multipliers).max())
        np.testing.assert_allclose(multipliers, multipliers2, atol=1e-9 * scale)


@pytest.mark.parametrize("name", ("crank_rocker", "kite", "tripod", "seven hinges", "humanoid"))
def test_agreement_with_pinocchios_constraint_dynamics(
    mechanisms: dict[str, rg.Mechanism], closed_states: States, name: str
) -> None:
    """An independent implementation; a proximal μ > 0, because its default NaNs on planar loops.

    The two agree to 2e-13 at regular configurations.
    """
    mech = mechanisms[name]
    model, rng = mech.model, np.random.default_rng(1)
    kinds = {rg.PointClosure: pin.ContactType.CONTACT_3D, rg.FrameClosure: pin.ContactType.CONTACT_6D}
    contacts = pin.StdVec_RigidConstraintModel()
    for closure in mech.closures:
        one, two = (model.frames[model.getFrameId(f)] for f in (closure.frame1, closure.frame2))
        contacts.append(
            pin.RigidConstraintModel(
                kinds[type(closure)],
                model,
                one.parentJoint,
                one.placement,
                two.parentJoint,
                two.placement,
                pin.ReferenceFrame.LOCAL,
            )
        )
    data = model.createData()
    contact_data = pin.StdVec_RigidConstraintData()
    for contact in contacts:
        contact_data.append(contact.createData())
    pin.initConstraintDynamics(model, data, contacts, contact_data)
    settings = pin.ProximalSettings(1e-14, 1e-14, 1e-6, 200)
    for q, v in closed_states(mech, 4):
        tau = rng.uniform(-10, 10, mech.nv)
        q0, v0, a, _ = explicit(mech, q, v, tau)
        theirs = pin.constraintDynamics(model, data, q0, v0, tau, contacts, contact_data, settings)
        np.testing.assert_allclose(a, theirs, atol=1e-9 * max(1.0, np.abs(a).max()))


def test_without_loops_it_is_forward_dynamics() -> None:
    model = pin.buildSampleModelManipulator()
    mech = rg.Mechanism.from_pinocchio(model)
    rng = np.random.default_rng(2)
    q, v, tau = (rng.uniform(-1, 1, model.nv) for _ in range(3))
    a = explicit(mech, q, v, tau)[2]
    aba = pin.aba(model, model.createData(), q, v, tau)
    np.testing.assert_allclose(a, aba, rtol=1e-11, atol=1e-11 * np.abs(aba).max())
    np.testing.assert_allclose(rg.implicit_dynamics(mech, q, v, tau)[0], aba, rtol=1e-9)


# --------------------------------------------------------------------------- identities


@pytest.mark.parametrize("name", LOOPS)
def test_forces_balance_and_constraint_forces_do_no_work(
    mechanisms: dict[str, rg.Mechanism], closed_states: States, name: str
) -> None:
    """M a + C − τ = Kᵀ λ, K a = k, and Gᵀ τ_c = 0: (Kᵀ λ) · v = 0 for every v with K v = 0."""
    mech = mechanisms[name]
    rng = np.random.default_rng(3)
    for q, v in closed_states(mech, 3):
        tau = rng.uniform(-10, 10, mech.nv)
        q0, v0, a, multipliers = explicit(mech, q, v, tau)
        K = mech.K(q0)
        needed = mech.tree.rnea(q0, v0, a) - tau
        scale = max(1.0, np.abs(needed).max(), np.abs(a).max())
        np.testing.assert_allclose(K.T @ multipliers, needed, atol=1e-10 * scale)
        np.testing.assert_allclose(K @ a, mech.k(q0, v0), atol=1e-10 * scale)
        for ydot in rng.uniform(-1, 1, (3, mech.m)):
            virtual = mech.lift(q0, ydot)
            assert abs(K.T @ multipliers @ virtual) <= 1e-10 * scale * max(1.0, np.abs(virtual).max())


def tilted_crank_rocker() -> rg.Mechanism:
    """The crank-rocker in a tilted plane: three rows of rank two."""
    tilt = pin.SE3(pin.exp3(np.array([0.3, 0.4, 0.5])), np.array([0.1, 0.2, 0.3]))
    flat = linkages.four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    model = flat.model.copy()
    for joint in (1, 3):
        model.jointPlacements[joint] = tilt * model.jointPlacements[joint]
    model.gravity.linear = tilt.rotation @ model.gravity.linear
    return rg.Mechanism.from_pinocchio(model, flat.closures, ["q1"], home=flat.home)


def test_redundant_rows_share_the_force_with_the_least_norm() -> None:
    """The same linkage, gravity turned along: the same a; λ the same force in world axes, nothing
    across the plane, which is the least norm of all that balance."""
    flat, tilted = rg.load("crank_rocker"), tilted_crank_rocker()
    assert (flat.nc, tilted.nc) == (2, 3)
    v = flat.lift(flat.home, [2.0])
    tau = np.array([1.0, -2.0, 3.0])
    a, multipliers = explicit(flat, flat.home, v, tau)[2:]
    a3, multipliers3 = explicit(tilted, flat.home, v, tau)[2:]
    np.testing.assert_allclose(a3, a, rtol=1e-11)
    R = pin.exp3(np.array([0.3, 0.4, 0.5]))
    np.testing.assert_allclose(multipliers3, R[:, 1:] @ multipliers, atol=1e-10)
    a2, multipliers2 = rg.implicit_dynamics(tilted, flat.home, v, tau)
    np.testing.assert_allclose(a2, a, rtol=1e-10)
    np.testing.assert_allclose(multipliers2, multipliers3, atol=1e-9)


def test_implicit_equations_survive_a_singular_configuration() -> None:
    """At (0, 0, 0), moving on the parallelogram mode, K has rank 1 and k is attainable: a solves
    (2), which determines it because M is positive definite on ker K; λ is the shortest."""
    mech = rg.load("rhombus")
    q, v = np.zeros(3), np.array([1.0, -1.0, 1.0])
    a, multipliers = rg.implicit_dynamics(mech, q, v)
    K, M, C = mech.K(q), mech.tree.crba(q).copy(), mech.tree.rnea(q, v, np.zeros(3)).copy()
    assert np.linalg.matrix_rank(K, tol=1e-12) == 1
    np.testing.assert_allclose(M @ a + C, K.T @ multipliers, atol=1e-12)
    np.testing.assert_allclose(K @ a, mech.k(q, v), atol=1e-12)
    assert abs(multipliers[0]) < 1e-12  # the row that vanishes carries nothing


# --------------------------------------------------------------------------- motion


@pytest.mark.parametrize("name", ("rhombus", "parallelogram"))
def test_reduced_equation_is_the_papers_pendulum(name: str) -> None:
    """A ÿ = −B cos y of docs/method.md, in every state of the parallelogram mode."""
    mech = rg.load(name)
    l1 = l3 = {"rhombus": 1.0, "parallelogram": 2.0}[name]
    A, B = parallelogram_pendulum(l1, l3, 1.0, 1.0, 1.0)
    for y, rate in ((0.2, 0.0), (1.3, -2.0), (2.7, 5.0), (-4.0, 1.0)):
        q, v = y * np.array([1.0, -1.0, 1.0]), rate * np.array([1.0, -1.0, 1.0])
        a = explicit(mech, q, v)[2]
        np.testing.assert_allclose(a, -B / A * np.cos(y) * np.array([1.0, -1.0, 1.0]), atol=1e-12)


@pytest.mark.parametrize("independent", (("q2",), ("q3",)))
def test_every_partition_gives_the_same_motion(independent: tuple[str, ...]) -> None:
    """The crank-rocker from q1 = −1 for 0.4 s with crank, coupler or rocker as y: none of them
    turns back on the way, and RK4 errs by some 1e-11 in each."""
    mech = rg.load("crank_rocker")
    q0 = FourBar(4.0, 1.0, 3.5, 3.0).evaluate(-1.0)[0]
    ends = [rg.simulate(m, q0, duration=0.4, step=2e-3) for m in (mech, mech.with_independent(independent))]
    assert np.abs(ends[0].q[-1] - q0).min() > 0.1  # all three have moved
    np.testing.assert_allclose(ends[1].q, ends[0].q, atol=1e-9)
    np.testing.assert_allclose(ends[1].v, ends[0].v, atol=1e-8)


def test_partitions_of_a_mechanism_in_space(spatial: dict[str, rg.Mechanism]) -> None:
    """Any six well conditioned leg joints move the tripod's platform alike."""
    mech = spatial["tripod"]
    choices = [names for _, names in mech.coordinate_choices(mech.home)]
    assert len(choices) >= 2
    runs = [rg.simulate(mech.with_independent(c), duration=0.05, step=2.5e-3) for c in choices[:2]]
    first, second = (run.q[-1] for run in runs)
    assert np.abs(mech.tree.difference(mech.home, first)).max() > 5e-3
    np.testing.assert_allclose(mech.tree.difference(first, second), 0.0, atol=1e-8)


def test_gravity_comes_from_the_model() -> None:
    """Without it a rhombus pushed at ẏ = 1 keeps turning at this rate: A is constant on the mode."""
    model = rg.load("rhombus").model.copy()
    model.gravity.setZero()
    mech = rg.Mechanism.from_pinocchio(model, rg.load("rhombus").closures, ["q1"])
    q0, v0 = [0.3, -0.3, 0.3], [1.0, -1.0, 1.0]
    traj = rg.simulate(mech, q0, v0, duration=0.5, step=0.05)
    np.testing.assert_allclose(traj.q[:, 0], 0.3 + traj.t, atol=1e-12)


# --------------------------------------------------------------------------- applied torques


def test_torque_callable_array_and_zero() -> None:
    """A torque on q1 that cancels gravity, −B cos y, leaves a rhombus at rest; a constant array is
    the callable that returns it; zero torque is none."""
    mech, q0 = rg.load("rhombus"), [0.4, -0.4, 0.4]
    _, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    held = rg.simulate(
        mech, q0, duration=0.05, step=0.01, torque=lambda t, q, v: [B * np.cos(q[0]), 0.0, 0.0]
    )
    np.testing.assert_allclose(held.q, np.tile(q0, (6, 1)), atol=1e-12)
    constant = [3.0, -1.0, 2.0]
    runs = [
        rg.simulate(mech, q0, duration=0.05, step=0.01, torque=tau)
        for tau in (constant, lambda t, q, v: np.array(constant), None, np.zeros(3))
    ]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)
    np.testing.assert_allclose(runs[2].q, runs[3].q, atol=1e-15)
    assert np.abs(runs[0].q - runs[2].q).max() > 1e-4


def test_torques_reach_the_dependent_joints() -> None:
    """Gᵀ τ: on the parallelogram mode G = (1, −1, 1), so (0, −5, 0) pushes as (5, 0, 0) does."""
    mech, q0 = rg.load("rhombus"), np.array([0.4, -0.4, 0.4])
    one = explicit(mech, q0, np.zeros(3), np.array([5.0, 0.0, 0.0]))[2]
    other = explicit(mech, q0, np.zeros(3), np.array([0.0, -5.0, 0.0]))[2]
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    assert one[0] == pytest.approx((5.0 - B * np.cos(0.4)) / A, rel=1e-12)
    np.testing.assert_allclose(one, other, rtol=1e-12)


def test_work_of_torques_is_accounted_for() -> None:
    """A damper −c q̇ on every joint and a drive sin t: energy changes, the error does not.

    RK4 integrates the work along with the motion, so what is left is its own error: 200 steps of
    (ω h)⁵/120, ω² < 12 /s², times some 10 W s, is 3e-8."""
    mech = rg.load("rhombus")
    traj = rg.simulate(
        mech,
        [0.4, -0.4, 0.4],
        duration=1.0,
        step=5e-3,
        torque=lambda t, q, v: np.array([np.sin(3.0 * t), 0.0, 0.0]) - 0.5 * v,
        record=("energy",),
    )
    assert traj.energy is not None
    assert abs(traj.energy[-1] - traj.energy[0]) > 1.0
    assert np.abs(traj.energy_error()).max() < 1e-7


def test_constant_torque_has_an_exact_motion() -> None:
    """τ on q1 tilts the pendulum's equation no further than A ÿ = τ − B cos y; without gravity the
    motion is a parabola, which RK4 takes without error through the singularity at y = 0."""
    model = rg.load("rhombus").model.copy()
    model.gravity.setZero()
    mech = rg.Mechanism.from_pinocchio(model, rg.load("rhombus").closures, ["q1"])
    A, _ = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    traj = rg.simulate(mech, [-0.3, 0.3, -0.3], duration=1.0, step=0.02, torque=[2.0, 0.0, 0.0])
    y = -0.3 + 0.5 * (2.0 / A) * traj.t**2
    assert y[-1] > 0.25  # past the crossing
    # ε/zone³ of rounding through the bridge, zone 0.05
    np.testing.assert_allclose(traj.q, np.outer(y, [1.0, -1.0, 1.0]), atol=1e-11)
    assert len(traj.crossings) == 1


def test_pendulum_of_the_closed_form_is_the_simulated_one() -> None:
    """One coarse step of RK4 from the exact state stays with the exact solution to O(h⁵)."""
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    mech = rg.load("rhombus")
    y, rate, _ = pendulum(np.array([0.7, 0.71]), 0.2, 0.0, A, B)
    t = np.array([1.0, -1.0, 1.0])
    traj = rg.simulate(mech, y[0] * t, rate[0] * t, duration=0.01, step=0.01)
    # h⁵ y⁽⁵⁾/120-like: (ω h)⁵ with ω = 3.4 /s is 5e-8, over some hundred
    np.testing.assert_allclose(traj.q[-1], y[1] * t, atol=1e-8)


@pytest.mark.parametrize("beside", [1e-1, 1e-3, 3e-5, 1e-6])
def test_implicit_dynamics_beside_a_crossing(beside: float) -> None:
    """The parallelogram mode at y = π − δ: (ÿ, −ÿ, ÿ) with A ÿ = −B cos y; K costs 1/δ of the digits."""
    mechanism = rg.load("rhombus")
    y = np.pi - beside
    q, v = np.array([y, -y, y]), np.array([1.0, -1.0, 1.0])
    a, _ = rg.implicit_dynamics(mechanism, q, v)
    start = rg.simulate(mechanism, q, v, duration=1e-3, step=1e-3, method="closed_form", record=("a",))
    assert start.a is not None
    np.testing.assert_allclose(a, start.a[0], rtol=1e-14 / beside, atol=1e-13 / beside)
