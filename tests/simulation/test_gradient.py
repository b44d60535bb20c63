"""The gradient of a cost along a motion, against differences of whole runs."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.simulation.derivatives.reverse_sweep import STRETCH

from ..dynamics.test_derivatives import TENTH, floating, moved

Array = NDArray[np.float64]


def slope(f: Callable[[float], float], h: float) -> float:
    """f'(0) by central differences of order 10."""
    return float(sum(w * (f(k * h) - f(-k * h)) for k, w in enumerate(TENTH, start=1)) / h)


def terminal(q: Array, v: Array) -> float:
    return float(np.sin(q[-1]) + 0.3 * v[-1] ** 2 + q[-2] * v[-3])


def running(t: float, q: Array, v: Array, tau: Array) -> float:
    return float(0.1 * q[-2] ** 2 + 0.05 * v[-3] ** 2 + 0.2 * tau[0] ** 2 + t * v[-1])


COST = rg.Cost(terminal, running)


class Case:
    """A run of N steps of h under torques held over each step, and its cost as a function of what it has."""

    def __init__(self, mech: rg.Mechanism, u: list[float], steps: int, h: float) -> None:
        self.mech, self.u, self.steps, self.h = mech, np.array(u), steps, h
        self.tau = np.random.default_rng(0).normal(size=(steps, mech.nv))

    def run(
        self, eta: Array | None = None, du: Array | None = None, tau: Array | None = None
    ) -> rg.Trajectory:
        mech, none = self.mech, np.zeros(self.mech.m)
        q = mech.home if eta is None else moved(mech, mech.home, eta)
        sim = rg.Simulation(mech, q, mech.lift(q, self.u + (none if du is None else du)), step=self.h)
        for torque in self.tau if tau is None else tau:
            sim.step(torque)
        return sim.trajectory

    def value(self, run: rg.Trajectory, tau: Array | None = None) -> float:
        table = self.tau if tau is None else tau
        rates = [
            running(run.t[i + k], run.q[i + k], run.v[i + k], table[i])
            for i in range(self.steps)
            for k in (0, 1)
        ]
        return terminal(run.q[-1], run.v[-1]) + 0.5 * self.h * sum(rates)

    def errors(self, found: rg.Gradient, h: float) -> dict[str, float]:
        """Of the parts of a gradient, relative to the largest of their kind."""
        m, far = self.mech.m, {}
        start = [slope(lambda s, e=e: self.value(self.run(eta=s * e)), h) for e in np.eye(m)]
        far["dy"] = float(np.abs(found.dy - start).max() / np.abs(start).max())
        speed = [slope(lambda s, e=e: self.value(self.run(du=s * e)), h) for e in np.eye(m)]
        far["dv"] = float(np.abs(found.dv - speed).max() / np.abs(speed).max())
        for i, joint in ((0, 0), (self.steps // 2, self.mech.nv - 1), (self.steps - 1, 1)):

            def pushed(s: float, i: int = i, joint: int = joint) -> float:
                tau = self.tau.copy()
                tau[i, joint] += s
                return self.value(self.run(tau=tau), tau)

            error = abs(found.dtau[i, joint] - slope(pushed, 30.0 * h))
            far[f"dtau {i}"] = error / float(np.abs(found.dtau).max())
        return far


CASES: dict[str, tuple[Callable[[], Case], float]] = {
    "crank-rocker": (lambda: Case(rg.load("crank_rocker"), [2.0], 40, 5e-3), 1e-2),
    "five-bar": (lambda: Case(rg.load("five_bar"), [0.5, -0.5], 20, 2e-3), 1e-2),
    "free four-bar": (lambda: Case(floating(pin.JointModelFreeFlyer()), [0.5] * 7, 4, 2e-2), 1e-2),
    "change point": (lambda: Case(four_bar(4.0, 2.0, 3.0, 3.0, y=2.9), [3.0], 40, 5e-3), 4e-3),
}


@pytest.mark.parametrize("name", CASES)
def test_against_differences_of_runs(name: str) -> None:
    """By the start and the torques; the change-point linkage passes its singular configuration."""
    make, h = CASES[name]
    case = make()
    run = case.run()
    assert len(run.crossings) == (name == "change point")
    found = rg.gradient(run, COST, case.tau)
    assert found.value == pytest.approx(case.value(run), rel=1e-13)
    assert max(case.errors(found, h).values()) < 1e-9


def test_by_parameters() -> None:
    """Masses, first and second moments, a rotor, a spring and a damper, with their names."""
    base = rg.load("crank_rocker")

    def made(name: str = "", by: float = 0.0) -> rg.Mechanism:
        model = base.model.copy()
        model.armature = np.array([0.0, 0.05, 0.0])
        numbers = {"q1.stiffness": 4.0, "q1.rest": 0.3, "q3.damping": 0.7}
        joint, _, what = name.partition(".")
        if name in numbers:
            numbers[name] += by
        elif what == "armature":
            armature = np.array(model.armature)
            armature[base.joint(joint).idx_v] += by
            model.armature = armature
        elif name:
            pi = model.inertias[base.joint(joint).index].toDynamicParameters()
            pi[("m", "mx", "my", "mz", "Ixx").index(what)] += by
            model.inertias[base.joint(joint).index] = pin.Inertia.FromDynamicParameters(pi)
        spring = rg.JointSpring("q1", numbers["q1.stiffness"], numbers["q1.rest"])
        forces = [spring, rg.JointDamper("q3", numbers["q3.damping"])]
        return rg.Mechanism.from_pinocchio(model, base.closures, ["q1"], base.home, forces=forces)

    names = ("q1.m", "q2.my", "q3.Ixx", "q2.armature", "q1.stiffness", "q1.rest", "q3.damping")
    case = Case(made(), [2.0], 30, 5e-3)
    found = rg.gradient(case.run(), COST, case.tau, parameters=names)
    assert tuple(found.parameters) == names

    def value(name: str, by: float) -> float:
        other = Case(made(name, by), [2.0], 30, 5e-3)
        return other.value(other.run())

    size = max(map(abs, found.parameters.values()))
    for name, got in found.parameters.items():
        assert abs(got - slope(lambda s, n=name: value(n, s), 1e-2)) < 1e-9 * size, name


def test_a_feedback_and_slopes_that_are_given() -> None:
    """τ = −c v₁ − k sin q₁ on the crank; the running term has the torque in it."""
    mech = rg.load("crank_rocker")

    def feedback(t: float, q: Array, v: Array) -> Array:
        return np.array([-0.8 * v[0] - 2.0 * np.sin(q[0]) + t, 0.0, 0.0])

    def feedback_slopes(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        by_q, by_v = np.zeros((3, 3)), np.zeros((3, 3))
        by_q[0, 0], by_v[0, 0] = -2.0 * np.cos(q[0]), -0.8
        return by_q, by_v

    def run(s: float) -> rg.Trajectory:
        q = moved(mech, mech.home, np.array([s]))
        return rg.simulate(mech, q, mech.lift(q, [2.0]), 0.2, 5e-3, torque=feedback)

    def value(s: float) -> float:
        motion, total = run(s), 0.0
        for i in range(len(motion.t) - 1):
            for k in (i, i + 1):
                state = motion.t[k], motion.q[k], motion.v[k]
                total += 0.5 * (motion.t[i + 1] - motion.t[i]) * running(*state, feedback(*state))
        return total + terminal(motion.q[-1], motion.v[-1])

    exact = slope(value, 1e-2)
    given = rg.gradient(run(0.0), COST, feedback, torque_slopes=feedback_slopes)
    assert given.value == pytest.approx(value(0.0), rel=1e-13)
    assert given.dy[0] == pytest.approx(exact, rel=1e-10)
    assert rg.gradient(run(0.0), COST, feedback).dy[0] == pytest.approx(exact, rel=1e-9)


def test_a_running_term_without_torques_beside_a_torque_function() -> None:
    mech, tau = rg.load("crank_rocker"), np.array([1.5, 0.0, 0.0])
    run = rg.simulate(mech, duration=0.1, step=5e-3, torque=lambda t, q, v: tau)
    cost = rg.Cost(running=lambda t, q, v, tau: q[0] ** 2)
    by_function, by_number = (rg.gradient(run, cost, torque) for torque in (lambda t, q, v: tau, tau))
    np.testing.assert_allclose(by_function.dtau, by_number.dtau, rtol=1e-9, atol=1e-14)
    assert by_function.dv[0] == pytest.approx(by_number.dv[0], rel=1e-9)


def test_slopes_of_the_cost_that_are_given() -> None:
    case = Case(rg.load("crank_rocker"), [2.0], 10, 5e-3)
    plain = rg.Cost(lambda q, v: v[0] ** 2, lambda t, q, v, tau: q[2] ** 3 * tau[0])

    def along(t: float, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
        by_q, by_tau = np.zeros(3), np.zeros(3)
        by_q[2], by_tau[0] = 3.0 * q[2] ** 2 * tau[0], q[2] ** 3
        return by_q, np.zeros(3), by_tau

    given = rg.Cost(
        plain.terminal, plain.running, lambda q, v: (np.zeros(3), np.array([2.0 * v[0], 0.0, 0.0])), along
    )
    one, other = (rg.gradient(case.run(), cost, case.tau) for cost in (plain, given))
    for name in ("dy", "dv", "dtau"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-10, atol=1e-12)


def test_through_nine_crossings() -> None:
    """As differences of the same steps say, and of fourth order beside runs of the closed form."""
    mech = rg.load("rhombus")

    def ends(q: Array, v: Array) -> float:
        return float(np.sin(q).sum() + 0.1 * v @ v)

    def run(du: float, **how: Any) -> rg.Trajectory:
        q = np.array([0.2, -0.2, 0.2])
        return rg.simulate(mech, q, mech.lift(q, [0.5 + du]), duration=5.5, **how)

    def differences(**how: Any) -> float:
        def value(s: float) -> float:
            end = run(s, **how)
            return ends(end.q[-1], end.v[-1])

        return slope(value, 2e-3)

    base = run(0.0, step=2e-3)
    assert len(base.crossings) == 9
    found = [rg.gradient(run(0.0, step=h), rg.Cost(ends)).dv[0] for h in (8e-3, 4e-3, 2e-3)]
    assert found[-1] == pytest.approx(differences(step=2e-3), rel=1e-10)
    exact = differences(step=2e-3, method="closed_form", stepper="DOP853", rtol=1e-13, atol=1e-13)
    errors = [abs(x - exact) for x in found]
    assert 3.8 < np.log2(errors[0] / errors[1]) < 4.4


def test_through_changes_of_the_independent_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rocker turns back, another takes over and gives back; by differences of runs, and the reference."""
    import robust_gcp.simulation.derivatives.reverse_sweep as module

    case = Case(four_bar(1.0, 1.2, 1.4, 0.7, y=1.0), [-1.0], 120, 4e-3)
    case.tau *= 0.1
    run = case.run()
    assert [names for _, names in run.stats.repartitions] == [("q3",), ("q1",)]
    assert run.stats.repartitions[0][0] > 0.0
    found = rg.gradient(run, COST, case.tau)
    assert found.value == pytest.approx(case.value(run), rel=1e-13)
    assert max(case.errors(found, 1e-4).values()) < 1e-8
    monkeypatch.setattr(module, "kernel_of", lambda *_: None)
    exact = rg.gradient(run, COST, case.tau)
    for part in ("dy", "dv", "dtau"):
        one, other = getattr(found, part), getattr(exact, part)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11 * np.abs(other).max())


def test_joints_that_do_not_serve_from_the_start_on() -> None:
    """The run takes others at once; its gradient is by the coordinates that were named."""
    crank = rg.load("crank_rocker")
    rocker, case = crank.with_independent(["q3"]), Case(crank, [6.0], 60, 5e-3)
    run = case.run()
    sim = rg.Simulation(rocker, rocker.home, run.v[0], step=5e-3)
    for tau in case.tau:
        sim.step(tau)
    again = sim.trajectory
    assert again.stats.repartitions[0][0] == 0.0
    by_crank, by_rocker = rg.gradient(run, COST, case.tau), rg.gradient(again, COST, case.tau)
    np.testing.assert_allclose(by_rocker.dtau, by_crank.dtau, rtol=1e-9, atol=1e-12)
    pace = crank.G(crank.home)[2, 0]
    # along the same motion dq3 = G₃ dq1, and v3 = G₃ v1 changes with where it is
    rates = rg.derivatives(crank, crank.home, run.v[0])
    np.testing.assert_allclose(by_rocker.dv * pace, by_crank.dv, rtol=1e-9)
    np.testing.assert_allclose(by_rocker.dy * pace + by_rocker.dv * rates.dv_dy[2], by_crank.dy, rtol=1e-9)


def test_through_steps_that_were_taken_with_error_control() -> None:
    """Beside a near miss, where coordinates change within steps as well; by differences of runs."""
    mech = four_bar(4.01, 2.0, 3.0, 3.0, y=2.6)
    ends = np.arange(1.0, 4.0)
    cost = rg.Cost(terminal=lambda q, v: float(q @ ends), terminal_slopes=lambda q, v: (ends, 0.0 * ends))

    def run(u: float) -> rg.Trajectory:
        return rg.simulate(mech, v0=mech.lift(mech.home, [u]), duration=0.22, step=4e-3)

    at = run(2.0)
    assert at.stats.refined
    assert at.stats.repartitions
    found, e = rg.gradient(at, cost).dv[0], 1e-4
    ahead, far = (float((run(2.0 + k * e).q[-1] - run(2.0 - k * e).q[-1]) @ ends) for k in (1, 2))
    assert found == pytest.approx((8.0 * ahead - far) / (12.0 * e), rel=1e-6)


def test_memory_is_that_of_one_stretch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the run's length, and the same gradient by stretches of another length (the reference)."""
    import robust_gcp.simulation.derivatives.reverse_sweep as module

    monkeypatch.setattr(module, "kernel_of", lambda *_: None)
    case = Case(rg.load("rhombus"), [1.0], 3 * STRETCH + 7, 1e-3)
    run, kept = case.run(), []
    by_reference = module.ReverseSweep._by_reference

    def watched(self: Any, end: int, first: int) -> int:
        begin = by_reference(self, end, first)
        kept.append(end - begin)
        return begin

    monkeypatch.setattr(module.ReverseSweep, "_by_reference", watched)
    whole = rg.gradient(run, COST, case.tau)
    assert sum(kept) == case.steps and max(kept) <= STRETCH + 5
    monkeypatch.setattr(module, "STRETCH", 10)
    other = rg.gradient(run, COST, case.tau)
    np.testing.assert_allclose(other.dtau, whole.dtau, rtol=1e-9, atol=1e-12 * np.abs(whole.dtau).max())


# --------------------------------------------------------------------------- what the trajectory remembers


ANGLE = rg.Cost(lambda q, v: float(q[0]), lambda t, q, v, tau: float(1e-3 * tau[0] ** 2 + t * v[2]))


@cache
def at_rest() -> tuple[rg.Mechanism, Array, Callable[[float, Array, Array], Array]]:
    """A four-bar that hangs still, and a controller about that place, which is silent there."""
    mech = rg.load("crank_rocker")
    damped = rg.Mechanism.from_pinocchio(
        mech.model, mech.closures, ["q1"], mech.home, forces=[rg.JointDamper("q1", 20.0)]
    )
    still = mech.assemble(rg.simulate(damped, duration=60.0, step=1e-2).q[-1], hold=["q1"])
    return mech, still, lambda t, q, v: np.array([400.0 * (still[0] - q[0]) - 40.0 * v[0], 0.0, 0.0])


def cost_of(run: rg.Trajectory, table: Array | None, f: Callable[[float, Array, Array], Array]) -> float:
    """`ANGLE` along a run, by what was held or else by the function."""
    total = ANGLE.terminal(run.q[-1], run.v[-1])  # type: ignore[misc]
    for i in range(len(run.t) - 1):
        for k in (i, i + 1):
            state = float(run.t[k]), run.q[k], run.v[k]
            tau = f(*state) if table is None else table[i]
            total += 0.5 * (run.t[i + 1] - run.t[i]) * ANGLE.running(*state, tau)  # type: ignore[misc]
    return float(total)


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_the_feedback_of_a_run_is_remembered(hold: bool, moving: bool, tmp_path: Path) -> None:
    """At rest too, where the controller says nothing, and over steps where it was held."""
    mech, still, pd = at_rest()
    speed = [1.0] if moving else [0.0]

    def run(s: float = 0.0) -> rg.Trajectory:
        q = moved(mech, still, np.array([s]))
        return rg.simulate(mech, q, mech.lift(q, speed), 0.016, 2e-3, torque=pd, hold=hold)

    def value(s: float) -> float:
        motion = run(s)
        assert motion.acted is not None
        return cost_of(motion, motion.acted.held, pd)

    first, exact = run(), slope(value, 1e-2)
    for torque in (None, pd):
        found = rg.gradient(first, ANGLE, torque)
        assert found.value == pytest.approx(value(0.0), rel=1e-12)
        assert found.dy[0] == pytest.approx(exact, rel=1e-8)
    first.save(tmp_path / "run.npz")
    for again in (rg.load_trajectory(tmp_path / "run.npz"), pickle.loads(pickle.dumps(first))):
        with pytest.raises(rg.OptionError, match=r"torque function or wrenches acted.*give all that acted"):
            rg.gradient(again, ANGLE)
        assert rg.gradient(again, ANGLE, pd).dy[0] == pytest.approx(exact, rel=1e-8)


def test_what_a_simulation_held_is_remembered(tmp_path: Path) -> None:
    """In its files too; a controller that gave it is followed where it is told of."""
    case = Case(rg.load("crank_rocker"), [2.0], 6, 5e-3)
    run = case.run()
    known = rg.gradient(run, COST, case.tau)
    for again in (run, rg.load_trajectory(run.save(tmp_path / "run.npz"))):
        np.testing.assert_array_equal(rg.gradient(again, COST).dtau, known.dtau)
    with pytest.raises(rg.OptionError, match=r"t = 0 s torque\(t, q, v\) gives .* held.*without a memory"):
        rg.gradient(run, COST, lambda t, q, v: np.zeros(3))
    sim = rg.Simulation(case.mech, step=5e-3)

    def pushed(t: float, q: Array, v: Array) -> Array:
        return np.array([np.sin(3.0 * q[0]) - v[0], 0.0, 0.0])

    for _ in range(6):
        sim.step(pushed(sim.t, sim.q, sim.v))
    held = rg.simulate(case.mech, case.mech.home, duration=0.03, step=5e-3, torque=pushed, hold=True)
    np.testing.assert_array_equal(sim.trajectory.q, held.q)
    followed = rg.gradient(sim.trajectory, COST, pushed)
    assert followed.dy[0] == pytest.approx(rg.gradient(held, COST).dy[0], rel=1e-12)
    assert followed.dy[0] != pytest.approx(rg.gradient(sim.trajectory, COST).dy[0], rel=1e-2)


def test_wrenches_are_remembered() -> None:
    """Those that stay and those that follow the motion, beside no torque, a constant and a function."""
    mech = rg.load("crank_rocker")
    pull = rg.Wrench("coupler_tip", lambda t, q, v: np.array([0.0, 4.0 * q[0], 2.0, 0.0, 0.0, 0.0]), "local")
    torques: list[Any] = [None, [1.5, 0.0, 0.0], {"q1": lambda t, q, v: -v[0]}]
    for torque in torques:

        def run(s: float = 0.0, torque: Any = torque) -> rg.Trajectory:
            q = moved(mech, mech.home, np.array([s]))
            return rg.simulate(mech, q, mech.lift(q, [2.0]), 0.02, 2e-3, torque=torque, wrenches=[pull])

        cost = rg.Cost(terminal)
        exact = slope(lambda s, run=run: terminal(run(s).q[-1], run(s).v[-1]), 1e-2)
        for given in (None, np.zeros(3) if torque is None else torque):
            assert rg.gradient(run(), cost, given).dy[0] == pytest.approx(exact, rel=1e-8)
        with pytest.raises(rg.OptionError, match=r"wrenches= acted.*which a table of torques leaves out"):
            rg.gradient(run(), cost, np.zeros((10, 3)))


def test_wrenches_that_are_remembered_have_slopes_beside_those_given() -> None:
    mech = rg.load("crank_rocker")
    push, drag = rg.Wrench("coupler_tip", np.array([0.0, 4.0, -2.0, 0.0, 0.0, 0.0])), -0.5 * np.eye(3)
    q, v, options = mech.home, mech.lift(mech.home, [2.0]), {"wrenches": [push]}
    run = rg.simulate(mech, q, v, 0.1, 2e-3, torque=lambda t, q, v: drag @ v, **options)
    given = rg.gradient(run, COST, torque_slopes=lambda t, q, v: (np.zeros((3, 3)), drag))
    found = rg.gradient(run, COST)
    np.testing.assert_allclose([*given.dy, *given.dv], [*found.dy, *found.dv], rtol=1e-8)


def test_many_runs_remember_their_torque() -> None:
    mech = rg.load("crank_rocker")
    starts = [(None, mech.lift(mech.home, [w])) for w in (1.0, 2.0)]
    for run in rg.simulate_many(mech, starts, 0.02, 2e-3, torque={"q1": 3.0}):
        assert run is not None
        known = rg.gradient(run, COST, np.array([3.0, 0.0, 0.0]))
        np.testing.assert_array_equal(rg.gradient(run, COST).dtau, known.dtau)


class TestRefused:
    CASE = Case(rg.load("crank_rocker"), [2.0], 5, 5e-3)

    def test_another_torque(self) -> None:
        with pytest.raises(rg.OptionError, match=r"taken again.*leave torque= out.*give the torque"):
            rg.gradient(self.CASE.run(), COST, np.zeros(3))

    def test_another_stepper(self) -> None:
        mech = rg.load("crank_rocker")
        run = rg.simulate(mech, v0=mech.lift(mech.home, [2.0]), duration=0.5, step=0.1, stepper="RK45")
        with pytest.raises(rg.OptionError, match=r"made by stepper='RK45'.*make it with stepper=\"rk4\""):
            rg.gradient(run, COST)

    def test_outputs_that_are_not_the_steps(self) -> None:
        run = rg.simulate(rg.load("crank_rocker"), step=1e-3, outputs=[0.0, 0.01, 0.02])
        with pytest.raises(rg.OptionError, match=r"outputs.* 0\.01 s apart, its steps 0\.001 s; make"):
            rg.gradient(run, COST)
        end = rg.simulate(rg.load("crank_rocker"), step=1e-3, outputs=[0.02])
        last = rg.Simulation(rg.load("crank_rocker"), keep="last").step(n=20).trajectory
        for alone in (end, last):
            with pytest.raises(rg.OptionError, match="holds 1 states, and so no step"):
                rg.gradient(alone, COST)

    def test_names_and_tables(self) -> None:
        run = self.CASE.run()
        with pytest.raises(rg.OptionError, match=r"'q1.weight' is none.*joint.m"):
            rg.gradient(run, COST, self.CASE.tau, parameters=["q1.weight"])
        with pytest.raises(
            rg.OptionError, match=r"torque has shape \(4, 3\), expected \(steps, nv\) = \(5, 3\)"
        ):
            rg.gradient(run, COST, self.CASE.tau[1:])
        with pytest.raises(rg.OptionError, match=r"give rg.Cost\(terminal, running\)"):
            rg.gradient(run, terminal)  # type: ignore[arg-type]

    def test_costs(self) -> None:
        run = self.CASE.run()
        with pytest.raises(rg.OptionError, match=r"give terminal\(q, v\), running"):
            rg.Cost()
        with pytest.raises(
            rg.OptionError, match=r"terminal\(q, v\) returned shape \(3,\), expected one real number"
        ):
            rg.gradient(run, rg.Cost(lambda q, v: q), self.CASE.tau)
        bad = rg.Cost(terminal, terminal_slopes=lambda q, v: (q, v[:2]))
        with pytest.raises(rg.OptionError, match=r"shapes \(3,\), \(2,\), expected 2 arrays \(3,\)"):
            rg.gradient(run, bad, self.CASE.tau)
        with pytest.raises(rg.NonFiniteError, match="running"):
            rg.gradient(run, rg.Cost(running=lambda t, q, v, tau: np.nan), self.CASE.tau)


def test_a_run_ended_within_a_step_by_an_event_has_the_gradient_of_one_of_its_duration() -> None:
    mech = rg.load("kite")

    def run(u: float, duration: float = 1.0, events: Any = None) -> rg.Trajectory:
        return rg.simulate(mech, None, mech.lift(mech.home, [5.0 + u]), duration, 1e-2, events=events)

    ended = run(0.0, events=rg.Event(lambda t, q, v: v[1] + 26.0 / 3.0, terminal=True))
    g = rg.gradient(ended, rg.Cost(terminal))

    def value(u: float) -> float:
        end = run(u, float(ended.t[-1]))
        return terminal(end.q[-1], end.v[-1])

    assert ended.ended_by == 0
    assert g.dv[0] == pytest.approx(slope(value, 1e-2), rel=1e-5)
