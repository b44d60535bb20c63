"""Forces of a user's own class: the same motion, energy balance and derivatives in every backend."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.dynamics import discrete
from robust_gcp.mechanism.forces.applied_forces import AppliedForces
from tests.compiled import KERNEL, needs_kernel

Array = NDArray[np.float64]
BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]


@dataclass(frozen=True)
class CubicSpring(rg.Force):
    """τ = −stiffness q³ on a joint with one number."""

    joint: str
    stiffness: float

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        joint, tau = mechanism.joint(self.joint), np.zeros(mechanism.nv)
        tau[joint.idx_v] = -self.stiffness * q[joint.idx_q] ** 3
        return tau

    def energy(self, mechanism: rg.Mechanism, q: Array) -> float:
        return float(0.25 * self.stiffness * q[mechanism.joint(self.joint).idx_q] ** 4)


@dataclass(frozen=True)
class SlopedSpring(CubicSpring):
    """The same, with derivatives of its own."""

    def derivatives(self, mechanism: rg.Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
        joint, by_q = mechanism.joint(self.joint), np.zeros((mechanism.nv, mechanism.nv))
        by_q[joint.idx_v, joint.idx_v] = -3.0 * self.stiffness * q[joint.idx_q] ** 2
        return by_q, 0.0 * by_q


@dataclass(frozen=True)
class Drag(rg.Force):
    """τ = −c |v| v on every velocity: all of it does work."""

    c: float

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        return -self.c * np.abs(v) * v


@dataclass(frozen=True)
class BallSpring(rg.Force):
    """A spherical joint is turned back to its neutral position, with a damper: ½ k φ² by the angle φ."""

    joint: str
    k: float
    damping: float = 0.0

    def _turn(self, mechanism: rg.Mechanism, q: Array) -> Array:
        at = mechanism.joint(self.joint).idx_q
        return np.asarray(pin.log3(pin.Quaternion(q[at : at + 4]).toRotationMatrix()))

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        tau, own = np.zeros(mechanism.nv), mechanism.joint(self.joint).v
        tau[own] = -self.k * self._turn(mechanism, q) - self.damping * v[own]
        return tau

    def energy(self, mechanism: rg.Mechanism, q: Array) -> float:
        turn = self._turn(mechanism, q)
        return 0.5 * self.k * float(turn @ turn)


@dataclass(frozen=True)
class Stiffening(rg.JointSpring):
    """Derived from a force of the package, and another one."""

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        return super().tau(mechanism, q, v) * (1.0 + q[mechanism.joint(self.joint).idx_q] ** 2)

    def energy(self, mechanism: rg.Mechanism, q: Array) -> float:
        return super().energy(mechanism, q) * (1.0 + 0.5 * float(q[mechanism.joint(self.joint).idx_q]) ** 2)


def with_forces(mech: rg.Mechanism, *forces: rg.Force) -> rg.Mechanism:
    return rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, mech.independent, mech.home, mech.name, forces
    )


def sprung() -> rg.Mechanism:
    return with_forces(rg.load("crank_rocker"), rg.JointDamper("q3", 0.3), CubicSpring("q1", 20.0))


@pytest.fixture(params=["crank rocker", "ball", "floating"])
def scene(request: Any, spatial: dict[str, rg.Mechanism]) -> rg.Mechanism:
    """Forces of all sorts, on numbers, on a spherical joint and on a floating base."""
    if request.param == "ball":
        return with_forces(
            spatial["spherical loop"], BallSpring("ball", 30.0, 0.5), rg.JointTorque("crank", 4.0)
        )
    if request.param == "floating":
        return with_forces(_floating(), Drag(0.4), CubicSpring("q1", 5.0))
    return sprung()


def _floating() -> rg.Mechanism:
    """A free body that carries a four-bar."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia(3.0, np.zeros(3), np.diag([0.2, 0.3, 0.4])), pin.SE3.Identity())

    def link(parent: int, y: float, name: str, size: float) -> int:
        place = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
        joint = model.addJoint(parent, pin.JointModelRX(), place, name)
        inertia = pin.Inertia(0.8, np.array([0.02, size / 2.0, 0.01]), 0.05 * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        return int(joint)

    q1 = link(base, 0.0, "q1", 0.5)
    q2, q3 = link(q1, 0.5, "q2", 1.0), link(base, 0.9, "q3", 0.8)
    for name, at, y in (("e2", q2, 1.0), ("e3", q3, 0.8)):
        place = pin.SE3(np.eye(3), np.array([0.0, y, 0.0]))
        model.addFrame(pin.Frame(name, at, place, pin.FrameType.OP_FRAME))
    home = pin.neutral(model)
    home[-3:] = (1.2, -0.9, 1.27)
    mech = rg.Mechanism.from_pinocchio(model, [rg.PointClosure("e2", "e3")], ["base", "q1"], home=home)
    mech.home = mech.assemble(home)
    return mech


def state(mech: rg.Mechanism, seed: int = 0) -> tuple[Array, Array]:
    """Home with a velocity that the loops allow."""
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, mech.m)
    q = mech.assemble(mech.home)
    return q, mech.lift(q, u)


