"""The stiff families: their references, and that no cell of theirs is wrong without saying so."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest

import robust_gcp as rg
from robust_gcp.maps.closed_form import pendulum
from robust_gcp.reports.stability import stiff
from robust_gcp.reports.stability.bound import KICK, TARGET, motions, stride
from robust_gcp.reports.stability.case import Case, Cell
from robust_gcp.reports.stability.judge import RIGHT, judge
from robust_gcp.reports.stability.stiff import SHARES, around
from robust_gcp.reports.stability.truth import A, B, Servo, of_run


def test_without_spring_and_damper_the_servo_is_the_exact_pendulum() -> None:
    t = np.linspace(0.0, 1.0, 21)
    exact = pendulum(t, 0.5, 0.0, A, B)[0]
    np.testing.assert_allclose(Servo(0.0, 0.0).exact(t)[:, 0], exact, atol=1e-10)


@pytest.mark.parametrize("servo", (Servo(30.0, 2.0), Servo(1e3 * B, 0.0), Servo(0.0, 300.0)))
def test_the_servo_s_solution_satisfies_its_equation(servo: Servo) -> None:
    """A ÿ = −B cos y − k (y − r) − c (ẏ − ṙ), ÿ by central differences of the solution."""
    h = 1e-4
    t = 0.1 + h * np.arange(-1, 2)
    y = servo.exact(np.concatenate([[0.0], t]))[1:, 0]
    speed, acceleration = (y[2] - y[0]) / (2 * h), (y[0] - 2 * y[1] + y[2]) / h**2
    r, rate = servo.r0 * np.cos(0.4), -servo.r0 * servo.nu * np.sin(0.4)
    force = -B * np.cos(y[1]) - servo.k * (y[1] - r) - servo.c * (speed - rate)
    assert A * acceleration == pytest.approx(force, abs=1e-3 * max(abs(force), B))


def test_a_stiff_drive_starts_where_its_spring_carries_the_load() -> None:
    """No fast motion is left: y follows r(t) within the load over k, with a ripple of its square."""
    servo = Servo(1e6 * B, 0.0)
    t = np.linspace(0.0, 0.5, 2001)
    r = servo.r0 * np.cos(servo.nu * t)
    y = servo.exact(t)[:, 0]
    sag = -(B * np.cos(r) - A * servo.nu**2 * r) / servo.k
    assert np.abs(sag).max() > 1e-7
    assert np.abs(y - r - sag).max() < 1e-2 * np.abs(sag).max()


def test_the_scalar_rk4_s_error_is_of_order_four_and_infinite_outside_its_bound() -> None:
    servo = Servo(1e4 * B, 0.0)
    assert servo.floor(4e-4, 0.1) / servo.floor(2e-4, 0.1) == pytest.approx(16.0, rel=0.15)
    assert servo.floor(1e-2, 0.5) == np.inf


def test_references_between_outputs_are_as_good_as_the_run() -> None:
    mech = rg.load("rhombus")
    exact = of_run(mech, 0.3, step=1e-3, stepper="DOP853", rtol=1e-12, atol=1e-12)
    t = np.linspace(0.0, 0.3, 77)
    np.testing.assert_allclose(exact(t)[:, 0], pendulum(t, 0.2, 0.0, A, B)[0], atol=1e-10)


@functools.cache
def quick_cells(make: Callable[[bool], list[Case]]) -> list[Cell]:
    return [cell for case in make(True) for cell in judge(case)]


def names_of(make: Callable[[bool], list[Case]]) -> str:
    return make.__name__


@pytest.mark.parametrize("make", (stiff.springs, stiff.dampers, stiff.servos, stiff.across), ids=names_of)
def test_no_stiff_cell_is_wrong_without_saying_so(make: Callable[[bool], list[Case]]) -> None:
    cells = quick_cells(make)
    assert [f"{c.case.name}, {c.setting.label}: {c.reason}" for c in cells if c.verdict == "wrong"] == []
    # an implicit stepper passes each row, and every row but the softest stops a step of 1 ms by a warning
    assert {c.verdict for c in cells if c.setting.stepper == "Radau"} == {"right"}
    assert all(c.reason.startswith("warned: StabilityWarning") for c in cells if c.verdict == "stopped")
    if make is not stiff.across:
        assert any(c.verdict == "stopped" for c in cells)


def test_stiff_swings_cross_the_singularity_each_time() -> None:
    """A spring of 1e8 of gravity through q1 = π: four crossings in two swings, none without certificate."""
    cells = [c for c in quick_cells(stiff.across) if c.setting.method == "bridge"]
    assert {c.crossings for c in cells} == {4}


def test_within_bounds_inside_and_amber_outside() -> None:
    """The map of RK4's bound changes colour where the linearised equations say it does.

    Inside, a step near the bound damps the fast motion of `KICK` or errs in its phase, by no more than twice
    that: it may be coarse, but never wrong or stopped.
    """
    for case in around(True)[:3]:
        for share, cell in zip(SHARES, judge(case), strict=True):
            inside = "coarse" if cell.error > RIGHT else "right"
            assert cell.verdict == (inside if share < 1.0 else "stopped"), (case.name, share, cell.reason)
            assert share > 1.0 or cell.error <= 2.0 * KICK, (case.name, share, cell.error)
            assert cell.reason.startswith("warned: StabilityWarning") == (share > 1.0)


def test_radau_strides_over_the_fast_motion() -> None:
    """At 1e-5 rad its mean step is more than ten times RK4's bound on a servo of 1e8 of gravity."""
    servo = next(m for m in motions(True) if m.name.startswith("servo"))
    found = stride(servo, "Radau")
    assert found.error <= TARGET
    assert found.ratio > 10.0
    assert found.largest >= found.mean
    assert found.rhs < 0.5 * found.rk4_rhs
