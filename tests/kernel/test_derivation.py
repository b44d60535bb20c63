"""Derivatives, Jacobians of steps and gradients by the compiled kernel against the Python reference."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics import derivatives as reference
from robust_gcp.dynamics import discrete
from robust_gcp.dynamics import linearise as by_reference
from robust_gcp.dynamics.modes.mode_rates import ZONE
from robust_gcp.dynamics.problem import initial_value_problem
from robust_gcp.examples.legged import legged
from robust_gcp.examples.linkages import four_bar, n_four_bar
from robust_gcp.kernel.derivatives.derivations import derivation
from robust_gcp.mechanism.tree.joints import JointKind
from robust_gcp.reports.stability.truth import with_forces
from robust_gcp.simulation.derivatives import reverse_sweep

from ..compiled import needs_kernel, stepped
from ..dynamics.test_derivatives import FLOATING, floating, geared
from ..simulation.test_idle_spins import rssr

Array = NDArray[np.float64]

pytestmark = needs_kernel

ROBOTS = Path(os.environ.get("ROBUST_GCP_ROBOTS", Path(__file__).parents[3] / "shared" / "robots"))

SAME = 1e-12
"""Of the largest entry."""

STEPS = {"andrews": 3e-5, "flyball": 1e-4, "stewart": 1e-3}
"""s; of others 1e-2."""


def sprung() -> rg.Mechanism:
    """A four-bar with springs, dampers and drives of all kinds, rotors, and a spring across bodies."""
    forces = [
        rg.JointSpring("q1", 30.0, 0.3),
        rg.JointDamper("q2", 4.0),
        rg.JointTorque("q3", -2.0),
        *(rg.PointSpring(*ends) for ends in (("link1", "link3", 20.0, 0.4, 1.5), ("universe", "link2", 9.0))),
    ]
    model = pin.Model(four_bar(1.0, 0.9, 1.2, 1.1, y=0.7).model)
    model.armature = np.array([0.3, 0.1, 0.2])
    for j in (1, 2, 3):
        place = pin.SE3(np.eye(3), np.array([0.3, 0.1 * j, 0.2]))
        model.addFrame(pin.Frame(f"link{j}", j, place, pin.FrameType.OP_FRAME))
    mech = four_bar(1.0, 0.9, 1.2, 1.1, y=0.7)
    made = rg.Mechanism.from_pinocchio(model, mech.closures, ["q1"], home=mech.home)
    return with_forces(made, tuple(forces))


def welded() -> rg.Mechanism:
    """A swinging arm and a hinge on the same axis whose directions must agree, by rows of rotation alone."""
    model = pin.Model()
    for name in ("arm", "hand"):
        joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), name)
        inertia = pin.Inertia(1.0, np.array([0.0, 0.4, 0.1]), np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_end", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    closure = rg.FrameClosure("arm_end", "hand_end")
    return rg.Mechanism.from_pinocchio(model, [closure], ["arm"], home=np.array([0.4, 0.4]))


def branching(seed: int) -> rg.Mechanism:
    """Random hinges, slides and a ball on a floating base, and two of its arms tied to a loop in space."""
    rng, model = np.random.default_rng(seed), pin.Model()
    kinds = [
        pin.JointModelRX(),
        pin.JointModelRZ(),
        pin.JointModelPY(),
        pin.JointModelRevoluteUnaligned(0.6, 0.0, 0.8),
    ]
    at = [model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")]
    free = ["base"]
    for i in range(7):
        kind = pin.JointModelSpherical() if i == 3 else kinds[int(rng.integers(4))]
        place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.5 * rng.normal(size=3))
        # depth first: on any joint on the way to the last one
        way = [*list(model.supports[at[-1]])[1:]]
        at.append(model.addJoint(int(way[int(rng.integers(len(way)))]), kind, place, f"j{i}"))
        free.append(f"j{i}")
    # a loop in space: two arms of three hinges from one body, joined by a point
    way = list(model.supports[at[-1]])[1:]
    root, arms = int(way[int(rng.integers(len(way)))]), []
    for side in "ab":
        parent = root
        for i in range(3):
            axis = pin.exp3(rng.normal(size=3))[0]
            place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.4 * rng.normal(size=3))
            parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(*axis), place, f"{side}{i}")
            at.append(parent)
        arms.append(parent)
    for joint in at:
        sides = rng.uniform(0.05, 0.1, 3)
        inertia = pin.Inertia(rng.uniform(0.5, 2.0), 0.1 * rng.normal(size=3), np.diag(sides))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.armature = rng.uniform(0.0, 0.2, model.nv)
    home, data = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)), None
    data = model.createData()
    pin.framesForwardKinematics(model, data, home)
    there = data.oMi[arms[0]].act(np.array([0.1, 0.2, 0.1]))
    for name, joint in zip(("tip_a", "tip_b"), arms, strict=True):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), data.oMi[joint].actInv(there))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    forces = [rg.PointSpring("tip_a", "universe", 7.0, 0.3, 0.4), rg.JointDamper("base", 0.3)]
    return rg.Mechanism.from_pinocchio(
        model, [rg.PointClosure("tip_a", "tip_b")], [*free, "a0", "a1", "b0"], home=home, forces=forces
    )


def serial(length: int) -> rg.Mechanism:
    """A chain of hinges without loops: each is carried by all before it."""
    rng, model, parent = np.random.default_rng(0), pin.Model(), 0
    for i in range(length):
        axis = pin.JointModelRevoluteUnaligned(*pin.exp3(rng.normal(size=3))[0])
        place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.3 * rng.normal(size=3))
        parent = model.addJoint(parent, axis, place, f"j{i}")
        inertia = pin.Inertia(1.0, 0.1 * rng.normal(size=3), np.diag([0.1] * 3))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    model.armature = np.full(length, 10.0)  # or M_r has a conditioning of 1e5
    return rg.Mechanism.from_pinocchio(model, [], [f"j{i}" for i in range(length)])


def grove(tied: bool) -> rg.Mechanism:
    """Two branching trees on the ground, their coordinates out of order, or with a spring between them."""
    rng, model, names = np.random.default_rng(5), pin.Model(), []
    for tree in "ab":
        for i, parent in enumerate(("", "0", "1", "1", "0", "4", "4")):
            above = model.getJointId(f"{tree}{parent}") if parent else 0
            axis = pin.JointModelRevoluteUnaligned(*pin.exp3(rng.normal(size=3))[0])
            place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.4 * rng.normal(size=3))
            joint = model.addJoint(above, axis, place, f"{tree}{i}")
            model.appendBodyToJoint(
                joint, pin.Inertia(1.0, 0.1 * rng.normal(size=3), np.eye(3)), pin.SE3.Identity()
            )
            model.addFrame(pin.Frame(f"{tree}{i} tip", joint, place, pin.FrameType.OP_FRAME))
            names.append(f"{tree}{i}")
    forces = [rg.PointSpring("a3 tip", "b5 tip", 7.0, 0.3, 0.4)] if tied else []
    return rg.Mechanism.from_pinocchio(model, [], list(rng.permutation(names)), forces=forces)


MADE: dict[str, Callable[[], rg.Mechanism]] = {
    **{name: (lambda name=name: rg.load(name)) for name in rg.model_names()},
    **{f"on a {name} joint": (lambda joint=joint: floating(joint)) for name, joint in FLOATING.items()},
    "geared": geared,
    "sprung": sprung,
    **{f"serial of {n}": (lambda n=n: serial(n)) for n in (9, 60)},
    **{
        name: (lambda tied=tied: grove(tied)) for name, tied in (("trees apart", False), ("trees tied", True))
    },
    "five four-bars in a row": lambda: n_four_bar(5, 1.2),
    "legged": lambda: legged(4),
    "legged and floating": lambda: legged(3, floating=True),
    **{f"branching {seed}": (lambda seed=seed: branching(seed)) for seed in (0, 1, 2, 4, 6, 7)},
}


def state(mech: rg.Mechanism, seed: int = 3) -> tuple[Array, Array, Array]:
    """Home, velocities and torques, reproducible."""
    rng = np.random.default_rng(seed)
    return mech.home, mech.lift(mech.home, rng.normal(size=mech.m)), rng.normal(size=mech.nv)


def same(found: Any, exact: Any, share: float = SAME) -> None:
    """All parts, relative to the largest entry of each."""
    for part in fields(rg.Derivatives):
        one, other = getattr(found, part.name), getattr(exact, part.name)
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=0.0, atol=share * max(np.abs(other).max(), 1e-2))


class TestDerivatives:
    @pytest.mark.parametrize("name", MADE)
    def test_as_the_reference(self, name: str) -> None:
        mech = MADE[name]()
        q, v, tau = state(mech)
        kernel = derivation(mech, q)
        assert kernel is not None
        found = kernel.slopes(q[None], v[None], tau[None])
        assert found.good.all()
        exact = reference.derivatives(mech, q, v, tau)
        same(found.of_state(0), exact)
        same(rg.derivatives(mech, q, v, tau), exact)
        np.testing.assert_array_equal(rg.forward_dynamics(mech, q, v, tau), found.udot[0])

    @pytest.mark.parametrize("name", ("tripod", "spherical loop", "seven hinges", "humanoid"))
    def test_in_space(self, name: str, spatial: dict[str, rg.Mechanism]) -> None:
        mech = spatial[name]
        q, v, tau = state(mech)
        assert derivation(mech, q) is not None
        same(rg.derivatives(mech, q, v, tau), reference.derivatives(mech, q, v, tau))

    @pytest.mark.parametrize(
        "own", (("crank", "ball.rx"), ("base", "crank", "ball.ry"), ("base", "crank", "ball.rx"))
    )
    def test_idle_spins(self, own: tuple[str, ...]) -> None:
        """Single velocities of a ball in a loop are independent: the fields G e_j do not commute."""
        mech = rssr(*own, floating="base" in own)
        model = mech.model.copy()
        model.armature = np.random.default_rng(2).uniform(0.0, 0.5, model.nv)
        mech = rg.Mechanism.from_pinocchio(model, mech.loops, own, home=mech.home)
        q, v, tau = state(mech)
        kernel = derivation(mech, q)
        assert mech.chart_joints and kernel is not None
        same(rg.derivatives(mech, q, v, tau), reference.derivatives(mech, q, v, tau))
        assert stepped(kernel, q[None], v[None], tau[None], 0.01) is None, "steps are the reference's"
        for one, other in zip(
            rg.step_jacobians(mech, q, v, tau, 0.01),
            discrete.step_jacobians(mech, q, v, tau, 0.01),
            strict=True,
        ):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(rg.linearise(mech, q, v).A, by_reference.linearise(mech, q, v).A)

    @pytest.mark.parametrize("name", ("delta", "tripod", "spherical loop"))
    def test_rotors_on_balls_in_loops(self, name: str, spatial: dict[str, rg.Mechanism]) -> None:
        """Their velocities are no rates of numbers: ∂a/∂u is not 2 ∂v/∂y there."""
        bare = spatial[name] if name in spatial else rg.load(name)
        model = bare.model.copy()
        model.armature = np.random.default_rng(2).uniform(0.0, 0.5, model.nv)
        mech = rg.Mechanism.from_pinocchio(model, bare.loops, bare.independent, home=bare.home)
        assert any(j.kind in (JointKind.SPHERICAL, JointKind.FREE_FLYER) for j in mech.joints), name
        q, v, tau = state(mech)
        assert derivation(mech, q) is not None
        same(rg.derivatives(mech, q, v, tau), reference.derivatives(mech, q, v, tau))

    @pytest.mark.skipif(not ROBOTS.is_dir(), reason="no folder of robots: name one in ROBUST_GCP_ROBOTS")
    @pytest.mark.parametrize(
        "name", ("gepetto/cassie_like", "gepetto/digit_like_2legs", "robotiq_2f85/2f85.xml", "agility_cassie")
    )
    def test_robots(self, name: str) -> None:
        """Their reduced inertia has a conditioning of 1e5: the last place of q shows."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rg.ModelWarning)
            mech = rg.load(ROBOTS / name)
        q, v, tau = state(mech)
        assert derivation(mech, q) is not None
        found = rg.derivatives(mech, q, v, tau)
        size, rng = np.abs(found.udot).max(), np.random.default_rng(4)
        rounded = (q * (1.0 + 2.0**-52 * rng.choice([-1, 0, 1], size=q.shape)) for _ in range(20))
        moved = max(np.abs(rg.forward_dynamics(mech, p, v, tau) - found.udot).max() for p in rounded) / size
        assert moved < 1e-10
        same(found, reference.derivatives(mech, q, v, tau), 1e-11 + moved)

    @pytest.mark.parametrize("name", ("change_point", "delta", "on a free joint", "branching 2"))
    def test_many_states_at_once(self, name: str) -> None:
        """Those in the zone of a singular place, too, which the reference does."""
        mech = MADE[name]()
        q0, v0, tau = state(mech)
        run = rg.simulate(
            mech, q0, v0, duration=1.0 if name == "change_point" else 0.05, step=5e-3, torque=tau
        )
        q, v = run.q[::10], run.v[::10]
        many = rg.derivatives(mech, q, v, tau)
        for i in range(len(q)):
            one = reference.derivatives(mech, q[i], v[i], tau)
            # second derivatives of γ round by ε/σ⁴, whoever takes them: ten roundings
            sigma = initial_value_problem(mech, q[i], v[i]).start.point.conditioning
            rounding = 2e-15 * (1.0 + np.abs(v[i]).max() ** 2) / max(sigma, ZONE) ** 4
            for part in fields(rg.Derivatives):
                found, exact = getattr(many, part.name)[i], getattr(one, part.name)
                atol = SAME * max(np.abs(exact).max(), 1e-2) + rounding
                np.testing.assert_allclose(found, exact, rtol=0.0, atol=atol)

    def test_at_rest_without_torques(self) -> None:
        mech = rg.load("walker")
        same(rg.derivatives(mech, mech.home), reference.derivatives(mech, mech.home))
        none = rg.derivatives(mech, np.zeros((0, mech.nq)))
        assert none.da_dtau.shape == (0, mech.m, mech.nv)

    def test_far_from_the_origin(self) -> None:
        """A floating base a kilometre away has the same derivatives but for rounding."""
        mech = floating(FLOATING["free"])
        mech = rg.Mechanism.from_pinocchio(mech.model, mech.closures, ["base", "q1"], home=mech.home)
        q, v, tau = state(mech)
        away = q.copy()
        away[:3] += (1000.0, -700.0, 400.0)
        same(rg.derivatives(mech, away, v, tau), rg.derivatives(mech, q, v, tau), 1e-11)

    def test_linearise(self) -> None:
        for name in ("five_bar", "on a free joint", "on a planar joint", "sprung"):
            mech = MADE[name]()
            q, v, tau = state(mech)
            found, exact = (f(mech, q, v, tau).A for f in (rg.linearise, by_reference.linearise))
            np.testing.assert_allclose(found, exact, rtol=0.0, atol=SAME * np.abs(exact).max())


