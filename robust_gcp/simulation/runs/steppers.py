"""Steppers: f(t, x) in, states out. They know nothing of mechanisms."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...checks import shown
from ...dynamics.tableau import Tableau
from ...errors import BranchError, OptionError, SimulationError
from ...mechanism.differences import differences
from ...mechanism.tree.tree import Array

RightHandSide = Callable[[float, Array], Array]
Jacobian = Callable[[float, Array], Array]
FixedStep = Callable[[RightHandSide, float, Array, float, Array], Array]
"""f, t, x, h and f(t, x) in, the state at t + h out; see `rk4_step`."""

SCIPY_STEPPERS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
IMPLICIT = ("Radau", "BDF", "LSODA")
"""Those that use ∂f/∂x."""

HEADWAY = 1e-3
"""Fraction of the span that a solver must advance by within its allowed effort."""

PATIENCE = 200
"""Refused trials without headway after which the refusal is final: halving reaches rounding in 50."""


class NoProgressError(SimulationError):
    """An adaptive solver could not go on; the last refusal of the right-hand side, if any, is its cause."""


class RefusedTrialError(BranchError):
    """A trial that lies farther than can be followed; `solver_steps` lets none of them out.

    Attributes
    ----------
    look : callable () -> ndarray (n,)
        ẋ there after all, or the error that says why there is none. Set by whoever raises it, as is:
    why : callable () -> SimulationError
        The error of a look, or else what stops the motion where it came to.
    """

    look: Callable[[], Array]
    why: Callable[[], SimulationError]


class Between:
    """States within a solver's last step; its interpolant costs evaluations, so it is made when asked for."""

    def __init__(self, solver: Any) -> None:
        self._solver = solver
        self._dense: Any = None

    def dense(self) -> Callable[[float], Array]:
        """The interpolant itself."""
        self._dense = self._dense or self._solver.dense_output()
        dense: Callable[[float], Array] = self._dense
        return dense

    def __call__(self, t: float) -> Array:
        """The state at a time within the step."""
        return np.asarray(self.dense()(t))


@dataclass(frozen=True)
class SolverStep:
    """An accepted step of an adaptive solver.

    Attributes
    ----------
    t0, t1 : float
        s.
    x : ndarray (n,)
        The state at t1.
    outputs : list of ndarray (n,)
        States at the asked times in (t0, t1].
    between : callable (t) -> ndarray (n,)
        The state at a time within the step, by the solver's interpolant; to be asked before the next step.
    """

    t0: float
    t1: float
    x: Array
    outputs: list[Array]
    between: Between


def rk4_step(f: RightHandSide, t: float, x: Array, h: float, k1: Array) -> Array:
    """One step of the classical Runge–Kutta method of order 4 (Kutta, 1901).

    Parameters
    ----------
    f : callable (t, x) -> ẋ
    t, h : float
        Time and step, s.
    x, k1 : ndarray (n,)
        State, and f(t, x), which the caller has evaluated already.

    Returns
    -------
    ndarray (n,)
        The state at t + h.
    """
    half = 0.5 * h
    k2 = f(t + half, x + half * k1)
    k3 = f(t + half, x + half * k2)
    k4 = f(t + h, x + h * k3)
    return x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


def adaptive(*args: Any, **options: Any) -> Iterator[Array]:
    """The states of `solver_steps` at the given times alone."""
    for step in solver_steps(*args, **options):
        yield from step.outputs


