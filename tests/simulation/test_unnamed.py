"""Steps that nobody named: the usual ones where they serve; else parts of them, or error control, told of."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.simulation.runs.solver_run import AdaptiveRun

pytestmark = pytest.mark.filterwarnings("ignore::robust_gcp.ModelWarning")

USUAL = 1e-3
TIMES = np.linspace(0.0, 0.1, 101)


def slider(rate: float) -> rg.Mechanism:
    """1 kg that falls through a damper of c = rate N s/m: v̇ = g − rate v."""
    return rg.Mechanism.from_mjcf(
        f"""<mujoco><worldbody><body><joint name="z" type="slide" axis="0 0 -1" damping="{rate!r}"/>
        <geom type="sphere" size="0.1" mass="1"/></body></worldbody></mujoco>""",
        ["z"],
    )


def fallen(rate: float, t: Any) -> Any:
    """Closed form: g / rate (t − (1 − e^{−rate t}) / rate)."""
    return 9.81 / rate * (t + np.expm1(-rate * t) / rate)


@pytest.mark.parametrize(("rate", "parts"), [(3e3, 4), (1.5e4, 16), (6e4, 64)])
@pytest.mark.parametrize("backend", ["auto", "python"])
def test_a_stiff_start_takes_the_step_in_parts(rate: float, parts: int, backend: Any) -> None:
    """The parts are at most half as long as RK4 allows, the rows are those of the usual step."""
    with pytest.warns(rg.StabilityWarning, match="no step was named, and the usual 0.001 s lies outside"):
        run = rg.simulate(slider(rate), duration=0.1, backend=backend)
    assert run.stats.step == pytest.approx(USUAL / parts, rel=1e-12)
    assert 0.25 * 2.785 < run.stats.step * rate < 0.5 * 2.786
    np.testing.assert_allclose(run.t, TIMES, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(run.q[:, 0], fallen(rate, run.t), rtol=0.0, atol=3e-3 * 9.81 / rate**2)
    named = rg.simulate(slider(rate), duration=0.1, step=run.stats.step, backend=backend)
    np.testing.assert_allclose(named.q[::parts], run.q, rtol=0.0, atol=1e-15)


def test_a_start_too_stiff_for_parts_takes_an_implicit_stepper() -> None:
    with pytest.warns(rg.StabilityWarning, match='stepper="Radau" is taken'):
        run = rg.simulate(slider(2e6), duration=0.1)
    assert (run.stats.stepper, run.stats.step) == ("Radau", None)
    np.testing.assert_allclose(run.t, TIMES, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(run.q[:, 0], fallen(2e6, run.t), rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize(("speed", "allowed"), [(300.0, 1e-5), (2000.0, 1e-3)])
def test_a_motion_too_fast_for_the_usual_step_has_error_control(speed: float, allowed: float) -> None:
    """Told by energy at 0.6 rad a step and by what a step moves at 4 rad; without gravity energy stays.

    DOP853 takes a step across the peak of the crank's speed for good now and then, on the closed form
    too: of 40 speeds within 4 % of 2000 rad/s three have errors above 1e-5 there, the largest 1.3e-4.
    """
    linkage = four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    v0 = linkage.lift(linkage.home, [speed])
    with pytest.warns(rg.CoarseStepWarning, match="no step was named, and steps of 0.001 s do not serve"):
        run = rg.simulate(linkage, v0=v0, duration=0.05)
    assert (run.stats.stepper, run.stats.step, len(run.t)) == ("DOP853", None, 51)
    assert np.abs(run.energy_error()).max() < allowed * linkage.tree.kinetic(run.q[0], v0)
    assert run.closure_error().max() < 1e-12
    named = rg.simulate(linkage, v0=v0, duration=0.05, step=USUAL, stepper="DOP853")
    np.testing.assert_array_equal(run.q, named.q)


def test_a_run_that_stops_for_its_steps_goes_on_with_error_control() -> None:
    """A stiff damper beside a singular start, where nothing is linearised: no branch is found at 1 ms."""
    free = four_bar(1.0, 1.0, 1.0, 1.0, y=0.02)
    forces = [rg.JointDamper("q1", 1.5e4)]
    rhombus = rg.Mechanism.from_pinocchio(free.model, free.closures, ["q1"], home=free.home, forces=forces)
    v0 = rhombus.lift(rhombus.home, [-1.0])
    with pytest.raises(rg.SimulationError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rg.simulate(rhombus, v0=v0, duration=0.05, step=USUAL)
    with pytest.warns(rg.CoarseStepWarning, match=r"do not serve \((BranchError|NonFiniteError)"):
        run = rg.simulate(rhombus, v0=v0, duration=0.05)
    assert run.stats.stepper == "DOP853"
    assert run.t[-1] == 0.05
    # the crank stops at once, after 1/c of its momentum, and creeps on by gravity τ/c
    assert abs(run.q[-1, 0] - 0.02) < 5e-3
    assert np.abs(run.energy_error()).max() < 1e-6


def test_where_error_control_stops_too_finer_steps_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where coordinates have to be changed in a zone that a solver's trial steps leave."""

    def stops(self: Any) -> None:
        raise rg.BranchError("lost")

    linkage = four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    v0 = linkage.lift(linkage.home, [300.0])
    monkeypatch.setattr(AdaptiveRun, "go", stops)
    with pytest.warns(rg.CoarseStepWarning, match=r"in steps of 6.25e-05 s, as DOP853 stops \(lost\)"):
        run = rg.simulate(linkage, v0=v0, duration=0.05)
    assert (run.stats.stepper, run.stats.step, len(run.t)) == ("rk4", USUAL / 16, 51)
    assert np.abs(run.energy_error()).max() < 1e-5 * linkage.tree.kinetic(run.q[0], v0)