class TestWhatIsLeftToTheReference:
    def test_singular_places(self) -> None:
        mech = rg.load("rhombus")
        for mode in rg.analyse(mech, np.zeros(3)).modes[:1]:
            found = rg.derivatives(mech, np.zeros(3), 2.0 * mode, mode=mode)
            same(found, reference.derivatives(mech, np.zeros(3), 2.0 * mode, mode=mode))
        near, other = mech.assemble(np.array([1e-3, -1e-3, 1e-3])), rg.load("rhombus")
        for of, known in ((mech, True), (other, False)):  # what a call has told a mechanism's kernel it keeps
            kernel = derivation(of, of.home)
            assert kernel is not None
            assert kernel.slopes(near[None], np.zeros((1, 3)), None).good[0] == known
            exact = reference.derivatives(of, near).da_dy
            np.testing.assert_allclose(rg.derivatives(of, near).da_dy, exact, rtol=1e-9)

    def test_open_loops_and_velocities_that_break_them(self) -> None:
        mech = rg.load("crank_rocker")
        q, v, _ = state(mech)
        rg.derivatives(mech, q, v)
        for call in (rg.derivatives, rg.forward_dynamics, rg.linearise):
            with pytest.raises(rg.ClosureError, match=r"^the configuration: the loop"):
                call(mech, q + 0.01, v)
            with pytest.raises(rg.StateError, match="velocity breaks the loop"):
                call(mech, q, v + np.array([0.0, 0.1, 0.0]))
            with pytest.raises(rg.StateError, match=r"^v has shape"):
                call(mech, q, v[:-1])
        with pytest.raises(rg.ClosureError, match=r"^the configuration: the loop"):
            rg.step_jacobians(mech, q + 0.01, v, None, 1e-3)

    def test_frames_turned_by_half_a_turn(self) -> None:
        """Rotation rows vanish there too: a false closure, whatever was asked before."""
        mech = welded()
        rg.derivatives(mech, mech.home)
        false = mech.home.copy()
        false[-1] += np.pi
        assert mech.closure_residual(false) < 1e-12
        with pytest.raises(rg.ClosureError, match="half a turn"):
            rg.derivatives(mech, false)

    def test_tables_of_another_shape(self) -> None:
        mech = rg.load("five_bar")
        two = np.array([mech.home, mech.home])
        with pytest.raises(rg.StateError, match=r"v has shape \(3, 4\), expected \(N, nv\) = \(2, 4\)"):
            rg.derivatives(mech, two, np.zeros((3, 4)))
        with pytest.raises(rg.StateError, match="q holds entries that are not finite"):
            rg.derivatives(mech, two * np.nan)

    def test_torques_that_are_functions(self) -> None:
        mech = rg.load("five_bar")
        q, v, _ = state(mech)

        def torque(t: float, q: Array, v: Array) -> Array:
            return -3.0 * q - 0.2 * v

        def slopes(t: float, q: Array, v: Array) -> tuple[Array, Array]:
            return -3.0 * np.eye(4), -0.2 * np.eye(4)

        exact = reference.derivatives(mech, q, v, torque, tau_slopes=slopes)
        same(rg.derivatives(mech, q, v, torque, tau_slopes=slopes), exact)
        one = rg.derivatives(mech, q, v, torque)  # by differences
        np.testing.assert_allclose(one.da_dy, exact.da_dy, rtol=0.0, atol=1e-9 * np.abs(exact.da_dy).max())
        many = rg.derivatives(mech, q[None], v[None], torque)
        np.testing.assert_array_equal(many.da_dy[0], one.da_dy)


