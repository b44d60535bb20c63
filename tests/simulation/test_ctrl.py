"""Actuators under their controls: closed forms, orders, both backends, and what is recorded."""

from __future__ import annotations

import dataclasses
import pickle
from typing import Any, Literal

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import robust_gcp as rg
from robust_gcp.mechanism.tree.tree import Array
from tests.compiled import needs_kernel

BACKENDS = ["python", pytest.param("native", marks=needs_kernel)]
Backend = Literal["python", "native"]

ACTUATORS = [
    rg.Actuator.motor("motor", "q1", gear=2.0, ctrl_range=(-3.0, 3.0)),
    rg.Actuator.position("servo", rg.FixedTendon({"q2": 1.0, "q3": 0.5}), kp=3.0, kv=0.2),
    rg.Actuator(
        "lag", rg.SpatialTendon(["universe", "coupler_tip"]), gain=(2.0,), dynamics="filter", time=(0.1,)
    ),
]


def _rhombus(*actuators: rg.Actuator, **more: Any) -> rg.Mechanism:
    shipped = rg.load("rhombus")
    return rg.Mechanism.from_pinocchio(
        shipped.model, shipped.closures, shipped.independent, shipped.home, actuators=actuators, **more
    )


def _slide(*actuators: rg.Actuator, mass: float = 2.0) -> rg.Mechanism:
    """A mass on a level slide "x"."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model, actuators=actuators)


class TestClosedForms:
    @pytest.mark.parametrize("tau", [0.0, 1e-9])
    @pytest.mark.parametrize("backend", BACKENDS)
    def test_a_lag_of_no_time_is_none(self, tau: float, backend: Backend) -> None:
        """Between its bounds the activation is the table, after it has left its start."""
        table = ([0.0, 0.3, 0.8], [0.5, 2.0, -1.0])
        lag = rg.Actuator("push", "x", dynamics="filter", time=(tau,), ctrl_range=(-0.5, 1.5))
        mech = _slide(dataclasses.replace(lag, activation_range=(0.0, 9.0)))
        run = rg.simulate(mech, duration=1.0, step=1e-2, ctrl={"push": table}, backend=backend)
        wanted = np.clip(np.interp(run.t[1:], *table), 0.0, 1.5)
        np.testing.assert_allclose(run["activation.push"][1:], wanted, atol=1e-8)

    @pytest.mark.parametrize("backend", BACKENDS)
    def test_a_lagging_motor_pushes_a_mass(self, backend: Backend) -> None:
        """w = c (1 − e^(−t/τ)), x = (k c/m) (t²/2 − τ t + τ² (1 − e^(−t/τ))): RK4 at order 4."""
        tau, k, c, t = 0.2, 3.0, 0.7, 1.0
        mech = _slide(rg.Actuator("push", "x", gain=(k,), dynamics="filter", time=(tau,)))
        wanted = k * c / 2.0 * (t**2 / 2 - tau * t + tau**2 * (1 - np.exp(-t / tau)))
        errors = []
        for n in (20, 40):
            run = rg.simulate(mech, duration=t, step=t / n, ctrl={"push": c}, backend=backend)
            errors.append(abs(float(run["x"][-1]) - wanted))
            w = c * (1.0 - np.exp(-run.t / tau))
            assert run["activation.push"] == pytest.approx(w, abs=1e-10)
            assert run["actuator.push"] == pytest.approx(k * w, abs=1e-10)
        assert errors[1] < 1e-7 and np.log2(errors[0] / errors[1]) > 3.9

    @pytest.mark.parametrize("backend", BACKENDS)
    def test_an_integrator_stops_at_its_range(self, backend: Backend) -> None:
        valve = rg.Actuator("push", "x", dynamics="integrator", activation_range=(0.0, 0.5), gain=(2.0,))
        run = rg.simulate(_slide(valve), duration=1.0, step=0.05, ctrl={"push": 1.0}, backend=backend)
        w = np.minimum(run.t, 0.5)
        assert run["activation.push"] == pytest.approx(w, abs=1e-9)
        wanted = 0.5**3 / 6 + 0.5**2 / 2 * 0.5 + 0.5 * 0.5**2 / 2
        assert run["x"][-1] == pytest.approx(wanted, rel=1e-6)

    @pytest.mark.parametrize("backend", BACKENDS)
    def test_a_velocity_servo_settles(self, backend: Backend) -> None:
        run = rg.simulate(
            _slide(rg.Actuator.velocity("push", "x", kv=4.0)),
            duration=2.0, step=0.01, ctrl={"push": 1.5}, backend=backend,
        )  # fmt: skip
        assert run["v.x"] == pytest.approx(1.5 * (1.0 - np.exp(-2.0 * run.t)), abs=1e-9)

    def test_ranges_clip_controls_forces_and_joints(self) -> None:
        """A joint's own limit counts for all of its actuators together, a path's scales them alike."""
        two = [
            rg.Actuator("a", "x", gain=(2.0,), ctrl_range=(-1.0, 1.0)),
            rg.Actuator("b", "x", gain=(3.0,), force_range=(-5.0, 5.0)),
        ]
        mech = _slide(*two)
        assert mech.actuation is not None
        forces, tau = mech.actuation.forces_at(mech.home, np.zeros(1), np.array([1.0, 9.0]))
        assert forces.tolist() == [2.0, 5.0] and tau.tolist() == [7.0]
        run = rg.simulate(mech, duration=0.1, step=0.01, ctrl={"a": 7.0, "b": -9.0})
        assert (
            run["actuator.a"][0] == 2.0 and run["actuator.b"][0] == -5.0 and run.u[0].tolist() == [1.0, -9.0]
        )  # type: ignore[index]
        shared = [
            rg.Actuator(name, "x", gain=(gain,), shared_range=(-4.0, 4.0))
            for name, gain in (("a", 2.0), ("b", 6.0))
        ]
        other = _slide(*shared).actuation
        assert other is not None and other.forces_at(mech.home, np.zeros(1), np.ones(2))[0].tolist() == [
            1.0,
            3.0,
        ]

    @pytest.mark.parametrize("backend", BACKENDS)
    @pytest.mark.parametrize("named", ["a", "b", "ab"])
    def test_a_sum_has_one_range_whoever_names_it(self, named: str, backend: Backend) -> None:
        """2 + 6 N on 2 kg, of which 4 N act: x = t²."""
        pulls = [
            rg.Actuator(name, "x", gain=(gain,), shared_range=(-4.0, 4.0) if name in named else None)
            for name, gain in (("a", 2.0), ("b", 6.0))
        ]
        run = rg.simulate(_slide(*pulls), duration=0.5, step=0.01, ctrl={"a": 1.0, "b": 1.0}, backend=backend)
        assert run["x"][-1] - run["x"][0] == pytest.approx(0.25, abs=1e-13)
        assert [run["actuator.a"][-1], run["actuator.b"][-1]] == pytest.approx([1.0, 3.0], abs=1e-13)

    def test_two_ranges_of_one_sum_are_refused(self) -> None:
        pulls = [rg.Actuator(name, "x", shared_range=(-4.0, end)) for name, end in (("a", 4.0), ("b", 5.0))]
        with pytest.raises(rg.ModelError, match="one shared_range, not several: 'a'"):
            _slide(*pulls)

    @pytest.mark.parametrize("backend", BACKENDS)
    def test_a_muscle_by_another_solver(self, backend: Backend) -> None:
        """Activation, force by length and velocity and the motion as one system, by SciPy at 1e-12."""
        muscle = rg.Muscle((0.3, 0.9), 40.0)
        pull = rg.Actuator("m", "x", muscle=muscle, dynamics="muscle", time=(0.01, 0.04), activation=0.05)
        mech = _slide(pull)

        def rate(t: float, s: Array) -> list[float]:
            gain, bias = muscle.gain_and_bias(s[0], s[1])
            return [s[1], (gain * s[2] + bias) / 2.0, pull.activation_rate(0.8, s[2])]

        wanted = solve_ivp(rate, (0.0, 0.15), [0.7, 0.0, 0.05], "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        run = rg.simulate(mech, [0.7], [0.0], 0.15, 1e-4, ctrl={"m": 0.8}, backend=backend)
        assert [run["x"][-1], run["v.x"][-1], run["activation.m"][-1]] == pytest.approx(wanted, abs=2e-10)


CTRL: dict[str, Any] = {"motor": 0.5, "servo": 0.3, "lag": 1.0}
TABLE: dict[str, Any] = {**CTRL, "motor": ([0.0, 0.25, 0.5], [0.0, 1.0, 0.0]), "lag": ([0, 0.5], [1, 0])}
ASKED: dict[str, Any] = {**CTRL, "motor": lambda t, q, v: -q[0]}


class TestLoops:
    @needs_kernel
    @pytest.mark.parametrize(
        ("ctrl", "more"),
        [
            (CTRL, {}), (TABLE, {}), (ASKED, {}), (ASKED, {"hold": True}), (TABLE, {"hold": True}),
            (CTRL, {"stepper": "DOP853"}), (TABLE, {"stepper": "Radau"}), (CTRL, {"torque": [1.0, 0.0, 0.0]}),
            (CTRL, {"torque": lambda t, q, v: np.array([np.sin(t), 0.0, 0.0])}),
            (CTRL, {"stepper": rg.Tableau([[0.5]], [0.0, 1.0])}),
        ],
    )  # fmt: skip
    def test_both_backends(self, ctrl: Any, more: Any) -> None:
        """Through a singular configuration, energies balanced."""
        mech = _rhombus(*ACTUATORS, tendons={"t": ACTUATORS[1].along})
        one, two = (
            rg.simulate(
                mech, duration=0.5, step=1e-3, ctrl=ctrl, record=("tau", "energy"), backend=backend, **more
            )
            for backend in ("native", "python")
        )
        assert len(one.crossings) == len(two.crossings) == 1
        assert np.abs(one.q - two.q).max() < 1e-11
        assert np.abs(one.tau - two.tau).max() < 1e-10  # type: ignore[operator]
        for name in ("actuator.motor", "actuator.servo", "actuator.lag", "activation.lag", "tendon.t"):
            assert one[name] == pytest.approx(two[name], abs=1e-10)
        limit = 1e-4 if "Tableau" in str(more) or "Radau" in str(more) else 1e-6
        assert np.abs(one.energy_error()).max() < limit

    def test_it_is_the_torque_that_it_amounts_to(self) -> None:
        mech = _rhombus(ACTUATORS[0])
        one = rg.simulate(mech, duration=0.5, step=1e-3, ctrl=[0.5])
        two = rg.simulate(rg.load("rhombus"), duration=0.5, step=1e-3, torque={"q1": 1.0})
        assert np.abs(one.q - two.q).max() < 1e-13

    def test_without_control_they_have_no_power(self) -> None:
        mech = _rhombus(*ACTUATORS)
        one, two = (rg.simulate(m, duration=0.3, step=1e-3) for m in (mech, rg.load("rhombus")))
        assert np.array_equal(one.q, two.q) and one.u is None
        with pytest.raises(rg.OptionError, match="simulate with ctrl="):
            one["actuator.motor"]

    def test_other_coordinates_the_same_motion(self) -> None:
        mech = _rhombus(*ACTUATORS)
        runs = [
            rg.simulate(mech.with_independent([name]), duration=0.5, step=1e-3, ctrl=TABLE)
            for name in ("q1", "q2", "q3")
        ]
        for run in runs[1:]:
            assert np.abs(run.q - runs[0].q).max() < 1e-9

    def test_gradients_through_a_crossing(self) -> None:
        mech = _rhombus(*ACTUATORS)
        run = rg.simulate(mech, duration=0.4, step=2e-3, ctrl=CTRL)
        gradient = rg.gradient(run, rg.Cost(terminal=lambda q, v: q[0]))
        ends, h = [], 1e-6
        for side in (1.0, -1.0):
            q = mech.tree.integrate(run.q[0], side * h * mech.lift(run.q[0], [1.0]))
            q = mech.polish(q, mech.iv_dependent)
            ends.append(rg.simulate(mech, q, mech.lift(q, run.v[0][:1]), 0.4, 2e-3, ctrl=CTRL).q[-1, 0])
        assert gradient.dy[0] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=1e-7)

    def test_gradients_of_held_controls_are_refused(self) -> None:
        mech, cost = _rhombus(*ACTUATORS), rg.Cost(terminal=lambda q, v: q[0])
        held = rg.simulate(mech, duration=0.05, step=1e-3, ctrl=ASKED, hold=True)
        stepped = rg.Simulation(mech, step=1e-3, ctrl=[0.5, 0.3, 1.0]).step(n=20).trajectory
        for run in (held, stepped):
            with pytest.raises(rg.OptionError, match="controls that were held"):
                rg.gradient(run, cost)


class TestStepByStep:
    @pytest.mark.parametrize("backend", BACKENDS)
    def test_the_same_as_simulate(self, backend: Backend) -> None:
        mech = _rhombus(*ACTUATORS)
        ctrl = {"motor": lambda t, q, v: -q[0], "servo": 0.3, "lag": lambda t, q, v: 1.0 + t}
        run = rg.simulate(mech, duration=0.3, step=1e-3, ctrl=ctrl, hold=True, backend=backend)
        sim = rg.Simulation(mech, step=1e-3, ctrl={"servo": 0.3}, backend=backend)
        for _ in range(300):
            sim.step(ctrl={"motor": -sim.q[0], "lag": 1.0 + sim.t})
        found = sim.trajectory
        assert np.abs(found.q - run.q).max() < 1e-12
        assert found["activation.lag"] == pytest.approx(run["activation.lag"], abs=1e-14)
        assert sim["actuator.lag"] == pytest.approx(found["actuator.lag"][-1], abs=1e-12)

    @pytest.mark.parametrize("backend", BACKENDS)
    def test_saved_states_keep_controls_and_activations(self, backend: Backend) -> None:
        mech = _rhombus(*ACTUATORS)
        sim = rg.Simulation(mech, step=1e-3, backend=backend).step(n=5)
        assert sim.trajectory.u is None
        sim.step(ctrl={"lag": 1.0}).step(n=20)
        state = sim.save()
        wanted = sim.step(n=30).q
        sim.step(n=3, ctrl={"lag": -2.0})
        assert np.array_equal(sim.restore(state).step(n=30).q, wanted)
        other = rg.Simulation(mech, step=1e-3, backend=backend).restore(pickle.loads(pickle.dumps(state)))
        assert other.step(n=30).q == pytest.approx(wanted, abs=1e-13)

    def test_begun_anew_activations_are_those_of_the_start(self) -> None:
        mech = _rhombus(*ACTUATORS)
        sim = rg.Simulation(mech, step=1e-3, ctrl={"lag": 1.0})
        first = sim.step(n=50).q
        assert np.array_equal(sim.reset().step(n=50).q, first)


def test_a_tendon_pulls_on_the_joints_that_it_passes() -> None:
    """A pendulum held by a cord to the ground: the joint carries weight, inertia and the cord's pull."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "q")
    model.appendBodyToJoint(
        joint, pin.Inertia(2.0, np.array([0.5, 0, 0]), 0.1 * np.eye(3)), pin.SE3.Identity()
    )
    for name, parent, at in (("tip", joint, [1.0, 0.0, 0.0]), ("hook", 0, [0.3, 0.0, 2.0])):
        model.addFrame(pin.Frame(name, parent, pin.SE3(np.eye(3), np.array(at)), pin.FrameType.OP_FRAME))
    cord = rg.SpatialTendon(["tip", "hook"])
    mech = rg.Mechanism.from_pinocchio(
        model, forces=[rg.TendonSpring(cord, 5.0)], actuators=[rg.Actuator("pull", cord, gain=(-3.0,))]
    )
    run = rg.simulate(mech, duration=0.5, step=1e-3, ctrl={"pull": 2.0}, record=("a",))
    tip, tree = run.frame("tip"), mech.tree
    length = np.linalg.norm(tip.position[-1] - [0.3, 0.0, 2.0])
    pull = (-5.0 * length - 6.0) * (tip.position[-1] - [0.3, 0.0, 2.0]) / length
    angle, rate, turn = run["q"][-1], run["v.q"][-1], run["a.q"][-1]
    out, along = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([-np.sin(angle), 0, -np.cos(angle)])
    centre = 0.5 * (turn * along - rate**2 * out)
    wanted = 2.0 * (centre + [0, 0, 9.81]) - pull
    assert run.reaction("q").force[-1] == pytest.approx(wanted, abs=1e-9)
    assert tree.nv == 1


