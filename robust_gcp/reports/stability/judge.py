"""One cell of a map: simulate a case with a setting and judge what came out."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ... import CoarseStepWarning, SingularityWarning, StabilityWarning, Trajectory, simulate
from ...errors import RobustGcpError, StateError
from ...printing import along
from .case import Case, Cell, Setting, Start

MOST_CHECKED = 2000
"""Outputs of a long run at which error, energy and closure are looked at."""

RIGHT = 1e-3
"""rad or m: a run that errs by more may be as good as its step, but is not called right."""

OURS = (SingularityWarning, StabilityWarning, CoarseStepWarning)


def judge(case: Case) -> list[Cell]:
    """All cells of a row."""
    try:
        start = case.build()
    except RobustGcpError as error:
        reason = f"refused: {_spelled(error)}"
        return [Cell(case, setting, "stopped", reason=reason) for setting in case.settings]
    return [judge_setting(case, setting, start) for setting in case.settings]


def judge_setting(case: Case, setting: Setting, start: Start) -> Cell:
    """The cell of a setting, from the case's start.

    Anything but a typed error, from the run or from judging it, makes the cell wrong.
    """
    cell = Cell(case, setting, "wrong")
    told: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            run = _simulate(case, setting, start)
        _keep(cell, run)
    except RobustGcpError as error:
        cell.verdict, cell.reason = "stopped", "; ".join([*_warned(told), _spelled(error)])
        if error.trajectory is not None:
            _keep(cell, error.trajectory)
        return cell
    except Exception as error:  # any other type is a fault of the library, and is shown as one
        cell.reason = f"foreign error {_spelled(error)}"
        return cell
    faults = _faults(cell, run, start)
    warned = _warned(told)
    projected = sum(crossing.kind == "projected" for crossing in run.crossings)
    if projected:
        warned.append(f"told: {projected} crossings are marked as projected, which has no certificate")
    if not faults:
        cell.verdict = "coarse" if cell.error > RIGHT else "right"
    elif warned:
        cell.verdict, cell.reason = "stopped", "; ".join(warned)
    else:
        cell.reason = "; ".join(faults)
    return cell


def judge_all(cases: Sequence[Case]) -> list[Cell]:
    """All cells of the cases, row by row, with a bar."""
    return [cell for case in along(cases, "stability") for cell in judge(case)]


def _simulate(case: Case, setting: Setting, start: Start) -> Trajectory:
    return simulate(*start, case.duration, **{**setting.options, **case.more})


def _keep(cell: Cell, run: Trajectory) -> None:
    """The figures that a run tells about itself."""
    case = cell.case
    cell.rhs, cell.seconds, cell.crossings = run.stats.rhs, run.stats.wall_seconds, len(run.crossings)
    if len(run.t) == 0:
        return
    with np.errstate(all="ignore"):  # a run that blew up has figures beyond the largest float
        seen = thinned(run)
        cell.closure_error = _figure(lambda: float(seen.closure_error().max()) / run.mechanism.length)
        cell.energy_drift = _figure(lambda: _energy_drift(seen, case.energy_scale))
        if case.mode_kept is not None:
            cell.mode_kept = bool(case.mode_kept(seen.q))
        if case.reference is not None:
            cell.error = float(np.abs(seen.q - case.reference(seen.t)).max())


def _figure(figure: Callable[[], float]) -> float:
    """The figure; infinite where the state is too large for it."""
    try:
        return figure()
    except StateError:
        return float("inf")


def _energy_drift(run: Trajectory, scale: float | None) -> float:
    """Largest |energy error| over the scale, which is the largest kinetic energy unless given."""
    drift = float(np.abs(run.energy_error()).max())
    if scale is None:
        tree = run.mechanism.tree
        scale = max(tree.energies(q, v)[0] for q, v in zip(run.q, run.v, strict=True))
    return drift / scale if scale > 0.0 else (0.0 if drift == 0.0 else float("inf"))


def thinned(run: Trajectory) -> Trajectory:
    """The run at no more than `MOST_CHECKED` outputs, the first and the last among them."""
    n = len(run.t)
    if n <= MOST_CHECKED:
        return run
    keep = np.unique(np.append(np.arange(0, n, -(-n // (MOST_CHECKED - 1))), n - 1))

    values = {name: getattr(run, name) for name in ("t", "q", "v", "a", "energy", "multipliers", "work")}
    return replace(run, **{name: value[keep] for name, value in values.items() if value is not None})


def _faults(cell: Cell, run: Trajectory, start: Start) -> list[str]:
    """What is wrong with a finished run, in words; empty when it is right."""
    case, setting = cell.case, cell.setting
    faults = []
    if case.allowed is not None:
        if case.reference is None:
            try:
                cell.error = _converged(case, setting, run, start)
            except RobustGcpError as error:
                return [f"no error known, the finer run stopped: {_spelled(error)}"]
        allowed = case.allowed(setting, run.stats) if callable(case.allowed) else case.allowed
        faults += _over("error", cell.error, allowed)
    if case.energy_allowed is not None:
        faults += _over("energy drift", cell.energy_drift, case.energy_allowed)
    faults += _over("closure error", cell.closure_error, case.closure_allowed)
    if case.crossings is not None and cell.crossings != case.crossings:
        faults.append(f"{cell.crossings} crossings logged instead of {case.crossings}")
    if cell.mode_kept is False:
        faults.append("left its mode")
    return faults


def _converged(case: Case, setting: Setting, run: Trajectory, start: Start) -> float:
    """The error as the distance from a finer run: 16/15 of it for RK4 with half the step."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        finer = _simulate(case, setting.finer, start)
    _, i, j = np.intersect1d(run.t, finer.t, return_indices=True)
    apart = float(np.abs(run.q[i] - finer.q[j]).max())
    return apart * (16.0 / 15.0 if setting.stepper == "rk4" else 1.0)


def _over(what: str, value: float, allowed: float) -> list[str]:
    return [] if value <= allowed else [f"{what} {value:.1e} above {allowed:.1e}"]


def _warned(told: Sequence[warnings.WarningMessage]) -> list[str]:
    """Our own warnings in words, each kind once."""
    kinds = {w.category: str(w.message) for w in told if issubclass(w.category, OURS)}
    return [f"warned: {kind.__name__}: {message}" for kind, message in kinds.items()]


def _spelled(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