class TestSteps:
    @pytest.mark.parametrize("name", MADE)
    def test_as_the_reference(self, name: str) -> None:
        mech, h = MADE[name](), STEPS.get(name, 1e-2)
        q, v, tau = state(mech)
        kernel = derivation(mech, q)
        assert kernel is not None
        found = stepped(kernel, q[None], v[None], tau[None], h)
        assert found is not None
        for one, other in zip(found, discrete.step_jacobians(mech, q, v, tau, h), strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=SAME * max(1.0, np.abs(other).max()))

    @pytest.mark.parametrize(
        "name", ("rhombus", "five_bar", "delta", "sprung", *map("on a {} joint".format, FLOATING))
    )
    def test_gradient(self, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """With torques that change from step to step; the rhombus falls through flat."""
        mech, steps = MADE[name](), 30
        rng = np.random.default_rng(1)
        table = rng.normal(size=(steps, mech.nv))
        start = mech.lift(mech.home, -1.5 * np.ones(mech.m)) if name == "rhombus" else state(mech)[1]
        simulation = rg.Simulation(mech, mech.home, start, step=5e-3)
        for tau in table:
            simulation.step(tau)
        run = simulation.trajectory
        assert len(run.crossings) == (name == "rhombus")
        a, b = rng.normal(size=(2, mech.nv))

        def slopes(t: float, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
            return b, 2.0 * a * v, 0.2 * tau

        # what the cost is of q matters to neither: both are handed the same slopes
        cost = rg.Cost(
            terminal=lambda q, v: a @ v,
            running=lambda t, q, v, tau: a @ v**2 + 0.1 * tau @ tau,
            terminal_slopes=lambda q, v: (b, a),
            running_slopes=slopes,
        )
        found = rg.gradient(run, cost, table)
        kernel = reverse_sweep.kernel_of(mech, run)
        assert kernel is not None
        assert reverse_sweep.backwards(kernel, run, (table, None), False, 0, steps) is not None
        monkeypatch.setattr(reverse_sweep, "kernel_of", lambda *_: None)
        exact = rg.gradient(run, cost, table)
        assert found.value == pytest.approx(exact.value, rel=1e-13)
        for part in ("dy", "dv", "dtau"):
            one, other = getattr(found, part), getattr(exact, part)
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11 * np.abs(other).max())

    def test_a_run_under_another_torque_is_refused(self) -> None:
        mech = rg.load("crank_rocker")
        run = rg.simulate(mech, duration=0.1, step=1e-3, torque=np.array([1.0, 0.0, 0.0]))
        with pytest.raises(rg.OptionError, match="give the torque of the run"):
            rg.gradient(run, rg.Cost(terminal=lambda q, v: q[0]), torque=np.zeros(3))

    def test_long_runs_in_several_stretches(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from robust_gcp.simulation.derivatives import kernel_sweep as backwards

        run = rg.simulate(rg.load("crank_rocker"), duration=0.3, step=1e-3)
        cost = rg.Cost(terminal=lambda q, v: v[0], running=lambda t, q, v, tau: 0.1 * v[1] ** 2)
        whole = rg.gradient(run, cost)
        monkeypatch.setattr(backwards, "LONGEST", 37)
        parts = rg.gradient(run, cost)
        for part in ("dy", "dv", "dtau"):
            np.testing.assert_allclose(getattr(parts, part), getattr(whole, part), rtol=1e-12, atol=1e-15)

    def test_costs_that_ask_for_derivatives_themselves(self) -> None:
        """Steps of the same mechanism, taken in the middle of the sweep, leave it as it is."""
        mech = rg.load("five_bar")
        run = rg.simulate(mech, None, mech.lift(mech.home, np.ones(2)), duration=0.2, step=1e-3)
        a, asked = np.arange(1.0, 5.0), [0]

        def plain(t: float, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
            return a, a, 0.0 * tau

        def asking(t: float, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
            rg.step_jacobians(mech, q, v, None, 1e-2)
            asked[0] += 1
            return plain(t, q, v, tau)

        found = [
            rg.gradient(
                run,
                rg.Cost(
                    terminal=lambda q, v: a @ v,
                    running=lambda t, q, v, tau: a @ q + a @ v,
                    running_slopes=slopes,
                ),
            )
            for slopes in (plain, asking)
        ]
        assert asked[0] >= 200
        np.testing.assert_array_equal(found[1].dy, found[0].dy)
        np.testing.assert_array_equal(found[1].dv, found[0].dv)
        np.testing.assert_array_equal(found[1].dtau, found[0].dtau)

    def test_tables_that_lie_column_by_column(self) -> None:
        """What the kernel reads as rows are rows, and it takes such runs too."""
        mech, rng = rg.load("five_bar"), np.random.default_rng(1)
        q, v, _ = state(mech)
        table = 1e-6 * rng.normal(size=(60, mech.nv))
        simulation = rg.Simulation(mech, q, v, step=1e-3)
        for tau in table:
            simulation.step(tau)
        run = simulation.trajectory
        kernel = derivation(mech, q)
        assert kernel is not None
        rows = kernel.slopes(run.q[:-1], run.v[:-1], table)
        columns = kernel.slopes(*map(np.asfortranarray, (run.q[:-1], run.v[:-1], table)))
        assert columns.good.all()
        np.testing.assert_array_equal(columns.rows, rows.rows)
        np.testing.assert_array_equal(columns.udot, rows.udot)