# --------------------------------------------------------------------------- motions


@needs_kernel
def test_one_motion_in_both_backends(scene: rg.Mechanism) -> None:
    q, v = state(scene)
    options: dict[str, Any] = {"duration": 0.1, "step": 1e-3, "record": ("a", "energy", "tau")}
    one, other = (rg.simulate(scene, q, v, backend=name, **options) for name in ("python", "native"))
    assert other.stats.native_steps == 100
    for name in ("q", "v", "a", "tau", "energy", "work"):
        ours, theirs = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(theirs, ours, atol=1e-12 * np.abs(ours).max(), rtol=0.0, err_msg=name)


@pytest.mark.parametrize("backend", BACKENDS)
def test_energy_is_accounted_for_to_the_order_of_the_stepper(scene: rg.Mechanism, backend: Any) -> None:
    """By potential energies and by work: the error falls with h⁴ or faster, and is rounding's in the end."""
    q, v = state(scene)
    errors = [
        np.abs(rg.simulate(scene, q, v, 0.08, h, backend=backend).energy_error()).max() for h in (8e-3, 4e-3)
    ]
    assert errors[1] < max(errors[0] / 12.0, 1e-12)


def test_a_spring_does_no_work() -> None:
    mech = with_forces(rg.load("crank_rocker"), CubicSpring("q1", 20.0))
    run = rg.simulate(mech, duration=0.1, step=1e-3)
    assert run.work is not None
    assert np.abs(run.work).max() < 1e-14
    assert np.abs(run.energy_error()).max() < 1e-9


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("stepper", ["DOP853", "Radau"])
def test_solvers_know_it(backend: Any, stepper: str) -> None:
    mech = sprung()
    options: dict[str, Any] = {"duration": 0.03, "step": 0.03, "rtol": 1e-10, "atol": 1e-12}
    run = rg.simulate(mech, stepper=stepper, backend=backend, **options)
    exact = rg.simulate(mech, duration=0.03, step=5e-4, backend="python")
    np.testing.assert_allclose(run.q[-1], exact.q[-1], atol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_torques_act_beside_it(backend: Any) -> None:
    """A function, a constant and a torque that is held, each with the force's own."""
    mech = sprung()
    start = state(mech)
    push = np.array([3.0, 0.0, -2.0])
    whole = with_forces(mech, *mech.forces, rg.JointTorque("q1", 3.0), rg.JointTorque("q3", -2.0))
    options: dict[str, Any] = {"duration": 0.05, "step": 1e-3, "backend": backend, "record": ("energy",)}
    expected = rg.simulate(whole, *start, **options)
    simulation = rg.Simulation(mech, *start, step=1e-3, backend=backend, record=("energy",))
    for _ in range(25):
        simulation.step({"q1": 3.0, "q3": -2.0}).step(push)
    runs = [rg.simulate(mech, *start, torque=torque, **options) for torque in (push, lambda t, q, v: push)]
    for run in (*runs, simulation.trajectory):
        np.testing.assert_allclose(run.q, expected.q, atol=1e-12)
        np.testing.assert_allclose(run.energy, expected.energy, atol=1e-11)
        np.testing.assert_allclose(run.work, expected.work, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_simulation_takes_the_steps_of_a_run(scene: rg.Mechanism, backend: Any) -> None:
    start = state(scene)
    run = rg.simulate(scene, *start, duration=0.02, step=1e-3, backend=backend)
    simulation = rg.Simulation(scene, *start, step=1e-3, backend=backend)
    simulation.step(n=5)
    saved = simulation.save()
    simulation.step(n=7).restore(saved)
    for _ in range(15):
        simulation.step()
    np.testing.assert_array_equal(simulation.trajectory.q, run.q)
    assert run.work is not None
    np.testing.assert_array_equal(simulation.trajectory.work, run.work)


def test_many_starts_are_those_of_simulate(scene: rg.Mechanism) -> None:
    starts = [state(scene, seed) for seed in range(3)]
    options: dict[str, Any] = {"duration": 0.02, "step": 1e-3, "record": ("energy",)}
    for (q, v), run in zip(starts, rg.simulate_many(scene, starts, threads=2, **options), strict=True):
        one = rg.simulate(scene, q, v, **options)
        np.testing.assert_allclose(run.q, one.q, atol=1e-13)
        np.testing.assert_allclose(run.energy, one.energy, atol=1e-11)
        np.testing.assert_allclose(run.energy_error(), one.energy_error(), atol=1e-11)


def test_through_a_singular_configuration() -> None:
    """Into the zones of the kernel and out again, and into those of the reference."""
    mech = with_forces(rg.load("rhombus"), CubicSpring("q1", 4.0), Drag(0.02))
    runs = [
        rg.simulate(mech, duration=0.4, step=4e-3, backend=name)
        for name in (("python", "native") if KERNEL.available else ("python",))
    ]
    for run in runs:
        assert run.crossings
        assert np.abs(run.energy_error()).max() < 1e-6
        np.testing.assert_allclose(run.q, runs[0].q, atol=1e-9)


def test_a_stiff_one_is_told_of() -> None:
    mech = with_forces(rg.load("crank_rocker"), CubicSpring("q1", 1e9))
    said = pytest.warns(rg.StabilityWarning, match="lies outside the stability region")
    with said, suppress(rg.RobustGcpError):  # as the step deserves
        rg.simulate(mech, duration=2e-3, step=1e-3)


# --------------------------------------------------------------------------- derivatives


def by_differences(mech: rg.Mechanism, f: Callable[..., Array], q: Array, v: Array, h: float = 1e-5) -> Array:
    """∂f/∂(η, u) of f(q, v) at a state, η along G e_j and u held."""
    u = v[mech.iv_independent]

    def along(k: int, s: float) -> Array:
        y = np.zeros(mech.m)
        if k < mech.m:
            y[k] = s
            moved = mech.tree.integrate(q, mech.G(q) @ y)
            moved = mech.assemble(moved)
            return f(moved, mech.lift(moved, u))
        y[k - mech.m] = s
        return f(q, mech.lift(q, u + y))

    return np.array([(along(k, h) - along(k, -h)) / (2.0 * h) for k in range(2 * mech.m)]).T


def test_derivatives_are_those_of_the_motion() -> None:
    """By the reference and by whatever serves, against differences of either forward dynamics."""
    mech = with_forces(rg.load("crank_rocker"), CubicSpring("q1", 20.0), Drag(0.5), SlopedSpring("q3", 3.0))
    q, v = state(mech)
    for forward in (rg.forward_dynamics, reference.forward_dynamics):
        expected = by_differences(mech, partial(forward, mech), q, v)
        many = rg.derivatives(mech, np.tile(q, (2, 1)), np.tile(v, (2, 1)))
        for found in (rg.derivatives(mech, q, v), reference.derivatives(mech, q, v)):
            np.testing.assert_allclose(np.hstack([found.da_dy, found.da_dv]), expected, rtol=1e-7)
            np.testing.assert_allclose(many.da_dy[1], found.da_dy, rtol=1e-12)
    A = rg.linearise(mech, q, v).A
    np.testing.assert_allclose(A[mech.m :], expected, rtol=1e-7)


def test_derivatives_on_a_ball_and_on_a_floating_base(scene: rg.Mechanism) -> None:
    """Of τ itself, along the velocities' components, where nq is not nv."""
    q, v = state(scene)
    applied = scene.applied
    assert applied is not None
    found = rg.derivatives(scene, q, v)
    moved = np.zeros((scene.nv, 2 * scene.m))
    h = 1e-5
    for k in range(scene.m):
        way, fast = found.G[:, k], found.dv_dy[:, k]
        ends = [applied.tau(scene.tree.integrate(q, s * way), v + s * fast) for s in (h, -h)]
        moved[:, k] = (ends[0] - ends[1]) / (2.0 * h)
        moved[:, scene.m + k] = (applied.tau(q, v + h * way) - applied.tau(q, v - h * way)) / (2.0 * h)
    bare = with_forces(scene)
    held = rg.derivatives(bare, q, v, applied.tau(q, v))
    expected = np.hstack([held.da_dy, held.da_dv]) + held.da_dtau @ moved
    scale = np.abs(expected).max()
    np.testing.assert_allclose(np.hstack([found.da_dy, found.da_dv]), expected, atol=1e-8 * scale)
    np.testing.assert_allclose(
        rg.forward_dynamics(scene, q, v), held.udot, atol=1e-12 * np.abs(held.udot).max()
    )


def test_own_derivatives_are_taken() -> None:
    plain, sloped = (
        with_forces(rg.load("crank_rocker"), kind("q1", 20.0)) for kind in (CubicSpring, SlopedSpring)
    )
    q, v = state(plain)
    ours, theirs = (rg.derivatives(mech, q, v).da_dy for mech in (plain, sloped))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)
    assert ours[0, 0] != theirs[0, 0]  # by differences, and as they were given


def test_inverse_dynamics_is_the_inverse(scene: rg.Mechanism) -> None:
    q, v = state(scene)
    force = rg.inverse_dynamics(scene, q, v, rg.forward_dynamics(scene, q, v))
    assert np.abs(force).max() < 1e-9


def test_a_step_and_its_jacobians() -> None:
    mech = sprung()
    q, v = state(mech)
    h = 5e-3

    def after(q: Array, v: Array) -> Array:
        simulation = rg.Simulation(mech, q, v, step=h).step()
        return np.concatenate([simulation.y, simulation.v[mech.iv_independent]])

    expected = by_differences(mech, after, q, v)
    for A in (rg.step_jacobians(mech, q, v, None, h)[0], discrete.step_jacobians(mech, q, v, None, h)[0]):
        np.testing.assert_allclose(A, expected, atol=1e-7)


def test_the_gradient_of_a_run() -> None:
    """Against runs begun beside it; the stiffness of a known spring beside it is a parameter still."""
    mech = with_forces(rg.load("crank_rocker"), CubicSpring("q1", 20.0), Drag(0.2), rg.JointSpring("q3", 2.0))
    cost = rg.Cost(
        terminal=lambda q, v: float(q[0] ** 2 + v[0]),
        terminal_slopes=lambda q, v: (np.array([2.0 * q[0], 0.0, 0.0]), np.array([1.0, 0.0, 0.0])),
    )
    q, v = state(mech)

    def run(q: Array, v: Array) -> rg.Trajectory:
        return rg.simulate(mech, q, v, duration=0.06, step=2e-3)

    def value(q: Array, v: Array) -> Array:
        last = run(q, v)
        return np.array([last.q[-1, 0] ** 2 + last.v[-1, 0]])

    found = rg.gradient(run(q, v), cost, parameters=["q3.stiffness"])
    expected = by_differences(mech, value, q, v)[0]
    np.testing.assert_allclose(np.concatenate([found.dy, found.dv]), expected, rtol=1e-6)
    assert found.parameters["q3.stiffness"] != 0.0


def test_parameters_are_those_of_forces_that_are_known() -> None:
    """A force derived from a spring answers otherwise to its stiffness."""
    mech = with_forces(rg.load("crank_rocker"), Stiffening("q1", 5.0))
    run = rg.simulate(mech, duration=0.01, step=1e-3)
    cost = rg.Cost(terminal=lambda q, v: 0.0, terminal_slopes=lambda q, v: (0.0 * q, 0.0 * v))
    with pytest.raises(rg.OptionError, match=r"'q1\.stiffness' is none"):
        rg.gradient(run, cost, parameters=["q1.stiffness"])


# --------------------------------------------------------------------------- the contract


def test_a_force_derived_from_another_is_not_taken_for_it() -> None:
    q = np.array([0.5, 0.2, 0.3])
    mech, plain = (
        with_forces(rg.load("crank_rocker"), kind("q1", 5.0)) for kind in (Stiffening, rg.JointSpring)
    )
    assert mech.applied is not None
    assert plain.applied is not None
    np.testing.assert_allclose(mech.applied.tau(q, 0 * q), 1.25 * plain.applied.tau(q, 0 * q))


@pytest.mark.parametrize(
    "force",
    [
        rg.JointSpring("q1", 3.0, 0.2),
        rg.JointDamper("q2", 0.7),
        rg.JointTorque("q3", 2.0),
        rg.PointSpring("coupler_tip", "universe", 9.0, 0.3, 0.4),
    ],
    ids=lambda force: type(force).__name__,
)
def test_the_forces_of_the_package_keep_the_contract(force: rg.Force) -> None:
    """Each says of itself what all of them together amount to."""
    mech = with_forces(rg.load("crank_rocker"), force)
    applied = mech.applied
    assert isinstance(applied, AppliedForces)
    assert applied.own is None
    q, v = state(mech)
    np.testing.assert_allclose(force.tau(mech, q, v), applied.tau(q, v), atol=1e-14)
    assert force.energy(mech, q) == pytest.approx(applied.energy(q), abs=1e-14)
    by_q, by_v = (np.asarray(part) for part in force.derivatives(mech, q, v))
    found, bare = rg.derivatives(mech, q, v), rg.derivatives(with_forces(mech), q, v, force.tau(mech, q, v))
    expected = bare.da_dy + bare.da_dtau @ (by_q @ bare.G + by_v @ bare.dv_dy)
    np.testing.assert_allclose(found.da_dy, expected, rtol=1e-8)


@dataclass(frozen=True)
class Wrong(rg.Force):
    """Returns what it is given."""

    what: Any

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        return np.asarray(self.what)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (CubicSpring("q9", 1.0), r"no joint 'q9', only q1, q2, q3"),
        (Wrong(np.zeros(2)), r"Wrong.*: tau returned shape \(2,\), expected \(3,\)"),
        (Wrong("much"), r"Wrong.*: tau returned array.*, expected \(3,\) real numbers"),
        (CubicSpring, r"is not a JointSpring, .*, PointSpring, TendonSpring or another rg\.Force"),
    ],
)
def test_what_is_no_force_is_refused_by_name(force: Any, message: str) -> None:
    with pytest.raises(rg.ModelError, match=message):
        with_forces(rg.load("crank_rocker"), force)


