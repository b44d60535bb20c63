"""Derivatives of the forward dynamics, of one step, and by inertial parameters, against differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import parallelogram_pendulum
from robust_gcp.mechanism.constraint.closure_rates import ClosureRates
from robust_gcp.mechanism.constraint.extended_precision import ExtendedClosures
from robust_gcp.mechanism.loops import ClosedLoops
from robust_gcp.mechanism.tree.columns import Columns, with_simple_joints
from robust_gcp.mechanism.tree.motions import Motions
from robust_gcp.mechanism.tree.tree import Tree
from robust_gcp.reports.stability.truth import with_forces

from ..simulation.test_idle_spins import rssr

Array = NDArray[np.float64]

TENTH = np.array([5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260])
"""Central differences of order 10: Σ w_k (f(kh) − f(−kh)) / h."""

FLOATING = {
    "free": pin.JointModelFreeFlyer(),
    "ball": pin.JointModelSpherical(),
    "planar": pin.JointModelPlanar(),
    "unbounded": pin.JointModelRUBZ(),
}


def differences(f: Callable[[Array], Array], n: int, h: float) -> Array:
    """∂f/∂x at 0, (k, n)."""
    columns = []
    for e in np.eye(n):
        pairs = [f(k * h * e) - f(-k * h * e) for k in range(1, 6)]
        columns.append(np.tensordot(TENTH, np.array(pairs), 1) / h)
    return np.array(columns).T


def off(found: Array, exact: Array, floor: float = 1e-300) -> float:
    """Largest error relative to the largest entry."""
    return float(np.abs(found - exact).max() / max(np.abs(exact).max(), floor))


def moved(mech: rg.Mechanism, q: Array, eta: Array) -> Array:
    """The closed configuration whose independent joints are moved by η along their own velocities."""
    own = np.zeros(mech.nv)
    own[mech.iv_independent] = eta
    guess, exact = mech.tree.integrate(q, mech.G(q) @ eta), mech.tree.integrate(q, own)
    for i in mech.iv_independent.tolist():
        joint = mech.joint_at(i)
        at = joint.idx_q + i - joint.idx_v
        place = slice(at, at + 1) if joint.flat else slice(joint.idx_q, joint.idx_q + joint.nq)
        guess[place] = exact[place]
    return mech.polish(guess, mech.iv_dependent)


def floating(joint: Any) -> rg.Mechanism:
    """A body on this joint that carries a closed four-bar, a spring across it and a damper."""
    model = pin.Model()
    base = model.addJoint(0, joint, pin.SE3.Identity(), "base")
    inertia = pin.Inertia(1.3, np.array([0.1, 0.2, -0.05]), np.diag([0.05, 0.1, 0.13]))
    model.appendBodyToJoint(base, inertia, pin.SE3.Identity())

    def link(parent: int, y: float, name: str, size: float) -> int:
        at = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
        index = model.addJoint(parent, pin.JointModelRX(), at, name)
        about = np.diag([0.02 + size**2 / 12.0, 0.01, 0.02 + size**2 / 12.0])
        body = pin.Inertia(0.8, np.array([0.02, size / 2.0, 0.01]), about)
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
        tip = pin.SE3(np.eye(3), np.array([0.0, size, 0.0]))
        model.addFrame(pin.Frame(f"{name}_tip", index, tip, pin.FrameType.OP_FRAME))
        return int(index)

    link(link(base, 0.0, "q1", 0.5), 0.5, "q2", 1.0)
    link(base, 0.9, "q3", 0.8)
    home = pin.integrate(model, pin.neutral(model), np.linspace(0.3, -0.5, model.nv))
    home[-3:] = (1.2, -0.9, 1.27)
    forces = [rg.PointSpring("q1_tip", "universe", 7.0, 0.3, 0.4), rg.JointDamper("base", 0.3)]
    mech = rg.Mechanism.from_pinocchio(
        model, [rg.PointClosure("q2_tip", "q3_tip")], ["base", "q1"], home=home, forces=forces
    )
    mech.home = mech.assemble(home)
    return mech


def geared() -> rg.Mechanism:
    """Two pendulums tied by a cubic and a third that follows both."""
    model = pin.Model()
    for name in ("one", "two", "three"):
        index = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(
            index, pin.Inertia(1.0, np.array([0.0, 0.4, 0.1]), np.eye(3)), pin.SE3.Identity()
        )
    couplings = [
        rg.CouplingClosure("two", "one", 0.7, 0.1, (0.3, -0.2)),
        rg.CouplingClosure("three", "one", -1.5, more=(("two", 0.4),)),
    ]
    mech = rg.Mechanism.from_pinocchio(model, couplings, ["one"], name="geared")
    mech.home = mech.assemble({"one": 0.4})
    return mech


def state(mech: rg.Mechanism, speed: float = 1.0) -> tuple[Array, Array, Array, Array]:
    """Home, independent velocities, v and torques, reproducible."""
    rng = np.random.default_rng(3)
    u, tau = speed * rng.normal(size=mech.m), rng.normal(size=mech.nv)
    return mech.home, u, mech.lift(mech.home, u), tau


def errors(mech: rg.Mechanism, h: float, speed: float = 1.0) -> tuple[float, float, float]:
    """Relative errors of ∂u̇/∂y, ∂u̇/∂u and ∂u̇/∂τ."""
    q, u, v, tau = state(mech, speed)
    found, m = rg.derivatives(mech, q, v, tau), mech.m

    def by_state(z: Array) -> Array:
        at = moved(mech, q, z[:m])
        return rg.forward_dynamics(mech, at, mech.lift(at, u + z[m:]), tau)

    exact = differences(by_state, 2 * m, h)
    # u̇ is linear in τ
    rest = rg.forward_dynamics(mech, q, v)
    by_torque = np.array([rg.forward_dynamics(mech, q, v, e) - rest for e in np.eye(mech.nv)]).T
    np.testing.assert_array_equal(found.udot, rg.forward_dynamics(mech, q, v, tau))
    size = float(np.abs(found.udot).max())
    return (
        off(found.da_dy, exact[:, :m]),
        off(found.da_dv, exact[:, m:], 1e-3 * size),
        off(found.da_dtau, by_torque),
    )


SHIPPED = tuple(name for name in rg.model_names() if name not in ("stewart", "andrews"))
SPATIAL = {"tripod": 2e-3, "spherical loop": 3e-3, "seven hinges": 3e-3}


class TestAgainstDifferences:
    @pytest.mark.parametrize("name", SHIPPED)
    def test_shipped(self, name: str) -> None:
        assert max(errors(rg.load(name), 6e-3)) < 1e-9

    def test_andrews_whose_forces_are_a_thousand_times_larger(self) -> None:
        assert max(errors(rg.load("andrews"), 3e-3, speed=30.0)) < 1e-9

    def test_stewart(self) -> None:
        assert max(errors(rg.load("stewart"), 1e-3, speed=0.1)) < 1e-9

    @pytest.mark.parametrize("name", SPATIAL)
    def test_spatial(self, name: str, spatial: dict[str, rg.Mechanism]) -> None:
        assert max(errors(spatial[name], SPATIAL[name])) < 1e-9

    @pytest.mark.parametrize("name", FLOATING)
    def test_floating(self, name: str) -> None:
        assert max(errors(floating(FLOATING[name]), 5e-3)) < 1e-9

    def test_a_cut_slide_and_joints_whose_subspace_moves(self) -> None:
        assert max(errors(sliding(), 3e-3)) < 1e-9

    def test_couplings(self) -> None:
        assert max(errors(geared(), 5e-3)) < 1e-9

    def test_the_order_of_the_differences_shows(self) -> None:
        """Central differences of order 2 err by h²: what is left at h → 0 is the error of the derivatives."""
        mech = rg.load("crank_rocker")
        q, u, v, tau = state(mech)
        exact = rg.derivatives(mech, q, v, tau).da_dy

        def error(h: float) -> float:
            ahead, behind = (moved(mech, q, np.array([s * h])) for s in (1.0, -1.0))
            pair = [rg.forward_dynamics(mech, at, mech.lift(at, u), tau) for at in (ahead, behind)]
            return float(np.abs((pair[0] - pair[1]) / (2.0 * h) - exact[:, 0])[0])

        orders = np.log2([error(2.0**-k) / error(2.0 ** -(k + 1)) for k in range(4, 9)])
        np.testing.assert_allclose(orders, 2.0, atol=0.01)


class TestClosedForm:
    @pytest.mark.parametrize("y", (0.5, 2.0, -2.5))
    def test_the_rhombus_is_a_pendulum(self, y: float) -> None:
        """A ÿ = −B cos y − k (y − r) − c ẏ + Σ ± τ."""
        A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
        k, c = 30.0, 4.0
        forces = (rg.JointSpring("q1", k, 0.3), rg.JointDamper("q1", c))
        mech = with_forces(four_bar(1.0, 1.0, 1.0, 1.0, y=y), forces)
        found = rg.derivatives(mech, mech.home, mech.lift(mech.home, [1.7]))
        assert off(found.da_dy, np.array([[(B * np.sin(y) - k) / A]])) < 1e-11
        assert off(found.da_dv, np.array([[-c / A]])) < 1e-11
        assert off(found.da_dtau, np.array([[1.0, -1.0, 1.0]]) / A) < 1e-12


class TestTorques:
    """τ = (a sin q₂ − b v₁ v₃, 0, c q₁²) on the crank-rocker."""

    MECH = rg.load("crank_rocker")

    @staticmethod
    def torque(t: float, q: Array, v: Array) -> Array:
        return np.array([3.0 * np.sin(q[1]) - 0.5 * v[0] * v[2] + t, 0.0, 2.0 * q[0] ** 2])

    @staticmethod
    def slopes(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        by_q, by_v = np.zeros((3, 3)), np.zeros((3, 3))
        by_q[0, 1], by_q[2, 0] = 3.0 * np.cos(q[1]), 4.0 * q[0]
        by_v[0, 0], by_v[0, 2] = -0.5 * v[2], -0.5 * v[0]
        return by_q, by_v

    def exact(self, torque: Any, wrenches: tuple[rg.Wrench, ...] = ()) -> Array:
        mech = self.MECH
        q, u, _, _ = state(mech)

        def by_state(z: Array) -> Array:
            at = moved(mech, q, z[:1])
            w = mech.lift(at, u + z[1:])
            return rg.derivatives(mech, at, w, torque, wrenches=wrenches).udot

        return differences(by_state, 2, 5e-3)

    def test_with_slopes_given(self) -> None:
        q, _, v, _ = state(self.MECH)
        found = rg.derivatives(self.MECH, q, v, self.torque, tau_slopes=self.slopes)
        assert off(np.hstack([found.da_dy, found.da_dv]), self.exact(self.torque)) < 1e-11

    def test_with_slopes_by_differences(self) -> None:
        q, _, v, _ = state(self.MECH)
        found = rg.derivatives(self.MECH, q, v, self.torque)
        assert off(np.hstack([found.da_dy, found.da_dv]), self.exact(self.torque)) < 1e-9

    def test_wrenches_and_torques_by_name(self) -> None:
        q, _, v, _ = state(self.MECH)
        wrenches = (rg.Wrench("q2", [0.0, 3.0, -2.0, 0.5, 0.0, 0.0], "local"),)
        torque = {"q1": lambda t, q, v: -2.0 * v[0] ** 3}
        found = rg.derivatives(self.MECH, q, v, torque, wrenches=wrenches)
        assert off(np.hstack([found.da_dy, found.da_dv]), self.exact(torque, wrenches)) < 1e-9

    def test_wrenches_beside_slopes_of_a_torque_have_their_own(self) -> None:
        q, _, v, _ = state(self.MECH)
        wrenches = (rg.Wrench("q2", [0.0, 3.0, -2.0, 0.5, 0.0, 0.0], "local"),)
        exact = self.exact(self.torque, wrenches)
        for derivatives in (rg.derivatives, reference.derivatives):
            found = derivatives(self.MECH, q, v, self.torque, tau_slopes=self.slopes, wrenches=wrenches)
            assert off(np.hstack([found.da_dy, found.da_dv]), exact) < 1e-9


def all_kinds() -> pin.Model:
    """A chain of every kind of joint that is served, with rotors."""
    rng, model, parent = np.random.default_rng(5), pin.Model(), 0
    a, b = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])
    inner = pin.JointModelComposite(pin.JointModelRX())
    inner.addJoint(pin.JointModelUniversal(a, b), pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)))
    composite = pin.JointModelComposite(pin.JointModelPY())
    composite.addJoint(inner, pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)))
    composite.addJoint(pin.JointModelSpherical(), pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)))
    kinds = [
        pin.JointModelRX(), pin.JointModelRevoluteUnaligned(b), pin.JointModelPY(), pin.JointModelRUBZ(),
        pin.JointModelSpherical(), pin.JointModelTranslation(), pin.JointModelPlanar(), pin.JointModelHX(0.3),
        pin.JointModelUniversal(a, b), pin.JointModelSphericalZYX(), composite, pin.JointModelFreeFlyer(),
    ]  # fmt: skip
    for i, kind in enumerate(kinds):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        parent = model.addJoint(parent, kind, place, f"j{i}")
        inertia = pin.Inertia(rng.uniform(0.5, 2.0), rng.normal(size=3), np.diag(rng.uniform(0.5, 1.0, 3)))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    model.armature = rng.uniform(0.0, 1.0, model.nv)
    return model


class TestEveryKindOfJoint:
    def test_rnea(self) -> None:
        """Pinocchio's own derivatives are wrong for joints whose motion subspace depends on q."""
        model = all_kinds()
        tree = Tree(model)
        simple = with_simple_joints(model, tree.joints)
        assert (simple.nq, simple.nv) == (model.nq, model.nv)
        data, other, rng = model.createData(), simple.createData(), np.random.default_rng(0)
        q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        v, a = rng.normal(size=(2, model.nv))
        torques = pin.rnea(model, data, q, v, a)
        np.testing.assert_allclose(pin.rnea(simple, other, q, v, a), torques, rtol=0, atol=1e-12 * 1e3)
        by_q, by_v, M = (np.array(part) for part in pin.computeRNEADerivatives(simple, other, q, v, a))
        exact = differences(lambda d: pin.rnea(model, data, pin.integrate(model, q, d), v, a), model.nv, 1e-2)
        assert off(by_q, exact) < 1e-11
        assert off(by_v, differences(lambda d: pin.rnea(model, data, q, v + d, a), model.nv, 1e-2)) < 1e-11
        assert off(M, differences(lambda d: pin.rnea(model, data, q, v, a + d), model.nv, 1.0)) < 1e-12
        wrong = np.array(pin.computeRNEADerivatives(model, data, q, v, a)[0])
        assert off(wrong, exact) > 0.1, "no longer wrong: the chains are not needed for this any more"

    def test_points_and_directions(self) -> None:
        model = all_kinds()
        tree, rng = Tree(model), np.random.default_rng(1)
        columns = Columns(model, tree.joints)
        part = columns.of_joint[1:]
        q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        v, a = rng.normal(size=(2, model.nv))
        local = rng.normal(size=(len(part), 3))

        def vectors(dq: Array, dv: Array) -> list[Any]:
            tree.jacobians(pin.integrate(model, q, dq))
            motions = Motions(columns, tree.J.copy(), v + dv, a)
            u = np.einsum("nij,nj->ni", tree.R[1:], local)
            return [motions.points(part, tree.p[1:] + u), motions.directions(part, u)]

        still = np.zeros(model.nv)
        for kind, found in enumerate(vectors(still, still)):
            for name in ("x", "d", "dd"):
                exact = differences(
                    lambda d, k=kind, n=name: getattr(vectors(d, still)[k], n).ravel(), model.nv, 1e-2
                )
                mine = np.moveaxis(getattr(found, f"{name}_q"), 1, 2).reshape(exact.shape)
                assert off(mine, exact) < 1e-11, (kind, name)
            exact = differences(lambda d, k=kind: vectors(still, d)[k].dd.ravel(), model.nv, 1e-2)
            assert off(np.moveaxis(found.dd_v, 1, 2).reshape(exact.shape), exact) < 1e-11

    def test_closures_in_more_digits(self) -> None:
        """Nothing is closed here: φ is large, and the same in both precisions."""
        model = all_kinds()
        rng, names = np.random.default_rng(3), []
        for i, joint in enumerate((3, 7, 11, model.njoints - 1)):
            place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
            names.append(f"f{i}")
            model.addFrame(pin.Frame(names[-1], joint, place, pin.FrameType.OP_FRAME))
        closures = [rg.FrameClosure(*names[:2]), rg.RevoluteClosure(*names[2:], axis=(1.0, 2.0, 0.5))]
        loops = ClosedLoops(model, [*closures, rg.CouplingClosure("j0", "j2", 0.7, 0.1, (0.3,))])
        extended = ExtendedClosures(ClosureRates(loops))
        q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        found = extended.residual(q)
        assert found.dtype == np.longdouble and np.abs(found).min() > 1e-3
        np.testing.assert_allclose(found.astype(float), loops.phi(q) / loops.row_scale, rtol=0, atol=2e-15)

    def test_ellipsoids_are_refused_by_name(self) -> None:
        model = pin.Model()
        model.addJoint(0, pin.JointModelEllipsoid(0.3, 0.4, 0.5), pin.SE3.Identity(), "egg")
        model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
        with pytest.raises(rg.ModelError, match=r"'egg'.*ellipsoid.*replace it by such a chain"):
            rg.derivatives(rg.Mechanism.from_pinocchio(model), np.array([0.1, 0.2, 0.3]))


