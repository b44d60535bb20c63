"""Each verdict of the stability study is given where it must be, and nowhere else."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import robust_gcp as rg
from robust_gcp.examples.linkages import four_bar
from robust_gcp.maps.closed_form import parallelogram_pendulum, pendulum
from robust_gcp.reports.stability import judge as module
from robust_gcp.reports.stability.case import Case, Cell, Setting
from robust_gcp.reports.stability.judge import MOST_CHECKED, judge, thinned

Array = NDArray[np.float64]
A, B = parallelogram_pendulum(1.0, 1.0, 1.0, 1.0, 1.0)


def exact(t: Array) -> Array:
    return pendulum(t, 0.2, 0.0, A, B)[0][:, None] * np.array([1.0, -1.0, 1.0])


def start() -> tuple[rg.Mechanism, Array, Array]:
    mech = four_bar(1.0, 1.0, 1.0, 1.0, y=0.2)
    return mech, mech.home, np.zeros(3)


FALL = Case("test", "fall", start, 0.4, (Setting(step=4e-3),), 1e-7, exact, crossings=1)


def only(case: Case) -> Cell:
    (cell,) = judge(case)
    return cell


def test_right_with_all_its_figures() -> None:
    cell = only(replace(FALL, energy_allowed=1e-6, mode_kept=lambda q: bool(abs(q[-1, 0] + q[-1, 1]) < 1e-9)))
    assert cell.verdict == "right"
    assert cell.reason == ""
    assert 0.0 < cell.error < 1e-7
    assert 0.0 < cell.energy_drift < 1e-6
    assert cell.closure_error < 1e-13
    assert (cell.crossings, cell.mode_kept, cell.rhs) == (1, True, 401)


def test_a_coarse_step_is_not_called_right() -> None:
    """One step for the whole fall errs by more than `RIGHT`: allowed, and told apart."""
    cells = judge(replace(FALL, settings=(Setting(step=0.4), Setting(step=4e-3)), allowed=1.0))
    assert [c.verdict for c in cells] == ["coarse", "right"]
    assert cells[0].error > module.RIGHT > cells[1].error


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"allowed": 1e-15}, "error .* above 1.0e-15"),
        ({"reference": lambda t: exact(t) + 1.0}, "error 1.0e.00 above"),
        ({"energy_allowed": 0.0}, "energy drift"),
        ({"closure_allowed": -1.0}, "closure error"),
        ({"crossings": 2}, "1 crossings logged instead of 2"),
        ({"mode_kept": lambda q: False}, "left its mode"),
    ],
)
def test_wrong_when_a_figure_is_and_nothing_was_said(change: dict[str, object], reason: str) -> None:
    cell = only(replace(FALL, **change))  # type: ignore[arg-type]
    assert cell.verdict == "wrong"
    with pytest.raises(AssertionError, match=reason):
        raise AssertionError(cell.reason)


def test_typed_errors_stop_a_cell_and_keep_what_came_before() -> None:
    """The crank-rocker's rocker turns back after 0.28 s."""
    mech = rg.load("crank_rocker").with_independent(["q3"])
    start = mech, mech.home, np.zeros(3)
    more = {"on_toggle": "error"}
    case = Case("test", "toggle", lambda: start, 0.4, (Setting(step=0.01),), None, more=more)
    cell = only(case)
    assert cell.verdict == "stopped"
    assert cell.reason.startswith("ToggleError: ")
    assert cell.rhs > 0
    assert cell.closure_error < 1e-12


def test_a_case_that_cannot_be_built_is_refused_in_every_column() -> None:
    def build() -> tuple[rg.Mechanism, Array, Array]:
        raise rg.ModelError("no such linkage")

    cells = judge(replace(FALL, build=build, settings=(Setting(), Setting(stepper="Radau"))))
    assert [(c.verdict, c.reason) for c in cells] == [("stopped", "refused: ModelError: no such linkage")] * 2


def test_errors_of_other_types_are_wrong() -> None:
    def torque(t: float, q: Array, v: Array) -> Array:
        raise ZeroDivisionError("not ours")

    cell = only(replace(FALL, more={"torque": torque}))
    assert cell.verdict == "wrong"
    assert cell.reason == "foreign error ZeroDivisionError: not ours"


def test_a_warning_beforehand_counts_only_where_the_result_is_wrong() -> None:
    """λ = −300 1/s, hλ = −3: warned, and in 1 s the speed runs away. In 0.05 s it is still right."""
    mech = rg.Mechanism.from_pinocchio(
        four_bar(1.0, 1.0, 1.0, 1.0).model,
        [rg.PointClosure("q2_tip", "q3_tip")],
        ["q1"],
        home=0.5 * np.array([1.0, -1.0, 1.0]),
        forces=[rg.JointDamper("q1", 300.0 * A)],
    )
    case = Case(
        "test", "damper", lambda: (mech, mech.home, np.zeros(3)), 1.0, (Setting(step=0.01),), 1e-2
    )  # fmt: skip
    cell = only(case)
    assert cell.verdict == "stopped"
    assert cell.reason.startswith("warned: StabilityWarning: step = 0.01 s lies outside")
    assert only(replace(case, duration=0.05)).verdict == "right"


def test_without_a_reference_the_error_is_found_by_a_finer_run() -> None:
    """RK4 with half the step: 16/15 of the distance is the true error to a few per cent."""
    true = only(FALL).error
    assert only(replace(FALL, reference=None)).error == pytest.approx(true, rel=0.05)
    adaptive = (Setting(stepper="DOP853", rtol=1e-6, atol=1e-8, step=0.01),)
    true = only(replace(FALL, settings=adaptive, allowed=1e-4)).error
    found = only(replace(FALL, settings=adaptive, allowed=1e-4, reference=None)).error
    assert found == pytest.approx(true, rel=0.1)


def test_long_runs_are_looked_at_here_and_there() -> None:
    mech, q0, v0 = start()
    run = rg.simulate(mech, q0, v0, duration=0.3, step=1e-4, record="a")
    seen = thinned(run)
    assert len(seen.t) <= MOST_CHECKED
    assert (seen.t[0], seen.t[-1]) == (run.t[0], run.t[-1])
    assert seen.a is not None
    at = np.searchsorted(run.t, seen.t)
    np.testing.assert_array_equal(seen.q, run.q[at])
    assert run.a is not None
    np.testing.assert_array_equal(seen.a, run.a[at])


def test_the_study_does_not_change_how_warnings_are_shown() -> None:
    before = list(warnings.filters)
    judge(FALL)
    assert list(warnings.filters) == before
    assert set(module.OURS) >= {rg.SingularityWarning, rg.StabilityWarning}