def test_a_force_without_a_torque_is_none() -> None:
    with pytest.raises(TypeError, match="tau"):
        rg.Force()  # type: ignore[abstract]


@dataclass(frozen=True)
class Until(rg.Force):
    """Raises something, or gives something, once the crank is beyond an angle."""

    angle: float
    then: Any

    def tau(self, mechanism: rg.Mechanism, q: Array, v: Array) -> Array:
        if q[0] <= self.angle:
            return np.zeros(mechanism.nv)
        if isinstance(self.then, type):
            raise self.then
        return np.full(mechanism.nv, self.then)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("then", "error"),
    [(ZeroDivisionError, ZeroDivisionError), (KeyboardInterrupt,) * 2, (np.nan, rg.NonFiniteError)],
)
def test_what_it_raises_arrives(backend: Any, then: Any, error: type[BaseException]) -> None:
    """Through the kernel, in a run and between the steps of a simulation."""
    bare = rg.load("crank_rocker")
    q, v = bare.home, bare.lift(bare.home, [4.0])
    mech = with_forces(bare, Until(float(q[0]) + 0.05, then))
    with pytest.raises(error):
        rg.simulate(mech, q, v, duration=0.1, step=1e-3, backend=backend)
    simulation = rg.Simulation(mech, q, v, step=1e-3, backend=backend)
    with pytest.raises(error):
        for _ in range(100):
            simulation.step()
    assert 2 < len(simulation.trajectory.t) < 100


def test_mechanisms_with_it_are_pickled_and_saved(tmp_path: Path) -> None:
    """A file does not hold the class: it asks for the mechanism, by the force's name."""
    mech = sprung()
    again = pickle.loads(pickle.dumps(mech))
    assert again.forces == mech.forces
    run = rg.simulate(mech, duration=0.02, step=1e-3)
    np.testing.assert_array_equal(rg.simulate(again, duration=0.02, step=1e-3).q, run.q)
    path = run.save(tmp_path / "run.npz")
    with pytest.raises(
        rg.OptionError, match=r"class of the force CubicSpring\(joint='q1'.*give the mechanism"
    ):
        rg.load_trajectory(path)
    loaded = rg.load_trajectory(path, mech)
    np.testing.assert_array_equal(loaded.q, run.q)
    np.testing.assert_array_equal(loaded.energy_error(), run.energy_error())
    with pytest.raises(rg.OptionError, match="gravity or forces are at the start not those"):
        rg.load_trajectory(path, rg.load("crank_rocker"))