def solver_steps(
    method: str,
    f: RightHandSide,
    x: Array,
    times: Array,
    rtol: float,
    atol: float | Array,
    effort: int = 50_000,
    jacobian: Jacobian | None = None,
    rounding: Callable[[], float] | None = None,
) -> Iterator[SolverStep]:
    """The steps of one of scipy's solvers, each with the states at those of the given times that it passes.

    Where f raises a `SimulationError` at a trial state, the trial is rejected and the step shrinks;
    if no step is small enough, that error is raised, or what a `RefusedTrialError` finds at a closer look.

    Parameters
    ----------
    method : {"RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"}
    f : callable (t, x) -> ẋ
    x : ndarray (n,)
        State at times[0].
    times : ndarray (N + 1,)
        Ascending, s.
    effort : int
        Evaluations of f within which the time must advance by 1/1000 of the whole span.
    jacobian : callable (t, x) -> (n, n), optional
        ∂f/∂x for Radau, BDF and LSODA; by forward differences of f when left out.
    rounding : callable, optional
        Asked before each step: the tolerance below which none is asked for, as f has an error of its own.

    Yields
    ------
    SolverStep
        Until the last time; together their outputs are the states at times[1], times[2], …
    """
    from scipy import integrate

    refused: list[SimulationError] = []  # since the last headway
    nothing = np.zeros_like(x)
    started = False

    def guarded(t: float, state: Array) -> Array:
        nonlocal started
        if state.dot(nothing) != 0.0:  # 0 · ∞ is NaN: of a trial that a refusal has spoilt
            return np.full_like(state, np.nan)
        try:
            value = f(t, state.copy())  # LSODA overwrites its state in place
        except SimulationError as error:
            if started and method != "LSODA":  # which takes a step to NaN for one that serves
                refused.append(error)
                return np.full_like(state, np.nan)
            if not isinstance(error, RefusedTrialError):
                raise
            value = error.look()
        started = True
        return value

    more = {"jac": _KeptJacobian(f, jacobian)} if method in IMPLICIT else {}
    alone = _Alone(method)
    with alone:
        solver: Any = getattr(integrate, method)(
            guarded, float(times[0]), x, float(times[-1]), rtol=rtol, atol=atol, **more
        )
    i, mark, begun = 1, (float(times[0]), 0), None
    while i < len(times):
        if rounding is not None:
            noise = rounding()
            # as far apart as the tolerances of steps with error control are themselves
            solver.rtol, solver.atol = max(rtol, noise), np.maximum(atol, 0.01 * noise)
        with alone:
            message = solver.step() if solver.status == "running" else None
        if solver.t - mark[0] >= HEADWAY * (times[-1] - times[0]) or solver.status == "finished":
            mark = (solver.t, solver.nfev)
            refused.clear()  # trials that were refused on the way say nothing of where it is stuck later
        elif solver.status == "failed" or len(refused) > PATIENCE or solver.nfev - mark[1] > effort:
            if refused:
                last = refused[-1]
                raise last.why() if isinstance(last, RefusedTrialError) else last
            raise NoProgressError(
                f"{method} made no headway at t = {solver.t:.6g} s in {solver.nfev - mark[1]} evaluations"
                f"{f' ({message})' if message else ''}: the problem is too stiff for this method or tolerance"
            )
        if solver.t_old is None or solver.t_old == begun:
            continue
        begun = solver.t_old
        between, outputs = Between(solver), []
        while i < len(times) and (times[i] <= solver.t or solver.status == "finished"):
            # dense output costs DOP853 three right-hand sides, and has an order less than the step
            outputs.append(solver.y.copy() if times[i] == solver.t else between(float(times[i])))
            i += 1
        yield SolverStep(float(begun), float(solver.t), solver.y.copy(), outputs, between)


class _Running(threading.local):
    """Whether LSODA takes a step in this thread."""

    lsoda = False


_running = _Running()


class _Alone:
    """While a step is taken: LSODA keeps one state in each thread, which a run within it would overwrite.

    Raises
    ------
    OptionError
        Where LSODA is to begin within a right-hand side that LSODA asks for.
    """

    def __init__(self, method: str) -> None:
        self._lsoda = method == "LSODA"

    def __enter__(self) -> None:
        if self._lsoda and _running.lsoda:
            raise OptionError(
                'stepper="LSODA" within a torque function of a run by LSODA: it keeps one state for both; '
                'use another stepper for one of them, as "Radau" or "BDF"'
            )
        _running.lsoda = _running.lsoda or self._lsoda  # other solvers may run within one by LSODA

    def __exit__(self, *failure: object) -> None:
        if self._lsoda:
            _running.lsoda = False


class _KeptJacobian:
    """∂f/∂x; the last one where f refuses the state or its neighbour.

    A solver's own differences would put NaN into its linear algebra there.
    """

    def __init__(self, f: RightHandSide, jacobian: Jacobian | None) -> None:
        def by_differences(t: float, x: Array) -> Array:
            return differences(lambda state: f(t, state), x, np.maximum(1.0, np.abs(x)))

        self._jacobian = by_differences if jacobian is None else jacobian
        self._last: Array | None = None

    def __call__(self, t: float, x: Array) -> Array:
        try:
            found = self._jacobian(t, x.copy())
        except SimulationError:
            if self._last is None:
                raise
            return self._last
        self._last = found
        return found


def check_stepper(name: Any) -> str | Tableau:
    """The stepper's name or tableau, or an OptionError that lists the names there are."""
    if isinstance(name, Tableau):
        return name
    if not isinstance(name, str) or (name != "rk4" and name not in SCIPY_STEPPERS):
        raise OptionError(
            f"stepper {shown(name)} is unknown; use 'rk4', one of scipy's {', '.join(SCIPY_STEPPERS)}, or a "
            "Tableau"
        )
    return name
