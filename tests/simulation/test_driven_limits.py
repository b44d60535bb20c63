"""Driven joints beside stops, friction and locks: closed forms, what has no way out, and what it costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import make_interp_spline

import robust_gcp as rg

from .machines import BACKENDS, require_backend
from .test_driven_phases import MASS, OMEGA, SIZE, block, swing, turning


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Any:
    return require_backend(request.param)


def test_locks_that_leave_a_drive_no_way_are_named() -> None:
    """One degree of freedom besides the drive's, and two locks: neither of them alone is in the way."""
    mech = rg.load("five_bar")
    parts = [rg.Lock("q4", start=0.1), rg.Lock("q3", start=0.2)]
    with pytest.raises(rg.SimulationError, match="drive: q1 would take one of q4, q3 ") as stop:
        rg.simulate(mech, duration=0.5, step=2e-3, drive={"q1": swing(0.3, 3.0, 2.2)}, joints=parts)
    assert stop.value.trajectory is not None
    assert stop.value.trajectory.t[-1] == pytest.approx(0.2, abs=1e-9)


def turntable() -> rg.Mechanism:
    """A table that turns about the vertical, without gravity, and a bead in its radial groove."""
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    table = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "th")
    model.appendBodyToJoint(table, pin.Inertia(1.0, np.zeros(3), 0.2 * np.eye(3)), pin.SE3.Identity())
    bead = model.addJoint(table, pin.JointModelPX(), pin.SE3.Identity(), "r")
    model.appendBodyToJoint(bead, pin.Inertia(MASS, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    return rg.Mechanism.from_pinocchio(model)


def test_a_bead_in_a_groove_that_turns_rubs_by_what_coriolis_presses(backend: Any) -> None:
    """r̈ = ω² r − 2 μ ω ṙ: two exponentials. Spun up from rest it sticks until r α² t² = F₀/m + μ r α."""
    rate, share, r0 = 3.0, 0.3, 0.2
    kw: dict[str, Any] = {"backend": backend, "record": ("a", "tau", "energy")}
    parts = [rg.JointFriction("r", 0.0, coefficient=share)]
    run = rg.simulate(
        turntable(), [0.0, r0], [rate, 0.0], 0.5, 5e-3, drive={"th": turning(0.0, rate)}, joints=parts, **kw
    )
    one, two = np.roots([1.0, 2.0 * share * rate, -(rate**2)])
    exact = r0 * (two * np.exp(one * run.t) - one * np.exp(two * run.t)) / (two - one)
    np.testing.assert_allclose(run["r"], exact, atol=1e-9)  # RK4: (5 ω h)^4 at most
    pressed = 2.0 * MASS * rate * run["v.r"]
    np.testing.assert_allclose(run["friction.r"], -share * pressed, atol=1e-10)
    np.testing.assert_allclose(run["drive.th"], pressed * run["r"], atol=1e-10)
    spin, F0 = 4.0, 1.0
    up = rg.Motion(lambda t: 0.5 * spin * t * t, lambda t: spin * t, lambda t: spin)
    parts = [rg.JointFriction("r", F0, coefficient=share)]
    run = rg.simulate(turntable(), [0.0, r0], None, 0.6, 1e-2, drive={"th": up}, joints=parts, **kw)
    assert [x.kind for x in run.happenings] == ["hold", "release"]
    until = np.sqrt((F0 / MASS + share * r0 * spin) / (r0 * spin**2))
    assert run.happenings[-1].time == pytest.approx(until, abs=1e-9)


def test_motions_are_asked_for_the_steps_that_are_taken() -> None:
    """Not for all that are to come, phase after phase: that would grow as the square of the duration."""
    asked = list[float]()

    def place(t: float) -> float:
        asked.append(float(t))  # takes no arrays
        return SIZE * float(np.sin(OMEGA * t))

    table = rg.Motion(
        place, lambda t: SIZE * OMEGA * np.cos(OMEGA * t), lambda t: -SIZE * OMEGA**2 * np.sin(OMEGA * t)
    )
    parts = [rg.Stop("r", lower=-0.005, upper=0.005, restitution=0.9)]
    run = rg.simulate(block(True), drive={"x": table}, duration=4.0, step=2e-3, joints=parts)
    assert len(run.happenings) > 30
    # three times in a step, twice as many steps as are taken, and what events need
    assert len(asked) < 2 * 3 * 2000 + 200 * len(run.happenings)


def test_what_rests_at_a_dead_point_rubs_when_it_goes_on(backend: Any) -> None:
    """There nothing moves the slide: by power when the crank is driven, and as under the torque F else."""
    crank, F, at = rg.load("slider_crank"), 2.0, [0.0, 0.0, 3.5]
    kw: dict[str, Any] = {"backend": backend, "record": ("a", "energy", "tau"), "step": 2e-3}
    turn = rg.Motion(lambda t: 1 - np.cos(2 * t), lambda t: 2 * np.sin(2 * t), lambda t: 4 * np.cos(2 * t))
    free = rg.simulate(crank, duration=2.0, drive={"q1": turn}, **kw)
    parts: list[Any] = [rg.JointFriction("q3", F)]
    run = rg.simulate(crank, duration=2.0, drive={"q1": turn}, joints=parts, **kw)
    assert [x.kind for x in run.happenings] == ["hold", "release", "at rest"]
    own = np.isin(run.t, free.t)
    rate = 2.0 * np.sin(2.0 * free.t)
    moving = (np.abs(rate) > 0.05) & (free.t > 0.01)
    lost = F * np.abs(run["v.q3"][own][moving]) / rate[moving]
    np.testing.assert_allclose(run["drive.q1"][own][moving], free["drive.q1"][moving] + lost, atol=1e-10)
    run = rg.simulate(crank, at, [0.0] * 3, 0.4, torque=[50.0, 0.0, 0.0], joints=parts, **kw)
    exact = rg.simulate(crank, at, [0.0] * 3, 0.4, torque=[50.0, 0.0, F], **kw)
    assert [x.kind for x in run.happenings] == ["hold", "release"]
    # up to 2e-6 m/s, for 1 ms, it does not rub: F v t = 4e-9 J; the rest is RK4's, in other steps
    np.testing.assert_allclose(run.at([0.1])["q1"], exact.at([0.1])["q1"], atol=2e-8)
    lock = [rg.Lock("q3")]
    run = rg.simulate(crank, at, [0.0] * 3, 0.4, torque=[50.0, 0.0, 0.0], joints=lock, **kw)
    # as soon as it can: q3 falls by 1.2 q1² /2
    assert np.abs(run["q3"] - 3.5).max() < 1e-9 and np.abs(run["q1"]).max() < 1e-4


def test_a_spline_without_a_second_derivative_is_no_motion() -> None:
    with pytest.raises(rg.OptionError, match=r"no second derivative.*degree 3"):
        rg.Motion(make_interp_spline([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], k=1))
