"""The linearised equations against closed forms and Pinocchio's derivatives; RK4's bound on real runs."""

from __future__ import annotations

import cmath
import math
import warnings
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.equations import EquationsOfMotion
from robust_gcp.dynamics.linearise import ReducedJacobian, rk4_reach, stable_step
from robust_gcp.examples.linkages import add_link, four_bar
from robust_gcp.maps.closed_form import parallelogram_pendulum
from robust_gcp.maps.cluster.cluster_map import ClusterMap
from robust_gcp.maps.explicit import Counters
from robust_gcp.maps.start import initial_point
from robust_gcp.mechanism.tree.tree import Tree
from robust_gcp.reports.stability.bound import measure, systems
from robust_gcp.reports.stability.truth import with_forces

Array = NDArray[np.float64]
A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)


def rhombus(y: float, *forces: object) -> rg.Mechanism:
    return with_forces(four_bar(1.0, 1.0, 1.0, 1.0, y=y), forces)  # type: ignore[arg-type]


# --------------------------------------------------------------------------- RK4's region


def test_the_ends_of_the_axes() -> None:
    """R(z) = 1 for z³ + 4 z² + 12 z + 24 = 0 on the real axis; |R(iz)|² = 1 − z⁶/72 + z⁸/576, so z² = 8."""
    root = min(np.roots([1.0, 4.0, 12.0, 24.0]), key=lambda z: abs(z.imag)).real
    assert rk4_reach(math.pi) == pytest.approx(-root, rel=1e-11)
    assert rk4_reach(math.pi) == pytest.approx(2.785, abs=5e-4)
    assert rk4_reach(math.pi / 2) == pytest.approx(math.sqrt(8.0), rel=1e-9)


@pytest.mark.parametrize("angle", np.linspace(math.pi / 2, math.pi, 25))
def test_no_growth_up_to_the_reach_and_growth_beyond(angle: float) -> None:
    def growth(size: float) -> float:
        z = cmath.rect(size, angle)
        return abs(sum(z**n / math.factorial(n) for n in range(5)))

    reach = rk4_reach(angle)
    assert growth(reach) == pytest.approx(1.0, abs=1e-10)
    assert all(growth(s * reach) <= 1.0 + 1e-12 for s in np.linspace(0.0, 1.0, 200))
    assert growth(1.001 * reach) > 1.0


def test_motions_that_grow_of_themselves_do_not_limit_the_step() -> None:
    assert stable_step(1e9 + 0j) == math.inf
    assert stable_step(0j) == math.inf
    # a growing oscillation must still be resolved
    assert stable_step(1.0 + 100j) == pytest.approx(math.sqrt(8.0) / 100.0)
    assert stable_step(-8117.0 + 0j) == pytest.approx(2.7853 / 8117.0, rel=1e-5)


# --------------------------------------------------------------------------- A itself


@pytest.mark.parametrize("y", (0.5, 2.0, -2.5))
def test_the_rhombus_is_a_pendulum(y: float) -> None:
    """A ÿ = −B cos y − k (y − r) − c ẏ: ∂ÿ/∂y = (B sin y − k)/A, ∂ÿ/∂ẏ = −c/A."""
    k, c = 30.0, 4.0
    mech = rhombus(y, rg.JointSpring("q1", k, 0.3), rg.JointDamper("q1", c))
    found = rg.linearise(mech, mech.home, mech.lift(mech.home, [1.7]))
    exact = np.array([[0.0, 1.0], [(B * math.sin(y) - k) / A, -c / A]])
    np.testing.assert_allclose(found.A, exact, atol=1e-8)
    np.testing.assert_allclose(
        np.sort_complex(found.eigenvalues), np.sort_complex(np.linalg.eigvals(exact)), atol=1e-8
    )


