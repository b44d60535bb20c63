"""Crossings: all of them, once, at their times, whatever the stepper and the outputs are."""

import numpy as np
import pytest
from scipy.optimize import brentq

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import parallelogram_pendulum, pendulum
from robust_gcp.simulation.runs.crossings import hermite

PI = np.pi


def exact_times(duration: float, y0: float) -> list[float]:
    """Zeros of sin y on the rhombus' free fall, from its elliptic solution."""
    A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)
    t = np.linspace(0.0, duration, 4001)

    def folded(s: float, angle: float) -> float:
        return float(pendulum(s, y0, 0.0, A, B)[0]) - angle

    y = pendulum(t, y0, 0.0, A, B)[0]
    return sorted(
        brentq(folded, t[i], t[i + 1], args=(angle,), xtol=1e-15)
        for angle in (0.0, -PI)
        for i in np.flatnonzero((y[:-1] - angle) * (y[1:] - angle) < 0.0)
    )


@pytest.mark.parametrize("outputs", (5.0, 1.0, 0.3, 0.01))
@pytest.mark.parametrize("stepper", ("DOP853", "RK45", "Radau", "LSODA"))
def test_adaptive_steppers_list_every_crossing_whatever_the_outputs(stepper: str, outputs: float) -> None:
    run = rg.simulate(rg.load("rhombus"), duration=5.0, step=outputs, stepper=stepper, rtol=1e-9, atol=1e-11)
    exact = exact_times(5.0, 0.2)
    found = [c.time for c in run.crossings]
    assert len(found) == len(exact) == 9
    assert np.abs(np.array(found) - exact).max() < 1e-6
    assert all(np.sin(c.y[0]) == pytest.approx(0.0, abs=1e-10) for c in run.crossings)


@pytest.mark.parametrize("backend", ("python", "native"))
@pytest.mark.parametrize("step", (1e-3, 4e-3, 0.05))
def test_fixed_steps_time_crossings_to_the_steps_order(backend: str, step: float) -> None:
    """Quintic in the step: what is left is RK4's own error, 1e-11 of an h of 1 ms, growing with h⁴."""
    if not rg.backends()[backend].available:
        pytest.skip("no compiled kernel")
    run = rg.simulate(rg.load("rhombus"), duration=1.5, step=step, backend=backend)
    exact = exact_times(1.5, 0.2)
    found = [c.time for c in run.crossings]
    assert len(found) == len(exact) == 3
    assert np.abs(np.array(found) - exact).max() < 1e-10 * (step / 1e-3) ** 4


def weightless_rhombus() -> rg.Mechanism:
    """Its speed stays as it is: steppers make no error in y."""
    model = four_bar(1.0, 1.0, 1.0, 1.0).model.copy()
    model.gravity.linear[:] = 0.0
    return rg.Mechanism.from_pinocchio(model, [rg.PointClosure("q2_tip", "q3_tip")], ["q1"])


@pytest.mark.parametrize("backend", ("python", "auto"))
def test_two_surfaces_in_one_step_are_both_listed(backend: str) -> None:
    """40 rad/s and steps of 0.1 s: 4 rad at once, and a flat configuration each π."""
    mech = weightless_rhombus()
    q0 = 0.5 * np.array([1.0, -1.0, 1.0])
    with pytest.warns(rg.CoarseStepWarning):
        run = rg.simulate(mech, q0, mech.lift(q0, [40.0]), duration=1.0, step=0.1, backend=backend)
    exact = (np.pi * np.arange(1, 13) - 0.5) / 40.0
    assert [c.time for c in run.crossings] == pytest.approx(exact.tolist(), abs=1e-10)


def test_a_crossing_on_an_output_counts_once() -> None:
    """At constant speed without gravity the rhombus is flat exactly at an output."""
    mech = weightless_rhombus()
    q0 = 0.25 * np.array([1.0, -1.0, 1.0])
    for backend in ("python", "auto"):
        run = rg.simulate(mech, q0, mech.lift(q0, [-1.0]), duration=0.5, step=1.0 / 64.0, backend=backend)
        assert run.q[16, 0] == pytest.approx(0.0, abs=1e-13)  # the rounding of γ'' on the bridge
        assert [c.time for c in run.crossings] == pytest.approx([0.25], abs=1e-11)


def test_the_quintic_meets_both_ends_and_reproduces_quintics() -> None:
    p = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.5, -0.7, 1.1])
    ends = [[np.array([f(t)]) for f in (p, p.deriv(), p.deriv(2))] for t in (0.2, 0.9)]
    stretch = hermite(0.2, 0.9, *ends)
    for t in np.linspace(0.2, 0.9, 9):
        assert stretch.y(t)[0] == pytest.approx(p(t), abs=1e-14)
