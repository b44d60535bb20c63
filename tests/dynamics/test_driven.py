"""Prescribed motions: kinematics in closed form, the torque that they take, what moves freely beside them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import scipy
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.dynamics.prescribed.drive import Drive
from robust_gcp.dynamics.prescribed.time_rates import rates
from robust_gcp.examples.linkages import add_link

Array = NDArray[np.float64]

WAYS: dict[str, dict[str, Any]] = {
    "rk4": {},
    "DOP853": {"stepper": "DOP853"},
    "Radau": {"stepper": "Radau"},
    "classical": {"method": "classical"},
    "python": {"backend": "python"},
    "a tableau": {"stepper": rg.Tableau(((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6))},
}

OMEGA = 3.0


def turning(t: Any) -> Any:
    return 1.0 + OMEGA * t


def two_links() -> rg.Mechanism:
    """Rods of 1 m and 1 kg on hinges along x, one after the other."""
    model = pin.Model()
    add_link(model, add_link(model, 0, 0.0, "a", 1.0), 1.0, "b", 1.0)
    return rg.Mechanism.from_pinocchio(model)


@pytest.mark.parametrize("name", WAYS)
def test_slider_crank_at_constant_speed(name: str) -> None:
    """x = cos θ + √(l² − sin² θ), its rates, and the crank's torque by inverse dynamics and by dE/dθ."""
    mech = rg.load("slider_crank")
    run = rg.simulate(
        mech, duration=2.0, step=1e-2, drive={"q1": rg.Motion(turning)}, record=("a", "energy"), **WAYS[name]
    )
    angle = turning(run.t)
    np.testing.assert_allclose(run["q1"], angle, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(run["v.q1"], OMEGA)
    s, c, l2 = np.sin(angle), np.cos(angle), 2.5**2
    root = np.sqrt(l2 - s**2)
    slope = -s - s * c / root
    bend = -c - (c * c - s * s) / root - (s * c) ** 2 / root**3
    np.testing.assert_allclose(run["q3"], c + root, atol=1e-12)
    np.testing.assert_allclose(run["v.q3"], slope * OMEGA, atol=1e-11)
    np.testing.assert_allclose(run["a.q3"], bend * OMEGA**2, atol=1e-10)

    torque = run["drive.q1"]
    for i in range(0, len(run.t), 20):
        asked = rg.inverse_dynamics(mech, run.q[i], run.v[i], [0.0])
        np.testing.assert_allclose(torque[i], asked[0], atol=1e-10)

    def energy(theta: float) -> float:
        q = mech.assemble([theta, *run.q[0, 1:]]) if theta < 1.5 else np.full(3, np.nan)
        return mech.energy(q, mech.lift(q, [OMEGA]))

    h = 1e-5
    assert torque[0] == pytest.approx((energy(1.0 + h) - energy(1.0 - h)) / (2.0 * h), rel=1e-7)
    assert np.isnan(run.drive_torque[:, 1:]).all() if run.drive_torque is not None else False


def test_energy_balance_is_of_the_steppers_order() -> None:
    """Nothing but the work is integrated: its error falls as h⁴ where the speed is not constant."""
    mech = rg.load("slider_crank")
    drive = {"q1": rg.Motion(lambda t: 1.0 + 2.0 * np.sin(3.0 * t) ** 2)}
    errors = [
        float(np.abs(rg.simulate(mech, duration=1.0, step=h, drive=drive).energy_error()).max())
        for h in (2e-2, 1e-2)
    ]
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] > 14.0


def test_the_torque_recorded_makes_the_motion() -> None:
    """Applied as a torque it drives the same crank, by the ordinary equations."""
    mech = rg.load("slider_crank")
    asked = {"duration": 0.5, "step": 1e-3}
    driven = rg.simulate(mech, drive={"q1": rg.Motion(lambda t: 1.0 + 0.3 * t**3)}, **asked)
    torque = scipy.interpolate.make_interp_spline(driven.t, driven["drive.q1"], k=5)
    free = rg.simulate(mech, mech.home, torque={"q1": lambda t, q, v: float(torque(t))}, **asked)
    np.testing.assert_allclose(free.q, driven.q, atol=1e-9)


def test_constraint_forces_hold_with_a_drive() -> None:
    """M a + C − τ_drive = Kᵀ λ to rounding."""
    mech = rg.load("slider_crank")
    run = rg.simulate(
        mech, duration=1.0, step=1e-2, drive={"q1": rg.Motion(turning)}, record=("a", "multipliers")
    )
    assert run.a is not None
    assert run.multipliers is not None
    for i in range(0, 100, 9):
        left = mech.tree.rnea(run.q[i], run.v[i], run.a[i]).copy()
        left[0] -= run["drive.q1"][i]
        np.testing.assert_allclose(left, mech.K(run.q[i]).T @ run.multipliers[i], atol=1e-9)