@pytest.mark.parametrize("y", (0.0, math.pi))
def test_at_a_singular_configuration_the_bridge_serves(y: float) -> None:
    """The same pendulum where K has lost a rank: ∂ÿ/∂y = B sin y / A = 0 there, and −k/A from a spring."""
    k = 12.0
    mech = rhombus(0.5, rg.JointSpring("q1", k, y))
    q = y * np.array([1.0, -1.0, 1.0])
    found = rg.linearise(mech, q, mode=[1.0, -1.0, 1.0])
    np.testing.assert_allclose(found.A, [[0.0, 1.0], [-k / A, 0.0]], atol=1e-7)
    assert found.largest_stable_step == pytest.approx(math.sqrt(8.0 * A / k), rel=1e-6)


def test_a_tree_against_pinocchio() -> None:
    """No loops: Pinocchio's derivatives of the forward dynamics, the springs' and dampers' slopes added."""
    model = rg.load("rhombus").model
    k, c = np.array([40.0, 5.0, 9.0]), np.array([0.5, 0.0, 2.0])
    forces: list[object] = [rg.JointSpring(f"q{i + 1}", k[i], 0.1) for i in range(3)]
    forces += [rg.JointDamper(f"q{i + 1}", c[i]) for i in range(3)]
    mech = rg.Mechanism.from_pinocchio(model, forces=forces)  # type: ignore[arg-type]
    q, v = np.array([0.3, -1.1, 0.7]), np.array([1.0, -2.0, 0.5])
    data = model.createData()
    pin.computeABADerivatives(model, data, q, v, -k * (q - 0.1) - c * v)
    M = pin.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    exact = np.zeros((6, 6))
    exact[:3, 3:] = np.eye(3)
    exact[3:, :3] = data.ddq_dq - np.linalg.solve(M, np.diag(k))
    exact[3:, 3:] = data.ddq_dv - np.linalg.solve(M, np.diag(c))
    found = rg.linearise(mech, q, v)
    np.testing.assert_allclose(found.A, exact, atol=1e-9 * np.abs(exact).max())