@pytest.mark.parametrize(
    ("ctrl", "message"),
    [
        ({"no": 1.0}, "no actuator 'no'"),
        ({"motor": "much"}, r"ctrl\['motor'\] = 'much' is no finite number"),
        ({"motor": np.nan}, "no finite number"),
        ({"motor": ([0.0, 0.0], [1.0, 2.0])}, "ascending"),
        ([1.0], "3 numbers, of motor, servo, lag"),
        ({"lag": lambda t, q, v: 1.0}, r"ctrl\['lag'\] is a function.*hold=True"),
        ({"motor": lambda t, q, v: [1.0, 2.0]}, "expected one real number"),
    ],
)
def test_what_is_no_control_is_refused_by_name(ctrl: Any, message: str) -> None:
    with pytest.raises(rg.OptionError, match=message):
        rg.simulate(_rhombus(*ACTUATORS), duration=0.01, step=1e-3, ctrl=ctrl)


def test_a_table_in_one_array() -> None:
    table = [0.0, 0.1], [1.0, 2.0]
    ask: dict[str, Any] = dict(duration=0.1, step=0.01)
    runs = [rg.simulate(_rhombus(*ACTUATORS), ctrl={"motor": x}, **ask) for x in (table, np.array(table))]
    assert np.array_equal(runs[0].q, runs[1].q)


