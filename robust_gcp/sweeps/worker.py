"""One run of a sweep, wherever it is computed: here, in a thread, or in a worker process."""

from __future__ import annotations

import inspect
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from ..dynamics.tableau import Tableau
from ..errors import OptionError, RobustGcpError
from ..io.loader import load
from ..kernel.library import backends
from ..kernel.simulation.steps import chosen_library
from ..mechanism.mechanism import Mechanism
from ..simulation.simulate import simulate
from ..simulation.trajectories.trajectory import Trajectory
from .record import Failure, failure_of, summary, words_of

Build = str | Path | Mechanism | Callable[..., Mechanism]
Keep = Literal["summary", "trajectory"] | Callable[[Trajectory], Any]

OPTIONS = frozenset(inspect.signature(simulate).parameters) - {"mechanism", "progress"}
"""Parameters of a run that go to `simulate`; all others go to `build`."""


@dataclass(frozen=True)
class Outcome:
    """What a run came to; see `RunRecord`."""

    summary: dict[str, Any] | None = None
    kept: Any = None
    failure: Failure | None = None


class CancelledRunError(Exception):
    """The sweep was given up while this run was under way."""


def work(
    build: Build, keep: Keep, parameters: Mapping[str, Any], cancelled: Callable[[], bool] | None = None
) -> Outcome:
    """Build, simulate, summarise; every error becomes a `Failure`, an attempt to end the program too.

    Parameters
    ----------
    cancelled : callable, optional
        Asked after each output; True ends the run.

    Raises
    ------
    BaseException
        In the main thread of the main process, what is no `Exception`, `SystemExit` or
        `GeneratorExit`: Ctrl-C, and what the program around the sweep interrupts itself with.
    """
    figures = None

    def watch(fraction: float) -> None:
        if cancelled is not None and cancelled():
            raise CancelledRunError("the sweep was given up")

    try:
        mechanism = _mechanism(build, {k: v for k, v in parameters.items() if k not in OPTIONS})
        options = {k: v for k, v in parameters.items() if k in OPTIONS}
        trajectory = simulate(mechanism, **options, progress=watch)
        figures = summary(trajectory)
        return Outcome(figures, _kept(keep, trajectory))
    except BaseException as error:
        if _interrupts(error):
            raise
        return _failed(error, keep, figures)


def _interrupts(error: BaseException) -> bool:
    """Whether this is the caller's affair: no signal of theirs arrives in other threads or workers."""
    of_the_run = isinstance(error, Exception | SystemExit | GeneratorExit)
    at_home = threading.current_thread() is threading.main_thread() and not multiprocessing.parent_process()
    return at_home and not of_the_run


def _mechanism(build: Build, parameters: dict[str, Any]) -> Mechanism:
    """The mechanism of a run; several threads may use one, which has a workspace for each."""
    if isinstance(build, Mechanism):
        return build
    if isinstance(build, str | Path):
        return load(build)
    made: object = build(**parameters)
    if not isinstance(made, Mechanism):
        raise OptionError(f"build must return a Mechanism, not {type(made).__name__}")
    return made


def _kept(keep: Keep, trajectory: Trajectory) -> Any:
    if keep == "summary":
        return None
    return trajectory if keep == "trajectory" else keep(trajectory)


def _failed(error: BaseException, keep: Keep, figures: dict[str, Any] | None) -> Outcome:
    failure = failure_of(error)
    partial = error.trajectory if isinstance(error, RobustGcpError) else None
    if partial is None:
        return Outcome(figures, failure=failure)
    return Outcome(summary(partial), partial if keep == "trajectory" else None, failure)


# --------------------------------------------------------------------------- worker processes

_given_up: Any = None  # the event of the sweep that this worker process belongs to


def begin(given_up: Any) -> None:
    """Prepare a worker process: Ctrl-C is the parent's affair, and without a parent it ends."""
    global _given_up
    _given_up = given_up
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def ready(task: bytes) -> str:
    """Unpickle build and keep; returns what is wrong with them here, in words."""
    try:
        pickle.loads(task)
    except BaseException as error:  # a module may end the program when it is imported
        failure = failure_of(error)
        return f"{failure.kind}: {failure.message}"
    return ""


def work_pickled(task: bytes) -> Outcome:
    """`work` on pickled (build, keep, parameters); what is kept comes pickled, or is a failure."""
    outcome = Outcome()
    try:
        build, keep, parameters = pickle.loads(task)
        outcome = work(build, keep, parameters, None if _given_up is None else _given_up.is_set)
        return replace(outcome, kept=pickle.dumps(outcome.kept))
    except BaseException as error:  # pickle raises what it likes
        why = f"what was given or kept cannot pass between processes: {words_of(error)}"
        failure = replace(failure_of(error), message=why, ours=False)
        return Outcome(outcome.summary, pickle.dumps(None), outcome.failure or failure)


def unpickled(outcome: Outcome) -> Outcome:
    """The outcome of `work_pickled`, with what was kept."""
    try:
        return replace(outcome, kept=pickle.loads(outcome.kept))
    except (Exception, SystemExit) as error:
        why = f"what was kept cannot be read back in this process: {words_of(error)}"
        failure = replace(failure_of(error), message=why, ours=False)
        return Outcome(outcome.summary, failure=outcome.failure or failure)


CHOICES = ("backend", "method", "newton_start")
"""Parameters of `simulate` that decide who takes the steps, in the order of `chosen_library`."""

_DEFAULTS = {name: inspect.signature(simulate).parameters[name].default for name in CHOICES}


def runs_natively(parameters: Mapping[str, Any]) -> bool:
    """Whether the kernel is there and is asked to take this run's steps, without calls back to Python."""
    choices = [parameters.get(name, _DEFAULTS[name]) for name in CHOICES]
    if not all(isinstance(choice, str) for choice in choices) or _calls_back(parameters):
        return False
    stepper = parameters.get("stepper", "rk4")
    if stepper != "rk4" and not isinstance(stepper, Tableau):  # SciPy's solvers are Python
        return False
    if not backends()["native"].available:  # asked first: to look for a broken kernel would warn
        return False
    try:
        return chosen_library(*choices) is not None
    except OptionError:  # the run will say so itself
        return False


def _calls_back(parameters: Mapping[str, Any]) -> bool:
    """Whether loads are Python functions, as wrenches are: they turn with the motion; or motions are."""
    torque = parameters.get("torque")
    loads = torque.values() if isinstance(torque, Mapping) else (torque,)
    return any(map(callable, loads)) or bool(parameters.get("wrenches") or parameters.get("drive"))