def sliding() -> rg.Mechanism:
    """Six joints in a ring that a cut slide closes: 6 − 5 = 1."""
    rng, model, parent = np.random.default_rng(10), pin.Model(), 0  # σ_min/σ_max of K_d 0.09
    for i, kind in enumerate(
        (pin.JointModelRX(), pin.JointModelSphericalZYX(), pin.JointModelUniversal(X, Y))
    ):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        parent = model.addJoint(parent, kind, place, f"j{i}")
        inertia = pin.Inertia(1.0, 0.2 * rng.normal(size=3), np.diag([0.2, 0.3, 0.4]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    home, data = rng.uniform(-0.7, 0.7, model.nq), model.createData()
    pin.forwardKinematics(model, data, home)
    first = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    model.addFrame(pin.Frame("on", parent, first, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("rail", 0, data.oMi[parent] * first, pin.FrameType.OP_FRAME))
    closure = rg.PrismaticClosure("on", "rail", axis=(0.3, 0.8, -0.2))
    return rg.Mechanism.from_pinocchio(model, [closure], ["j0"], home=home, name="sliding")


X, Y = np.eye(3)[:2]


class Rows:
    """Rows of φ at home moved at random, loops open."""

    def __init__(self, mech: rg.Mechanism) -> None:
        rng = np.random.default_rng(2)
        self.mech, self.rates, self.still = mech, ClosureRates(mech), np.zeros(mech.nv)
        self.q = mech.tree.integrate(mech.home, 0.3 * rng.normal(size=mech.nv))
        self.v, self.a = rng.normal(size=(2, mech.nv))

    def at(self, dq: Array, dv: Array) -> Any:
        place = self.rates.real(self.mech.tree.integrate(self.q, dq))
        return self.rates.products_at(place, self.v + dv, self.a)

    def slope(self, name: str) -> Array:
        return differences(lambda d: np.asarray(getattr(self.at(d, self.still), name)), self.mech.nv, 5e-3)


def test_every_kind_of_closure_row(mechanisms: dict[str, rg.Mechanism]) -> None:
    """φ, K, k as the constraint has them; ∂φ̇/∂q, ∂φ̈/∂q, ∂φ̈/∂v against differences."""
    made = {name: mech for name, mech in mechanisms.items() if mech.nc and name != "humanoid"}
    for mech in (*made.values(), geared(), sliding()):
        rows, scale = Rows(mech), 1.0 / mech.row_scale
        found, K = rows.at(rows.still, rows.still), (mech.K(rows.q).T * scale).T
        np.testing.assert_allclose(found.x, mech.phi(rows.q) * scale, atol=1e-13)
        np.testing.assert_allclose(found.x_q, K, atol=1e-12)
        np.testing.assert_allclose(found.dd, K @ rows.a - mech.k(rows.q, rows.v) * scale, atol=1e-11)
        assert off(found.d_q, rows.slope("d"), 1.0) < 1e-10, mech.name
        assert off(found.dd_q, rows.slope("dd"), 1.0) < 1e-10, mech.name
        by_v = differences(lambda d, r=rows: r.at(r.still, d).dd, mech.nv, 5e-3)  # type: ignore[misc]
        assert off(found.dd_v, by_v, 1.0) < 1e-10, mech.name


class TestStep:
    @staticmethod
    def errors(mech: rg.Mechanism, step: float, h: float, speed: float = 1.0) -> tuple[float, float]:
        q, u, v, tau = state(mech, speed)
        A, B = rg.step_jacobians(mech, q, v, tau, step)
        m, own = mech.m, mech.iv_independent

        def after(z: Array) -> tuple[Array, Array]:
            at = moved(mech, q, z[:m])
            start = at, mech.lift(at, u + z[m : 2 * m])
            sim = rg.Simulation(mech, *start, step=step, backend="python").step(tau + z[2 * m :])
            return sim.q, sim.v

        q1 = after(np.zeros(2 * m + mech.nv))[0]

        def change(z: Array) -> Array:
            at, w = after(z)
            return np.concatenate([mech.tree.difference(q1, at)[own], w[own]])

        exact = differences(change, 2 * m + mech.nv, h)
        return off(A, exact[:, : 2 * m]), off(B, exact[:, 2 * m :], 1e-3 * step)

    @pytest.mark.parametrize(
        ("name", "step", "h"),
        [("crank_rocker", 0.01, 0.01), ("five_bar", 0.01, 0.005), ("bricard", 0.01, 0.01)],
    )
    def test_shipped(self, name: str, step: float, h: float) -> None:
        assert max(self.errors(rg.load(name), step, h)) < 1e-9

    @pytest.mark.parametrize("name", FLOATING)
    def test_floating(self, name: str) -> None:
        """With a step so long that terms of the group's bracket count."""
        assert max(self.errors(floating(FLOATING[name]), 0.05, 5e-3, speed=2.0)) < 1e-9


class TestIdleSpin:
    """Single velocities of a ball in a loop: its other velocities and the chart of a step follow."""

    @pytest.mark.parametrize(
        "own",
        [
            pytest.param(("crank", "ball.rx"), id="fixed"),
            pytest.param(("base", "crank", "ball.ry"), id="free", marks=pytest.mark.campaign),
        ],
    )
    def test_derivatives_and_step(self, own: tuple[str, ...]) -> None:
        mech, rng = rssr(*own, floating="base" in own), np.random.default_rng(1)
        q, m, independent = mech.home, mech.m, mech.iv_independent
        u, tau = rng.normal(size=m), rng.normal(size=mech.nv)
        G, v = mech.G(q), mech.lift(mech.home, u)

        def moved_along(eta: Array) -> Array:  # any smooth curve with the tangent G η
            return mech.polish(mech.tree.integrate(q, G @ eta), np.arange(mech.nv))

        def by_state(z: Array) -> Array:
            at = moved_along(z[:m])
            return rg.forward_dynamics(mech, at, mech.lift(at, u + z[m:]), tau)

        found, exact = rg.derivatives(mech, q, v, tau), differences(by_state, 2 * m, 5e-3)
        assert off(np.hstack([found.da_dy, found.da_dv]), exact) < 1e-10
        A, B = rg.step_jacobians(mech, q, v, tau, 0.05)

        def after(z: Array) -> tuple[Array, Array]:
            at = moved_along(z[:m])
            start = at, mech.lift(at, u + z[m : 2 * m])
            sim = rg.Simulation(mech, *start, step=0.05, backend="python").step(tau + z[2 * m :])
            return sim.q, sim.v

        q1 = after(np.zeros(2 * m + mech.nv))[0]

        def change(z: Array) -> Array:
            at, w = after(z)
            return np.concatenate([mech.tree.difference(q1, at)[independent], w[independent]])

        assert off(np.hstack([A, B]), differences(change, 2 * m + mech.nv, 5e-3)) < 1e-10


class TestRegressor:
    @pytest.mark.parametrize("name", ("andrews", "stewart", "bricard", "seven hinges", "spherical loop"))
    def test_times_the_parameters_it_is_inverse_dynamics(
        self, name: str, mechanisms: dict[str, rg.Mechanism]
    ) -> None:
        mech = mechanisms[name]
        free = rg.Mechanism.from_pinocchio(mech.model, mech.closures, mech.independent, home=mech.home)
        q, _, v, _ = state(free)
        udot = np.random.default_rng(7).normal(size=free.m)
        found, exact = rg.regressor(free, q, v, udot), rg.inverse_dynamics(free, q, v, udot)
        assert off(found.matrix @ found.values, exact) < 1e-12

    def test_by_the_mass_of_a_link(self) -> None:
        """A link with twice the mass everywhere: the column sums of its body, by name."""
        model = rg.load("crank_rocker").model.copy()
        mech = rg.load("crank_rocker")
        model.inertias[2] = pin.Inertia(
            2.0 * model.inertias[2].mass, model.inertias[2].lever, 2.0 * model.inertias[2].inertia
        )
        heavy = rg.Mechanism.from_pinocchio(model, mech.closures, mech.independent, home=mech.home)
        q, _, v, _ = state(mech)
        found = rg.regressor(mech, q, v, [0.7])
        own = [i for i, name in enumerate(found.names) if name.startswith("q2.") and "armature" not in name]
        assert len(own) == 10
        more = rg.inverse_dynamics(heavy, q, v, [0.7]) - rg.inverse_dynamics(mech, q, v, [0.7])
        np.testing.assert_allclose(found.matrix[:, own] @ found.values[own], more, rtol=1e-12)

    def test_rotors(self) -> None:
        mech = rg.Mechanism.from_pinocchio(all_kinds())
        rng = np.random.default_rng(8)
        q = pin.integrate(mech.model, pin.neutral(mech.model), rng.normal(size=mech.nv))
        v, udot = rng.normal(size=(2, mech.nv))
        found = rg.regressor(mech, q, v, udot)
        assert found.names[-1] == "j11.rz.armature" and len(set(found.names)) == len(found.names)
        assert off(found.matrix @ found.values, rg.inverse_dynamics(mech, q, v, udot)) < 1e-12