class Analytic:
    """∂ÿ/∂(y, ẏ) of loops closed by points, from Pinocchio's derivatives of RNEA and of point motions.

    K v = 0 and K a = k are differentiated along y: with δv = K_d⁻¹ (…) and δa alike, the projected
    equation Gᵀ r = 0, r = −RNEA(q, v, a) = Kᵀ μ, gives Gᵀ δr + (δG)ᵀ r = 0 with (δG)ᵀ r = −(δK G)ᵀ μ.
    """

    def __init__(self, mech: rg.Mechanism) -> None:
        self.mech, self.model, self.data = mech, mech.model, mech.model.createData()
        frames = self.model.frames
        self.pairs = [[frames[self.model.getFrameId(n)] for n in (c.frame1, c.frame2)] for c in mech.closures]

    def motion(self, q: Array, v: Array, a: Array) -> tuple[Array, ...]:
        """∂(K v)/∂q, ∂(acceleration)/∂q, ∂(acceleration)/∂v and K, of all points' differences."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.computeForwardKinematicsDerivatives(self.model, self.data, q, v, a)
        rows: list[list[Array]] = []
        for pair in self.pairs:
            parts = []
            for frame in pair:
                where = (self.model, self.data, frame.parentJoint, frame.placement, axes)
                v_q, v_v = pin.getPointVelocityDerivatives(*where)
                a_q, a_v = pin.getPointClassicAccelerationDerivatives(*where)[-3:-1]
                parts.append([v_q, a_q, a_v, v_v])
            rows.append([one - two for one, two in zip(*parts, strict=True)])
        return tuple(np.vstack(block) for block in zip(*rows, strict=True))

    def __call__(self, q: Array, G: Array, g: Array, ydot: Array, ydd: Array) -> Array:
        mech, m = self.mech, self.mech.m
        v, a = G @ ydot, G @ ydd + g
        pin.computeRNEADerivatives(self.model, self.data, q, v, a)
        tau_q, tau_v = self.data.dtau_dq.copy(), self.data.dtau_dv.copy()
        M = np.triu(self.data.M) + np.triu(self.data.M, 1).T
        r = -pin.rnea(self.model, self.data, q, v, a)
        v_q, a_q, a_v, K = self.motion(q, v, a)
        solve = np.zeros((mech.nv, len(K)))
        solve[mech.iv_dependent] = np.linalg.pinv(K[:, mech.iv_dependent])
        mu = np.linalg.lstsq(K.T, r, rcond=1e-10)[0]
        dv = -solve @ v_q @ G
        da_y, da_v = -solve @ (a_q @ G + a_v @ dv), -solve @ a_v @ G
        turned = np.array([-mu @ self.motion(q, G[:, i].copy(), 0 * v)[0] @ G for i in range(m)])
        mass = G.T @ M @ G
        by_y = np.linalg.solve(mass, turned - G.T @ (tau_q @ G + tau_v @ dv + M @ da_y))
        by_v = np.linalg.solve(mass, -G.T @ (tau_v @ G + M @ da_v))
        return np.hstack([by_y, by_v])


@pytest.mark.parametrize("name", ("rhombus", "change_point", "crank_rocker", "five_bar", "strandbeest"))
def test_closed_loops_against_an_analytic_jacobian(name: str) -> None:
    """Central differences to 1e-9 of the largest entry, forward ones to 1e-6."""
    mech = rg.load(name)
    v = mech.lift(mech.home, 1.3 * np.arange(1.0, mech.m + 1.0))
    start = initial_point(mech, mech.home, v, None, rg.BridgeOptions(), Counters())
    equations = EquationsOfMotion(mech, ClusterMap(start.path, start.point, rg.BridgeOptions(), True))
    x = np.concatenate([start.point.y, start.ydot])
    ydd = equations.evaluate(0.0, x).ydd
    exact = Analytic(mech)(start.point.q, start.point.G, start.point.g, start.ydot, ydd)
    for central, allowed in ((True, 1e-9), (False, 1e-6)):
        found = ReducedJacobian(equations, central)(0.0, x)
        np.testing.assert_array_equal(found[: mech.m], np.eye(mech.m, 2 * mech.m, mech.m))
        assert np.abs(found[mech.m :] - exact).max() <= allowed * np.abs(exact).max()


def test_the_flyball_governor_of_the_benchmark() -> None:
    """−8117 1/s at its start (IFToMM A05)."""
    mech = rg.load("flyball")
    found = rg.linearise(mech, mech.home, [2.0 * np.pi, 0.0, 0.0, 0.0])
    assert found.eigenvalues[0].real == pytest.approx(-8117.0, abs=0.5)
    assert found.limiting == found.eigenvalues[0]


def test_the_work_is_no_part_of_the_motion() -> None:
    """Its column is zero: nothing depends on W; its row is the slope of the power −c ẏ²."""
    c, speed = 4.0, 1.5
    mech = rhombus(0.5, rg.JointDamper("q1", c))
    start = initial_point(
        mech, mech.home, mech.lift(mech.home, [speed]), None, rg.BridgeOptions(), Counters()
    )
    equations = EquationsOfMotion(mech, ClusterMap(start.path, start.point, rg.BridgeOptions()))
    found = ReducedJacobian(equations)(0.0, np.array([0.5, speed, 7.0]))
    np.testing.assert_array_equal(found[:, 2], 0.0)
    np.testing.assert_allclose(found[2, :2], [0.0, -2.0 * c * speed], atol=1e-6)


def test_bad_input_is_named() -> None:
    mech = rg.load("rhombus")
    with pytest.raises(rg.OptionError, match="load\\('rhombus'\\)"):
        rg.linearise("rhombus", mech.home)  # type: ignore[arg-type]
    with pytest.raises(rg.OptionError, match="t = nan"):
        rg.linearise(mech, mech.home, t=float("nan"))
    with pytest.raises(rg.SingularStartError):
        rg.linearise(mech, [0.0, 0.0, 0.0])
    with pytest.raises(rg.StateError, match=r"q has shape \(1, 3\)"):
        rg.linearise(mech, [mech.home])


# --------------------------------------------------------------------------- confirmed on runs


@pytest.mark.parametrize(
    "name",
    ["spring 1e2", "spring 1e8", "damper 1e2", "damper 1e8", "spring 1e6, damping ratio 0.7",
     "change point, spring 1e6 on q3", "flyball at its start"],
)  # fmt: skip
def test_bisection_on_real_runs_finds_the_predicted_step(name: str) -> None:
    """Within 2 %: the step at which a small error no longer dies away in 60 steps."""
    assert measure(name, systems(False)[name]).ratio == pytest.approx(1.0, abs=0.02)


# --------------------------------------------------------------------------- the warning


def warned(run: Callable[[], object]) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run()
    return [str(w.message) for w in caught if issubclass(w.category, rg.StabilityWarning)]


def test_a_run_that_starts_outside_is_warned_once_with_the_largest_step() -> None:
    """ẏ' = −(c/A) ẏ: λ = −300 1/s allows 9.28 ms."""
    mech = rhombus(0.5, rg.JointDamper("q1", 300.0 * A))
    (message,) = warned(lambda: rg.simulate(mech, duration=0.1, step=0.01))
    assert "eigenvalue -300" in message
    assert "steps up to 0.009284 s" in message
    assert "Radau" in message
    assert not warned(lambda: rg.simulate(mech, duration=0.1, step=0.0092))
    assert not warned(lambda: rg.simulate(mech, duration=0.1, step=0.01, stepper="Radau"))