def test_what_serves_is_left_alone() -> None:
    """Without a word, and to the last bit what the usual step gives."""
    linkage = four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    run, named = rg.simulate(linkage), rg.simulate(linkage, duration=1.0, step=USUAL)
    assert (run.stats.stepper, run.stats.step) == ("rk4", USUAL)
    np.testing.assert_array_equal(run.q, named.q)


def test_torque_functions_are_called_for_one_run_alone() -> None:
    """They may be controllers with a memory: time goes back by no more than a step."""
    seen: list[float] = []

    def torque(t: float, q: Any, v: Any) -> Any:
        seen.append(t)
        return np.zeros(1)

    with warnings.catch_warnings(), pytest.raises(rg.NonFiniteError):
        warnings.simplefilter("ignore")
        rg.simulate(slider(1.5e4), v0=[1.0], duration=0.1, torque=torque)
    assert np.diff(seen).min() >= -USUAL


def driven(ctrl: Any, **more: Any) -> tuple[rg.Trajectory, float]:
    """A crank under its control, too fast for the usual step; and how far the usual step itself takes it."""
    plain = four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    motor = [rg.Actuator.motor("drive", "q1")]
    crank = rg.Mechanism.from_pinocchio(plain.model, plain.closures, ["q1"], plain.home, actuators=motor)
    given = dict(v0=crank.lift(crank.home, [400.0]), duration=0.02, ctrl={"drive": ctrl}, **more)
    with pytest.warns(rg.CoarseStepWarning):
        return rg.simulate(crank, **given), rg.simulate(crank, step=USUAL, **given).q[-1, 0]


def test_functions_of_controls_are_called_for_one_run_alone() -> None:
    """As those of torques are, and once a step where they are held, which no other stepper would know."""
    seen: list[float] = []
    for hold in (False, True):
        seen.clear()
        run, usual = driven(lambda t, q, v: seen.append(t) or 5.0, hold=hold)
        assert (run.stats.stepper, run.q[-1, 0]) == ("rk4", usual)
    assert len(seen) == 2 * 20


def test_tables_that_are_held_stay_with_their_step() -> None:
    run, usual = driven(([0.0, 0.02], [0.0, 5.0]), hold=True)
    assert (run.stats.stepper, run.q[-1, 0]) == ("rk4", usual)


def test_a_stepper_of_the_callers_says_what_it_was() -> None:
    linkage = four_bar(4.0, 1.0, 3.5, 3.0, y=1.0)
    midpoint = rg.Tableau(a=((0.5,),), b=(0.0, 1.0))
    assert rg.simulate(linkage, duration=0.01, stepper=midpoint).stats.stepper == "tableau"
    assert rg.simulate(linkage, duration=0.01, stepper="Radau").stats.stepper == "Radau"