def test_where_there_are_no_actuators() -> None:
    with pytest.raises(rg.OptionError, match=r"has no actuators; give torque="):
        rg.simulate(_rhombus(), duration=0.01, step=1e-3, ctrl={"q1": 1.0})
    with pytest.raises(rg.OptionError, match="a step holds a finite number"):
        rg.Simulation(_rhombus(*ACTUATORS), ctrl={"motor": lambda t, q, v: 1.0})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rg.Actuator("a", 3), "no joint's name and no path"),  # type: ignore[arg-type]
        (lambda: rg.Actuator("a", "q1", gain=(1, 2, 3, 4)), "gain"),
        (lambda: rg.Actuator("a", "q1", gain="much"), "gain"),
        (lambda: rg.Actuator("a", "q1", dynamics="filter"), "takes 1 time"),
        (lambda: rg.Actuator("a", "q1", ctrl_range=(1.0, 0.0)), "ascending"),
        (lambda: rg.Actuator("a", "q1", dynamics="quick"), "dynamics"),
        (lambda: _rhombus(rg.Actuator("a", "q1"), rg.Actuator("a", "q2")), "'a' names 2"),
        (lambda: _rhombus(rg.Actuator("a", "nowhere")), "Actuator 'a'.*nowhere"),
        (lambda: _rhombus("motor"), "no Actuator"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_actuator_is_refused_by_name(make: Any, message: str) -> None:
    with pytest.raises(rg.RobustGcpError, match=message):
        make()


def test_files_keep_them(tmp_path: Any) -> None:
    cord = rg.SpatialTendon(
        [
            "universe",
            rg.Wrap("coupler", 0.1, side="rocker"),
            "coupler_tip",
            rg.Pulley(2.0),
            "crank",
            "rocker_tip",
        ]
    )
    muscle = rg.Actuator(
        "m", cord, muscle=rg.Muscle((0.1, 2.0), 10.0), dynamics="muscle", time=(0.01, 0.04, 0.1),
    )  # fmt: skip
    mech = _rhombus(*ACTUATORS, muscle, tendons={"t": ACTUATORS[1].along})
    run = rg.simulate(mech, duration=0.1, step=1e-3, ctrl={"m": 0.5})
    read = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    assert read.mechanism.actuators == mech.actuators and read.mechanism.tendons == mech.tendons
    assert read["actuator.m"] == pytest.approx(run["actuator.m"], abs=0.0)
    assert pickle.loads(pickle.dumps(mech)).actuators == mech.actuators


def test_what_drove_it_is_told_of_controls_that_are_held() -> None:
    """With stops and locks as without: each output's own control; activations within steps too."""
    crank = rg.load("slider_crank")
    servo = rg.Actuator.position("servo", "q1", kp=20.0, kv=1.0)
    lag = rg.Actuator("lag", "q3", gain=(5.0,), dynamics="filter", time=(0.1,))
    more = crank.independent, crank.home
    mech = rg.Mechanism.from_pinocchio(crank.model, crank.closures, *more, actuators=[servo, lag])
    ctrl = {"lag": lambda t, q, v: np.sin(8.0 * t), "servo": lambda t, q, v: np.cos(9.0 * t)}
    asked: dict[str, Any] = {"v0": [0, 0, 0], "duration": 0.1, "step": 2e-3, "ctrl": ctrl, "hold": True}
    plain = rg.simulate(mech, joints=[], **asked)
    outputs = np.array([0.0507, 0.0522, 0.0731])
    k = np.floor(outputs / 2e-3).astype(int)
    w, u = plain["activation.lag"][k], np.sin(8.0 * plain.t[k])
    expected = w + (u - w) * -np.expm1(-(outputs - plain.t[k]) / 0.1)
    within = rg.simulate(mech, outputs=outputs, **asked)
    np.testing.assert_allclose(within["activation.lag"], expected, atol=1e-14)
    for part in (
        rg.Lock("q1", start=9.0),
        rg.Stop("q3", lower=-9.0),
        rg.Stop("q3", lower=-9.0, stiffness=1.0),
    ):
        run = rg.simulate(mech, joints=[part], **asked)
        sim = rg.Simulation(mech, [*mech.home], [0, 0, 0], step=2e-3, joints=[part])
        for _ in range(50):
            sim.step(ctrl={name: function(sim.t, sim.q, sim.v) for name, function in ctrl.items()})
        for name in ("actuator.servo", "actuator.lag", "activation.lag"):
            np.testing.assert_allclose(run[name], plain[name], atol=1e-12)
            np.testing.assert_allclose(sim.trajectory[name], plain[name], atol=1e-12)
