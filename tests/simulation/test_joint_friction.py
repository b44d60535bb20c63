"""Dry friction in joints: closed forms, statics, orders, one motion for every choice of y, crossings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag
from scipy.optimize import linprog

import robust_gcp as rg
from robust_gcp.simulation.phases.quadratic_programs import LARGEST_MARGIN, Load

from .machines import BACKENDS, orders, require_backend, require_sound, sliders, times_of

SPRING, MASS, DRY, PUSH, OMEGA = 100.0, 1.0, 2.0, 7.0, 4.0
"""Of an oscillator: N/m, kg, N, N and rad/s."""


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def oscillator() -> rg.Mechanism:
    level = sliders(MASS, along=pin.JointModelPY())
    return rg.Mechanism.from_pinocchio(level.model, forces=[rg.JointSpring("q1", SPRING)])


def stick_and_slip(t_end: float) -> tuple[np.ndarray, np.ndarray]:
    """x and v of the oscillator at the end, and when it stops and breaks loose, by DOP853."""
    t, x, when = 0.0, np.array([0.2, 0.0]), []
    sign = -1.0

    def push(t: float) -> float:
        return float(PUSH * np.sin(OMEGA * t))

    def still(t: float, x: np.ndarray) -> float:
        return float(x[1])

    while True:
        still.terminal, still.direction = True, -sign  # type: ignore[attr-defined]
        part = solve_ivp(
            lambda t, x, s=sign: [x[1], (push(t) - SPRING * x[0] - DRY * s) / MASS],
            (t, t_end), x, "DOP853", rtol=1e-13, atol=1e-15, events=still,
        )  # fmt: skip
        t, x = part.t[-1], part.y[:, -1] * [1.0, 0.0 if part.status else 1.0]
        if part.status == 0:
            return x, np.array(when)
        when.append(t)
        force = push(t) - SPRING * x[0]
        if abs(force) <= DRY:

            def over(s: float, x: np.ndarray) -> float:
                return DRY - abs(push(s) - SPRING * x[0])

            over.terminal = True  # type: ignore[attr-defined]
            held = solve_ivp(
                lambda t, x: [0.0, 0.0], (t, t_end), x, rtol=1e-13, atol=1e-15, events=over, max_step=1e-2
            )
            t = held.t[-1]
            if held.status == 0:
                return x, np.array(when)
            when.append(t)
            force = push(t) - SPRING * x[0]
        sign = float(np.sign(force))


def test_a_forced_oscillator_sticks_and_slips_at_order_four(backend: Any) -> None:
    exact, when = stick_and_slip(2.0)
    found, late = [], []
    for h in (0.02, 0.01, 0.005):
        run = rg.simulate(
            oscillator(), [0.2], [0.0], 2.0, h, backend=backend, joints=[rg.JointFriction("q1", DRY)],
            torque=lambda t, q, v: np.array([PUSH * np.sin(OMEGA * t)]),
        )  # fmt: skip
        kinds = times_of(run, "at rest", "release")
        met = np.unique(kinds[kinds > 0.0].round(12))
        assert len(met) == len(when) and len(when) > 4
        found.append(np.abs([run.q[-1, 0] - exact[0], run.v[-1, 0] - exact[1]]).max())
        late.append(np.abs(met - when).max())
        require_sound(run, 1e3 * h**4)
    assert np.log2(found[1] / found[2]) > 3.8 and found[2] < 1e-7
    assert np.log2(late[1] / late[2]) > 3.6 and late[2] < 1e-6
    assert np.abs(run["friction.q1"]).max() <= DRY * (1.0 + 1e-12)
    held = (np.abs(run.v[:, 0]) == 0.0) & (run.t > 0.0)
    force = PUSH * np.sin(OMEGA * run.t[held]) - SPRING * run.q[held, 0]
    assert np.abs(run["friction.q1"][held] + force).max() < 1e-9


def test_a_block_slides_to_rest_and_stays() -> None:
    """2 kg at 3 m/s against 4 N: at rest after 1.5 s and 2.25 m, 9 J; there is no force then."""
    level = sliders(2.0, along=pin.JointModelPY())
    run = rg.simulate(level, [0.0], [3.0], 2.0, 0.1, joints=[rg.JointFriction("q1", 4.0)], torque=[0.0])
    assert [(x.kind, x.joints) for x in run.happenings] == [("at rest", ("q1",)), ("hold", ("q1",))]
    assert run.happenings[0].time == pytest.approx(1.5, abs=1e-13)
    assert run.q[-1, 0] == pytest.approx(2.25, abs=1e-13) and run.v[-1, 0] == 0.0
    assert run.dissipated is not None and run.dissipated[-1] == pytest.approx(9.0, abs=1e-12)
    assert run["friction.q1"][0] == -4.0 and run["friction.q1"][-1] == 0.0
    require_sound(run, 1e-12)


def test_a_four_bar_breaks_loose_where_statics_has_it() -> None:
    """Two joints stick; a growing torque breaks both at T a₁ = g + F₁|a₁| + F₃|a₃|, a the tangent."""
    mech = rg.load("crank_rocker")
    F1, F3 = 6.0, 9.0
    a = mech.lift(mech.home, [1.0])
    gravity = float(a @ mech.tree.rnea(mech.home, np.zeros(3), np.zeros(3)))
    breaks = (gravity + F1 * abs(a[0]) + F3 * abs(a[2])) / 30.0
    parts = [rg.JointFriction("q1", F1), rg.JointFriction("q3", F3)]
    torque = {"q1": lambda t, q, v: 30.0 * t}
    start: dict[str, Any] = dict(q0=mech.home, v0=np.zeros(3), duration=breaks + 0.1, step=0.01)
    runs = [
        rg.simulate(mech.with_independent([y]), torque=torque, joints=parts, **start) for y in ("q1", "q3")
    ]
    for run in runs:
        assert times_of(run, "release") == pytest.approx([breaks], abs=1e-13)
        assert run.happenings[-1].joints == ("q1", "q3")
        require_sound(run, 1e-6)
    assert np.abs(runs[0].q[-1] - runs[1].q[-1]).max() < 1e-8


def four_dry_joints(step: float, end: float = 1.4) -> rg.Trajectory:
    bar = rg.load("five_bar")
    parts = [rg.JointFriction(f"q{j}", F) for j, F in enumerate((12.0, 3.0, 14.0, 4.0), 1)]
    torque = {"q1": lambda t, q, v: 20.0 * t}
    return rg.simulate(bar, bar.home, np.zeros(4), end, step, torque=torque, joints=parts)


def test_dependent_rows_share_the_load_and_break_together() -> None:
    """Four sticking joints, two mobilities: statics breaks when a linear program says; one joint stays."""
    bar, F = rg.load("five_bar"), np.array([12.0, 3.0, 14.0, 4.0])
    run = four_dry_joints(0.01, 0.5)
    G, gravity = bar.G(bar.home), bar.tree.rnea(bar.home, np.zeros(4), np.zeros(4)).copy()
    # the largest T with G'(T e1 - g + f) = 0, |f| <= F
    best = linprog(
        [-1.0, 0.0, 0.0, 0.0, 0.0], A_eq=np.hstack([G[:1].T, G.T]), b_eq=G.T @ gravity,
        bounds=[(0.0, None), *zip(-F, F, strict=True)],
    )  # fmt: skip
    release = [x for x in run.happenings if x.kind == "release"]
    assert release[0].time == pytest.approx(best.x[0] / 20.0, abs=1e-12)
    assert release[0].joints == ("q1", "q2", "q4")
    for j in range(4):
        assert np.abs(run[f"friction.q{j + 1}"]).max() <= F[j] * (1.0 + 1e-9)
    require_sound(run, 1e-5)


@pytest.mark.slow
def test_four_dry_joints_at_order_four() -> None:
    runs = [four_dry_joints(h) for h in (0.01, 0.005, 0.0025)]
    assert len({len(run.happenings) for run in runs}) == 1
    assert orders([run.q[-1] for run in runs]).min() > 3.6
    energy = [np.abs(run.energy_error()).max() for run in runs]
    assert energy[1] / energy[2] > 14.0


def test_through_crossings_at_order_four() -> None:
    """A rhombus with friction in a dependent joint passes crossings; the same for every y."""
    rhombus, runs = rg.load("rhombus"), list[rg.Trajectory]()
    ask: dict[str, Any] = dict(q0=[0.6, -0.6, 0.6], duration=1.0)
    parts = [rg.JointFriction("q3", 0.5)]
    v = rhombus.lift(ask["q0"], [-1.0])
    runs += [rg.simulate(rhombus, v0=v, step=h, joints=parts, **ask) for h in (0.02, 0.01, 0.005)]
    assert len(runs[-1].crossings) >= 1
    assert orders([run.v[-1] for run in runs]).min() > 3.8
    other = rg.simulate(rhombus.with_independent(["q2"]), v0=v, step=0.005, joints=parts, **ask)
    assert np.abs(other.q[-1] - runs[-1].q[-1]).max() < 1e-8
    assert (
        np.abs([x.time for x in other.crossings] - np.array([x.time for x in runs[-1].crossings])).max()
        < 1e-8
    )
    require_sound(runs[-1], 1e-6)


def test_a_held_leg_passes_crossings_as_one_alone() -> None:
    """Friction holds the turntable that a rhombus stands on: mobility 2 to 1, through crossings."""
    rhombus = rg.load("rhombus")
    model = pin.Model()
    table = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "turn")
    model.appendBodyToJoint(table, pin.Inertia(5.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    both = pin.appendModel(model, rhombus.model, 0, pin.SE3.Identity())
    q0 = [0.6, -0.6, 0.6]
    v0 = rhombus.lift(q0, [-1.0])
    mech = rg.Mechanism.from_pinocchio(both, rhombus.closures, ["turn", "q1"])
    alone = rg.simulate(rhombus, q0, v0, 1.0, 0.005)
    held = rg.simulate(mech, [0.3, *q0], [0.0, *v0], 1.0, 0.005, joints=[rg.JointFriction("turn", 1e3)])
    assert len(alone.crossings) == len(held.crossings) >= 1
    assert np.abs(held.q[-1] - [0.3, *alone.q[-1]]).max() < 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_random_machines_move_alike_in_every_choice_of_coordinates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    name = ("slider_crank", "crank_rocker", "five_bar", "parallelogram")[seed % 4]
    mech = rg.load(name)
    q0 = mech.home
    v0 = mech.lift(q0, rng.normal(0.0, 1.0, mech.m))
    parts: list[Any] = []
    for joint in mech.joint_names:
        if rng.random() < 0.5:
            parts.append(rg.JointFriction(joint, float(rng.uniform(0.1, 2.0))))
        if rng.random() < 0.5:
            place, e = float(q0[mech.joint(joint).idx_q]), float(rng.choice([0.0, 0.3, 0.7]))
            parts.append(rg.Stop(joint, place - rng.uniform(0.05, 0.6), place + rng.uniform(0.05, 0.6), e))
    choices = [names for _, names in mech.coordinate_choices(q0)][:2]
    runs = [rg.simulate(mech.with_independent(y), q0, v0, 0.4, 0.005, joints=parts) for y in choices]
    for run in runs:
        require_sound(run, 1e-4)
        for part in parts:
            if isinstance(part, rg.Stop):
                r = run[part.joint]
                assert part.lower - 1e-11 < r.min() and r.max() < part.upper + 1e-11
    seen = [[(x.kind, x.joints) for x in run.happenings] for run in runs]
    assert seen[0] == seen[1]
    assert np.abs(runs[0].q[-1] - runs[1].q[-1]).max() < 1e-5


def test_phases_without_end_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robust_gcp.simulation.phases.course.AT_ONCE", 0)
    with pytest.raises(rg.SimulationError, match="follow each other without end") as caught:
        rg.simulate(rg.load("rhombus"), duration=0.01, step=1e-3, joints=[rg.JointFriction("q1", 1.0)])
    assert caught.value.trajectory is not None


def test_friction_at_a_dead_point_of_its_joint(backend: Any) -> None:
    """A crank let go where its slide is at its end: friction of the slide begins as soon as that moves."""
    crank, brush = rg.load("slider_crank"), rg.JointFriction("q3", 2.0)
    starts = [crank.assemble({"q1": np.pi - beside}, hold=["q1"]) for beside in (0.0, 1e-8)]
    at, beside = (
        rg.simulate(crank, q0, [0.0] * 3, 0.2, 1e-3, joints=[brush], backend=backend) for q0 in starts
    )
    np.testing.assert_allclose(at.q[-1], beside.q[-1], atol=1e-7)
    assert at["friction.q3"][-1] == beside["friction.q3"][-1] == -2.0
    assert at.dissipated[-1] == pytest.approx(beside.dissipated[-1], rel=1e-6)


def test_rows_that_carry_nothing_are_no_hindrance() -> None:
    """Rows at their dead points, which are 0; friction that nothing presses, where rounding is no load."""
    dead, dry = np.zeros((3, 2)), np.ones(3)
    one = dead + np.eye(3)[:, 2:] * [1.0, 0.0]
    assert Load(one, 2, dry, dry < 0.0).margin(np.array([0.3, 0.0])) == pytest.approx(0.7)
    assert Load(dead, 2, dry, dry < 0.0).margin(np.zeros(2)) > 0.0
    for push in (False, True):
        pressed = np.array([np.inf if push else 0.0, 0.0])
        rows = Load(np.array([[1.0], [2.0]]), 1, pressed, np.array([push, False]))
        assert all(rows.margin(np.array([load])) >= 0.0 for load in (0.0, 1e-17, -1e-17))
        assert rows.margin(np.array([-1.0])) < 0.0


def test_bearings_that_nothing_presses_give_way_at_once(backend: Any) -> None:
    """Without weight friction that is a share of reactions holds nothing, of joints that share a load too."""
    rhombus = rg.load("rhombus")
    model = rhombus.own_model.copy()
    model.gravity.linear = np.zeros(3)
    light = rg.Mechanism.from_pinocchio(model, rhombus.closures, ["q1"], rhombus.home)
    bearings = [rg.JointFriction(name, coefficient=0.2, radius=0.05) for name in light.joint_names]
    push = {"q1": lambda t, q, v: 1e-3 * t}
    run = rg.simulate(light, duration=0.02, step=1e-3, torque=push, joints=bearings, backend=backend)
    assert [x.kind for x in run.happenings] == ["hold", "release"]
    assert run.happenings[1].time < 1e-6 and run["v.q1"][-1] > 0.0


@pytest.mark.parametrize("seed", range(30))
def test_rows_that_share_a_load_do_so_in_any_units(seed: int) -> None:
    """The largest margin of dependent rows: that of a linear program, in whatever units each row is told."""
    rng = np.random.default_rng(seed)
    groups = [rng.normal(size=(k + int(rng.integers(0, 3)), k)) for k in (1, 1, int(rng.integers(1, 3)))]
    A = block_diag(*groups) @ rng.normal(size=(sum(len(g.T) for g in groups),) * 2)
    (n, m), kinds = A.shape, rng.integers(0, 5, len(A))  # dry, dry, stop, stop, lock
    F, pushes = np.where(kinds < 2, 10.0 ** rng.uniform(-1.0, 1.0, n), np.inf), (kinds == 2) | (kinds == 3)
    dry = np.isfinite(F)
    need = A.T @ np.where(pushes, rng.uniform(0.0, 2.0, n), rng.normal(size=n))

    f, margin = Load(A, m, F, pushes)._shared(need)
    assert np.abs(A.T @ f - need).max() < 1e-7 * np.abs(need).max()
    most = np.where(dry, F, 1.0 * pushes)
    limits = [np.c_[np.eye(n), most][dry], np.c_[-np.eye(n), most][dry | pushes]]
    best = linprog(
        [0.0] * n + [-1.0], np.vstack(limits), np.r_[F[dry], np.where(pushes, 0.0, F)[dry | pushes]],
        np.c_[A.T, np.zeros(m)], need, [(None, None)] * n + [(None, LARGEST_MARGIN)],
    )  # fmt: skip
    assert margin == pytest.approx(best.x[-1], rel=1e-6, abs=1e-6)
    if not pushes.any():  # whose margin is a force
        own = 10.0 ** rng.uniform(-3.0, 3.0, n)
        assert Load(A * own[:, None], m, F / own, pushes).margin(need) == pytest.approx(margin, abs=1e-6)
    held = np.where(dry, 1.0 - np.abs(f) / F, np.where(pushes, f, np.inf))
    assert held.min() >= min(margin, 0.0) - 1e-6