def test_motions_that_grow_or_are_slow_give_no_warning() -> None:
    """Positive feedback: λ = +30 1/s, hλ = 3. And the rhombus near its upright, unstable place."""
    mech = rhombus(0.5)

    def push(t: float, q: Array, v: Array) -> Array:
        return np.array([30.0 * A * v[0], 0.0, 0.0])

    assert rg.linearise(mech, mech.home, torque=push).eigenvalues[0].real == pytest.approx(30.0, rel=0.02)
    assert not warned(lambda: rg.simulate(mech, duration=0.2, step=0.1, torque=push))
    assert not warned(lambda: rg.simulate(rhombus(1.5), duration=0.5, step=0.1))


def test_the_check_costs_no_right_hand_side_and_spares_singular_starts() -> None:
    """It works beside the run: four evaluations a step, one at the end, whatever the start."""
    mech = rg.load("rhombus")
    assert rg.simulate(mech, duration=0.01).stats.rhs == 41
    at_once = rg.simulate(mech, [0.0, 0.0, 0.0], mode=[1.0, -1.0, 1.0], duration=0.01)
    assert at_once.stats.rhs == 41


def test_what_cannot_be_linearised_is_left_to_the_run() -> None:
    """A stop that pushes back with 1e305 N m has no finite slope; a motion that leaves it is no worse."""
    mech = rhombus(0.5)

    def stop(t: float, q: Array, v: Array) -> Array:
        return np.array([1e305 if v[0] > 0.0 else 0.0, 0.0, 0.0])

    with pytest.raises(rg.NonFiniteError, match=r"linearisation at y = .* is not finite"):
        rg.linearise(mech, mech.home, torque=stop)
    held = rg.simulate(mech, duration=0.1, torque=stop)
    np.testing.assert_array_equal(held.q, rg.simulate(mech, duration=0.1, torque=np.zeros(3)).q)