def test_what_is_not_driven_moves_freely() -> None:
    """A pendulum on a driven rod moves as it does where the recorded torque acts on that rod."""
    mech = two_links()
    drive = {"a": rg.Motion(lambda t: 0.2 * np.sin(5.0 * t))}
    asked = {"duration": 1.0, "step": 5e-4}
    driven = rg.simulate(mech, [0.0, 0.4], drive=drive, **asked)
    torque = scipy.interpolate.make_interp_spline(driven.t, driven["drive.a"], k=5)
    free = rg.simulate(mech, [0.0, 0.4], [1.0, 0.0], torque={"a": lambda t, q, v: float(torque(t))}, **asked)
    np.testing.assert_allclose(free.q, driven.q, atol=1e-8)
    assert np.abs(driven.energy_error()).max() < 1e-7


def test_a_free_joint_on_a_held_one_is_a_pendulum() -> None:
    """Held by a number: the second rod swings as if on the ground, and the first takes its moment."""
    mech = two_links()
    held = rg.simulate(mech, [0.0, 0.4], duration=1.0, step=1e-3, drive={"a": rg.Motion(0.0)})
    model = pin.Model()
    add_link(model, 0, 0.0, "b", 1.0)
    alone = rg.simulate(rg.Mechanism.from_pinocchio(model), [0.4], duration=1.0, step=1e-3)
    np.testing.assert_allclose(held["b"], alone["b"], atol=1e-12)
    np.testing.assert_array_equal(held["a"], 0.0)


@pytest.mark.parametrize("stepper", ["rk4", "DOP853"])
def test_straight_through_singular_configurations(stepper: str) -> None:
    """A rhombus driven through its flat position stays on its mode, q = (y, −y, y), torque and all."""
    mech = rg.load("rhombus")
    drive = {"q1": rg.Motion(lambda t: 0.5 - 1.0 * t)}
    run = rg.simulate(
        mech, [0.5, -0.5, 0.5], duration=1.0, step=1e-2, drive=drive, stepper=stepper, record="a"
    )
    y = 0.5 - run.t
    np.testing.assert_allclose(run.q, np.stack([y, -y, y], axis=1), atol=1e-10)
    np.testing.assert_allclose(run.a, 0.0, atol=1e-8)
    assert [c.time for c in run.crossings] == [pytest.approx(0.5, abs=1e-9)]
    # on this mode the rods move in parallel: the torque is that of a smooth function of y
    fit = scipy.interpolate.make_interp_spline(run.t[::5], run["drive.q1"][::5], k=5)
    np.testing.assert_allclose(run["drive.q1"], fit(run.t), atol=1e-6)


def test_a_dependent_joint_is_made_independent() -> None:
    mech = rg.load("slider_crank")
    reach = float(mech.home[2])
    run = rg.simulate(
        mech, duration=1.0, step=1e-2, drive={"q3": rg.Motion(lambda t: reach + 0.2 * np.sin(4.0 * t))}
    )
    assert run.mechanism.independent == ("q3",)
    np.testing.assert_allclose(run["q3"], reach + 0.2 * np.sin(4.0 * run.t), atol=1e-13)
    assert run.closure_error().max() < 1e-11


def test_home_is_led_to_where_the_drive_begins() -> None:
    mech = rg.load("slider_crank")
    run = rg.simulate(mech, duration=0.1, step=1e-2, drive={"q1": rg.Motion(lambda t: 4.0 + t)})
    s = np.sin(4.0 + run.t)
    np.testing.assert_allclose(run["q3"], np.cos(4.0 + run.t) + np.sqrt(2.5**2 - s**2), atol=1e-12)


def test_a_table_and_given_rates_are_the_same_motion() -> None:
    mech = rg.load("slider_crank")
    asked = {"duration": 1.0, "step": 1e-2}
    times = np.linspace(0.0, 1.0, 201)

    def position(t: Any) -> Any:
        return 1.0 + np.sin(t) * t

    motions = [
        rg.Motion(position),
        rg.Motion(position, lambda t: np.cos(t) * t + np.sin(t)),
        rg.Motion(
            lambda t: 1.0 + math.sin(t) * t,
            lambda t: math.cos(t) * t + math.sin(t),
            lambda t: 2.0 * math.cos(t) - math.sin(t) * t,
        ),
        rg.Motion((times, position(times))),
        rg.Motion(scipy.interpolate.make_interp_spline(times, position(times), k=5)),
    ]
    runs = [rg.simulate(mech, drive={"q1": motion}, **asked) for motion in motions]
    for run, tolerance in zip(runs[1:], (1e-12, 1e-12, 1e-6, 1e-6), strict=True):
        np.testing.assert_allclose(run.q, runs[0].q, atol=tolerance)
        np.testing.assert_allclose(run["drive.q1"], runs[0]["drive.q1"], atol=1e3 * tolerance)


