"""Couplings of two joints: rows against finite differences, motions against closed forms."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg

Array = NDArray[np.float64]

GRAVITY = 9.81


def wheels(slide: bool = False) -> pin.Model:
    """Two discs of 2 and 5 kg m² about x; the second may be a block of 3 kg that slides along z."""
    model = pin.Model()
    one = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "one")
    place = pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0]))
    kind = pin.JointModelPZ() if slide else pin.JointModelRX()
    two = model.addJoint(0, kind, place, "two")
    model.appendBodyToJoint(one, pin.Inertia(1.0, np.zeros(3), np.diag([2.0, 1.5, 1.5])), pin.SE3.Identity())
    model.appendBodyToJoint(two, pin.Inertia(3.0, np.zeros(3), np.diag([5.0, 4.0, 4.0])), pin.SE3.Identity())
    return model


def geared(*closures: Any, slide: bool = False, **more: Any) -> rg.Mechanism:
    return rg.Mechanism.from_pinocchio(wheels(slide), closures, ["two"], **more)


def test_a_gear_has_the_inertia_that_its_ratio_gives() -> None:
    """(J₂ + r² J₁) φ̈ = τ₂ + r τ₁ for φ₁ = r φ₂ + c."""
    r, c = -2.5, 0.7
    mech = geared(rg.CouplingClosure("one", "two", r, c), home=[c, 0.0])
    assert (mech.nc, mech.m, mech.dependent) == (1, 1, ("one",))
    ydd, _ = rg.implicit_dynamics(mech, mech.home, np.zeros(2), tau=[0.3, 1.1])
    assert ydd[1] == pytest.approx((1.1 + r * 0.3) / (5.0 + r * r * 2.0), rel=1e-14)
    traj = rg.simulate(mech, duration=1.0, step=0.1, torque=[0.3, 1.1])
    np.testing.assert_allclose(traj.q[:, 0], r * traj.q[:, 1] + c, atol=1e-14)
    np.testing.assert_allclose(traj.q[-1, 1], 0.5 * ydd[1], atol=1e-13)  # RK4 is exact for t²


def test_a_rack_falls_as_its_pinion_lets_it() -> None:
    """A block of 3 kg on a rack, pinion of radius 0.2 m: z̈ = −m g / (m + J/R²); a row in rad."""
    mech = geared(rg.CouplingClosure("one", "two", 1.0 / 0.2), slide=True)
    np.testing.assert_array_equal(mech.row_scale, [1.0])
    traj = rg.simulate(mech, duration=1.0, step=0.1)
    fall = -3.0 * GRAVITY / (3.0 + 2.0 / 0.2**2)
    np.testing.assert_allclose(traj.q[-1], [0.5 * fall / 0.2, 0.5 * fall], atol=1e-13)


def test_a_coupling_of_a_slide_has_a_row_in_metres() -> None:
    mech = rg.Mechanism.from_pinocchio(wheels(True), [rg.CouplingClosure("two", "one", 0.2)], ["one"])
    np.testing.assert_array_equal(mech.row_scale, [mech.length])
    np.testing.assert_array_equal(mech.K([0.0, 0.0]), [[-0.2, 1.0]])


CAM = rg.CouplingClosure("one", "two", 0.4, 0.1, (0.7, -0.3, 0.2))


def test_rows_of_a_polynomial_against_finite_differences() -> None:
    """φ = q₁ − P(q₂), K = ∂φ/∂q and K̇ v by central differences."""
    mech = geared(CAM, home=[0.1, 0.0])
    q, v, h = np.array([0.4, 0.9]), np.array([0.3, -1.2]), 1e-5
    assert mech.phi(q)[0] == pytest.approx(0.4 - (0.1 + 0.36 + 0.7 * 0.81 - 0.3 * 0.729 + 0.2 * 0.6561))
    numeric = [(mech.phi(q + h * e) - mech.phi(q - h * e)) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(mech.K(q), np.column_stack(numeric), atol=1e-9)
    rate = (mech.K(q + h * v) - mech.K(q - h * v)) / (2 * h)
    np.testing.assert_allclose(mech.k(q, v), -rate @ v, atol=1e-9)


def test_a_cam_conserves_energy_at_order_four() -> None:
    errors = []
    for step in (0.02, 0.01):
        mech = geared(CAM, slide=True, home=[0.1, 0.0])
        traj = rg.simulate(mech, mech.home, mech.lift(mech.home, [0.8]), duration=1.0, step=step)
        assert traj.closure_error().max() < 1e-14
        errors.append(np.abs(traj.energy_error()).max())
    assert np.log2(errors[0] / errors[1]) > 3.7


def test_a_cam_against_its_equation_of_motion() -> None:
    """(m + J P′²) z̈ + J P′ P″ ż² = −m g, solved by another program to 1e-12."""
    from scipy.integrate import solve_ivp

    P = np.polynomial.Polynomial(CAM.coefficients)

    def rate(_: float, x: Array) -> list[float]:
        slope, curvature = P.deriv()(x[0]), P.deriv(2)(x[0])
        return [x[1], (-3.0 * GRAVITY - 2.0 * slope * curvature * x[1] ** 2) / (3.0 + 2.0 * slope**2)]

    reference = solve_ivp(rate, (0.0, 0.5), [0.0, 0.8], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    mech = geared(CAM, slide=True, home=[0.1, 0.0])
    v0 = mech.lift(mech.home, [0.8])
    traj = rg.simulate(mech, mech.home, v0, duration=0.5, step=1e-3)
    np.testing.assert_allclose([traj.q[-1, 1], traj.v[-1, 1]], reference, atol=1e-10)


def test_a_belt_over_two_joints() -> None:
    """A rotor on the ground drives the forearm of a double pendulum: q_r = 6 (q_a + q_b)."""
    model = pin.Model()
    body = pin.Inertia(1.0, np.array([0.0, 0.0, -0.5]), np.diag([0.1, 0.1, 0.1]))
    last = 0
    for name in "ab":
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0 if last else 0.0]))
        last = model.addJoint(last, pin.JointModelRX(), place, name)
        model.appendBodyToJoint(last, body, pin.SE3.Identity())
    rotor = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "rotor")
    model.appendBodyToJoint(rotor, pin.Inertia(0.0, np.zeros(3), np.diag([0.02] * 3)), pin.SE3.Identity())
    belt = rg.CouplingClosure("rotor", "a", 6.0, more=(("b", 6.0),))
    mech = rg.Mechanism.from_pinocchio(model, [belt], ["a", "b"])
    np.testing.assert_array_equal(mech.K(np.zeros(3)), [[-6.0, -6.0, 1.0]])
    free = rg.Mechanism.from_pinocchio(model, (), ["a", "b", "rotor"])
    q, v = np.array([0.4, -0.9, -3.0]), np.array([1.0, 0.5, 9.0])
    G = np.vstack([np.eye(2), [6.0, 6.0]])
    M = free.tree.crba(q).copy()
    M = np.triu(M) + np.triu(M, 1).T
    expected = np.linalg.solve(G.T @ M @ G, -G.T @ free.tree.rnea(q, v, np.zeros(3)))
    np.testing.assert_allclose(rg.implicit_dynamics(mech, q, v)[0][:2], expected, atol=1e-13)
    traj = rg.simulate(mech, q, v, duration=0.3, step=2e-3)
    np.testing.assert_allclose(traj.q[:, 2], 6.0 * (traj.q[:, 0] + traj.q[:, 1]), atol=1e-13)
    assert np.abs(traj.energy_error()).max() < 1e-8


@pytest.mark.parametrize("m", [1, 2])
def test_the_compiled_kernel_computes_the_same(m: int) -> None:
    """Gears, a cam, a belt and a held joint beside a loop, in one cluster or several."""
    if not rg.backends()["native"].available:
        pytest.skip("no compiled kernel here")
    rhombus = rg.load("rhombus")
    model = rhombus.model.copy()
    for i, name in enumerate(("wheel", "cam", "belt", "held", "free")):
        place = pin.SE3(np.eye(3), np.array([0.1 * i, 0.2, 0.3]))
        kind = pin.JointModelPZ() if name == "cam" else pin.JointModelRX()
        joint = model.addJoint(0, kind, place, name)
        body = pin.Inertia(0.5, np.array([0.0, 0.1, 0.05]), np.diag([0.02] * 3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    closures = [
        rg.CouplingClosure("wheel", "q1", 3.0, 0.2),
        *rhombus.closures,
        rg.CouplingClosure("cam", "wheel", 0.1, 0.3, (0.05, -0.02)),
        rg.CouplingClosure("belt", "q1", -2.0, 0.0, (), (("q2", 0.5),)),
        rg.CouplingClosure("held", None, 0.0, 0.7),
    ]
    if m == 1:
        closures.append(rg.CouplingClosure("free", "q3", 1.0))
    mech = rg.Mechanism.from_pinocchio(model, closures, ["q1"] if m == 1 else ["q1", "free"])
    q = mech.assemble({"q1": 0.9, "q2": -0.9, "q3": 0.9})
    v = mech.lift(q, [1.5, 0.4][:m])
    runs = [rg.simulate(mech, q, v, duration=0.4, step=1e-3, backend=b) for b in ("native", "python")]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-12)
    np.testing.assert_allclose(runs[0].v, runs[1].v, atol=1e-11)
    assert runs[0].closure_error().max() < 1e-13
    np.testing.assert_array_equal(runs[0].q[:, 6], 0.7)


def test_polynomials_about_other_origins_are_the_same_function() -> None:
    moved = rg.CouplingClosure.from_polynomial("one", "two", [0.5, -1.0, 0.3, 0.1], origin1=0.2, origin2=-0.7)
    P = np.polynomial.Polynomial(moved.coefficients)
    for x in (-1.3, 0.0, 2.1):
        assert P(x) == pytest.approx(0.2 + 0.5 - (x + 0.7) + 0.3 * (x + 0.7) ** 2 + 0.1 * (x + 0.7) ** 3)
    assert rg.CouplingClosure.from_polynomial("one", "two", [0.0, 2.0]) == rg.CouplingClosure(
        "one", "two", 2.0
    )


def test_couplings_beside_loops() -> None:
    """A rhombus whose crank is geared to a wheel: the wheel's inertia adds r² J to the crank's."""
    rhombus = rg.load("rhombus")
    model = rhombus.model.copy()
    wheel = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "wheel")
    model.appendBodyToJoint(
        wheel, pin.Inertia(0.0, np.zeros(3), np.diag([0.3, 0.2, 0.2])), pin.SE3.Identity()
    )
    home = np.append(rhombus.home, 3.0 * rhombus.home[0])
    closures = [rg.CouplingClosure("wheel", "q1", 3.0), *rhombus.closures]
    mech = rg.Mechanism.from_pinocchio(model, closures, ["q1"], home)
    assert mech.loops == rhombus.closures
    assert [w for w in mech.implicit.labels] == [*rhombus.implicit.labels, "wheel – q1"]
    ydd, _ = rg.implicit_dynamics(rhombus, rhombus.home, np.zeros(3))
    inertia = float(
        (rhombus.G(rhombus.home).T @ rhombus.tree.crba(rhombus.home) @ rhombus.G(rhombus.home))[0, 0]
    )
    with_wheel, _ = rg.implicit_dynamics(mech, mech.home, np.zeros(4))
    assert with_wheel[0] == pytest.approx(ydd[0] * inertia / (inertia + 9.0 * 0.3), rel=1e-12)
    picture = rg.analyse(mech, mech.home)
    assert (picture.kind, picture.rank) == ("regular", 3)
    again = pickle.loads(pickle.dumps(mech))
    assert again.closures == mech.closures == (*rhombus.closures, closures[0])
    flat = rg.analyse(mech, np.zeros(4))  # the singular configuration and its modes stay where they were
    assert len(flat.modes) == len(rg.analyse(rhombus, np.zeros(3)).modes)


def test_a_geared_rhombus_crosses_its_singular_configuration(tmp_path: Path) -> None:
    rhombus = rg.load("rhombus")
    model = rhombus.model.copy()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "wheel")
    home = np.append(rhombus.home, rhombus.home[0])
    closures = [*rhombus.closures, rg.CouplingClosure("wheel", "q1", 1.0)]
    mech = rg.Mechanism.from_pinocchio(model, closures, ["q1"], home)
    one, other = (rg.simulate(m, duration=1.0) for m in (rhombus, mech))
    assert len(one.crossings) == len(other.crossings) > 0
    np.testing.assert_allclose(other.q[:, :3], one.q, atol=1e-10)
    np.testing.assert_allclose(other.q[:, 3], one.q[:, 0], atol=1e-13)
    path = other.save(tmp_path / "geared.npz")
    assert rg.load_trajectory(path).mechanism.closures == mech.closures


def test_a_coupling_of_distant_joints_is_a_cluster_with_several_roots() -> None:
    """Ankle geared to hip past a free knee: the knee is in no cluster, the order stays depth first."""
    model = pin.Model()
    body = pin.Inertia(1.0, np.array([0.0, 0.1, -0.4]), np.diag([0.1, 0.1, 0.1]))
    last = 0
    for name in ("hip", "knee", "ankle"):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0 if last else 0.0]))
        last = model.addJoint(last, pin.JointModelRX(), place, name)
        model.appendBodyToJoint(last, body, pin.SE3.Identity())
    arm = model.addJoint(1, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, body, pin.SE3.Identity())
    closures = [
        rg.CouplingClosure("ankle", "hip", -0.5),
        rg.CouplingClosure("arm", "ankle", 2.0, 0.0, (1.0,)),
    ]
    mech = rg.Mechanism.from_pinocchio(model, closures, ["hip", "knee"])
    (cluster,) = mech.clusters
    assert (cluster.joints, cluster.independent, cluster.m) == (("hip", "arm", "ankle"), ("hip",), 1)
    q = np.array([0.3, 0.8, -0.2, 0.5])
    part = cluster.loops
    np.testing.assert_allclose(part.phi(q[cluster.iq]), mech.phi(q), atol=1e-15)
    np.testing.assert_allclose(part.K(q[cluster.iq]), mech.K(q)[:, cluster.iv], atol=1e-15)
    traj = rg.simulate(mech, mech.assemble([0.4, 0.2, 0.0, 0.0]), duration=0.5, step=5e-3)
    assert traj.closure_error().max() < 1e-14
    assert np.abs(traj.energy_error()).max() < 1e-7


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("one", "too", 1.0), "no joint 'too'.*did you mean 'two'"),
        (("one", "one", 1.0), "cannot follow itself"),
        (("one", "two", float("nan")), "finite"),
        (("one", "two", "fast"), "must be numbers"),
        (("one", "two", 1.0, 0.0, 5.0), "must be numbers"),
        (("one", "free", 1.0), "'free'.*numbers in q"),
        (("one", "two", 1.0, 0.0, (), (("two", 1.0),)), "nor count twice"),
        (("one", "two", 1.0, 0.0, (), (("three", 1.0),)), "no joint 'three'"),
    ],
)
def test_couplings_that_couple_nothing(arguments: tuple[Any, ...], message: str) -> None:
    model = wheels()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    with pytest.raises(rg.ModelError, match=message):
        rg.Mechanism.from_pinocchio(model, [rg.CouplingClosure(*arguments)], ["two"])