def test_implicit_steppers_pass_a_stiff_drive_at_once() -> None:
    """λ = −3.4e6 1/s for 0.5 s: RK4 would need 6e5 steps, each of these a thousandth of that."""
    mech = rhombus(0.5, rg.JointDamper("q1", 1e6 * np.sqrt(A * B)))
    largest = rg.linearise(mech, mech.home).largest_stable_step
    for stepper in ("Radau", "BDF", "LSODA"):
        run = rg.simulate(mech, duration=0.5, step=0.1, stepper=stepper, rtol=1e-6)
        # it creeps at the terminal speed −B cos y / c
        assert run.v[-1, 0] == pytest.approx(-B * np.cos(run.q[-1, 0]) / (1e6 * np.sqrt(A * B)), rel=1e-3)
        assert run.stats.rhs < 1e-3 * 4.0 * 0.5 / largest


@pytest.mark.parametrize("stiffness", [1e2, 1e5, 1e8])
@pytest.mark.parametrize("damped", [False, True])
def test_many_coordinates_are_judged_by_a_few_directions(stiffness: float, damped: bool) -> None:
    """What limits the step of a chain of 20 hinges is found by 17 right-hand sides as by 41."""
    force = rg.JointDamper("j7", stiffness) if damped else rg.JointSpring("j10", stiffness)
    chain = rg.Mechanism.from_pinocchio(hinges(20), forces=[force])
    largest = rg.linearise(chain, chain.home).largest_stable_step
    for step, warned in ((1.2 * largest, True), (0.8 * largest, False)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            rg.simulate(chain, duration=step, step=step)
        assert any(issubclass(w.category, rg.StabilityWarning) for w in caught) is warned


def test_a_long_chain_costs_a_few_right_hand_sides() -> None:
    chain = rg.Mechanism.from_pinocchio(hinges(60))
    run = rg.simulate(chain, duration=3e-3, step=1e-3, backend="python")
    assert run.stats.rhs < 15
    counted = EquationsOfMotion.__call__
    calls = 0

    def counting(self: EquationsOfMotion, t: float, x: Array) -> Array:
        nonlocal calls
        calls += 1
        return counted(self, t, x)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EquationsOfMotion, "__call__", counting)
        rg.simulate(chain, duration=3e-3, step=1e-3, backend="python")
    assert calls < 32


def test_open_chains_need_no_sum_over_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """M of a tree holds no differences, however much heavier the first joint's motion is than the last's."""
    chain = rg.Mechanism.from_pinocchio(hinges(60))

    kinetic, calls = Tree.kinetic, 0

    def counting(self: Tree, q: Array, v: Array) -> float:
        nonlocal calls
        calls += 1
        return kinetic(self, q, v)

    monkeypatch.setattr(Tree, "kinetic", counting)
    rg.simulate(chain, duration=1e-3, step=1e-3, backend="python")
    assert calls < 60  # the energy of a few outputs, not one for each pair of coordinates


def hinges(count: int) -> pin.Model:
    """Rods of a metre in a row."""
    model, parent = pin.Model(), 0
    for i in range(count):
        parent = add_link(model, parent, 0.0 if i == 0 else 1.0, f"j{i}", 1.0)
    return model


def test_a_rod_on_a_turning_arm() -> None:
    """Without gravity the centrifugal force holds it outward: ω² L (l/2) φ = −(l²/3) φ̈, by drive alone."""
    model = pin.Model()
    model.gravity.linear[:] = 0.0
    add_link(model, add_link(model, 0, 0.0, "a", 1.0), 1.0, "b", 1.0)
    arm = rg.Mechanism.from_pinocchio(model)
    omega = 3.0
    turn = {"a": rg.Motion(lambda t: 0.4 + omega * t)}
    found = rg.linearise(arm, [0.4 + omega * 0.5, 0.0], [omega, 0.0], t=0.5, drive=turn)
    np.testing.assert_allclose(found.A, [[0.0, 1.0], [-1.5 * omega**2, 0.0]], atol=1e-6)
    assert found.largest_stable_step == pytest.approx(math.sqrt(8.0 / 1.5) / omega, rel=1e-6)
    with pytest.raises(rg.StateError, match="its drive begins"):
        rg.linearise(arm, [0.0, 0.0], [omega, 0.0], t=0.5, drive=turn)