DERIVED: dict[str, tuple[Any, Any, Any]] = {
    "polynomial": (
        lambda t: 3.0 * t**4 - t / 2.0 + 1.0, lambda t: 12.0 * t**3 - 0.5, lambda t: 36.0 * t**2,
    ),
    "product": (
        lambda t: np.sin(2.0 * t) * np.exp(-t),
        lambda t: np.exp(-t) * (2.0 * np.cos(2.0 * t) - np.sin(2.0 * t)),
        lambda t: np.exp(-t) * (-3.0 * np.sin(2.0 * t) - 4.0 * np.cos(2.0 * t)),
    ),
    "quotient": (lambda t: 1.0 / (1.0 + t), lambda t: -1.0 / (1.0 + t) ** 2, lambda t: 2.0 / (1.0 + t) ** 3),
    "root": (lambda t: np.sqrt(t), lambda t: 0.5 * t**-0.5, lambda t: -0.25 * t**-1.5),
    "power of two": (lambda t: 2.0**t, lambda t: np.log(2.0) * 2.0**t, lambda t: np.log(2.0) ** 2 * 2.0**t),
    "hyperbolic": (
        lambda t: np.tanh(t), lambda t: 1 / np.cosh(t) ** 2, lambda t: -2 * np.tanh(t) / np.cosh(t) ** 2
    ),
    "arcs": (lambda t: np.arcsin(t / 9) + np.arccos(t / 9), lambda t: 0.0, lambda t: 0.0),
    "arctangent": (
        lambda t: np.arctan(t), lambda t: 1 / (1 + t * t), lambda t: -2 * t / (1 + t * t) ** 2
    ),
    "tangent": (
        lambda t: np.tan(t), lambda t: 1 / np.cos(t) ** 2, lambda t: 2 * np.tan(t) / np.cos(t) ** 2
    ),
    "logarithms": (
        lambda t: np.log(t) + np.log1p(t),
        lambda t: 1 / t + 1 / (1 + t),
        lambda t: -1 / t**2 - 1 / (1 + t) ** 2,
    ),
    "pieces": (
        lambda t: np.where(t < 1.0, t * t, 2.0 * t - 1.0),
        lambda t: min(2.0 * t, 2.0),
        lambda t: 2.0 * (t < 1.0),
    ),
    "least": (
        lambda t: np.minimum(t * t, 5.0), lambda t: 2.0 * t * (t * t < 5.0), lambda t: 2.0 * (t * t < 5.0),
    ),
    "saw": (lambda t: (t % 0.4) ** 2, lambda t: 2.0 * (t % 0.4), lambda t: 2.0),
    "constant": (lambda t: 3.0, lambda t: 0.0, lambda t: 0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", DERIVED)
def test_functions_are_differentiated_to_rounding(name: str) -> None:
    functions = DERIVED[name]
    for t in (0.3, 0.7, 1.7, 2.3):
        np.testing.assert_allclose(rates(functions[0], t), [f(t) for f in functions], rtol=1e-14, atol=1e-15)


REFUSED: dict[str, tuple[Any, dict[str, Any], str]] = {
    "no motion": (lambda: {"q1": 3.0}, {}, r"rg\.Motion"),
    "nothing": (dict, {}, "drive"),
    "unknown joint": (lambda: {"crank": rg.Motion(1.0)}, {}, "no joint 'crank'"),
    "too many": (lambda: {"q1": rg.Motion(1.0), "q3": rg.Motion(2.0)}, {}, "cannot be driven together"),
    "not for numbers": (lambda: {"q1": rg.Motion(lambda t: math.sin(t))}, {}, r"np\.sin instead of math"),
    "wrong velocity": (lambda: {"q1": rg.Motion(lambda t: 1.0 + t, lambda t: 2.0)}, {}, "the velocity given"),
    "wrong acceleration": (
        lambda: {"q1": rg.Motion(lambda t: 1.0 + t, lambda t: 1.0, lambda t: 3.0)},
        {}, "the acceleration given",
    ),
    "start": (lambda: {"q1": rg.Motion(2.0)}, {"q0": rg.load("slider_crank").home}, "drive begins with"),
    "speed": (
        lambda: {"q1": rg.Motion(turning)},
        {"q0": rg.load("slider_crank").home, "v0": np.zeros(3)}, "velocity 3",
    ),
    "table ends": (
        lambda: {"q1": rg.Motion(([0.0, 0.1, 0.2, 0.3], [1.0, 1.0, 1.1, 1.2]))}, {}, "table of a Motion ends",
    ),
    "not finite": (lambda: {"q1": rg.Motion(lambda t: np.log(t))}, {}, "not finite"),
    "repartition": (lambda: {"q1": rg.Motion(turning)}, {"on_toggle": "repartition"}, "on_toggle"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_driven_is_refused_by_name(what: str) -> None:
    drive, more, words = REFUSED[what]
    with pytest.raises(rg.RobustGcpError, match=words), np.errstate(all="ignore"):
        rg.simulate(rg.load("slider_crank"), duration=1.0, step=0.1, drive=drive(), **more)


def test_motions_that_are_none() -> None:
    for position in ("fast", ([0.0, 1.0], [0.0, 1.0]), ([0.0, 1.0, 0.5, 2.0], [0.0] * 4), None, [1.0, 2.0]):
        with pytest.raises(rg.OptionError, match="Motion"):
            rg.Motion(position)
    with pytest.raises(rg.OptionError, match="velocity"):
        rg.Motion(lambda t: t, acceleration=lambda t: 0.0)


def test_the_torque_is_kept_in_files(tmp_path: Any) -> None:
    run = rg.simulate(rg.load("slider_crank"), duration=0.1, step=1e-2, drive={"q1": rg.Motion(turning)})
    again = rg.load_trajectory(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again["drive.q1"], run["drive.q1"])
    assert "drive.q1" in run.to_csv(tmp_path / "run.csv").read_text().splitlines()[0].split(",")


def crank_slider() -> rg.Mechanism:
    """A crank of 0.1 m and a rod of 0.35 m, whose slider turns back at 0.45 m."""
    model = pin.Model()
    crank = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "crank")
    rod = model.addJoint(crank, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, 0.1, 0.0])), "rod")
    slider = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), "slider")
    for joint in (crank, rod, slider):
        body = pin.Inertia(1.0, np.array([0.0, 0.05, 0.0]), 0.01 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.35, 0.0]))
    model.addFrame(pin.Frame("tip", rod, tip, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("pin", slider, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    home = np.array([1.0, -1.0 - np.arcsin(np.sin(1.0) * 0.1 / 0.35), 0.0])
    home[2] = 0.1 * np.cos(1.0) + 0.35 * np.cos(home[0] + home[1])
    return rg.Mechanism.from_pinocchio(model, [rg.PointClosure("tip", "pin")], ["slider"], home=home)


@pytest.mark.parametrize("gap", [1e-4, 1e-6])
def test_a_slider_that_turns_just_before_its_dead_point(gap: float) -> None:
    mech = crank_slider()
    begin = float(mech.home[2])
    motion = rg.Motion(lambda t: begin + (0.45 - gap - begin) * np.sin(np.pi * t) ** 2)
    run = rg.simulate(mech, duration=1.0, step=0.05, drive={"slider": motion})
    crank = np.arccos((run["slider"] ** 2 + 0.1**2 - 0.35**2) / (0.2 * run["slider"]))
    assert run["slider"].max() == pytest.approx(0.45 - gap, abs=1e-12)
    np.testing.assert_allclose(run["crank"], crank, rtol=0.0, atol=1e-16 / gap**0.5 * 100.0)


def test_a_drive_beyond_a_dead_point_is_told_what_helps() -> None:
    mech = crank_slider()
    begin = float(mech.home[2])
    with pytest.raises(rg.ToggleError) as stop:
        rg.simulate(mech, duration=1.0, step=0.02, drive={"slider": rg.Motion(lambda t: begin + 0.2 * t)})
    words = str(stop.value)
    assert "on_toggle" not in words
    assert "drive another joint that can" in words
    assert "slider = 0.44" in words
    assert ("crank",) in stop.value.choices


@pytest.mark.parametrize("step", [1e-2, 1e-3])
def test_a_kink_of_a_drive_is_named(step: float) -> None:
    """By its time and both velocities, whatever the step; nothing is said of the step."""
    mech, kink = rg.load("slider_crank"), 0.0437
    begin = float(mech.home[0])
    motion = rg.Motion(lambda t: begin + (3.0 * t if t < kink else 3.0 * kink + 0.0 * t))
    with pytest.warns(rg.KinkedDriveWarning, match=r"jumps at t = 0.0437 s, from 3 to 0") as caught:
        rg.simulate(mech, mech.home, duration=0.1, step=step, drive={"q1": motion})
    assert len(caught) == 1


def test_smooth_drives_have_no_kink() -> None:
    for motion in (
        rg.Motion(lambda t: np.tanh(200.0 * (t - 0.5))),
        rg.Motion(lambda t: 3.0 * t),
        rg.Motion(1.0),
    ):
        assert Drive(crank_slider(), {"slider": motion}).kink(np.linspace(0.0, 1.0, 21)) is None
